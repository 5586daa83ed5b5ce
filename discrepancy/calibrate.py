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

from discrepancy.lanes import at, residuals
from discrepancy.problem import Problem

MAX_STEPS = 30
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
# At a minimum the score of every unknown is zero; above this the score test of what is missing would be invalid.
GREATEST_BASE_SCORE = 0.1
# A further step that would gain less of chi-square (0.03 sd of whatever) is not worth its time.
FLAT = 1e-3
# Nor are further steps after so many in a row without a gain: what is left is the rounding of a kink in the model.
IDLE_STEPS = 6
IDLE_GAIN = 0.03
# A model that would need this many times as many steps, each as good as its last few, never catches up with a rival.
PACE = 10.0
# Unknowns that the solver sees come in so many, those that are not there at rest: its step is compiled once for most.
_SIZE = 16


@dataclasses.dataclass(frozen=True)
class Fit:
    """What came of one fit.

    Attributes:
        x: (unknowns,) coordinates where it ended.
        chi2: of the counted readings, whitened.
        prior: squared distance of the free unknowns from their priors.
        information: (unknowns, unknowns) J'J of readings and priors at the end.
        run_information: (runs, unknowns, unknowns) what each run's counted readings contribute to it.
        run_score: (runs, unknowns) half the slope of each run's chi-square along each unknown.
        greatest_score: largest |score| of a free unknown, in sd (that of what is left, where it is more than noise);
            zero at a minimum.
        steps: iterations used.
        idle: it ended where steps gained nothing, at the rounding of a kink in the model.
    """

    x: np.ndarray
    chi2: float
    prior: float
    information: np.ndarray
    run_information: np.ndarray
    run_score: np.ndarray
    greatest_score: float
    steps: int
    idle: bool = False

    @property
    def objective(self) -> float:
        """Return what was minimised: chi-square of readings and priors."""
        return self.chi2 + self.prior

    @property
    def converged(self) -> bool:
        """Return True at a minimum."""
        return self.greatest_score < GREATEST_BASE_SCORE

    @property
    def log_evidence(self) -> float:
        """Return the log of the model's probability of the readings (Laplace), less a constant common to all models.

        All unknowns have standard normal priors, so that it is -(chi2 + |x|^2)/2 - log det(J'J + I)/2.
        """
        return -0.5 * self.objective - 0.5 * float(np.linalg.slogdet(self.information)[1])

    @property
    def sd(self) -> np.ndarray:
        """Return the standard deviations of the unknowns' coordinates."""
        return np.sqrt(np.diag(np.linalg.inv(self.information)))


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


def rows_at(problem: Problem, places: np.ndarray) -> np.ndarray:
    """Return the whitened residuals at some places (places, unknowns), shape (places, readings).

    A model driven out of its range looks bad there; it does not break the solver.
    """
    rows = residuals(problem, [at(problem, x) for x in places])
    return np.where(np.isfinite(rows), np.clip(rows, -1e6, 1e6), 1e3)


