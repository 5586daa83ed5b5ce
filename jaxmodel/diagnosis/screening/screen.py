"""Sensitivities of the readings to every candidate at a calibrated model, in one batch of lanes.

They are finite differences of one compiled program that contains every candidate. The forward-mode program of a robot
with 31 effects took four times as long to compile, and the model is so linear in a switch that finite differences
change a score by only 1e-3.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.diagnosis.fitting.candidates import Candidate
from jaxmodel.diagnosis.fitting.fit import errors_and_jacobian
from jaxmodel.diagnosis.fitting.lanes import LANES
from jaxmodel.diagnosis.fitting.model import Setting, View
from jaxmodel.diagnosis.fitting.problem import Lane
from jaxmodel.diagnosis.noise.instrument import NoiseModel

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
        setting: the model.
        x: (unknowns,) calibrated coordinates.
        errors: (readings,) measured minus predicted.
        base: (readings, k) derivatives of the errors with respect to the model's free unknowns, with inputs without
            noise.
        directions: derivatives of the predictions with respect to the candidates.
    """

    setting: Setting
    x: np.ndarray
    errors: np.ndarray
    base: np.ndarray
    directions: tuple[Direction, ...]


def screen(
    view: View,
    setting: Setting,
    x: np.ndarray,
    noise: Mapping[str, NoiseModel],
    groups: Sequence[str] = ("effect", "sensor", "curve", "run"),
    near: Screen | None = None,
) -> Screen:
    """Return the sensitivities, at a calibrated model, to every candidate of some groups that is not in it.

    Args:
        view: the readings.
        setting: the model.
        x: calibrated coordinates.
        noise: of all channels. Sensitivities are computed with inputs without noise: with the noisy current of a row,
            the sensitivity to a resistance would be correlated with the residual of that row.
        groups: of candidates.
        near: of the same model and readings at other coordinates, whose sensitivities to the candidates are kept.
    """
    space = view.space
    problem, everything = space.problem(setting), space.problem_of_all(setting)
    errors = view.readings.value - view.at(problem, [setting.lane(x)])[0]
    _, base = errors_and_jacobian(view, space.quiet(problem, setting, noise), setting, x)
    if near is not None:
        return Screen(setting, x, errors, base, near.directions)
    quiet = space.quiet(everything, setting, noise)
    absent = [one for label, one in space.candidates.items() if one.group in groups and label not in setting.labels]
    laws = [space.candidates[label].law for label in setting.labels]
    used_ports = {law[0] for law in laws if law is not None}
    absent = [one for one in absent if one.law is None or one.law[0] not in used_ports]
    lanes, made = [setting.lane(x)], []
    together: dict[tuple[str, str], int] = {}
    for one in absent:
        if one.is_vector:
            for number in range(len(one.coordinates)):
                made.append((one, (), number, len(lanes), KNOT_STEP))
                lanes.append(_lane(view, setting, x, one, number))
        elif one.group == "run":
            # One lane for all runs: each shift moves the readings of its run only.
            key = ("run", one.effect.label)
            if key not in together:
                together[key] = len(lanes)
                lanes.append(setting.lane(x))
            lane = lanes[together[key]]
            moved = np.array(lane.x)
            moved[list(space.layout.of[one.label])] = KNOT_STEP
            lanes[together[key]] = dataclasses.replace(lane, x=moved)
            made.append((one, one.probes[0], 0, together[key], KNOT_STEP))
        else:
            for probe in one.probes:
                for step in (SWITCH_STEP, 1.0):
                    made.append((one, probe, -1, len(lanes), step))
                    lanes.append(_switched_on(view, setting, x, one, probe, step))
    predicted = view.at(quiet, lanes)
    answers = predicted[1:] - predicted[0]
    directions = list(_directions(view, made, answers))
    for one in absent:
        if one.amplitude_on_grid:
            directions += _between_the_best(view, setting, x, one, quiet, predicted[0], errors, directions)
    return Screen(setting, x, errors, base, tuple(directions))


def _lane(view: View, setting: Setting, x: np.ndarray, candidate: Candidate, number: int) -> Lane:
    moved, laws = x.copy(), setting.laws
    moved[view.space.layout.of[candidate.label][number]] += KNOT_STEP
    if candidate.law is not None:
        laws = laws.copy()
        laws[candidate.law[0]] = candidate.law[1]
    return Lane(moved, setting.switches, laws)


def _switched_on(
    view: View, setting: Setting, x: np.ndarray, candidate: Candidate, probe: Sequence[float], step: float
) -> Lane:
    moved, on = x.copy(), setting.switches.copy()
    moved[list(view.space.layout.of[candidate.label])] = probe
    on[view.space.coarse.switched.index(candidate.effect.label)] = step
    return Lane(moved, on, setting.laws)


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
        if one.group == "run":
            mine = view.readings.run == one.run
            columns = np.where(mine, answers[lane - 1], 0.0)[:, None] / step
            number += 1
            if np.all(np.isfinite(columns)) and np.linalg.norm(columns) > 0.0:
                yield Direction(one.label, (1.0,), columns)
            continue
        slope, whole = answers[lane - 1] / step, answers[made[number + 1][3] - 1]
        number += 2
        for way in [slope] if _cosine(slope, whole) > STRAIGHT else [slope, whole]:
            if np.all(np.isfinite(way)) and np.any(np.abs(way) > 1e-6 * view.readings.sd):
                yield Direction(one.label, tuple(probe), way[:, None])


def _between_the_best(view, setting, x, one, problem, still, errors, directions) -> list[Direction]:
    """Return directions at amplitudes around the best one, for effects with many local optima."""
    own = [way for way in directions if way.label == one.label]
    if not own:
        return []
    scaled = errors / view.readings.sd
    strength = [abs(way.columns[:, 0] / view.readings.sd @ scaled) / _length(way, view) for way in own]
    best = own[int(np.argmax(strength))].probe
    amplitudes = sorted({way.probe[0] for way in own} | {0.0})
    nearest = amplitudes.index(best[0])
    low, high = amplitudes[max(nearest - 1, 0)], amplitudes[min(nearest + 1, len(amplitudes) - 1)]
    between = [(float(at), *best[1:]) for at in np.linspace(low, high, LANES + 2)[1:-1]]
    answers = view.at(problem, [_switched_on(view, setting, x, one, probe, 1.0) for probe in between]) - still
    return [
        Direction(one.label, probe, way[:, None])
        for probe, way in zip(between, answers, strict=True)
        if np.all(np.isfinite(way)) and np.any(way)
    ]


def _length(way: Direction, view: View) -> float:
    return max(float(np.linalg.norm(way.columns[:, 0] / view.readings.sd)), 1e-9)


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / lengths) if np.isfinite(lengths) and lengths > 0.0 else 1.0
