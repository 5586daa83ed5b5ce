"""Logs with one reading per line: a time, the name of a signal, its value, as buses and databases export them."""

from __future__ import annotations

import csv
import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.names import matches, parse_name
from jaxmodel.data.tables.raw_table import RawTable, to_numbers
from jaxmodel.data.tables.sniffing import encoding_of, split
from jaxmodel.data.tables.streams import TIME, Readings, Stream, join_streams
from jaxmodel.data.tables.times import parse_times

# What such logs call the columns of a signal's name, its value, its unit and its time, in lower case.
_SIGNALS = frozenset(
    "signal|signal name|name|variable|variable name|channel|channel name|parameter|parameter name|pid|metric|sensor|"
    "sensor name|entity id|key|field|tag|tag name|topic|measurement|item|quantity|signalname|messwert|kanal".split("|")
)
_VALUES = frozenset(
    "value|reading|val|state|physical value|phys value|physical|signal value|number|wert|messwert|data".split("|")
)
_UNITS = frozenset(["unit", "units", "einheit", "unit of measurement"])
_TIMES = (
    "time", "timestamp", "time stamp", "datetime", "date time", "date", "last changed", "last updated", "ts", "t",
    "seconds", "secs", "time s", "zeit", "zeitstempel", "elapsed", "epoch", "millis", "ms",
)  # fmt: skip
_OF_THEIR_OWN = frozenset(["current", "voltage", "speed"])  # a table with such a column has one for each signal
_DELIMITERS = ("\t", ";", ",", "|")
_HEADER_WITHIN = 40  # lines
_SAMPLE_LINES = 400
_FEWEST_NUMBERS = 0.2  # of the values of the first lines
_MOST_SIGNALS = 5000
# A log of changes: of so few readings does a signal repeat the one before, and its longest pause is so many usual ones.
_ENOUGH = 8  # readings that tell
_FEW_REPEATS = 0.01
_LONG_PAUSE = 20.0


class _Form(NamedTuple):
    """Where such a log has what: line of the header, delimiter, and the columns by their place."""

    encoding: str
    header: int
    delimiter: str
    names: tuple[str, ...]
    time: int
    signal: int
    value: int
    unit: int | None


def form_of_long(path: Path, encoding: str | None = None) -> _Form | None:
    """Return how a log with one reading per line is laid out, None for a file that is no such log.

    Args:
        path: the file.
        encoding: a codec of Python; by default found.
    """
    try:
        encoding = encoding or encoding_of(path)
        with path.open(encoding=encoding, errors="replace") as stream:
            lines = [line.rstrip("\r\n") for line in itertools.islice(stream, _HEADER_WITHIN + _SAMPLE_LINES)]
    except (MeasurementError, LookupError):  # said by the reader of tables
        return None
    for number, line in enumerate(lines[:_HEADER_WITHIN]):
        for delimiter in _DELIMITERS:
            if (form := _form(number, split(line.lstrip("# "), delimiter), delimiter, encoding)) is not None:
                rows = [split(row, delimiter) for row in lines[number + 1 :] if row.strip()]
                return form if _holds_signals([row for row in rows if len(row) == len(form.names)], form) else None
    return None


def _form(number: int, names: Sequence[str], delimiter: str, encoding: str) -> _Form | None:
    """Return the form that a line of names states, None if it names no signal, value and time."""
    words = [parse_name(name).words for name in names]
    time = next((words.index(word) for word in _TIMES if word in words), None)
    signal, value, unit = (
        next((place for place, word in enumerate(words) if word in known and place != time), None)
        for known in (_SIGNALS, _VALUES - ({"messwert"} if "wert" in words else set()), _UNITS)
    )
    if time is None or signal is None or value is None or signal == value:
        return None
    if any(match.quantity in _OF_THEIR_OWN for name in names for match in matches(name) if match.rank < 100):
        return None
    return _Form(encoding, number, delimiter, tuple(names), time, signal, value, unit)


