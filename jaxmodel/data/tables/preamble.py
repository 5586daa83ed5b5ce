"""The clock of a table without times, or whose times count rows: the head states how often it was sampled."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from jaxmodel.data.tables.names import matches, parse_name
from jaxmodel.data.tables.units import conversion

CLOCK = "Time (s)"
# Words for the time from row to row, and for the rows in a second.
_INTERVALS = frozenset(
    "sample interval|sampling interval|sample period|sampling period|sample time|sampling time|scan interval|"
    "log interval|logging interval|recording interval|interval|hresolution|increment|x increment|xincrement|xinc|"
    "time step|timestep|dt|ts|delta t|abtastintervall|abtastzeit|messintervall|采样间隔".split("|")
)
_RATES = frozenset(
    "sample rate|sampling rate|samplerate|fs|sampling frequency|sample frequency|abtastrate|abtastfrequenz|"
    "采样频率".split("|")
)
_LINE = re.compile(
    r"""^[\s#"'%!]*(?P<key>[^"',;:=\t]+?)["']?\s*[,;:=\t][\s"']*(?P<number>[+]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)"""
    r"""\s*(?P<unit>[^\s\d"',;:=]*)"""
)
_PER_SECOND = {
    "": 1.0,
    "hz": 1.0,
    "s/s": 1.0,
    "sa/s": 1.0,
    "1/s": 1.0,
    "khz": 1e3,
    "ks/s": 1e3,
    "mhz": 1e6,
    "ms/s": 1e6,
}
_OF_TIME = frozenset(["time", "step_time", "stamp"])
_SCALES = (1.0, 1e3, 1e6)  # of a clock in s, ms or µs


def interval_of(lines: Iterable[str], names: Sequence[str], units: Sequence[str]) -> float | None:
    """Return the time from row to row that the head of a file states [s], None if it states none.

    Args:
        lines: above the header.
        names: of the columns.
        units: of the line below them, which has the number where a name is 'Increment'; empty for no such line.
    """
    pairs = [f"{name}:{unit}" for name, unit in zip(names, units, strict=False)]
    for line in (*lines, *pairs):
        if (found := _LINE.match(line)) is None:
            continue
        words, in_key = parse_name(found["key"])
        unit = found["unit"].strip() or in_key
        value = float(found["number"].replace(",", "."))
        if value <= 0.0:
            continue
        if words in _INTERVALS and (change := conversion(unit or "s", "s")) is not None:
            return value * change.factor
        if words in _RATES and (per_second := _PER_SECOND.get(unit.lower())) is not None:
            return 1.0 / (value * per_second)
    return None


def lacks_times(names: Sequence[str], units: Sequence[str]) -> bool:
    """Return whether no column is of times by its name or unit."""
    stated = [*units, *[""] * len(names)]
    return not any(
        any(match.quantity in _OF_TIME for match in matches(name, unit))
        or bool((unit or parse_name(name).unit) and conversion(unit or parse_name(name).unit, "s"))
        for name, unit in zip(names, stated, strict=False)
    )


def is_sampled_so(frame: pd.DataFrame, interval_s: float) -> bool:
    """Return whether some column rises by just this interval from row to row, and is the clock itself."""
    for name in frame:
        if frame[name].dtype.kind in "iuf" and len(frame) > 2:
            steps = np.diff(frame[name].to_numpy(dtype=float)) / interval_s
            if any(np.allclose(steps, scale, rtol=0.01) for scale in _SCALES):
                return True
    return False


def row_counter(frame: pd.DataFrame, units: Mapping[str, str]) -> str:
    """Return the column of times that states no unit and counts rows, 0, 1, 2, ...; "" where none does."""
    for name in frame:
        if str(name) in units or not any(match.quantity == "time" for match in matches(str(name), "")):
            continue
        if frame[name].dtype.kind in "iuf" and len(frame) > 2 and np.all(np.diff(frame[name].to_numpy(float)) == 1.0):
            return str(name)
    return ""
