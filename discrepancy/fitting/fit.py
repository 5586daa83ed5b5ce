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

from discrepancy.fitting.model import Setting, View
from discrepancy.fitting.problem import Problem
from discrepancy.fitting.readings import Weights

MAX_STEPS = 20
# A step that gains three quarters of what it promised is followed by a longer one. Optimistix asks for 0.99, and then
# creeps along curved valleys: one of a robot took 63 steps and was not at its end, in place of 20.
SOLVER = eqx.tree_at(
    lambda solver: solver.search,
    optx.Dogleg(rtol=1e-4, atol=1e-4),
    optx.ClassicalTrustRegion(high_cutoff=0.75),
)
# In a prior's standard deviations. Of five cells, motors and robots derivatives are within 2e-5 of exact tangents, and
# a base model's scores within 2e-4; a longer step bends, a shorter one meets the rounding of kinks.
DIFFERENCE_STEP = 1e-4
# A fit is at its minimum where a Newton step would gain less of chi-square than this: a seventh of an sd of whatever.
FLAT = 0.02
# Further steps are not worth their time after so many in a row that gain less than this: what is left is a kink of the
# model, as where a table bends.
IDLE_STEPS = 3
IDLE_GAIN = 0.1
# Nor after so many in a row that were refused, each a quarter as long as the one before: at the steep end of a
# discharge the first few are too long.
REFUSED_STEPS = 6
# Of a model that is only compared with others, the gain that is not worth another step.
COMPARED = 0.3
# Of a model that explains all but the noise: the same numbers to a thousandth of an sd whichever way one came to it.
SETTLED = 1e-6
# A fit that stopped where a Newton step promises less than this has come to its end all the same.
NEAR = 2.0
# A model that would need this many times as many steps, each as good as its last few, never catches up with a rival.
PACE = 10.0
# Unknowns that the solver sees come in so many, those that are not there at rest: its step is compiled once for most.
_SIZE = 32


