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

from discrepancy.problem import Lane, Problem

MAX_STEPS = 30
SOLVER = optx.Dogleg(rtol=1e-4, atol=1e-4)
DIFFERENCE_STEP = 1e-3
# At a minimum the score of every unknown is zero; above this the score test of what is missing would be invalid.
GREATEST_BASE_SCORE = 0.1
# Below this a further step would gain 1e-4 of chi-square and a hundredth of a standard deviation.
FLAT = 0.01


class Task(eqx.Module):
    """One fit: from where, which unknowns are free (1 or 0) and which readings count (1 or 0)."""

    x: Array
    free: Array
    counted: Array


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
        greatest_score: largest |score| of a free unknown, in sd; zero at a minimum.
        steps: iterations used.
    """

    x: np.ndarray
    chi2: float
    prior: float
    information: np.ndarray
    run_information: np.ndarray
    run_score: np.ndarray
    greatest_score: float
    steps: int

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


def _objective(y: Array, problem: Problem, task: Task) -> Array:
    """Return the whitened residuals of the counted readings, then the prior rows (what is not free has none)."""
    x = jnp.where(task.free > 0.0, y, task.x)
    errors = problem.residual(Lane(x, jnp.zeros(len(problem.switched))))
    # A model driven out of its range must look bad, not break the solver.
    data = jnp.where(task.counted > 0.0, jnp.where(jnp.isfinite(errors), errors, 1e3), 0.0)
    return jnp.concatenate([data, jnp.where(task.free > 0.0, y, y - task.x)])


class Given(eqx.Module):
    """The objective's rows at one place, their Jacobian there, and the score of every unknown in sd."""

    rows: Array
    jacobian: Array
    scores: Array


@eqx.filter_custom_jvp
def _given(y: Array, given: Given) -> tuple[Array, None]:
    """Return rows computed beforehand, with their derivatives, in the form in which optimistix asks for them."""
    return given.rows, None


@_given.def_jvp
def _given_jvp(primals, tangents):
    _, given = primals
    dy, _ = tangents
    return (given.rows, None), (given.jacobian @ dy, None)


@eqx.filter_jit
def look(y: Array, problem: Problem, task: Task) -> Given:
    """Return the objective at a place, its derivatives by central differences of lanes of the forward program.

    Differences, not tangents: forward mode compiles four times as long, and a step of 1e-3 of a prior's standard
    deviation costs 1e-6 of a derivative.
    """
    steps = DIFFERENCE_STEP * jnp.eye(y.shape[0])
    lanes = y + jnp.concatenate([jnp.zeros((1, y.shape[0])), steps, -steps])
    rows = jax.vmap(lambda one: _objective(one, problem, task))(lanes)
    ahead, behind = jnp.split(rows[1:], 2)
    jacobian = (ahead - behind).T / (2.0 * DIFFERENCE_STEP)
    size = jnp.sqrt(jnp.maximum(jnp.sum(jacobian**2, axis=0), 1e-30))
    return Given(rows[0], jacobian, jnp.where(task.free > 0.0, jnp.abs(rows[0] @ jacobian) / size, 0.0))


@functools.lru_cache(maxsize=64)
def _blank(unknowns: int, rows: int):
    """Return the solver's state before any step; one for all fits of a shape, so that its steps are traced once."""
    struct = jax.ShapeDtypeStruct((rows,), float)
    blank = Given(jnp.zeros(rows), jnp.zeros((rows, unknowns)), jnp.zeros(unknowns))
    return SOLVER.init(_given, jnp.zeros(unknowns), blank, {}, struct, None, frozenset())


@eqx.filter_jit
def _step(y: Array, given: Given, state):
    y, state, _ = SOLVER.step(_given, y, given, {}, state, frozenset())
    return y, state


