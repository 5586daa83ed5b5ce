"""Times as files write them: numbers with a unit, durations, time stamps and dates of spreadsheets, in seconds."""

from __future__ import annotations

import re
import warnings
from typing import NamedTuple

import numpy as np
import pandas as pd

from jaxmodel.data.tables.raw_table import to_numbers
from jaxmodel.data.tables.units import conversion

_DURATION = re.compile(r"^\s*[+-]?(\d+\s*d(ays?)?[\s.]*)?\d+:\d{1,2}(:\d{1,2}([.,:]\d*)?)?\s*$", re.IGNORECASE)
_PARTS = r"^\s*(?:(?P<days>\d+)\s*d(?:ays?)?[\s.]*)?(?P<a>\d+):(?P<b>\d{1,2})(?::(?P<c>\d{1,2}(?:[.,:]\d*)?))?\s*$"
_SAMPLE = 200
# Seconds since 1970 of 1980 and 2100, and days of a spreadsheet's calendar for the same.
_EPOCH = (3.2e8, 4.1e9)
_SERIAL = (29_000.0, 73_500.0)
_SERIAL_EPOCH_DAYS = 25_569.0


class Times(NamedTuple):
    """Times in seconds; `absolute` ones are seconds since 1970. `form` says how they were written."""

    seconds: np.ndarray
    absolute: bool
    form: str
    known_unit: bool = True


def parse_times(column: pd.Series, unit: str) -> Times | None:
    """Return the times of a column in seconds, None if it holds none.

    Args:
        column: numbers, text, time stamps or durations.
        unit: of numbers; '' where the file states none.
    """
    if column.dtype.kind == "M":
        return Times(_epoch(column), True, "time stamps")
    if column.dtype.kind == "m":
        return Times(column.dt.total_seconds().to_numpy(dtype=float), False, "durations")
    if column.dtype.kind in "iufb":
        return _of_numbers(column.to_numpy(dtype=float), unit)
    text = column.astype("string")
    first = text.dropna().head(_SAMPLE)
    if first.empty:
        return None
    if first.str.match(_DURATION).mean() > 0.9:
        return Times(_durations(text), False, "durations as h:min:s")
    return _of_dates(text, first)


def _of_numbers(values: np.ndarray, unit: str) -> Times:
    there = values[np.isfinite(values)]
    middle = float(np.median(there[:: max(there.size // 10_000, 1)])) if there.size else 0.0
    if change := conversion(unit, "s") if unit else None:
        seconds = values if change.factor == 1.0 else values * change.factor
        absolute = _EPOCH[0] < middle * change.factor < _EPOCH[1] and change.factor <= 1.0
        return Times(seconds, absolute, f"numbers in {unit}")
    for factor, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")):
        if _EPOCH[0] < middle * factor < _EPOCH[1]:
            return Times(values * factor, True, f"{name} since 1970")
    if _SERIAL[0] < middle < _SERIAL[1] and there.size and float(np.ptp(there)) < 2000.0:
        return Times((values - _SERIAL_EPOCH_DAYS) * 86_400.0, True, "dates of a spreadsheet")
    return Times(values, False, "numbers without a unit, taken as seconds", known_unit=False)


def _durations(text: pd.Series) -> np.ndarray:
    """Return durations such as '1d 02:03:04.5', '25:00:01' or '03:04' (min:s) in seconds."""
    parts = text.str.extract(_PARTS, flags=re.IGNORECASE)
    last = parts["c"].str.replace(",", ".", regex=False).str.replace(":", ".", regex=False)

    def number(column: pd.Series) -> np.ndarray:
        return to_numbers(column)

    days, first, second, third = (number(column) for column in (parts["days"], parts["a"], parts["b"], last))
    of_hours = first * 3600.0 + second * 60.0 + np.nan_to_num(third)
    seconds = np.where(np.isnan(third), first * 60.0 + second, of_hours)
    return np.nan_to_num(days) * 86_400.0 + seconds


def _of_dates(text: pd.Series, first: pd.Series) -> Times | None:
    """Return time stamps; where day and month could be either, the order in which time goes on most evenly."""
    tried = []
    for day_first in (False, True):
        sample = pd.to_datetime(first, errors="coerce", dayfirst=day_first, format="mixed", utc=True)
        if sample.notna().mean() > 0.9:
            seconds = _epoch(sample)
            seconds = seconds[np.isfinite(seconds)]
            back = int(np.sum(np.diff(seconds) < 0.0))
            tried.append((back, float(np.ptp(seconds)), day_first))
    if not tried:
        return None
    day_first = min(tried)[2]
    form = "day first" if day_first and len({t[:2] for t in tried}) > 1 else ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that it tries stamp by stamp where no form fits the first
            stamps = pd.to_datetime(text, dayfirst=day_first, utc=True)
    except (ValueError, TypeError):
        stamps = pd.to_datetime(text, errors="coerce", dayfirst=day_first, format="mixed", utc=True)
    return Times(_epoch(stamps), True, f"time stamps, {form}" if form else "time stamps")


def _epoch(stamps: pd.Series) -> np.ndarray:
    """Return time stamps as seconds since 1970, NaN for none."""
    values = stamps.dt.tz_localize(None) if getattr(stamps.dt, "tz", None) is not None else stamps
    whole = values.to_numpy(dtype="datetime64[ns]").astype(np.int64)
    return np.where(values.isna().to_numpy(), np.nan, whole * 1e-9)
