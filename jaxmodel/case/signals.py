"""Properties of a series of readings: rounding step, fast scatter, pauses, and rows without input changes."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.case.records import Run
from jaxmodel.model.robot import duty_of_signal

MAD_OF_NORMAL = 0.6745
# An interval so many times as long as those on both sides is a pause, across which readings are independent.
PAUSE = 10.0
# Rows around a step of an input that may be affected by it.
_CALM = 2
# Change of an input, in robust sd of its noise, that counts as a step.
_INPUT_MOVES = 4.0
# Share of the largest value of an input in the case above which the hardware is loaded.
_LOADED = 0.03

Rows = Bool[np.ndarray, " rows"]
Values = Float[np.ndarray, " rows"]


def after_pauses(time_s: Values) -> Rows:
    """Return which rows come after a pause, including the first row."""
    rows = np.diff(time_s)
    beside = np.pad(rows, 1, constant_values=np.inf) if rows.size < 2 else np.pad(rows, 1, mode="reflect")
    return np.append(True, rows > PAUSE * np.maximum(beside[:-2], beside[2:]))[: time_s.size]


def represented_s(time_s: Values) -> Values:
    """Return the seconds that each of at least two rows represents: half of the time to its neighbours.

    Nothing was read in a pause: the rows beside it represent no more than those beside them.
    """
    apart = np.diff(time_s)
    beside = np.pad(apart, 1, mode="edge" if apart.size < 2 else "reflect")
    apart = np.where(after_pauses(time_s)[1:], np.maximum(beside[:-2], beside[2:]), apart)
    return np.maximum(0.5 * (np.append(apart[0], apart) + np.append(apart, apart[-1])), 1e-9)


def off_the_neighbours(values: np.ndarray) -> np.ndarray:
    """Return the difference of each value from the mean of its two neighbours."""
    return values[1:-1] - 0.5 * (values[:-2] + values[2:])


def robust_sd(values: np.ndarray) -> float:
    """Return a robust sd, missing values ignored; 0 without values."""
    values = values[np.isfinite(values)]
    return float(np.median(np.abs(values))) / MAD_OF_NORMAL if values.size else 0.0


def white_sd(values: np.ndarray) -> float:
    """Return the robust sd of white noise on a series, by how far values are off the mean of their neighbours."""
    return robust_sd(off_the_neighbours(values)) / float(np.sqrt(1.5))


def duty_of(run: Run) -> Values:
    """Return the duty of a robot's run: its own input, or that of its operator's signal (eq. 22)."""
    inputs = run.measured.inputs
    return inputs["duty"] if "duty" in inputs else np.asarray(duty_of_signal(inputs["V_set"]))


def calm(run: Run) -> Rows:
    """Return the rows without a step of any input shortly before or after.

    Small steps count too, because a fine sensor shows them.
    """
    moves = np.zeros(run.measured.time_s.size, dtype=bool)
    for values in run.measured.inputs.values():
        step = np.abs(np.diff(values, prepend=values[0]))
        moves |= step > _INPUT_MOVES * np.sqrt(2.0) * robust_sd(off_the_neighbours(values))
    near = np.convolve(moves, np.ones(2 * _CALM + 1), mode="same") > 0.5
    return ~near


def loads(run: Run) -> dict[str, Values]:
    """Return the inputs that load the hardware: all except ambient temperatures."""
    return {name: values for name, values in run.measured.inputs.items() if not name.endswith("degC")}


def loaded(run: Run, largest: dict[str, float]) -> Rows:
    """Return the rows in which the hardware is loaded, relative to the largest value of each input in the case."""
    found = np.zeros(run.measured.time_s.size, dtype=bool)
    for name, values in loads(run).items():
        if largest.get(name, 0.0) > 0.0:
            found |= np.abs(values) > _LOADED * largest[name]
    return found


def detect_quantum(readings: np.ndarray) -> float:
    """Find the step to which readings are rounded.

    It is the coarsest of 5, 2 and 1 x 10^k of which all readings are multiples. If they are also, within that rounding,
    multiples of a coarser step that is no round number (a converter's bit), it is that step.

    Args:
        readings: (n,) readings; NaN is a missing one.

    Returns:
        The step in the readings' unit; 0 if all readings are equal or all are different.
    """
    values = np.asarray(readings, dtype=float)
    values = values[np.isfinite(values)]
    levels = np.unique(values)
    if len(levels) < 2 or len(levels) == len(values):
        return 0.0
    decimal = _decimal_step(levels)
    gaps = np.diff(levels)
    bit = gaps.min()
    if decimal == 0.0 or bit < 4.0 * decimal:
        return decimal
    # The shortest gaps determine the bit well enough to count bits in longer gaps, which determine it better.
    for reach in (1.5, 5.0, 20.0, np.inf):
        short = gaps[gaps <= reach * bit]
        bit = short.sum() / np.round(short / bit).sum()
    off_grid = (levels - levels[0]) / bit
    off_grid = np.abs(off_grid - np.round(off_grid)) * bit
    return float(bit) if off_grid.max() <= 1.1 * decimal else decimal


def _decimal_step(levels: np.ndarray) -> float:
    largest = np.abs(levels).max()
    top = int(np.floor(np.log10(np.diff(levels).min()))) + 1
    for exponent in range(top, -13, -1):
        for digit in (5.0, 2.0, 1.0):
            step = digit * 10.0**exponent
            multiples = levels / step
            if np.abs(multiples - np.round(multiples)).max() <= 1e-9 * max(1.0, largest / step):
                return step
    return 0.0


def without_readings(run: Run, channel: str, rows: Rows) -> Run:
    """Return a run with some readings of a channel missing."""
    outputs = run.measured.outputs | {channel: np.where(rows, np.nan, run.measured.outputs[channel])}
    return dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs))
