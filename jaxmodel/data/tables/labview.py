"""Text that LabVIEW writes (.lvm): headers between '***End_of_Header***', one for each segment of a measurement."""

from __future__ import annotations

import dataclasses
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.raw_table import RawTable, repeated_names, to_numbers, unique_names, units_in
from jaxmodel.data.tables.sniffing import encoding_of
from jaxmodel.data.tables.streams import TIME, Stream, join_streams

_START = "LabVIEW Measurement"
_END = "***End_of_Header***"
_X_NAMES = ("X_Value", "X Value")


@dataclasses.dataclass(frozen=True)
class _Segment:
    """One segment: its own header by key, the names of its columns and its rows, each field a text."""

    header: dict[str, list[str]]
    names: list[str]
    rows: pd.DataFrame


def is_labview(path: Path) -> bool:
    """Return whether a file begins as text of LabVIEW does."""
    with path.open("rb") as stream:
        start = stream.read(64)
    return start.lstrip(b"\xef\xbb\xbf").startswith(_START.encode())


def read_labview(path: Path, encoding: str | None = None) -> RawTable:
    """Read a measurement that LabVIEW wrote as text, of one or many segments, with or without columns of times.

    Segments with the same columns follow each other. Without columns of times (`X_Columns No`), the time of row k is
    X0 + k Delta_X.

    Args:
        path: the file.
        encoding: a codec of Python; by default found.

    Raises:
        MeasurementError: it holds no table.
    """
    label = file_label(path)
    text = path.read_text(encoding=encoding or encoding_of(path), errors="replace")
    head, _, body = text.partition(_END)
    general = _header(head.splitlines())
    separator = "," if _value(general, "Separator").lower() == "comma" else "\t"
    decimal = _value(general, "Decimal_Separator") or "."
    x_columns = _value(general, "X_Columns").lower() or "one"
    segments = _segments(body, separator, label, _described(head))
    many = [_table(segment, x_columns == "no", decimal) for segment in segments]
    first = many[0].columns
    same = [table for table in many if list(table) == list(first)]
    frame = pd.concat(same, ignore_index=True)
    remarks = [f"Text of LabVIEW, {len(same)} {'segment' if len(same) == 1 else 'segments'}, X_Columns {x_columns}."]
    losses = (
        [] if len(same) == len(many) else [f"{len(many) - len(same)} segments have other columns and were not read."]
    )
    units = units_in(map(str, frame)) | _units(segments[0], list(first))
    return RawTable(
        frame,
        units,
        path,
        "LabVIEW text",
        tuple(remarks),
        losses=tuple(losses),
        repeated=repeated_names(name for name in segments[0].names if name not in _X_NAMES),
    )


def _header(lines: Sequence[str]) -> dict[str, list[str]]:
    """Return the fields behind each key of a header; the separator of its fields is not known yet."""
    found = {}
    for line in lines:
        key, *fields = re.split(r"[\t,]", line.strip("\r\n"), maxsplit=1)
        if key.strip():
            found[key.strip()] = fields
    return found


def _value(header: dict[str, list[str]], key: str) -> str:
    """Return the first field behind a key, '' if the header does not have it; a lone comma is a decimal mark."""
    field = next(iter(header.get(key, [])), None)
    if field is None:
        return ""
    return field.strip() or ("," if key == "Decimal_Separator" else "")


def _described(head: str) -> list[str]:
    """Return the columns that the description of a header lists: 'Columns are: time, current, and voltage'."""
    found = re.search(r"^Description[\t,][^:\n]*:(.*)$", head, re.MULTILINE)
    if found is None:
        return []
    return [re.sub(r"^and\s+", "", part.strip()) for part in re.split(r"[,;]", found[1])]


def _segments(body: str, separator: str, label: str, described: Sequence[str]) -> list[_Segment]:
    """Return the segments of a file below its first header.

    Args:
        body: below the first header.
        separator: of fields.
        label: of the file, in messages.
        described: names of columns, of a table that has none.

    Raises:
        MeasurementError: there is none with rows.
    """
    parts = body.split(_END)
    # With headers of segments there is one before each table; without, the table follows the first header.
    headers = parts[:-1]
    found = []
    pending: list[str] = headers[0].splitlines() if headers else []
    for part in parts[1:] if headers else parts:
        lines = part.splitlines()
        rows = [line for line in lines if line.strip(separator + " ")]
        begin = next(
            (n for n, line in enumerate(rows) if n > 0 and line.split(separator)[0].strip() == "Channels"), None
        )
        table, following = (rows, []) if begin is None else (rows[:begin], rows[begin:])
        if len(table) > 1:
            found.append(_segment(pending, table, separator, described))
        pending = following
    if not found:
        raise MeasurementError(
            f"{label} has a header of LabVIEW and no rows of readings; export the measurement again."
        )
    return found


