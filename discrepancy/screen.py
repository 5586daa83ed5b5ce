"""Screening: sensitivities of the readings to every unknown and every candidate, and the efficient scores.

All are differences of one compiled, purely forward program that holds every candidate behind a switch. Differences, not
tangents: the forward-mode program of a robot with 31 effects took four times as long to compile, and a switch moves the
model so linearly that the step of the difference costs 1e-3 of a score.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from discrepancy.calibrate import Fit
from discrepancy.candidates import Candidate
from discrepancy.problem import Lane, Layout, Problem
from discrepancy.projection import Candidate as Direction
from discrepancy.score import ScoreTable, score_effects

LANES = 16
BASE_STEP = 1e-3
SWITCH_STEP = 1e-3
# A direction of which less than this survives the projection is not told from the error of its differences.
ABSORBED_BELOW = 3e-3
# Where the effect at full size points elsewhere than its derivative (a cosine below this), both are tried.
STRAIGHT = 0.98


@dataclasses.dataclass(frozen=True)
class Screen:
    """What the data say of everything that could be added to a calibrated model.

    Attributes:
        table: the efficient scores.
        probes: for each scored effect and each of its shapes, the coordinates at which it was tried.
        base: (n, unknowns) whitened sensitivities of the fit readings to the model's own unknowns, prior rows appended.
        residual: (n,) whitened residual, prior rows appended.
        counted: (readings,) which of the problem's readings are in the rows.
    """

    table: ScoreTable
    probes: dict[str, list[tuple[float, ...]]]
    base: np.ndarray
    residual: np.ndarray
    counted: np.ndarray


@eqx.filter_jit
def _residuals(problem: Problem, lanes: Lane) -> Array:
    return jax.vmap(problem.residual)(lanes)


def _evaluate(problem: Problem, lanes: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the residuals of any number of lanes, shape (lanes, readings), a fixed number at a time on each core."""

    def evaluate(first: int) -> np.ndarray:
        batch = lanes[first : first + LANES]
        filled = batch + [batch[-1]] * (LANES - len(batch))
        stacked = Lane(jnp.asarray(np.stack([x for x, _ in filled])), jnp.asarray(np.stack([s for _, s in filled])))
        return np.asarray(_residuals(problem, stacked))[: len(batch)]

    return on_all_cores(evaluate, len(lanes))


def on_all_cores(evaluate: Callable[[int], np.ndarray], lanes: int) -> np.ndarray:
    """Return what `evaluate` gives for the batches of `LANES` that begin at 0, `LANES` and so on, one after the other.

    A batch is one kernel on one core; the first runs alone, so that the program is compiled once.
    """
    compiled = evaluate(0)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.concatenate([compiled, *pool.map(evaluate, range(LANES, lanes, LANES))])


def warm_up(problem: Problem, layout: Layout) -> None:
    """Compile the program that screens a problem; it serves every model of the case."""
    _evaluate(problem, [(np.zeros(len(layout.coordinates)), np.zeros(len(problem.switched)))])