@dataclasses.dataclass(frozen=True)
class Fit:
    """What came of one fit.

    Attributes:
        x: (unknowns,) coordinates where it ended.
        free: places of the k free unknowns.
        prior_sd: (k,) of their coordinates.
        rows: (n,) whitened residuals, measured less predicted.
        jacobian: (n, k) their derivatives by the free unknowns.
        promise: of chi-square, what another Newton step would gain; zero at a minimum.
        steps: iterations used.
        idle: it ended where steps gained nothing, at the rounding of a kink in the model.
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
        """Return how many sd of its prior each free unknown is away from it, (k,)."""
        return self.x[list(self.free)] / self.prior_sd

    @property
    def objective(self) -> float:
        """Return what was minimised: chi-square of readings and priors."""
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
        """Return the log of the model's probability of the readings (Laplace), less a constant common to all models.

        -(chi2 + |x / sd|^2) / 2 - log det(S J'J S + I) / 2, with S the sd of the priors.
        """
        scaled = self.prior_sd[:, None] * self.information * self.prior_sd
        return -0.5 * self.objective - 0.5 * float(np.linalg.slogdet(scaled)[1])

    def sd(self) -> np.ndarray:
        """Return the standard deviations of the free unknowns' coordinates, (k,)."""
        return np.sqrt(np.diag(self.covariance))


class Given(eqx.Module):
    """The objective's rows at one place, and their Jacobian there."""

    rows: Array
    jacobian: Array


@eqx.filter_custom_jvp
def _given(y: Array, given: Given) -> tuple[Array, None]:
    """Return rows computed beforehand, with their derivatives, in the form in which optimistix asks for them."""
    return given.rows, None


@_given.def_jvp
def _given_jvp(primals, tangents):
    _, given = primals
    dy, _ = tangents
    return (given.rows, None), (given.jacobian @ dy, None)


def errors_at(view: View, problem: Problem, setting: Setting, places: np.ndarray) -> np.ndarray:
    """Return measured less predicted at some places (places, unknowns), shape (readings, places).

    A model driven out of its range looks bad there; it does not break the solver.
    """
    predicted = view.at(problem, [setting.lane(x) for x in places])
    worst = 1e3 * view.readings.sd
    errors = view.readings.value - predicted
    return np.where(np.isfinite(errors), np.clip(errors, -1e6, 1e6), worst).T


def steps_of(view: View, setting: Setting) -> list[list[int]]:
    """Return which unknowns are moved together: those of different runs move different readings."""
    layout = view.space.layout
    alone = [[place] for place in setting.free if layout.runs[place] < 0]
    of_runs: dict[int, list[int]] = {}
    for place in setting.free:
        if layout.runs[place] in view.runs:
            of_runs.setdefault(layout.runs[place], []).append(place)
    most = max(map(len, of_runs.values()), default=0)
    return alone + [[places[number] for places in of_runs.values() if number < len(places)] for number in range(most)]


def errors_and_jacobian(view: View, problem: Problem, setting: Setting, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (readings,) at a place, and their derivatives (readings, k) by the model's own unknowns.

    By differences between lanes of the forward program, not by tangents: forward mode compiles four times as long. One
    side is enough: central differences take twice as many lanes. Unknowns of different runs share a lane.
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
    """Return the whitened residuals (readings,) at a place, and their derivatives (readings, k)."""
    errors, jacobian = errors_and_jacobian(view, problem, setting, x)
    white = weights.whiten(np.column_stack([errors, jacobian]))
    return white[:, 0], white[:, 1:]


@functools.lru_cache(maxsize=64)
def _blank(unknowns: int):
    """Return the solver's state before any step; one for all fits of a size, so that its steps are compiled once."""
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
    """The objective about one place: residuals and their Jacobian by y, the free unknowns in sd of their priors."""

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
        """A square root of the information: its eigenvectors by the roots of their eigenvalues, none below a prior's.

        Unlike Cholesky's it is there where a model out of its range gives derivatives without bounds.
        """
        values, vectors = np.linalg.eigh(self.information)
        return np.sqrt(np.maximum(values, 1.0))[:, None] * vectors.T

    @functools.cached_property
    def along(self) -> np.ndarray:
        """The slope along those axes."""
        return (self.axes @ self.slope) / np.sum(self.axes**2, axis=1)

    @property
    def unit(self) -> float:
        """What a reading adds to chi-square: 1 at the noise; a model far from it knows its numbers that much worse."""
        return max(1.0, float(self.rows @ self.rows) / max(1, self.rows.size))

    @property
    def promise(self) -> float:
        """What a Newton step would gain."""
        return float(self.along @ self.along)

    def few(self, size: int) -> Given:
        """Return the objective in few rows, the same sums of squares and products, one for each unknown and one more.

        Unknowns beyond its own, up to `size`, are at their minimum.
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

    The trust-region steps are optimistix's, one at a time: the model's program stays one forward program, which is all
    that has to be compiled anew for another model. And a loop around a kernel is not safe: see `jaxmodel.kernel`.

    Args:
        view: the readings.
        setting: the model.
        weights: what makes its errors white.
        start: (unknowns,) coordinates to begin at; those not free stay there.
        rival: objective of a model that this one must come near; the fit ends where at its pace it never will.
        steps: at most so many.
        free: places of the unknowns to calibrate; the model's own where None.
        flat: of chi-square, the gain that is not worth another step.
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
        if _at_its_end(best, latest, history, flat) or _never_near(history, rival) or bool(state.terminate):
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


def _at_its_end(best: _Linearised, last: _Linearised, history: Sequence[float], flat: float) -> bool:
    """Return True where further steps would gain nothing."""
    return (best is last and best.promise < flat * best.unit) or _idle(best, history)


def _idle(best: _Linearised, history: Sequence[float]) -> bool:
    return _gained_lately(history) < IDLE_GAIN * best.unit


def _never_near(history: Sequence[float], rival: float) -> bool:
    """Return True where a fit at its pace does not catch up with the rival."""
    return _gained_lately(history) < (history[-1] - rival) / PACE - 1.0


def _gained_lately(history: Sequence[float]) -> float:
    return history[-1 - IDLE_STEPS] - history[-1] if len(history) > IDLE_STEPS else np.inf


def objectives(view: View, setting: Setting, weights: Weights, places: np.ndarray) -> np.ndarray:
    """Return what `fit` minimises at some places, shape (places, unknowns)."""
    white = weights.whiten(errors_at(view, view.space.problem(setting), setting, places))
    free = list(setting.free)
    return np.sum(white**2, axis=0) + np.sum((places[:, free] / setting.prior_sd[free]) ** 2, axis=1)
