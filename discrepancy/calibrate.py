"""Fitting lanes of a problem together, and their derivatives: the two compiled programs of a diagnosis."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array

from discrepancy.problem import Lane, Problem

LANES = 8
DIRECTIONS = 16
MAX_STEPS = 60
SOLVER = optx.LevenbergMarquardt(rtol=1e-5, atol=1e-5)


class Task(eqx.Module):
    """One fit: from where, with which effects on, which unknowns free and which readings counted.

    `free` is padded to a common length with the number one past the last unknown, a place that changes nothing.
    """

    lane: Lane
    free: Array
    counted: Array


@dataclasses.dataclass(frozen=True)
class Fit:
    """What came of one fit.

    Attributes:
        x: (unknowns,) where it ended.
        switches: (candidates,) which effects are on.
        free: numbers of the free unknowns.
        chi2: of the counted readings.
        prior: squared distance of the free unknowns from their priors.
        converged: the solver met its tolerances.
        steps: iterations used.
    """

    x: np.ndarray
    switches: np.ndarray
    free: tuple[int, ...]
    chi2: float
    prior: float
    converged: bool
    steps: int

    @property
    def objective(self) -> float:
        """Return what was minimised: chi-square of readings and priors."""
        return self.chi2 + self.prior

    @property
    def lane(self) -> Lane:
        """Return the fitted lane."""
        return Lane(jnp.asarray(self.x), jnp.asarray(self.switches))


def _objective(y: Array, problem: Problem, task: Task) -> Array:
    """Return the whitened residuals of the counted readings, then the prior rows."""
    padded = jnp.append(task.lane.x, 0.0).at[task.free].set(y)
    errors = problem.residual(Lane(padded[:-1], task.lane.switches)) * task.counted
    # A model driven out of its range must look bad, not poison the lanes beside it.
    return jnp.concatenate([jnp.where(jnp.isfinite(errors), errors, 1e3), y])


@eqx.filter_custom_jvp
def _residuals(y: Array, arguments: tuple[Problem, Task]) -> Array:
    """Return the objective's rows, with the whole Jacobian made in one forward pass where a derivative is asked for.

    The solver linearises this function and applies the linear part many times. Left to itself, JAX would store every
    intermediate of every step for that; the Jacobian itself is a hundred times smaller.
    """
    return _objective(y, *arguments)


@_residuals.def_jvp
def _residuals_jvp(primals, tangents):
    y, arguments = primals
    dy, _ = tangents

    def along(way):
        return jax.jvp(lambda moved: _objective(moved, *arguments), (y,), (way,))

    value, columns = jax.vmap(along, out_axes=(None, 1))(jnp.eye(y.shape[0]))
    return value, columns @ dy


@eqx.filter_jit
def _solve(problem: Problem, tasks: Task) -> tuple[Array, Array, Array]:
    solver = SOLVER

    def one(task: Task):
        y0 = jnp.append(task.lane.x, 0.0)[task.free]
        solution = optx.least_squares(
            _residuals, solver, y0, args=(problem, task), max_steps=MAX_STEPS, throw=False
        )
        converged = solution.result == optx.RESULTS.successful
        return solution.value, solution.state.f_info.as_min(), converged, solution.stats["num_steps"]

    return jax.vmap(one)(tasks)


def fit(problem: Problem, starts: list[tuple[np.ndarray, np.ndarray, tuple[int, ...]]], split: str, width: int) -> list[Fit]:
    """Fit any number of lanes by Levenberg-Marquardt (optimistix), a fixed number at a time.

    Args:
        problem: the case.
        starts: for each fit the start x (unknowns,), the switches (candidates,) and the free unknowns.
        split: "fit" or "check", the runs whose readings count.
        width: number of free unknowns that the program is compiled for.
    """
    counted = problem.readings.fit if split == "fit" else 1.0 - problem.readings.fit
    size = problem.layout.size
    done: list[Fit] = []
    for first in range(0, len(starts), LANES):
        batch = starts[first : first + LANES]
        padded = batch + [batch[-1]] * (LANES - len(batch))
        tasks = Task(
            Lane(jnp.asarray([x for x, _, _ in padded]), jnp.asarray([s for _, s, _ in padded])),
            jnp.asarray([list(free) + [size] * (width - len(free)) for _, _, free in padded]),
            jnp.broadcast_to(counted, (LANES, counted.shape[0])),
        )
        ys, half, converged, steps = jax.device_get(_solve(problem, tasks))
        for number, (x, switches, free) in enumerate(batch):
            ended = np.array(x, dtype=float)
            ended[list(free)] = ys[number, : len(free)]
            prior = float(np.sum(ys[number, : len(free)] ** 2))
            done.append(
                Fit(ended, np.asarray(switches), free, 2.0 * float(half[number]) - prior, prior, bool(converged[number]), int(steps[number]))
            )
    return done


@eqx.filter_jit
def _tangents(problem: Problem, lanes: Lane, directions: Lane) -> tuple[Array, Array]:
    def one(lane: Lane, direction: Lane):
        return jax.jvp(problem.residual, (lane,), (direction,))

    return jax.vmap(one)(lanes, directions)


def tangents(problem: Problem, lanes: list[Lane], directions: list[Lane]) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals and their derivatives along directions, each of shape (n readings, directions).

    Forward mode: the directions are a hundred at most, the readings tens of thousands.
    """
    residuals, derivatives = [], []
    for first in range(0, len(lanes), DIRECTIONS):
        batch, ways = lanes[first : first + DIRECTIONS], directions[first : first + DIRECTIONS]
        count = len(batch)
        batch, ways = (part + [part[-1]] * (DIRECTIONS - count) for part in (batch, ways))
        stacked = [jax.tree.map(lambda *leaves: jnp.stack(leaves), *part) for part in (batch, ways)]
        value, slope = jax.device_get(_tangents(problem, *stacked))
        residuals.append(value[:count])
        derivatives.append(slope[:count])
    return np.concatenate(residuals).T, np.concatenate(derivatives).T