def screen(
    problem: Problem,
    layout: Layout,
    own: Sequence[int],
    fitted: Fit,
    candidates: Sequence[Candidate],
    present: Collection[str] = (),
    quiet: Problem | None = None,
) -> Screen:
    """Score at a calibrated model every candidate that is not in it.

    Args:
        problem: with all candidates switched.
        layout: of the problem's unknowns.
        own: numbers of the unknowns that the calibrated model has, in the order of the fit's.
        fitted: the calibrated model.
        candidates: in the order of the problem's switches.
        present: labels of those that the calibrated model has.
        quiet: the problem with its measured inputs freed of noise, for the sensitivities: a sensitivity to resistance
            made with the noise of a row's own current is correlated with the residual of that row.
    """
    here = np.zeros(len(layout.coordinates))
    here[list(own)] = fitted.x
    at_model = np.array([float(candidate.label in present) for candidate in candidates])
    lanes: list[tuple[np.ndarray, np.ndarray]] = [(here, at_model)]
    for number in own:
        for side in (BASE_STEP, -BASE_STEP):
            moved = here.copy()
            moved[number] += side
            lanes.append((moved, at_model))
    absent = [(place, candidate) for place, candidate in enumerate(candidates) if candidate.label not in present]
    for place, candidate in absent:
        for probe in candidate.probes:
            for step in (SWITCH_STEP, 1.0):
                lanes.append(_switched_on(here, at_model, place, layout.of_effect[candidate.label], probe, step))
    counted = np.asarray(problem.readings.fit) > 0.0
    rows = _evaluate(quiet or problem, lanes)[:, counted]
    residual = rows[0] if quiet is None else _evaluate(problem, lanes[:1])[0, counted]

    count = len(own)
    base = -(rows[1 : 1 + 2 * count : 2] - rows[2 : 2 + 2 * count : 2]).T / (2.0 * BASE_STEP)
    priors = np.zeros(count)
    directions, probes = {}, {}
    next_row = 1 + 2 * count
    for _, candidate in absent:
        shapes, tried = [], []
        for probe in candidate.probes:
            slope = -(rows[next_row] - rows[0]) / SWITCH_STEP
            whole = -(rows[next_row + 1] - rows[0])
            next_row += 2
            kept = [slope] if _cosine(slope, whole) > STRAIGHT else [slope, whole]
            for way in kept:
                if np.all(np.isfinite(way)) and np.linalg.norm(way) > 1e-6:
                    shapes.append(np.concatenate([way, priors]))
                    tried.append(probe)
        if shapes:
            probes[candidate.label] = tried
            directions[candidate.label] = Direction(shapes, signs=1 if candidate.one_sided else 0)
    base = np.concatenate([base, np.eye(count)])
    residual = np.concatenate([residual, -fitted.x])
    for place, candidate in absent:
        if candidate.label in probes and candidate.amplitude_on_grid:
            between = _between_the_best(base, residual, directions[candidate.label].shapes, probes[candidate.label])
            lanes = [_switched_on(here, at_model, place, layout.of_effect[candidate.label], x) for x in between]
            whole = -(_evaluate(quiet or problem, lanes)[:, counted] - rows[0])
            directions[candidate.label].shapes.extend(np.concatenate([way, priors]) for way in whole)
            probes[candidate.label].extend(between)
    names = [layout.names[number] for number in own]
    table = score_effects(base, residual, directions, names, absorbed_below=ABSORBED_BELOW)
    return Screen(table, probes, base, residual, counted)


def _switched_on(
    here: np.ndarray,
    at_model: np.ndarray,
    place: int,
    numbers: Sequence[int],
    probe: Sequence[float],
    step: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lane in which one candidate is switched on, wholly or by a step, at a probe of its parameters."""
    moved, on = here.copy(), at_model.copy()
    moved[list(numbers)] = probe
    on[place] = step
    return moved, on


def _between_the_best(
    base: np.ndarray, residual: np.ndarray, shapes: Sequence[np.ndarray], probes: Sequence[tuple[float, ...]]
) -> list[tuple[float, ...]]:
    """Return amplitudes between the neighbours of the one that explains most: its law has many local optima."""
    q, _ = np.linalg.qr(base)
    left = residual - q @ (q.T @ residual)
    projected = [shape - q @ (q.T @ shape) for shape in shapes]
    best = probes[int(np.argmax([abs(p @ left) / max(float(np.linalg.norm(p)), 1e-9) for p in projected]))]
    amplitudes = sorted({probe[0] for probe in probes} | {0.0})
    nearest = amplitudes.index(best[0])
    low, high = amplitudes[max(nearest - 1, 0)], amplitudes[min(nearest + 1, len(amplitudes) - 1)]
    return [(float(x), *best[1:]) for x in np.linspace(low, high, LANES + 2)[1:-1]]


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / lengths) if np.isfinite(lengths) and lengths > 0.0 else 1.0