def _segment(header: Sequence[str], table: Sequence[str], separator: str, described: Sequence[str]) -> _Segment:
    fields = {line.split(separator)[0].strip(): line.split(separator)[1:] for line in header if line.strip()}
    names = [name.strip() for name in table[0].split(separator)]
    if np.isfinite(to_numbers(pd.Series(names, dtype="string"))).all():  # the first row is one of readings already
        table = ["", *table]
        nameless = [f"column {number}" for number in range(1, len(names) + 1)]
        names = [*described] if len(described) == len(names) else nameless
    width = max(len(names), *(line.count(separator) + 1 for line in table[1:50]))
    names += [""] * (width - len(names))
    rows = pd.read_csv(
        io.StringIO("\n".join(table[1:])),
        sep=separator,
        header=None,
        names=list(range(width)),
        dtype="string",
        skip_blank_lines=False,
        on_bad_lines="skip",
        quoting=3,
    )
    return _Segment(fields, names, rows)


def _table(segment: _Segment, timeless: bool, decimal: str) -> pd.DataFrame:
    """Return the numbers of a segment: one time, and its channels; each on that time if they have clocks of their own.

    Args:
        segment: as text.
        timeless: whether it has no columns of times, under whatever name.
        decimal: '.' or ','.
    """
    names = [name for name in segment.names if name not in ("", "Comment")]
    numbers = [
        to_numbers(segment.rows[place].str.strip().str.replace(decimal, ".", regex=False)) for place in segment.rows
    ]
    if timeless and names and names[0] in _X_NAMES:
        # Some writers leave out the field of the time, others leave it empty.
        names, numbers = names[1:], numbers if np.isfinite(numbers[0]).any() else numbers[1:]
    channels: list[tuple[str, np.ndarray | None, np.ndarray]] = []
    time_s: np.ndarray | None = None
    unique = unique_names(name for name in names if name not in _X_NAMES)
    for name, values in zip(names, numbers, strict=False):
        if name in _X_NAMES:
            time_s = values
        else:
            channels.append((unique[len(channels)], time_s, values))
    if not channels:
        return pd.DataFrame()
    start, step = (_number(next(iter(segment.header.get(key, [])), ""), decimal) for key in ("X0", "Delta_X"))
    if channels[0][1] is None and step > 0.0:
        evenly = np.nan_to_num(start) + step * np.arange(len(segment.rows))
        channels = [(name, evenly, values) for name, _, values in channels]
    return _on_one_clock(channels)


def _on_one_clock(channels: Sequence[tuple[str, np.ndarray | None, np.ndarray]]) -> pd.DataFrame:
    """Return channels, of which each may have times of its own [s], as one table."""
    first = channels[0][1]
    columns = {name: values for name, _, values in channels}
    if first is None:
        return pd.DataFrame(columns)
    if all(own is None or np.array_equal(own, first, equal_nan=True) for _, own, _ in channels):
        return pd.DataFrame({TIME: first, **columns})
    streams = [_stream(name, own, values) for name, own, values in channels if own is not None]
    joined = join_streams(streams, lambda names: names)
    return pd.DataFrame() if joined is None else joined.frame


def _stream(name: str, time_s: np.ndarray, values: np.ndarray) -> Stream:
    there = np.isfinite(time_s)
    return Stream(name, (name,), {}, int(there.sum()), lambda: (time_s[there], {name: values[there]}))


def _number(text: str, decimal: str) -> float:
    return float(to_numbers(pd.Series([text.strip().replace(decimal, ".")], dtype="string"))[0])


def _units(segment: _Segment, names: Sequence[str]) -> dict[str, str]:
    """Return the units that the header states: the fields of a header stand over the columns behind the first one."""
    stated = [unit.strip() for unit in segment.header.get("Y_Unit_Label", [])]
    places = [place for place, name in enumerate(segment.names) if name not in (*_X_NAMES, "", "Comment")]
    channels = [name for name in names if name != TIME]
    units = {name: stated[place - 1] for name, place in zip(channels, places, strict=False) if 0 < place <= len(stated)}
    return {name: unit for name, unit in units.items() if unit}
