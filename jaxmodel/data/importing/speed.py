"""The speed of a motor whose log has only the angle of an encoder."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from jaxmodel.data.importing.findings import Decision
from jaxmodel.data.importing.logs import Log

POSITION = "position_rad"
_ORDER, _SHORTEST = 3, 7
_LONGEST_SHARE = 0.2  # of the rows of a run: the longest window
_FEWEST_ROWS = 40
# Rows are averaged until the angle moves by so many steps of the encoder from one to the next in a quarter of them:
# else its rounding is alike in neighbours and looks like motion.
_STEPS = 3.0


def with_speed(run: Log, *, keep: bool = False) -> Log:
    """Return a run with the speed where it has none, and without its angle unless that is to be kept.

    The speed is the slope of cubics through windows of the angle (Savitzky and Golay), on evenly spaced times. The
    window is the one of least generalised cross-validation error.
    """
    if POSITION not in run.columns:
        return run
    columns = {name: values for name, values in run.columns.items() if keep or name != POSITION}
    angle, without = run.columns[POSITION], dataclasses.replace(run, columns=columns)
    there = np.isfinite(angle) & np.isfinite(run.time_s)
    there[1:] &= np.diff(run.time_s) > 0.0
    if "speed_rad_s" in columns or there.sum() < _FEWEST_ROWS:
        return without
    time_s, angle = run.time_s[there], angle[there]
    step = float(np.median(np.diff(time_s)))
    even = np.arange(time_s[0], time_s[-1] + 0.5 * step, step)
    on_even = np.interp(even, time_s, angle)
    count = _averaged(on_even, angle)
    size = even.size // count * count
    even, on_even = (values[:size].reshape(-1, count).mean(axis=1) for values in (even, on_even))
    window = _window(on_even)
    slope = savgol_filter(on_even, window, _ORDER, deriv=1, delta=count * step)
    speed = np.full(run.rows, np.nan)
    speed[there] = np.interp(time_s, even, np.asarray(slope))
    why = f"slope of cubics through {window * count * step:.2g} s of the position"
    said = Decision("speed_rad_s", run.name, "from the position", why, "file")
    return dataclasses.replace(without, columns=columns | {"speed_rad_s": speed}).also(said)


def _averaged(angle: np.ndarray, read: np.ndarray) -> int:
    """Return how many rows of an evenly spaced angle are averaged into one; `read` is as logged."""
    moves = np.abs(np.diff(read))
    rounding = float(np.min(moves[moves > 1e-6 * np.ptp(read)], initial=np.inf))
    count = 1
    while angle.size > 2 * count * _FEWEST_ROWS:
        if np.percentile(np.abs(angle[count:] - angle[:-count]), 75) >= _STEPS * rounding:
            break
        count *= 2
    return count


def _window(angle: np.ndarray) -> int:
    """Return the number of rows of a window, odd."""
    longest = max(int(_LONGEST_SHARE * angle.size), _SHORTEST)
    windows = np.unique(np.geomspace(_SHORTEST, longest, 30).astype(int) // 2 * 2 + 1)

    def error(window: int) -> float:
        left = angle - np.asarray(savgol_filter(angle, window, _ORDER))
        return float(np.mean(left**2)) / (1.0 - float(savgol_coeffs(window, _ORDER)[window // 2])) ** 2

    return min(windows.tolist(), key=error)
