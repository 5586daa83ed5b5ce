"""The noise of every output of a case, and its source."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from jaxmodel.case.measurements import KINDS
from jaxmodel.case.records import Case, Run
from jaxmodel.diagnosis.noise.instrument import NoiseModel, break_at_jumps, channel_noise, local_noise
from jaxmodel.diagnosis.noise.whitening import chain_starts
from jaxmodel.diagnosis.preparation.held_inputs import LONG, noisy_inputs, rows_held

# Rows of the windows in which noise is estimated; short, to exclude slow signals.
_WINDOW = 12


def noise_of_case(case: Case) -> dict[str, NoiseModel]:
    """Return the noise of every output that the case measured, in the order of the kind's outputs.

    A stated sd is used unless the scatter of the readings contradicts it, and quantisation is added. Without a stated
    sd it is estimated from the readings between jumps of the inputs. Channels with constant readings and unknown noise
    are left out.
    """
    noise = {}
    calm = {}
    for run in case.runs:
        inputs = np.stack(list(run.measured.inputs.values()), axis=1)
        calm[run.name] = break_at_jumps(chain_starts([run.measured.time_s]), inputs, settling_rows=3)
    for name in KINDS[case.kind].outputs:
        runs = [run for run in case.runs if name in run.measured.outputs]
        readings = [run.measured.outputs[name] for run in runs]
        if not runs or not any(np.isfinite(values).any() for values in readings):
            continue
        times = [run.measured.time_s for run in runs]
        series = [np.concatenate(part) for part in (readings, [calm[run.name] for run in runs], times)]

        def estimate(known_sd, series=series):
            return local_noise(*series, known_sd=known_sd, window=_WINDOW)

        model = channel_noise(
            series[0],
            estimate,
            stated_sd=case.sensors.get(name),
        )
        if model.sd > 0.0:
            noise[name] = model
    return noise


def without_input_noise(case: Case, noise: Mapping[str, NoiseModel]) -> Case:
    """Return the case with noisy inputs replaced by the mean of neighbouring rows, unless they were held constant.

    The noise of a measured input is also in the residual of its row; as a function of that input it would look like a
    physical law.
    """
    noisy = noisy_inputs(case)
    # Whitening autocorrelated noise mixes a row with the previous one, so that the nearest neighbours are not
    # independent.
    apart = 2 if any(model.rho != 0.0 for model in noise.values()) else 1

    def quiet(run: Run) -> Run:
        inputs = {
            name: _of_neighbours(values, noisy[name], apart) if name in noisy else values
            for name, values in run.measured.inputs.items()
        }
        return run.driven_by(inputs)

    return dataclasses.replace(case, runs=tuple(quiet(run) for run in case.runs))


def _of_neighbours(values: np.ndarray, sd: float, apart: int) -> np.ndarray:
    """Return a measured input at each row as the mean of rows before and after it on the same level."""
    before, after = np.roll(values, apart), np.roll(values, -apart)
    before[:apart], after[-apart:] = np.nan, np.nan
    near = [np.where(np.abs(other - values) < 8.0 * sd, other, np.nan) for other in (before, after)]
    count = np.sum(np.isfinite(near), axis=0)
    alone = rows_held(values, np.arange(values.size)) < LONG
    return np.where(alone & (count > 0), np.nansum(near, axis=0) / np.maximum(count, 1), values)
