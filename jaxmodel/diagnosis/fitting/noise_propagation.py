"""Propagation of the noise of measured inputs through a calibrated model."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.case.records import Case
from jaxmodel.diagnosis.fitting.lanes import predictions
from jaxmodel.diagnosis.fitting.model import ModelSpace, Setting
from jaxmodel.diagnosis.noise.input_noise import InputNoise, MovedInputs
from jaxmodel.diagnosis.noise.instrument import NoiseModel
from jaxmodel.diagnosis.preparation.held_inputs import noisy_inputs


def propagated_noise(
    case: Case, noise: Mapping[str, NoiseModel], space: ModelSpace, setting: Setting, x: np.ndarray
) -> tuple[dict[str, NoiseModel], InputNoise]:
    """Return the noise that measured inputs cause: added to the noise of each channel, and for each reading.

    Args:
        case: with its measurements.
        noise: of each output column to be used.
        space: the programs.
        setting: the model.
        x: (unknowns,) calibrated coordinates.
    """
    problem, still = space.problem(setting), setting.lane(x)

    def readings(moves: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        return predictions(problem, [dataclasses.replace(still, added=dict(move)) for move in moves])

    moved = MovedInputs(readings, problem.tracks, noisy_inputs(case))
    variance = moved.variance()
    found = dict(noise)
    for place, name in enumerate(problem.channels):
        if name in noise:
            runs = [run.measured for run in case.runs]
            read = [v[: r.time_s.size, place] for v, r in zip(variance, runs, strict=True) if name in r.outputs]
            found[name] = noise[name].with_from_inputs(float(np.sqrt(np.mean(np.concatenate(read)))))
    return found, InputNoise(variance, moved.to_slow_noise())
