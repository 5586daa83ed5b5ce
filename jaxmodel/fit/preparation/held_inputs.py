"""Noisy inputs that were held constant: their mean is more accurate than each reading.

During a pulse, a rest or a constant load, the readings of an input differ only by sensor noise. The model would pass
this noise on through its resistances, count it as charge, and see currents at rest (hysteresis depends on the size of
the current). Each stretch between two jumps is averaged if noise of the stated sd explains its scatter and its drift.
If such stretches are not most of a run (a drive cycle, a ramp), all readings stay as they are: averaging a changing
input would cause a systematic error.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.special import chdtri, kolmogi

from jaxmodel.case.records import Case
from jaxmodel.fit.noise.of_speed import SPEED, speed_sd

# Difference of neighbours, in sd, that counts as a jump.
_JUMP = 6.0
# Smallest probability of the scatter, and of the drift, of the readings of a held input.
_IMPROBABLE = 1e-3
# An input is held if it is constant for so many rows; it is averaged if that is at least this share of the run.
_LONG, _MOST = 8, 0.8

# A speed within so many sd of zero, for so many rows, is that of a motor that stands. Assumed.
_AT_REST, _ROWS_AT_REST = 4.0, 3


def with_held_inputs(case: Case) -> Case:
    """Return a case with noisy inputs replaced by their means where they were held."""
    noisy = {name: sd for name, sd in case.sensors.items() if name in case.runs[0].measured.inputs}
    speed_noise = speed_sd(case) if SPEED in case.runs[0].measured.inputs else 0.0
    runs = []
    for run in case.runs:
        inputs = {n: held(v, noisy[n]) if n in noisy else v for n, v in run.measured.inputs.items()}
        if SPEED in inputs:
            inputs[SPEED] = at_rest(inputs[SPEED], speed_noise)
        runs.append(run.driven_by(inputs))
    return dataclasses.replace(case, runs=tuple(runs))


def at_rest(speed: np.ndarray, sd: float) -> np.ndarray:
    """Return a speed (rows,) that is exactly 0 where it cannot be told from that for some rows.

    A motor that stands draws nothing; the noise of its speed would make it brake, and a voltage drop of the brushes,
    which holds small currents back, would seem to explain that.
    """
    near = np.abs(speed) <= _AT_REST * sd
    begins = np.append(0, np.flatnonzero(np.diff(near.astype(np.int8))) + 1)
    rows = np.diff(np.append(begins, near.size))
    long = np.repeat(rows >= _ROWS_AT_REST, rows)
    return np.where(near & long, 0.0, speed)


def held(values: np.ndarray, sd: float) -> np.ndarray:
    """Return readings (rows,) of an input, with each stretch in which it was held replaced by its mean.

    It was held where noise of this sd explains the scatter about the mean and the drift of the cumulative sum.
    """
    begins = np.append(0, np.flatnonzero(np.abs(np.diff(values)) > _JUMP * sd) + 1)
    rows = np.diff(np.append(begins, values.size))
    stretch = np.repeat(np.arange(rows.size), rows)
    mean = np.add.reduceat(values, begins) / rows
    away = (values - mean[stretch]) / sd
    drift = np.cumsum(away)
    drift -= (drift[begins] - away[begins])[stretch]
    lengths, place = np.unique(rows, return_inverse=True)
    most_scatter = chdtri(np.maximum(lengths - 1, 1), _IMPROBABLE)[place]
    most_drift = kolmogi(_IMPROBABLE) * np.sqrt(rows)
    steady = (rows >= _LONG) & (np.add.reduceat(away**2, begins) < most_scatter)
    steady &= np.maximum.reduceat(np.abs(drift), begins) < most_drift
    if np.sum(rows[steady]) < _MOST * values.size:
        return values
    return np.where(steady[stretch], mean[stretch], values)
