"""Calibration: trust-region least squares (optimistix) on the whitened residuals and the priors."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array

from jaxmodel.diagnosis.fitting.model import Setting, View
from jaxmodel.diagnosis.fitting.problem import Problem
from jaxmodel.diagnosis.fitting.readings import Weights

MAX_STEPS = 20
# The trust region grows after a step that gains three quarters of its prediction. With the 0.99 of optimistix, one fit
# of a robot in a curved valley had not converged after 63 steps instead of 20.
SOLVER = eqx.tree_at(
    lambda solver: solver.search,
    optx.Dogleg(rtol=1e-4, atol=1e-4),
    optx.ClassicalTrustRegion(high_cutoff=0.75),
)
# Step of finite differences, in prior sd. For five cells, motors and robots, derivatives are within 2e-5 of exact
# tangents and scores within 2e-4; a longer step adds curvature, a shorter one rounding errors at kinks.
DIFFERENCE_STEP = 1e-4
# A fit has converged if a Newton step would gain less of chi-square than this: a seventh of an sd.
FLAT = 0.02
# A fit ends after so many steps in a row that gain less than this: it is at a kink of the model, such as a point of a
# table.
IDLE_STEPS = 3
IDLE_GAIN = 0.1
# It also ends after so many rejected steps in a row, each a quarter as long as the previous one: at the steep end of a
# discharge the first few are too long.
REFUSED_STEPS = 6
# The same limit for a model that is only compared with others,
COMPARED = 0.3
# and for a model that explains all but noise: its parameters are reproducible to a thousandth of an sd.
SETTLED = 1e-6
# A fit that stopped where a Newton step would gain less than this counts as converged.
NEAR = 2.0
# A fit ends if, at its recent pace, it would need this many times as many steps to reach a rival.
PACE = 10.0
# The number of unknowns is padded to a multiple of this, so that the solver step is compiled once for most fits.
_SIZE = 32


@dataclasses.dataclass(frozen=True)
class Fit:
    """The result of one fit.

    Attributes:
        x: (unknowns,) fitted coordinates.
        free: places of the k free unknowns.
        prior_sd: (k,) of their coordinates.
        rows: (n,) whitened residuals, measured minus predicted.
        jacobian: (n, k) their derivatives with respect to the free unknowns.
        promise: expected gain of chi-square by another Newton step; zero at a minimum.
        steps: iterations used.
        idle: it ended because steps gained nothing, at a kink of the model.
    """

    x: np.ndarray
    free: tuple[int, ...]
    prior_sd: np.ndarray
    rows: np.ndarray
    jacobian: np.ndarray
    promise: float
    steps: int
    idle: bool = False

    @property
    def chi2(self) -> float:
        """Return the sum of squares of the whitened residuals."""
        return float(self.rows @ self.rows)

    @property
    def pulls(self) -> np.ndarray:
        """Return the distance of each free unknown from its prior mean, in prior sd, (k,)."""
        return self.x[list(self.free)] / self.prior_sd

    @property
    def objective(self) -> float:
        """Return the objective: chi-square of readings and priors."""
        return self.chi2 + float(self.pulls @ self.pulls)

    @property
    def converged(self) -> bool:
        """Return True at a minimum."""
        return self.promise < NEAR

    @functools.cached_property
    def information(self) -> np.ndarray:
        """Return J'J of readings and priors, (k, k)."""
        return self.jacobian.T @ self.jacobian + np.diag(self.prior_sd**-2.0)

    @functools.cached_property
    def covariance(self) -> np.ndarray:
        """Return the covariance of the free unknowns' coordinates, (k, k)."""
        return np.linalg.inv(self.information)

    @functools.cached_property
    def log_evidence(self) -> float:
        """Return the log evidence (Laplace approximation), minus a constant common to all models.

        -(chi2 + |x / sd|^2) / 2 - log det(S J'J S + I) / 2, with S the sd of the priors.
        """
        scaled = self.prior_sd[:, None] * self.information * self.prior_sd
        return -0.5 * self.objective - 0.5 * float(np.linalg.slogdet(scaled)[1])

    def sd(self) -> np.ndarray:
        """Return the standard deviations of the free unknowns' coordinates, (k,)."""
        return np.sqrt(np.diag(self.covariance))


class Given(eqx.Module):
    """Residuals and Jacobian at one point."""

    rows: Array
    jacobian: Array


@eqx.filter_custom_jvp
def _given(y: Array, given: Given) -> tuple[Array, None]:
    """Return precomputed residuals with their derivatives, in the form that optimistix needs."""
    return given.rows, None


