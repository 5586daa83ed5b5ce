"""What a series of readings shows by itself: its step, its fast scatter, its pauses, and where inputs rest or step."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.case import Run

MAD_OF_NORMAL = 0.6745
# A row so many times as long as those on both sides is a pause: nothing that was before it says anything of after it.
PAUSE = 10.0
# Rows about a step of an input that may show it.
_CALM = 2
# An input steps where it changes by so many robust sd of what its noise makes of a change.
_INPUT_MOVES = 4.0
# Of the largest value that an input has in the case: above it the hardware is loaded.
_LOADED = 0.03

Rows = Bool[np.ndarray, " rows"]
Values = Float[np.ndarray, " rows"]


def after_pauses(time_s: Values) -> Rows:
    """Return which rows come after a pause, the first among them."""
    rows = np.diff(time_s)
    beside = np.pad(rows, 1, constant_values=np.inf) if rows.size < 2 else np.pad(rows, 1, mode="reflect")
    return np.append(True, rows > PAUSE * np.maximum(beside[:-2], beside[2:]))[: time_s.size]


def off_the_neighbours(values: np.ndarray) -> np.ndarray:
    """Return by how much each value is off the mean of the one before and the one after."""
    return values[1:-1] - 0.5 * (values[:-2] + values[2:])


def robust_sd(values: np.ndarray) -> float:
    """Return a standard deviation that a few outliers do not change, missing values left aside; 0 without values."""
    values = values[np.isfinite(values)]
    return float(np.median(np.abs(values))) / MAD_OF_NORMAL if values.size else 0.0


def calm(run: Run) -> Rows:
    """Return at which rows no input steps, nor shortly before or after.

    Small steps count, 2 % of an input's range: they show in a fine sensor too.
    """
    moves = np.zeros(run.measured.time_s.size, dtype=bool)
    for values in run.measured.inputs.values():
        step = np.abs(np.diff(values, prepend=values[0]))
        moves |= step > _INPUT_MOVES * np.sqrt(2.0) * robust_sd(off_the_neighbours(values))
    near = np.convolve(moves, np.ones(2 * _CALM + 1), mode="same") > 0.5
    return ~near


def loads(run: Run) -> dict[str, Values]:
    """Return the inputs that load the hardware: all but the temperature of what is around it."""
    return {name: values for name, values in run.measured.inputs.items() if not name.endswith("degC")}


def loaded(run: Run, largest: dict[str, float]) -> Rows:
    """Return at which rows the hardware is loaded, held against the largest value of each input in the case."""
    found = np.zeros(run.measured.time_s.size, dtype=bool)
    for name, values in loads(run).items():
        if largest.get(name, 0.0) > 0.0:
            found |= np.abs(values) > _LOADED * largest[name]
    return found


def detect_quantum(readings: np.ndarray) -> float:
    """Find the step to which readings are rounded.

    The coarsest of 5, 2 and 1 x 10^k of which all readings are multiples; where they are also, within that rounding,
    whole multiples of a coarser step that is no round number (a converter's bit), that step.

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
    # The shortest gaps fix the bit well enough to count the bits in longer ones, which then fix it better.
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