def _holds_signals(rows: Sequence[Sequence[str]], form: _Form) -> bool:
    """Return whether rows hold signals whose names come again and are no numbers, and values that are numbers.

    The first of them may be of one signal alone, where the log is sorted by signal, and many may be of words.
    """
    signals = Counter(row[form.signal] for row in rows)
    named = sum(not _is_number(name) for name in signals.elements())
    values = sum(_is_number(row[form.value].replace(",", ".")) for row in rows)
    again = 1 <= len(signals) <= max(len(rows) // 2, 2)
    return again and named == len(rows) and values > _FEWEST_NUMBERS * len(rows)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_long(path: Path, form: _Form, keep: Keep | None = None) -> RawTable:
    """Read a log with one reading per line: a column for each signal, on one clock.

    Args:
        path: the file.
        form: of `form_of_long`.
        keep: chooses from the names of all signals those to be read; by default all.

    Raises:
        MeasurementError: it cannot be read, or has no times or no numbers.
    """
    label = file_label(path)
    places = [form.time, form.signal, form.value, *([] if form.unit is None else [form.unit])]
    try:
        frame = pd.read_csv(
            path, sep=form.delimiter, skiprows=form.header + 1, header=None, names=list(range(len(form.names))),
            usecols=places, dtype="string", encoding=form.encoding, encoding_errors="replace", on_bad_lines="skip",
            skipinitialspace=True, quoting=csv.QUOTE_MINIMAL,
        )  # fmt: skip
    except (pd.errors.ParserError, csv.Error, ValueError) as error:
        raise MeasurementError(f"{label} cannot be read as a list of readings ({error}); export it again.") from error
    values = to_numbers(_pointed(frame[form.value]))
    clock = _pointed(frame[form.time])
    counts = to_numbers(clock)
    name = form.names[form.time]
    if np.isfinite(counts).mean() > 0.5:
        times, name = counts, name or TIME
    else:
        found = parse_times(frame[form.time], "")
        if found is None:
            raise MeasurementError(f"{label}: column '{name}' holds no times; export the readings with their times.")
        times, name = found.seconds, TIME
    rows = np.isfinite(times) & np.isfinite(values)
    lost = int((~rows).sum())
    signals = frame[form.signal].fillna("").to_numpy(dtype=object)
    units = frame[form.unit].fillna("").to_numpy(dtype=object) if form.unit is not None else None
    streams, on_change = [], []
    for signal, chosen in pd.Series(np.arange(len(frame))[rows]).groupby(signals[rows], sort=False):
        if len(streams) < _MOST_SIGNALS and signal:
            at = chosen.to_numpy()
            unit = "" if units is None else str(units[at[0]])
            streams.append(_stream(str(signal), unit, times[at], values[at]))
            if at.size >= _ENOUGH:
                on_change.append(_is_of_changes(times[at], values[at]))
    held = bool(on_change) and all(on_change)
    joined = join_streams(streams, _named_so(keep, name), held)
    if joined is None:
        raise MeasurementError(f"{label} is a list of readings without a signal of numbers; give one that has.")
    losses = (f"{lost:,} of {len(frame):,} lines have no number or no time and were left out.",) if lost else ()
    remark = f"Each line has one reading: '{form.names[form.value]}' of '{form.names[form.signal]}'."
    table = joined.frame.rename(columns={TIME: name})
    known = {name if column == TIME else column: unit for column, unit in joined.units.items()}
    if name != TIME:
        known.pop(name, None)
        known |= {name: unit} if (unit := parse_name(name).unit) else {}
    return RawTable(
        table, known, path, "list of readings", (remark, *joined.remarks), form.header + 2, left_out=joined.left_out,
        losses=losses,
    )  # fmt: skip


def _named_so(keep: Keep | None, name: str) -> Keep | None:
    """Return a choice among names of which the clock's is that of the file."""
    if keep is None or name == TIME:
        return keep
    return lambda names: [TIME if one == name else one for one in keep([name if n == TIME else n for n in names])]


def _pointed(text: pd.Series) -> pd.Series:
    """Return numbers as text with a decimal point."""
    text = text.str.strip()
    return text.str.replace(",", ".", regex=False) if not text.str.contains(".", regex=False).any() else text


def _stream(name: str, unit: str, times: np.ndarray, values: np.ndarray) -> Stream:
    def load() -> Readings:
        return times, {name: values}

    return Stream(name, (name,), {name: unit}, times.size, load)


def _is_of_changes(times: np.ndarray, values: np.ndarray) -> bool:
    """Return whether a signal is logged when it changes: no reading repeats the one before, and pauses are long."""
    pauses = np.diff(np.sort(times))
    pauses = pauses[pauses > 0.0]
    repeats = float(np.mean(values[1:] == values[:-1]))
    return repeats < _FEW_REPEATS and bool(pauses.size) and float(pauses.max()) > _LONG_PAUSE * float(np.median(pauses))
