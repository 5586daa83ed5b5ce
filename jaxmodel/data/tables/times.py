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
_COLON_MS = re.compile(r"(\s\d{1,2}:\d\d:\d\d):(\d{1,6})$")  # of a stamp, as loggers of benches write it
_IN_AN_HOUR = re.compile(r"^\s*[0-5]?\d:[0-5]\d[.,]\d+\s*$")
_PARTS = r"^\s*(?:(?P<days>\d+)\s*d(?:ays?)?[\s.]*)?(?P<a>\d+):(?P<b>\d{1,2})(?::(?P<c>\d{1,2}(?:[.,:]\d*)?))?\s*$"
_DATE = re.compile(r"^\s*\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}\s*$")
_TIME_OF_DAY = re.compile(r"^\s*([01]?\d|2[0-3]):\d{2}(:\d{2}([.,]\d+)?)?(\s*[ap]\.?m\.?)?\s*$", re.IGNORECASE)
_SAMPLE = 200
# Seconds since 1970 of 1980 and 2100, and days of a spreadsheet's calendar for the same.
_EPOCH = (3.2e8, 4.1e9)
_SERIAL = (29_000.0, 73_500.0)
_SERIAL_EPOCH_DAYS = 25_569.0
# Words of a name that tell the unit of whole numbers.
_IN_NAMES = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "msecs", "milli", "millis", "millisec", "milliseconds", "millisecond"),
    "µs": ("us", "µs", "usec", "usecs", "micro", "micros", "microsec", "microseconds", "microsecond"),
    "ns": ("ns", "nsec", "nano", "nanos", "nanoseconds", "nanosecond"),
    "min": ("minutes", "minute"),
    "h": ("hours", "hour"),
}
# Whole numbers that rise by so much per row are no seconds, unless by whole minutes, which a tester of cells may log.
_COUNTED = 1000.0
# From so much per row on they are µs, and from the first number of these pairs on they may be (assumed): a cell is
# read each 0.1 s to 1000 s, a motor or robot each 0.1 ms to some seconds.
_MICROS_OF_CELLS, _MICROS_OF_MOTORS = (1e5, 1e6), (5e3, 1e5)
# Whole numbers that rise by so much per row may be seconds or ms: of a cell and of what moves (assumed).
_DOUBTFUL_OF_CELLS, _DOUBTFUL_OF_MOTORS = 100.0, 2.0


# Elapsed times are in a unit whose size the time stamps beside them have within this share, over so many steps.
_SIZES = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0, "ms": 1e-3, "µs": 1e-6}
_SAME_UNIT, _FEWEST_STEPS = 0.05, 5


class Times(NamedTuple):
    """Times in seconds; `absolute` ones are seconds since 1970. `form` says how they were written."""

    seconds: np.ndarray
    absolute: bool
    form: str
    known_unit: bool = True


class Counted(NamedTuple):
    """What whole numbers without a unit count, and why; `sure` is false where only a person can tell."""

    unit: str
    why: str
    sure: bool


