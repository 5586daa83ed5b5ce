"""Screening: sensitivities of the readings to every unknown and every candidate, and the efficient scores.

All are differences of one compiled, purely forward program that holds every candidate behind a switch. Differences, not
tangents: the forward-mode program of a robot with 31 effects took four times as long to compile, and a switch moves the
model so linearly that the step of the difference costs 1e-3 of a score.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from discrepancy.candidates import Candidate
from discrepancy.lanes import LANES, compile_for, residuals
from discrepancy.problem import Lane, Layout, Problem, Start
from discrepancy.projection import Candidate as Direction
from discrepancy.score import ScoreTable, score_effects
from jaxmodel.profile import Track

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
    """

    table: ScoreTable
    probes: dict[str, list[tuple[float, ...]]]
    base: np.ndarray
    residual: np.ndarray


@dataclasses.dataclass(frozen=True)
class Switchboard:
    """A case with candidates behind switches: one program, compiled once, that screens whatever model is calibrated.

    Attributes:
        problem: the case.
        layout: of its unknowns: the base model's, then those of the candidates.
        candidates: in the order of the problem's switches.
    """

    problem: Problem
    layout: Layout
    candidates: tuple[Candidate, ...]

    def warm_up(self) -> None:
        """Compile the program."""
        compile_for(self.problem.only("fit"))

    def over(self, courses: Track) -> Switchboard:
        """Return the switchboard of other steps, or other inputs."""
        return dataclasses.replace(self, problem=eqx.tree_at(lambda p: p.courses, self.problem, courses))


class _Point:
    """A calibrated model on a switchboard, and the readings' answers to what is added to it."""

    def __init__(self, board: Switchboard, start: Start) -> None:
        """Set the unknowns of the base model and of the effects in the model, and switch these on."""
        self.board, self.part = board, board.problem.only("fit")
        self.here = board.layout.at(start)
        self.switches = np.array([float(candidate.label in start) for candidate in board.candidates])
        self.absent = [(place, c) for place, c in enumerate(board.candidates) if c.label not in start]

    def rows(self, lanes: list[Lane]) -> np.ndarray:
        """Return by how much lanes move the whitened residuals of the fit readings, shape (lanes, readings)."""
        rows = residuals(self.part, [Lane(self.here, self.switches), *lanes])
        rows = rows[:, np.asarray(self.part.readings.fit) > 0.0]
        return rows[1:] - rows[0]

    def a_little_and_wholly(self) -> list[Lane]:
        """Return two lanes for each probe of each absent candidate, one for its derivative."""
        return [
            self.switched_on(place, candidate, probe, step)
            for place, candidate in self.absent
            for probe in candidate.probes
            for step in (SWITCH_STEP, 1.0)
        ]

    def switched_on(self, place: int, candidate: Candidate, probe: Sequence[float], step: float = 1.0) -> Lane:
        """Return the lane in which one candidate is switched on, wholly or by a step, at a probe of its parameters."""
        moved, on = self.here.copy(), self.switches.copy()
        moved[list(self.board.layout.of_effect[candidate.label])] = probe
        on[place] = step
        return Lane(moved, on)


def screen(
    board: Switchboard,
    start: Start,
    base: np.ndarray,
    residual: np.ndarray,
    names: Sequence[str],
) -> Screen:
    """Score at a calibrated model every candidate that is not in it.

    Args:
        board: with the candidates.
        start: where the model is calibrated to.
        base: (n, unknowns) sensitivities of the whitened fit readings to the model's own unknowns, prior rows appended.
        residual: (n,) their residual, likewise.
        names: of the model's own unknowns.
    """
    point = _Point(board, start)
    probed = [(c, probe) for _, c in point.absent for probe in c.probes]
    priors = np.zeros(base.shape[1])
    answers = point.rows(point.a_little_and_wholly())
    shapes: dict[str, list[np.ndarray]] = {}
    probes: dict[str, list[tuple[float, ...]]] = {}
    for number, (candidate, probe) in enumerate(probed):
        slope, whole = -answers[2 * number] / SWITCH_STEP, -answers[2 * number + 1]
        kept = [slope] if _cosine(slope, whole) > STRAIGHT else [slope, whole]
        for way in kept:
            if np.all(np.isfinite(way)) and np.linalg.norm(way) > 1e-6:
                shapes.setdefault(candidate.label, []).append(np.concatenate([way, priors]))
                probes.setdefault(candidate.label, []).append(probe)
    for place, candidate in point.absent:
        if candidate.label in probes and candidate.amplitude_on_grid:
            between = _between_the_best(base, residual, shapes[candidate.label], probes[candidate.label])
            whole = -point.rows([point.switched_on(place, candidate, probe) for probe in between])
            told = np.all(np.isfinite(whole), axis=1)
            shapes[candidate.label].extend(np.concatenate([way, priors]) for way in whole[told])
            probes[candidate.label].extend(probe for probe, tells in zip(between, told, strict=True) if tells)
    one_sided = {candidate.label: candidate.one_sided for candidate, _ in probed}
    directions = {label: Direction(own, signs=int(one_sided[label])) for label, own in shapes.items()}
    table = score_effects(base, residual, directions, names, absorbed_below=ABSORBED_BELOW)
    return Screen(table, probes, base, residual)


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