@_given.def_jvp
def _given_jvp(primals, tangents):
    _, given = primals
    dy, _ = tangents
    return (given.rows, None), (given.jacobian @ dy, None)


def errors_at(view: View, problem: Problem, setting: Setting, places: np.ndarray) -> np.ndarray:
    """Return measured minus predicted at some points (places, unknowns), shape (readings, places).

    Predictions that are not finite count as a large error, so that the solver can continue.
    """
    predicted = view.at(problem, [setting.lane(x) for x in places])
    worst = 1e3 * view.readings.sd
    errors = view.readings.value - predicted
    return np.where(np.isfinite(errors), np.clip(errors, -1e6, 1e6), worst).T


def steps_of(view: View, setting: Setting) -> list[list[int]]:
    """Return groups of unknowns that share a finite difference: those of different runs affect different readings."""
    layout = view.space.layout
    alone = [[place] for place in setting.free if layout.runs[place] < 0]
    of_runs: dict[int, list[int]] = {}
    for place in setting.free:
        if layout.runs[place] in view.runs:
            of_runs.setdefault(layout.runs[place], []).append(place)
    most = max(map(len, of_runs.values()), default=0)
    return alone + [[places[number] for places in of_runs.values() if number < len(places)] for number in range(most)]


def errors_and_jacobian(view: View, problem: Problem, setting: Setting, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (readings,) at a point, and their derivatives (readings, k) by the model's free unknowns.

    One-sided finite differences between lanes: forward mode takes four times as long to compile, and central
    differences need twice as many lanes. Unknowns of different runs share a lane.
    """
    together = steps_of(view, setting)
    places = np.repeat(x[None], len(together) + 1, axis=0)
    for number, moved in enumerate(together, start=1):
        places[number, moved] += DIFFERENCE_STEP
    errors = errors_at(view, problem, setting, places)
    jacobian = np.zeros((errors.shape[0], len(setting.free)))
    column = {place: number for number, place in enumerate(setting.free)}
    for number, moved in enumerate(together, start=1):
        slope = (errors[:, number] - errors[:, 0]) / DIFFERENCE_STEP
        for place in moved:
            run = view.space.layout.runs[place]
            jacobian[:, column[place]] = slope if run < 0 else np.where(view.readings.run == run, slope, 0.0)
    return errors[:, 0], jacobian


def whitened_errors_and_jacobian(
    view: View, problem: Problem, setting: Setting, weights: Weights, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the whitened residuals (readings,) at a point, and their derivatives (readings, k)."""
    errors, jacobian = errors_and_jacobian(view, problem, setting, x)
    white = weights.whiten(np.column_stack([errors, jacobian]))
    return white[:, 0], white[:, 1:]


@functools.lru_cache(maxsize=64)
def _blank(unknowns: int):
    """Return the initial state of the solver for a number of unknowns; its step is then compiled once."""
    rows = unknowns + 1
    struct = jax.ShapeDtypeStruct((rows,), float)
    return SOLVER.init(
        _given, jnp.zeros(unknowns), Given(jnp.zeros(rows), jnp.zeros((rows, unknowns))), {}, struct, None, frozenset()
    )


@eqx.filter_jit
def _step(y: Array, given: Given, state):
    y, state, _ = SOLVER.step(_given, y, given, {}, state, frozenset())
    return y, state


@dataclasses.dataclass(frozen=True)
class _Linearised:
    """The linearised objective at one point: residuals and Jacobian by y, the free unknowns in prior sd."""

    y: np.ndarray
    rows: np.ndarray
    jacobian: np.ndarray

    @property
    def objective(self) -> float:
        return float(self.rows @ self.rows + self.y @ self.y)

    @functools.cached_property
    def information(self) -> np.ndarray:
        return self.jacobian.T @ self.jacobian + np.eye(self.y.size)

    @functools.cached_property
    def slope(self) -> np.ndarray:
        """Half the gradient of the objective."""
        return self.jacobian.T @ self.rows + self.y

    @functools.cached_property
    def axes(self) -> np.ndarray:
        """A square root of the information from its eigenvalues, none below that of a prior.

        Unlike a Cholesky factor it exists for unbounded derivatives of an invalid model too.
        """
        values, vectors = np.linalg.eigh(self.information)
        return np.sqrt(np.maximum(values, 1.0))[:, None] * vectors.T

    @functools.cached_property
    def along(self) -> np.ndarray:
        """The slope along these axes."""
        return (self.axes @ self.slope) / np.sum(self.axes**2, axis=1)

    @property
    def unit(self) -> float:
        """Chi-square per reading, at least 1: the scale of changes that matter for a poor model."""
        return max(1.0, float(self.rows @ self.rows) / max(1, self.rows.size))

    @property
    def promise(self) -> float:
        """Expected gain of a Newton step."""
        return float(self.along @ self.along)

    def few(self, size: int) -> Given:
        """Return an equivalent objective with one row per unknown and one more.

        It is padded with unknowns at their minimum up to `size`.
        """
        count = self.y.size
        rows, jacobian = np.zeros(size + 1), np.eye(size + 1, size)
        rows[:count], rows[-1] = self.along, np.sqrt(max(self.objective - self.promise, 0.0))
        jacobian[:count, :count] = self.axes
        return Given(jax.device_put(rows), jax.device_put(jacobian))


def fit(
    view: View,
    setting: Setting,
    weights: Weights,
    start: np.ndarray,
    *,
    rival: float = np.inf,
    steps: int = MAX_STEPS,
    free: Sequence[int] | None = None,
    flat: float = FLAT,
) -> Fit:
    """Calibrate from one start.

    Optimistix computes one trust-region step at a time, so that only the forward program is compiled for another model.
    A loop around a kernel would also be unsafe: see `jaxmodel.lanes.xla_kernel`.

    Args:
        view: the readings.
        setting: the model.
        weights: that whiten its errors.
        start: (unknowns,) initial coordinates; those that are not free stay.
        rival: objective of a competing model; the fit ends if at its pace it will not come close.
        steps: largest number of steps.
        free: indices of the unknowns to calibrate; those of the model if None.
        flat: gain of chi-square below which the fit has converged.
    """
    if free is not None:
        setting = dataclasses.replace(setting, free=tuple(free))
    unknowns, prior_sd = list(setting.free), setting.prior_sd[list(setting.free)]
    problem = view.space.problem(setting)

    def linearised(y: np.ndarray) -> _Linearised:
        x = start.copy()
        x[unknowns] = y * prior_sd
        rows, jacobian = whitened_errors_and_jacobian(view, problem, setting, weights, x)
        return _Linearised(y, rows, jacobian * prior_sd)

    size = -(-len(unknowns) // _SIZE) * _SIZE
    first = start[unknowns] / prior_sd
    y = jax.device_put(np.append(first, np.zeros(size - first.size)))
    state = eqx.tree_at(lambda blank: blank.y_eval, _blank(size), y)
    best, history, used, refused = None, [], 0, 0
    while used < steps:
        used += 1
        latest = linearised(np.asarray(state.y_eval)[: first.size])
        accepted = int(state.num_accepted_steps)
        y, state = _step(y, latest.few(size), state)
        refused += 1
        if best is None or int(state.num_accepted_steps) > accepted:
            best, refused = latest, 0
            history.append(best.objective)
        if _has_converged(best, latest, history, flat) or _is_too_slow(history, rival) or bool(state.terminate):
            break
        if refused > REFUSED_STEPS:
            break
        if bool(state.result != optx.RESULTS.successful):
            break
    assert best is not None
    x = start.copy()
    x[unknowns] = best.y * prior_sd
    return Fit(
        x=x,
        free=setting.free,
        prior_sd=prior_sd,
        rows=best.rows,
        jacobian=best.jacobian / prior_sd,
        promise=best.promise / best.unit,
        steps=used,
        idle=refused > REFUSED_STEPS or _idle(best, history),
    )


def _has_converged(best: _Linearised, last: _Linearised, history: Sequence[float], flat: float) -> bool:
    """Return True if further steps would gain nothing."""
    return (best is last and best.promise < flat * best.unit) or _idle(best, history)


def _idle(best: _Linearised, history: Sequence[float]) -> bool:
    return _recent_gain(history) < IDLE_GAIN * best.unit


def _is_too_slow(history: Sequence[float], rival: float) -> bool:
    """Return True if a fit at its pace will not reach the rival."""
    return _recent_gain(history) < (history[-1] - rival) / PACE - 1.0


def _recent_gain(history: Sequence[float]) -> float:
    return history[-1 - IDLE_STEPS] - history[-1] if len(history) > IDLE_STEPS else np.inf


def objectives(view: View, setting: Setting, weights: Weights, places: np.ndarray) -> np.ndarray:
    """Return the objective of `fit` at some points, shape (places, unknowns)."""
    white = weights.whiten(errors_at(view, view.space.problem(setting), setting, places))
    free = list(setting.free)
    return np.sum(white**2, axis=0) + np.sum((places[:, free] / setting.prior_sd[free]) ** 2, axis=1)
