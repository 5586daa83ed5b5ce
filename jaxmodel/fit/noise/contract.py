"""The noise of every output of a case, and its source."""

from __future__ import annotations

import numpy as np

from jaxmodel.case.records import Case
from jaxmodel.case.signals import after_pauses
from jaxmodel.fit.noise.instrument import NoiseModel, break_at_jumps, channel_noise, local_noise

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
        calm[run.name] = break_at_jumps(after_pauses(run.measured.time_s), inputs, settling_rows=3)
    for name in case.vocabulary.outputs:
        runs = [run for run in case.runs if name in run.measured.outputs]
        readings = [run.measured.outputs[name] for run in runs]
        if not runs or not any(np.isfinite(values).any() for values in readings):
            continue
        times = [run.measured.time_s for run in runs]
        series = [np.concatenate(part) for part in (readings, [calm[run.name] for run in runs], times)]

        def estimate(known_sd, series=series):
            return local_noise(*series, known_sd=known_sd, window=_WINDOW)

        model = channel_noise(series[0], estimate, stated_sd=case.sensors.get(name))
        if model.sd > 0.0:
            noise[name] = model
    return noise