def fit(problem: Problem, start: np.ndarray, free: Sequence[int] | None = None, split: str = "fit") -> Fit:
    """Calibrate from one start.

    The trust-region steps are optimistix's, one at a time: the model's program stays one forward program, which is all
    that has to be compiled anew for another model. And a loop around a kernel is not safe: see `jaxmodel.kernel`.

    Args:
        problem: the case under one model.
        start: (unknowns,) coordinates to begin at; those not free stay there.
        free: numbers of the unknowns to calibrate; all where None.
        split: "fit" or "check", the runs whose readings count.
    """
    size = len(problem.unknowns.names)
    mask = np.ones(size) if free is None else np.isin(np.arange(size), list(free)).astype(float)
    counted = problem.readings.fit if split == "fit" else problem.readings.check
    y = jnp.asarray(start, dtype=float)
    task = Task(y, jnp.asarray(mask), counted)
    state = eqx.tree_at(lambda blank: blank.y_eval, _blank(size, counted.shape[0] + size), y)
    best = None
    for _ in range(MAX_STEPS):
        seen = look(state.y_eval, problem, task)
        accepted = int(state.num_accepted_steps)
        y, state = _step(y, seen, state)
        if best is None or int(state.num_accepted_steps) > accepted:
            best = seen
        flat = best is seen and float(jnp.max(seen.scores)) < FLAT
        if flat or bool(state.terminate) or bool(state.result != optx.RESULTS.successful):
            break
    assert best is not None
    return _fit_of(problem, np.asarray(y), np.asarray(start, dtype=float), mask > 0.0, best, int(state.num_steps))


def _fit_of(problem: Problem, x: np.ndarray, start: np.ndarray, moving: np.ndarray, seen: Given, steps: int) -> Fit:
    """Return what came of a fit that ended at x, where it saw this."""
    residual, jacobian = np.asarray(seen.rows), np.asarray(seen.jacobian)
    runs, rows = problem.times.shape
    of_run = np.asarray(problem.readings.index) // (rows * len(problem.channels))
    parts = [np.flatnonzero(of_run == run) for run in range(runs)]
    return Fit(
        x=np.where(moving, x, start),
        chi2=float(np.sum(residual[: -x.size] ** 2)),
        prior=float(np.sum(x[moving] ** 2)),
        information=jacobian.T @ jacobian,
        run_information=np.stack([jacobian[part].T @ jacobian[part] for part in parts]),
        run_score=np.stack([jacobian[part].T @ residual[part] for part in parts]),
        greatest_score=float(np.max(seen.scores)),
        steps=steps,
    )


@eqx.filter_jit
def _objective_at(problem: Problem, x: Array, counted: Array) -> Array:
    return jnp.sum(_objective(x, problem, Task(x, jnp.ones(x.shape), counted)) ** 2)


def objectives(problem: Problem, places: np.ndarray) -> np.ndarray:
    """Return what `fit` minimises at some places, shape (places, unknowns).

    One after the other: lanes of this sum are a program that XLA cannot make one kernel of.
    """
    return np.array([float(_objective_at(problem, jnp.asarray(x), problem.readings.fit)) for x in places])


@eqx.filter_jit
def _predict(problem: Problem, x: Array) -> Array:
    return problem.predict(Lane(x, jnp.zeros(len(problem.switched))))


def predict(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Return the predicted readings at coordinates x, shape (runs, rows, channels)."""
    return np.asarray(_predict(problem, jnp.asarray(x)))


@eqx.filter_jit
def _variance_from_inputs(problem: Problem, x: Array, input_sd: dict[str, float]) -> Array:
    return problem.variance_from_inputs(Lane(x, jnp.zeros(len(problem.switched))), input_sd)


def variance_from_inputs(problem: Problem, x: np.ndarray, input_sd: dict[str, float]) -> np.ndarray:
    """Return what noise of measured inputs (sd by column) adds to each reading's variance, (runs, rows, channels)."""
    return np.asarray(_variance_from_inputs(problem, jnp.asarray(x), input_sd))
