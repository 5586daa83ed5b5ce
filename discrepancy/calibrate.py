"""Calibration: trust-region least squares (optimistix) on the whitened residuals and the priors."""

from __future__ import annotations

import dataclasses
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


@eqx.filter_jit
def _rows_about(y: Array, arguments: tuple[Problem, Task]) -> Array:
    """Return the objective's rows at a place and on either side of it along every unknown.

    One function for value and derivative, under `jit`, so that the model is traced once a program, not five times.
    """
    steps = DIFFERENCE_STEP * jnp.eye(y.shape[0])
    lanes = y + jnp.concatenate([jnp.zeros((1, y.shape[0])), steps, -steps])
    return jax.vmap(lambda one: _objective(one, *arguments))(lanes)


@eqx.filter_custom_jvp
def _residuals(y: Array, arguments: tuple[Problem, Task]) -> Array:
    """Return the objective's rows; where a derivative is asked for, with the Jacobian by central differences.

    Differences of lanes of the forward program, not tangents: forward mode compiles four times as long, and a step of
    1e-3 of a prior's standard deviation costs 1e-6 of a derivative.
    """
    return _rows_about(y, arguments)[0]


@_residuals.def_jvp
def _residuals_jvp(primals, tangents):
    y, arguments = primals
    dy, _ = tangents
    rows = _rows_about(y, arguments)
    ahead, behind = jnp.split(rows[1:], 2)
    return rows[0], dy @ (ahead - behind) / (2.0 * DIFFERENCE_STEP)


@eqx.filter_jit
def _solve(problem: Problem, task: Task):
    solution = optx.least_squares(_residuals, SOLVER, task.x, args=(problem, task), max_steps=MAX_STEPS, throw=False)
    info = solution.state.f_info
    jacobian = info.jac.as_matrix()
    runs, rows = problem.times.shape
    of_run = jnp.pad(problem.readings.index // (rows * len(problem.channels)), (0, task.x.size), constant_values=-1)

    def contribution(run: Array) -> tuple[Array, Array]:
        mine = jacobian * (of_run == run)[:, None]
        return mine.T @ jacobian, mine.T @ info.residual

    by_run = jax.lax.map(contribution, jnp.arange(runs))
    total = jacobian.T @ jacobian, jacobian.T @ info.residual
    return solution.value, info.residual, total, by_run, solution.stats["num_steps"]


def fit(problem: Problem, start: np.ndarray, free: Sequence[int] | None = None, split: str = "fit") -> Fit:
    """Calibrate from one start.

    Args:
        problem: the case under one model.
        start: (unknowns,) coordinates to begin at; those not free stay there.
        free: numbers of the unknowns to calibrate; all where None.
        split: "fit" or "check", the runs whose readings count.
    """
    size = len(problem.unknowns.names)
    mask = np.ones(size) if free is None else np.isin(np.arange(size), list(free)).astype(float)
    counted = problem.readings.fit if split == "fit" else problem.readings.check
    task = Task(jnp.asarray(start, dtype=float), jnp.asarray(mask), counted)
    x, residual, (information, gradient), by_run, steps = jax.device_get(_solve(problem, task))
    moving = mask > 0.0
    chi2 = float(np.sum(residual[:-size] ** 2))
    scores = np.abs(gradient[moving]) / np.sqrt(np.diag(information)[moving])
    return Fit(
        x=np.where(moving, x, start),
        chi2=chi2,
        prior=float(np.sum(np.asarray(x)[moving] ** 2)),
        information=information,
        run_information=by_run[0],
        run_score=by_run[1],
        greatest_score=float(scores.max()) if scores.size else 0.0,
        steps=int(steps),
    )


@eqx.filter_jit
def _objectives(problem: Problem, places: Array, counted: Array) -> Array:
    size = places.shape[1]
    return jax.lax.map(lambda x: jnp.sum(_objective(x, problem, Task(x, jnp.ones(size), counted)) ** 2), places)


def objectives(problem: Problem, places: np.ndarray) -> np.ndarray:
    """Return what `fit` minimises at some places, shape (places, unknowns)."""
    return np.asarray(_objectives(problem, jnp.asarray(places), problem.readings.fit))


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
