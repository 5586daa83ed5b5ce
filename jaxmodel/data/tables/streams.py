"""Streams of readings with clocks of their own, as robots log them, put into one table on the clock of one of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, listed, reason
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.names import matches
from jaxmodel.data.tables.raw_table import units_in
from jaxmodel.data.tables.units import is_unit

TIME = "Time (s)"
# What a stream may have that makes its clock that of the others, by quantity.
_ELECTRICAL = {
    "current": "current", "pack_current": "current", "motor_current": "current", "voltage": "voltage",
    "pack_voltage": "voltage", "motor_voltage": "voltage", "duty": "duty",
}  # fmt: skip
_MOST_NUMBERS = 50_000_000  # 400 MB
_FEWEST_ROWS = 2
_DAMAGED = "it is damaged"
_NAMED = 6  # streams that a sentence names

Readings = tuple[np.ndarray, dict[str, np.ndarray]]


def not_read(label: str, by: str, error: Exception, otherwise: str) -> MeasurementError:
    """Return the error for a file that a package could not read; what the system says of it tells a user nothing."""
    what = _DAMAGED if isinstance(error, OSError) else reason(error, _DAMAGED)
    return MeasurementError(f"{label} cannot be read by {by} ({what:.200}); {otherwise}.")


@dataclasses.dataclass(frozen=True, eq=False)
class Stream:
    """Readings that were logged together.

    Attributes:
        name: of the topic, message or group.
        columns: the names of its columns, different from those of all other streams.
        units: by column, as the file states them.
        rows: how many readings it has, about.
        load: returns its times [s], shape (rows,), and the readings by column, NaN where there is none.
    """

    name: str
    columns: tuple[str, ...]
    units: Mapping[str, str]
    rows: int
    load: Callable[[], Readings]

    def with_units(self) -> Stream:
        """Return the stream with its units in the names of its columns: 'BAT.Volt (V)'."""
        named = {name: _with_unit(name, self.units.get(name, "")) for name in self.columns}

        def load() -> Readings:
            time_s, readings = self.load()
            return time_s, {named[name]: values for name, values in readings.items()}

        return Stream(self.name, tuple(named.values()), {}, self.rows, load)


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if is_unit(unit) and "(" not in name else name


@dataclasses.dataclass(frozen=True, eq=False)
class Joined:
    """Streams on one clock: the table, units by column, what was done, and the columns that were not read."""

    frame: pd.DataFrame
    units: dict[str, str]
    remarks: tuple[str, ...]
    left_out: tuple[str, ...]


def join_streams(streams: Sequence[Stream], keep: Keep | None, held: bool = False) -> Joined | None:
    """Return streams as one table, None if no stream that is wanted has rows.

    The clock is that of the stream which has most of current, voltage and duty, and of these the one with most rows.
    Readings of the others are interpolated to it, and are missing outside of their own time.

    Args:
        streams: of one file.
        keep: chooses from the names of all columns those to be read; by default all. Where they are more than memory
            holds, those that may be of a bench are read.
        held: whether a reading stands until the next one, as where only changes are logged.
    """
    streams = [stream.with_units() for stream in streams if stream.rows >= _FEWEST_ROWS]
    names = [TIME, *(name for stream in streams for name in stream.columns)]
    wanted = set(names if keep is None else keep(names))
    chosen = {stream.name: [name for name in stream.columns if name in wanted] for stream in streams}
    of_bench = {stream.name: _quantities(chosen[stream.name]) for stream in streams}
    used = [stream for stream in streams if chosen[stream.name]]
    if not used:
        return None
    electrical = {name: {_ELECTRICAL[one] for one in found & _ELECTRICAL.keys()} for name, found in of_bench.items()}
    main = max(used, key=lambda one: (len(electrical[one.name]), bool(of_bench[one.name]), one.rows))
    if main.rows * sum(map(len, chosen.values())) > _MOST_NUMBERS:
        used = [stream for stream in used if of_bench[stream.name]] or [main]
        chosen = {stream.name: [name for name in chosen[stream.name] if matches(name)] for stream in used}
    time_s, _ = _in_order(*main.load())
    columns: dict[str, np.ndarray] = {TIME: time_s}
    for stream in used:
        own_s, readings = _in_order(*stream.load())
        for name in chosen[stream.name]:
            columns[name] = readings[name] if stream is main else _at(time_s, own_s, readings[name], held)
    others = [stream.name for stream in used if stream is not main]
    how = "held from one reading to the next" if held else "interpolated to it"
    remarks = [f"The clock is that of {main.name} ({time_s.size:,} readings)."]
    if others:
        remarks.append(f"Readings of {listed(others, _NAMED)} are {how}.")
    left_out = tuple(name for name in names if name not in columns)
    return Joined(pd.DataFrame(columns, copy=False), units_in(columns), tuple(remarks), left_out)


def _quantities(columns: Sequence[str]) -> set[str]:
    """Return the quantities that columns may be by their names."""
    return {match.quantity for name in columns for match in matches(name)}


def _in_order(time_s: np.ndarray, readings: dict[str, np.ndarray]) -> Readings:
    """Return readings by rising time, those without a time left out."""
    there = np.isfinite(time_s)
    if there.all() and np.all(np.diff(time_s) >= 0.0):
        return time_s, readings
    order = np.flatnonzero(there)[np.argsort(time_s[there], kind="stable")]
    return time_s[order], {name: values[order] for name, values in readings.items()}


def _at(time_s: np.ndarray, own_s: np.ndarray, values: np.ndarray, held: bool) -> np.ndarray:
    """Return readings at other times: interpolated between them, or the last one before."""
    there = np.isfinite(values)
    own_s, values = own_s[there], values[there]
    if not own_s.size:
        return np.full(time_s.size, np.nan)
    if not held:
        return np.interp(time_s, own_s, values, np.nan, np.nan)
    place = np.searchsorted(own_s, time_s, side="right") - 1
    return np.where(place >= 0, values[np.maximum(place, 0)], np.nan)
