"""Two loggers of one run: an electrical log and one of thermometers, put on one clock, and the shift between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmodel.case.measurements import file_label
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log

_ELECTRICAL = ("current_A", "voltage_V", "pack_current_A", "pack_voltage_V", "duty")
_SHIFTS = 121
# A shift is told where it lowers the error of the warming by this share.
_GAIN = 0.1
_POINTS = 2000
_FEWEST_ROWS = 10  # of two logs that are the same


def joined(logs: Sequence[Log]) -> list[Log]:
    """Return logs in which those without electrical readings are joined to the electrical log of the same run.

    A log of thermometers belongs to the electrical log whose time stamps it overlaps most, or, without time stamps, to
    the one whose name begins alike; where there is one of each, they belong together.
    """
    electrical = [log for log in logs if any(name in log.columns for name in _ELECTRICAL)]
    others = [log for log in logs if not any(log is one for one in electrical)]
    result = list(electrical)
    for other in others:
        # What is of one motor of a file is no second logger of another.
        place = _partner(other, electrical) if not other.specimen else None
        if place is None:
            result.append(other)
            continue
        result[place] = join(result[place], other)
    return result


def copies(logs: Sequence[Log]) -> list[Finding]:
    """Return which logs hold, row by row, the readings of one before."""
    found = []
    for number, log in enumerate(logs):
        twin = next((one for one in logs[:number] if _same(one, log)), None)
        if twin is not None:
            one, other = file_label(twin.source), file_label(log.source)
            sentence = (
                f"{other} holds the same readings as {one}, row by row: one log under two names. Leave one out, or a "
                "check run may be one of those that are fitted."
            )
            found.append(Finding("same log", other, sentence, "warning", numbers={"rows": float(log.rows)}))
    return found


def _same(one: Log, other: Log) -> bool:
    if one.specimen != other.specimen and one.source == other.source:  # two motors that do the same
        return False
    if one.rows != other.rows or one.rows < _FEWEST_ROWS or one.columns.keys() != other.columns.keys():
        return False
    pairs = [(values, other.columns[name]) for name, values in one.columns.items()]
    # The first rows of most logs differ.
    parts = (slice(_FEWEST_ROWS), slice(None))
    if not all(np.allclose(a[rows], b[rows], 1e-6, 1e-9, equal_nan=True) for rows in parts for a, b in pairs):
        return False
    return any(np.nanmax(a) > np.nanmin(a) for a, _ in pairs if np.isfinite(a).any())


def _partner(other: Log, electrical: Sequence[Log]) -> int | None:
    if len(electrical) == 1:
        return 0
    if other.stamp_s is not None and other.rows > 1:
        overlaps = [_overlap(other, log) for log in electrical]
        if overlaps and max(overlaps) > 0.0:
            return int(np.argmax(overlaps))
    alike = [len(_common_start(other.name, log.name)) for log in electrical]
    return int(np.argmax(alike)) if alike and max(alike) >= 4 and alike.count(max(alike)) == 1 else None


def _overlap(one: Log, other: Log) -> float:
    if one.stamp_s is None or other.stamp_s is None:
        return 0.0
    first, last = (
        max(np.nanmin(one.stamp_s), np.nanmin(other.stamp_s)),
        min(np.nanmax(one.stamp_s), np.nanmax(other.stamp_s)),
    )
    return float(max(last - first, 0.0))


def _common_start(one: str, other: str) -> str:
    size = next((n for n, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
    return one[:size]


def join(electrical: Log, other: Log) -> Log:
    """Return an electrical log with the readings of another, interpolated to its rows; NaN outside the other's time."""
    stamped = electrical.stamp_s is not None and other.stamp_s is not None
    if stamped:
        assert electrical.stamp_s is not None
        assert other.stamp_s is not None
        start = float(
            other.stamp_s[np.isfinite(other.stamp_s)][0] - electrical.stamp_s[np.isfinite(electrical.stamp_s)][0]
        )
        start += float(electrical.time_s[0] - other.time_s[0])
    else:
        start = float(electrical.time_s[0] - other.time_s[0])
    times = other.time_s + start
    columns = dict(electrical.columns)
    for name, values in other.columns.items():
        if name not in columns:
            there = np.isfinite(values)
            if there.any():
                columns[name] = np.interp(electrical.time_s, times[there], values[there], np.nan, np.nan)
    why = "by their time stamps" if stamped else "assumed to have begun together"
    log = dataclasses.replace(electrical, columns=columns, findings=electrical.findings + other.findings)
    log = log.also(
        *other.decisions,
        Decision("two loggers", electrical.name, f"joined with {other.name}", why, "file" if stamped else "assumed"),
    )
    return log.also(*shift_of(log))


def shift_of(log: Log) -> list[Finding]:
    """Return the shift between heat and thermometer if one explains the warming better than none.

    The warming is T' = a I^2 + b (T_a - T), fitted by least squares with the current moved by each of a range of times.
    """
    name = next(
        (n for n in ("cell_temperature_degC", "winding_temperature_degC", "case_temperature_degC") if n in log.columns),
        None,
    )
    current = log.columns.get("current_A", log.columns.get("pack_current_A"))
    if name is None or current is None:
        return []
    warm = log.columns[name]
    there = np.isfinite(warm) & np.isfinite(current)
    if there.sum() < 100 or np.ptp(warm[there]) < 1.0:
        return []
    span = float(log.time_s[there][-1] - log.time_s[there][0])
    time_s = np.linspace(log.time_s[there][0], log.time_s[there][-1], _POINTS)
    temperature = np.interp(time_s, log.time_s[there], warm[there])
    width = max(_POINTS // 200, 3)
    smooth = np.convolve(temperature, np.ones(width) / width, "same")
    rate = np.gradient(smooth, time_s)
    heat = np.concatenate([[0.0], np.cumsum(np.nan_to_num(current)[1:] ** 2 * np.diff(log.time_s))])
    shifts = np.linspace(-0.05 * span, 0.05 * span, _SHIFTS)
    inner = slice(_POINTS // 12, -(_POINTS // 12))
    step = time_s[1] - time_s[0]
    errors = []
    for shift in shifts:
        moved = np.interp(time_s + shift + step / 2, log.time_s, heat) - np.interp(
            time_s + shift - step / 2, log.time_s, heat
        )
        design = np.stack([moved / step, smooth, np.ones(_POINTS)], axis=1)[inner]
        fitted = np.linalg.lstsq(design, rate[inner], rcond=None)[0]
        left = rate[inner] - design @ fitted
        # A current that cools is none: half a period away, a load that repeats fits as well with the other sign.
        errors.append(float(np.sqrt(np.mean(left**2))) if fitted[0] > 0.0 or shift == 0.0 else np.inf)
    best, none = int(np.argmin(errors)), errors[_SHIFTS // 2]
    by = float(shifts[best])
    edge = best in (0, _SHIFTS - 1)
    if edge or errors[best] > (1.0 - _GAIN) * none or abs(by) < 3.0 * float(np.median(np.diff(log.time_s))):
        return []
    # A thermometer lags by itself; only one that is early, or late by much, tells of the clocks.
    if -0.01 * span < by < 0.0:
        return []
    late = "early" if by > 0.0 else "late"
    sentence = (
        f"{log.name}: {name} follows the heat of the current best if its clock is {abs(by):.3g} s {late} "
        "(error of the warming "
        f"{1.0 - errors[best] / none:.0%} smaller); the clocks of the two loggers seem shifted. Nothing was moved."
    )
    return [Finding("clock shift", log.name, sentence, "warning", name, numbers={"shift_s": by})]