def look(problem: Problem, x: np.ndarray, moving: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the whitened residuals (readings,) at a place, and their derivatives (readings, unknowns).

    By differences between lanes of the forward program, not by tangents: forward mode compiles four times as long. One
    side is enough: central differences take twice as many lanes. Unknowns that do not move, and those of runs that the
    problem leaves out, get zeros.
    """
    own = problem.moving
    moved = np.flatnonzero(own if moving is None else own & moving)
    away = DIFFERENCE_STEP * np.eye(x.size)[moved]
    rows = rows_at(problem, np.concatenate([x[None], x + away]))
    jacobian = np.zeros((rows.shape[1], x.size))
    jacobian[:, moved] = (rows[1:] - rows[0]).T / DIFFERENCE_STEP
    return rows[0], jacobian


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
class _Seen:
    """The objective about one place: residuals of the counted readings and their Jacobian, priors apart."""

    x: np.ndarray
    rows: np.ndarray
    jacobian: np.ndarray
    moving: np.ndarray

    @property
    def objective(self) -> float:
        return float(self.rows @ self.rows + np.sum(self.x[self.moving] ** 2))

    @functools.cached_property
    def information(self) -> np.ndarray:
        return self.jacobian.T @ self.jacobian + np.eye(self.x.size)

    @functools.cached_property
    def slope(self) -> np.ndarray:
        """Half the gradient of the objective."""
        return np.where(self.moving, self.jacobian.T @ self.rows + self.x, 0.0)

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

    @property
    def scores(self) -> np.ndarray:
        """How far each unknown is from its minimum, in its sd as what is left tells it."""
        return np.abs(self.slope) / np.sqrt(np.diag(self.information) * self.unit)

    def few(self, size: int) -> Given:
        """Return the objective in few rows, the same sums of squares and products, one for each unknown and one more.

        Unknowns beyond its own, up to `size`, are at their minimum.
        """
        own = self.x.size
        rows, jacobian = np.zeros(size + 1), np.eye(size + 1, size)
        rows[:own], rows[-1] = self.along, np.sqrt(max(self.objective - self.promise, 0.0))
        jacobian[:own, :own] = self.axes
        return Given(jax.device_put(rows), jax.device_put(jacobian))


def fit(
    problem: Problem,
    start: np.ndarray,
    free: Sequence[int] | None = None,
    split: str = "fit",
    *,
    rival: float = np.inf,
    steps: int = MAX_STEPS,
) -> Fit:
    """Calibrate from one start.

    The trust-region steps are optimistix's, one at a time: the model's program stays one forward program, which is all
    that has to be compiled anew for another model. And a loop around a kernel is not safe: see `jaxmodel.kernel`.

    Args:
        problem: the case under one model.
        start: (unknowns,) coordinates to begin at; those not free stay there.
        free: numbers of the unknowns to calibrate; all where None.
        split: "fit" or "check", the runs whose readings count.
        rival: objective of a model that this one must come near; the fit ends where at its pace it never will.
        steps: at most so many.
    """
    part = problem.only(split)
    counted = np.asarray(getattr(part.readings, split)) > 0.0
    moving = np.ones(start.size, dtype=bool) if free is None else np.isin(np.arange(start.size), list(free))

    def see(x: np.ndarray) -> _Seen:
        rows, jacobian = look(part, x, moving)
        return _Seen(x, rows[counted], jacobian[counted], moving)

    size = -(-start.size // _SIZE) * _SIZE
    y = jax.device_put(np.append(start, np.zeros(size - start.size)))
    state = eqx.tree_at(lambda blank: blank.y_eval, _blank(size), y)
    best, course = None, []
    for _ in range(steps):
        seen = see(np.where(moving, np.asarray(state.y_eval)[: start.size], start))
        accepted = int(state.num_accepted_steps)
        y, state = _step(y, seen.few(size), state)
        if best is None or int(state.num_accepted_steps) > accepted:
            best = seen
        course.append(best.objective)
        if _at_its_end(best, seen, course) or _never_near(course, rival) or bool(state.terminate):
            break
        if bool(state.result != optx.RESULTS.successful):
            break
    assert best is not None
    return _fit_of(problem, split, best, course)


def _at_its_end(best: _Seen, last: _Seen, course: Sequence[float]) -> bool:
    """Return True where further steps would gain nothing."""
    return (best is last and best.promise < FLAT * best.unit) or _idle(best, course)


def _idle(best: _Seen, course: Sequence[float]) -> bool:
    return _gained_lately(course) < IDLE_GAIN * best.unit


def _never_near(course: Sequence[float], rival: float) -> bool:
    """Return True where a fit at its pace does not catch up with the rival."""
    return _gained_lately(course) < (course[-1] - rival) / PACE - 1.0


def _gained_lately(course: Sequence[float]) -> float:
    return course[-1 - IDLE_STEPS] - course[-1] if len(course) > IDLE_STEPS else np.inf


def _fit_of(problem: Problem, split: str, seen: _Seen, course: Sequence[float]) -> Fit:
    """Return what came of a fit of this course that saw this where it ended."""
    counted = np.asarray(getattr(problem.readings, split)) > 0.0
    runs, rows = problem.times.shape
    of_run = np.asarray(problem.readings.index)[counted] // (rows * len(problem.channels))
    parts = [(seen.jacobian[of_run == run], seen.rows[of_run == run]) for run in range(runs)]
    return Fit(
        x=seen.x,
        chi2=float(seen.rows @ seen.rows),
        prior=float(np.sum(seen.x[seen.moving] ** 2)),
        information=seen.information,
        run_information=np.stack([jacobian.T @ jacobian for jacobian, _ in parts]),
        run_score=np.stack([jacobian.T @ rows for jacobian, rows in parts]),
        greatest_score=float(np.max(seen.scores)),
        steps=len(course),
        idle=_idle(seen, course),
    )


def objectives(problem: Problem, places: np.ndarray) -> np.ndarray:
    """Return what `fit` minimises at some places, shape (places, unknowns)."""
    part = problem.only("fit")
    rows = rows_at(part, places)[:, np.asarray(part.readings.fit) > 0.0]
    return np.sum(rows**2, axis=1) + np.sum(places**2, axis=1)
