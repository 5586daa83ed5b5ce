"""Sensitivities of the readings to every candidate at a calibrated model, in one batch of lanes.

They are finite differences of one compiled program that contains every candidate. The forward-mode program of a robot
with 31 effects took four times as long to compile, and the model is so linear in a switch that finite differences
change a score by only 1e-3.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmodel.fit.candidates import SHIFTED, Candidate
from jaxmodel.fit.gauss_newton import linearised
from jaxmodel.fit.lanes import LANES
from jaxmodel.fit.problem import Lane
from jaxmodel.fit.space import ModelSpec, View

# Groups of what a search adds one by one.
SINGLE = ("effect", "sensor", *SHIFTED)
SWITCH_STEP = 1e-3
# Step of a curve's knot, in sd of its usual size.
KNOT_STEP = 1e-3
# If the cosine between an effect at full size and its derivative is below this, both directions are tried.
STRAIGHT = 0.98


@dataclasses.dataclass(frozen=True)
class Direction:
    """Sensitivity of the readings to one candidate at one shape.

    Attributes:
        label: of the candidate.
        probe: coordinates at which it was computed; empty for a curve.
        columns: (readings, amplitudes) in the channels' units, per unit of amplitude.
    """

    label: str
    probe: tuple[float, ...]
    columns: np.ndarray


@dataclasses.dataclass(frozen=True)
class Screen:
    """A calibrated model and the sensitivities of the readings to its unknowns and to all candidates.

    Attributes:
        spec: the model.
        x: (unknowns,) calibrated coordinates.
        errors: (readings,) measured minus predicted.
        base: (readings, k) derivatives of the predictions with respect to the model's free unknowns.
        directions: derivatives of the predictions with respect to the candidates.
    """

    spec: ModelSpec
    x: np.ndarray
    errors: np.ndarray
    base: np.ndarray
    directions: tuple[Direction, ...]


def screen(view: View, spec: ModelSpec, x: np.ndarray, groups: Sequence[str] = SINGLE) -> Screen:
    """Return the sensitivities, at a calibrated model, to every candidate of some groups that is not in it.

    Args:
        view: the readings.
        spec: the model.
        x: calibrated coordinates.
        groups: of candidates.
    """
    space = view.space
    errors, base = linearised(view, space.problem(spec), spec, x)
    everything = space.problem_of_all(spec)
    absent = [one for label, one in space.candidates.items() if one.group in groups and label not in spec.labels]
    laws = [space.candidates[label].law for label in spec.labels]
    used_ports = {law[0] for law in laws if law is not None}
    absent = [one for one in absent if one.law is None or one.law[0] not in used_ports]
    lanes, made = [spec.lane(x)], []
    together: dict[tuple[str, str], int] = {}
    for one in absent:
        if one.is_vector:
            for number in range(len(one.coordinates)):
                made.append((one, (), number, len(lanes), KNOT_STEP))
                lanes.append(_lane(view, spec, x, one, number))
        elif one.group in SHIFTED:
            # One lane for all runs or specimens: each shift moves the readings of its own only.
            key = (one.group, one.effect.label)
            if key not in together:
                together[key] = len(lanes)
                lanes.append(spec.lane(x))
            lane = lanes[together[key]]
            moved = np.array(lane.x)
            moved[list(space.layout.of[one.label])] = KNOT_STEP
            lanes[together[key]] = lane._replace(x=moved)
            made.append((one, one.probes[0], 0, together[key], KNOT_STEP))
        else:
            for probe in one.probes:
                for step in (SWITCH_STEP, 1.0):
                    made.append((one, probe, -1, len(lanes), step))
                    lanes.append(_switched_on(view, spec, x, one, probe, step))
    predicted = view.at(everything, lanes)
    answers = predicted[1:] - predicted[0]
    directions = list(_directions(view, made, answers))
    for one in absent:
        if one.amplitude_on_grid:
            directions += _between_the_best(view, spec, x, one, everything, predicted[0], errors, directions)
    return Screen(spec, x, errors, base, tuple(directions))


def _lane(view: View, spec: ModelSpec, x: np.ndarray, candidate: Candidate, number: int) -> Lane:
    moved, laws = x.copy(), spec.laws
    moved[view.space.layout.of[candidate.label][number]] += KNOT_STEP
    if candidate.law is not None:
        laws = laws.copy()
        laws[candidate.law[0]] = candidate.law[1]
    return Lane(moved, spec.switches, laws)


def _switched_on(
    view: View, spec: ModelSpec, x: np.ndarray, candidate: Candidate, probe: Sequence[float], step: float
) -> Lane:
    moved, on = x.copy(), spec.switches.copy()
    moved[list(view.space.layout.of[candidate.label])] = probe
    on[view.space.coarse.switched.index(candidate.effect.label)] = step
    return Lane(moved, on, spec.laws)


def _directions(view: View, made: Sequence[tuple], answers: np.ndarray):
    """Yield the directions of candidates from the differences of their lanes, without those that are zero."""
    number = 0
    while number < len(made):
        one, probe, _, lane, step = made[number]
        if one.is_vector:
            count = len(one.coordinates)
            lanes = [entry[3] - 1 for entry in made[number : number + count]]
            columns = answers[lanes].T / step
            number += count
            if np.all(np.isfinite(columns)) and np.linalg.norm(columns) > 0.0:
                yield Direction(one.label, (), columns)
            continue
        if one.group in SHIFTED:
            mine = np.isin(view.data.run, one.runs)
            columns = np.where(mine, answers[lane - 1], 0.0)[:, None] / step
            number += 1
            if np.all(np.isfinite(columns)) and np.linalg.norm(columns) > 0.0:
                yield Direction(one.label, (1.0,), columns)
            continue
        slope, whole = answers[lane - 1] / step, answers[made[number + 1][3] - 1]
        number += 2
        for way in [slope] if _cosine(slope, whole) > STRAIGHT else [slope, whole]:
            if np.all(np.isfinite(way)) and np.any(np.abs(way) > 1e-6 * view.data.sd):
                yield Direction(one.label, tuple(probe), way[:, None])


def _between_the_best(view, spec, x, one, problem, still, errors, directions) -> list[Direction]:
    """Return directions at amplitudes around the best one, for effects with many local optima."""
    own = [way for way in directions if way.label == one.label]
    if not own:
        return []
    scaled = errors / view.data.sd
    strength = [abs(way.columns[:, 0] / view.data.sd @ scaled) / _length(way, view) for way in own]
    best = own[int(np.argmax(strength))].probe
    amplitudes = sorted({way.probe[0] for way in own} | {0.0})
    nearest = amplitudes.index(best[0])
    low, high = amplitudes[max(nearest - 1, 0)], amplitudes[min(nearest + 1, len(amplitudes) - 1)]
    between = [(float(at), *best[1:]) for at in np.linspace(low, high, LANES + 2)[1:-1]]
    answers = view.at(problem, [_switched_on(view, spec, x, one, probe, 1.0) for probe in between]) - still
    return [
        Direction(one.label, probe, way[:, None])
        for probe, way in zip(between, answers, strict=True)
        if np.all(np.isfinite(way)) and np.any(way)
    ]


def _length(way: Direction, view: View) -> float:
    return max(float(np.linalg.norm(way.columns[:, 0] / view.data.sd)), 1e-9)


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / lengths) if np.isfinite(lengths) and lengths > 0.0 else 1.0