def unit_in_words(name: str) -> str:
    """Return the unit of time that a word of a column's name tells ('ms_today', 'millis'); '' for none."""
    words = set(re.split(r"[\W_\d]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()))
    return next((unit for unit, known in _IN_NAMES.items() if words.intersection(known)), "")


def counted_in(values: np.ndarray, moves: bool) -> Counted | None:
    """Return the unit of a clock of whole numbers by its size and by what it steps; None where it may be seconds.

    Args:
        values: of a column that states no unit.
        moves: whether it is the clock of a motor or robot, which is read more often than a cell.
    """
    there = values[np.isfinite(values)]
    steps = np.diff(there)
    steps = steps[steps > 0.0]
    if steps.size < 3 or np.any(there != np.round(there)) or _EPOCH[0] * 1e3 < float(np.median(there)):
        return None
    step = float(np.median(steps))
    if _EPOCH[0] < float(np.median(there)) < _EPOCH[1] and (step < _COUNTED or step % 60.0 == 0.0):
        return None  # seconds since 1970
    minutes = step % 60.0 == 0.0 and float(np.mean(steps == step)) > 0.9
    said = f"whole numbers up to {there.max():.12g} that rise by {step:.6g} per row"
    if step >= _COUNTED and float(np.max(np.abs(there))) > _COUNTED:
        doubtful, surely = _MICROS_OF_MOTORS if moves else _MICROS_OF_CELLS
        unit = "µs" if step >= surely else "ms"
        in_seconds = not moves and minutes and step <= 7200.0
        return Counted(unit, said, not in_seconds and not doubtful <= step < surely)
    least = _DOUBTFUL_OF_MOTORS if moves else _DOUBTFUL_OF_CELLS
    # Seconds begin at 0 and go by whole minutes; an uptime or the time of day begins anywhere.
    days = float(np.ptp(there)) > 86_400.0
    if step < least or (not moves and (minutes or not (days or there[0] > _COUNTED))):
        return None
    return Counted("ms", said, False)


def unit_by_stamps(elapsed: np.ndarray, stamps: np.ndarray) -> str | None:
    """Return the unit of elapsed times that state none, by the time stamps beside them.

    Args:
        elapsed: of each row; it may begin anew.
        stamps: of the same rows [s].

    Returns:
        None where the stamps fit no unit.
    """
    both = np.isfinite(elapsed) & np.isfinite(stamps)
    steps, seconds = np.diff(elapsed[both]), np.diff(stamps[both])
    on = (steps > 0.0) & (seconds >= 0.0)
    if on.sum() < _FEWEST_STEPS or not float(seconds[on].sum()) > 0.0:
        return None
    ratio = float(seconds[on].sum()) / float(steps[on].sum())
    return next((unit for unit, size in _SIZES.items() if abs(ratio / size - 1.0) < _SAME_UNIT), None)


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
    text = column.astype("string").str.replace(_COLON_MS, r"\1.\2", regex=True)
    first = text.dropna().head(_SAMPLE)
    if first.empty:
        return None
    if first.str.match(_IN_AN_HOUR).mean() > 0.99:
        return Times(_within_hours(text), False, "minutes and seconds, as a spreadsheet shows times; hours are counted")
    if first.str.match(_DURATION).mean() > 0.9:
        return Times(_durations(text), False, "durations as h:min:s")
    return _of_dates(text, first)


def date_and_time(dates: pd.Series, times: pd.Series) -> Times | None:
    """Return the time stamps that a column of dates and one of times of day make, None if they are none.

    Args:
        dates: text, or time stamps at midnight.
        times: text such as '16:39:41.300', or seconds of the day.
    """
    if dates.dtype.kind == "M" and times.dtype.kind == "f":
        days, seconds = _epoch(dates), times.to_numpy(dtype=float)
        there = np.isfinite(days) & np.isfinite(seconds)
        if (
            not there.any()
            or np.any(days[there] % 86_400.0 != 0.0)
            or not np.all((0.0 <= seconds) & (seconds < 86_400.0))
        ):
            return None
        return Times(days + seconds, True, "date and time of day")
    if any(column.dtype.kind in "iufbmM" for column in (dates, times)):
        return None
    date, time = dates.astype("string"), times.astype("string")
    first = (date.dropna().head(_SAMPLE), time.dropna().head(_SAMPLE))
    if first[0].empty or first[1].empty or first[0].str.match(_DATE).mean() < 0.9:
        return None
    if not time.dropna().str.match(_TIME_OF_DAY).mean() > 0.99:
        return None
    both = date.str.strip() + " " + time.str.strip().str.replace(",", ".", regex=False)
    found = _of_dates(both, both.dropna().head(_SAMPLE))
    return None if found is None else found._replace(form=f"date and time of day, {found.form}")


def _of_numbers(values: np.ndarray, unit: str) -> Times:
    there = values[np.isfinite(values)]
    middle = float(np.median(there[:: max(there.size // 10_000, 1)])) if there.size else 0.0
    if change := conversion(unit, "s") if unit else None:
        seconds = values if change.factor == 1.0 else values * change.factor
        absolute = _EPOCH[0] < middle * change.factor < _EPOCH[1] and change.factor <= 1.0
        return Times(seconds, absolute, f"numbers in {unit}")
    # A counter of µs passes through the numbers of seconds since 1970; its unit is known before this is asked.
    for factor, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")):
        if _EPOCH[0] < middle * factor < _EPOCH[1]:
            return Times(values * factor, True, f"{name} since 1970")
    parts_of_days = bool(np.any(there != np.round(there)))
    if _SERIAL[0] < middle < _SERIAL[1] and parts_of_days and float(np.ptp(there)) < 2000.0:
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


def _within_hours(text: pd.Series) -> np.ndarray:
    """Return times such as '59:58.5' in seconds; where they begin anew, another hour has passed."""
    parts = text.str.replace(",", ".", regex=False).str.split(":", expand=True)
    seconds = 60.0 * to_numbers(parts[0]) + to_numbers(parts[1])
    back = np.nan_to_num(np.diff(pd.Series(seconds).ffill().to_numpy(dtype=float), prepend=seconds[0])) < -1800.0
    return seconds + 3600.0 * np.cumsum(back)


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
