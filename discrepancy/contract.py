"""The noise contract of a case (step 0 of the method): what each output's sensor adds, and who says so."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import numpy as np

from discrepancy.held_inputs import LONG, noisy_inputs, rows_held
from discrepancy.input_noise import InputNoise, MovedInputs, slow_directions
from discrepancy.lanes import at, predictions
from discrepancy.noise import BETWEEN_JUMPS, NoiseModel, break_at_jumps, channel_noise, local_noise
from discrepancy.problem import Problem
from discrepancy.readings import flatten
from discrepancy.whitening import chain_starts
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Case, Run
from jaxmodel.effects import CATALOGUE
from jaxmodel.measurements import KINDS
from jaxmodel.ports import Effect
from jaxmodel.simulate import run_track, track

# Readings of a model, by run and output.
Predictions = Mapping[str, Mapping[str, np.ndarray]]

# What tells the noise that nobody states, and the rows of the windows in which it is looked at. What a model leaves has
# lost the course of the readings: windows may be longer, which a long memory needs. On 32 blind development cases with
# something missing, windows of 48 rows told the stated sd within 6 % from what the base model leaves.
_READ = (BETWEEN_JUMPS, 12)
_LEFT = ("what the calibrated model leaves between jumps of the inputs", 48)


def noise_of_case(case: Case, catalogue: Mapping[str, type[Effect]] = CATALOGUE) -> dict[str, NoiseModel]:
    """Return the noise of every output that the case measured, in the order of the kind's outputs.

    A stated sd is believed, quantisation and the noise of measured inputs are added; where none is stated it is
    estimated from the readings between the jumps of the inputs. Channels whose readings never change, and of
    whose noise nothing is known, say nothing and are left out.
    """
    return _noise(case, _noise_from_inputs(case, catalogue))


def noise_left_by(case: Case, noise: Mapping[str, NoiseModel], predicted: Predictions) -> dict[str, NoiseModel]:
    """Return the noise as what a calibrated model leaves of the fit runs tells it, sharper than the readings do.

    Args:
        case: with its measurements.
        noise: of every output, as it was before: what comes from inputs stays.
        predicted: readings of the model, by run and output.
    """
    return {**noise, **_noise(case, {name: model.from_inputs for name, model in noise.items()}, predicted)}


def _noise(case: Case, from_inputs: Mapping[str, float], predicted: Predictions | None = None) -> dict[str, NoiseModel]:
    noise = {}
    shown_by, window = _READ if predicted is None else _LEFT
    for name in KINDS[case.kind].outputs:
        runs = [run for run in case.runs if name in run.measured.outputs]
        readings = [run.measured.outputs[name] for run in runs]
        if not runs or not any(np.isfinite(values).any() for values in readings):
            continue
        if predicted is not None:
            runs = [run for run in runs if run.split == "fit"]
        if not runs:
            continue
        shown = [run.measured.outputs[name] - (predicted[run.name][name] if predicted else 0.0) for run in runs]
        inputs = [np.stack(list(run.measured.inputs.values()), axis=1) for run in runs]
        times = [run.measured.time_s for run in runs]
        calm = [break_at_jumps(chain_starts([t]), part, settling_rows=3) for t, part in zip(times, inputs, strict=True)]
        series = [np.concatenate(part) for part in (shown, calm, times)]

        def estimate(known_sd, series=series):
            return local_noise(*series, known_sd=known_sd, window=window)

        model = channel_noise(
            np.concatenate(readings),
            estimate,
            stated_sd=case.sensors.get(name),
            input_sd=from_inputs.get(name, 0.0),
            shown_by=shown_by,
        )
        if model.sd > 0.0:
            noise[name] = dataclasses.replace(model, from_inputs=from_inputs.get(name, 0.0))
    return noise


def _noise_from_inputs(case: Case, catalogue: Mapping[str, type[Effect]]) -> dict[str, float]:
    """Return the sd that noise of measured inputs adds to each output of the first run, by the nominal model."""
    noisy = noisy_inputs(case)
    if not noisy:
        return {}
    model, profile = case_model(case, case.runs[0], catalogue=catalogue), run_profile(case.runs[0])
    outputs = KINDS[case.kind].outputs

    course = track(model, profile)

    def readings(move: Mapping[str, np.ndarray]) -> np.ndarray:
        inputs = course.inputs | {name: course.inputs[name] + more[0] for name, more in move.items()}
        moved = dataclasses.replace(course, inputs=inputs)
        found = run_track(model, moved, jax.device_put(profile.time_s)).readings
        return np.stack([np.asarray(found[name]) for name in outputs], axis=1)[None]

    courses = jax.tree.map(lambda leaf: np.asarray(leaf)[None], course)
    moved = MovedInputs(lambda moves: np.stack([readings(move) for move in moves]), courses, noisy)
    variance = np.mean(moved.variance()[0], axis=0)
    return {name: float(np.sqrt(one)) for name, one in zip(outputs, variance, strict=True)}


def noise_passed_on(
    case: Case, noise: Mapping[str, NoiseModel], problem: Problem, x: np.ndarray
) -> tuple[dict[str, NoiseModel], InputNoise]:
    """Return what a calibrated model makes of the noise of measured inputs: in each channel, and in each reading.

    Args:
        case: with its measurements.
        noise: of each output column to be used.
        problem: the case under the model.
        x: (unknowns,) where it is calibrated to.
    """
    still = at(problem, x)

    def readings(moves: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        return predictions(problem, [dataclasses.replace(still, added=dict(move)) for move in moves])

    moved = MovedInputs(readings, problem.courses, noisy_inputs(case))
    variance = moved.variance()
    found = dict(noise)
    for place, name in enumerate(problem.channels):
        if name in noise:
            runs = [run.measured for run in case.runs]
            read = [v[: r.time_s.size, place] for v, r in zip(variance, runs, strict=True) if name in r.outputs]
            found[name] = noise[name].with_from_inputs(float(np.sqrt(np.mean(np.concatenate(read)))))
    counted = flatten(case, found, problem.channels, variance.shape[1], InputNoise(variance))
    answers = moved.to_slow_noise()
    real = np.flatnonzero(np.asarray(counted.fit) + np.asarray(counted.check) > 0.0)
    index = np.asarray(counted.index)
    on_host = jax.tree.map(np.asarray, counted)
    white = on_host.whiten(answers.reshape(len(answers), -1)[:, index])[:, real]
    slow = slow_directions(white, index[real] // int(np.prod(answers.shape[2:])))
    return found, InputNoise(variance, slow)


def without_input_noise(case: Case, noise: Mapping[str, NoiseModel]) -> Case:
    """Return the case with its noisy inputs, where they were not held, as the neighbours of each row read them.

    The noise of a measured input is in the residual of its own row too; as a function of the row's own reading that
    would look like a law of nature.
    """
    noisy = noisy_inputs(case)
    # Whitening coloured noise mixes a row with the one before: then the nearest neighbours are no strangers either.
    apart = 2 if any(model.rho != 0.0 for model in noise.values()) else 1

    def quiet(run: Run) -> Run:
        inputs = {
            name: _of_neighbours(values, noisy[name], apart) if name in noisy else values
            for name, values in run.measured.inputs.items()
        }
        return run.driven_by(inputs)

    return dataclasses.replace(case, runs=tuple(quiet(run) for run in case.runs))


def _of_neighbours(values: np.ndarray, sd: float, apart: int) -> np.ndarray:
    """Return a measured input at each row as the rows so far before and after it read it, where on the same level."""
    before, after = np.roll(values, apart), np.roll(values, -apart)
    before[:apart], after[-apart:] = np.nan, np.nan
    near = [np.where(np.abs(other - values) < 8.0 * sd, other, np.nan) for other in (before, after)]
    count = np.sum(np.isfinite(near), axis=0)
    alone = rows_held(values, np.arange(values.size)) < LONG
    return np.where(alone & (count > 0), np.nansum(near, axis=0) / np.maximum(count, 1), values)
