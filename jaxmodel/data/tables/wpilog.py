"""Data logs of WPILib (.wpilog), as robots of FRC write them: each entry a stream of values that are logged on change.

Source: WPILib's `wpiutil/doc/datalog.adoc`, version 1.0. Entry 0 holds control records; times are in microseconds.
"""

from __future__ import annotations

import dataclasses
import json
import struct
from collections import Counter
from pathlib import Path

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.raw_table import RawTable
from jaxmodel.data.tables.streams import Readings, Stream, join_streams

_MARK = b"WPILOG"
_HEADER_BYTES = 12
_START, _FINISH, _SET_METADATA = 0, 1, 2
_NUMBERS = {"boolean": "u1", "int64": "<i8", "float": "<f4", "double": "<f8"}
_WIDEST = 32  # values of an array that become columns
# Endings of names by which teams state units: 'DriveVelocityRadPerSec'.
_ENDINGS = {
    "volts": "V", "voltage": "V", "amps": "A", "radpersec": "rad/s", "radspersec": "rad/s", "rpm": "rpm",
    "celsius": "degC", "tempcelsius": "degC", "rotpersec": "rps", "rotationspersecond": "rps",
}  # fmt: skip


@dataclasses.dataclass
class _Entry:
    """One entry: its name, type and metadata, and where its values lie in the file."""

    name: str
    kind: str
    metadata: str
    times: list[int] = dataclasses.field(default_factory=list)
    places: list[tuple[int, int]] = dataclasses.field(default_factory=list)


def is_wpilog(path: Path) -> bool:
    """Return whether a file is a data log of WPILib."""
    with path.open("rb") as stream:
        return stream.read(len(_MARK)) == _MARK


def read_wpilog(path: Path, keep: Keep | None = None) -> RawTable:
    """Read the numbers of a data log of WPILib on one clock; a value is held until the next one.

    Args:
        path: the file.
        keep: chooses from the names of all entries those to be read; by default all.

    Raises:
        MeasurementError: it is damaged, or holds no numbers.
    """
    label = file_label(path)
    content = path.read_bytes()
    try:
        entries, cut = _entries(content)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise MeasurementError(
            f"{label} is an incomplete data log of WPILib ({error}); copy it from the robot again."
        ) from error
    streams = [stream for entry in entries if (stream := _stream(content, entry)) is not None]
    joined = join_streams(_unique(streams), keep, held=True)
    if joined is None:
        raise MeasurementError(f"{label} is a data log of WPILib without numbers; give one that holds readings.")
    losses = ("The log ends within a record, which was left out.",) if cut else ()
    return RawTable(
        joined.frame, joined.units, path, "WPILib data log", joined.remarks, left_out=joined.left_out, losses=losses
    )  # fmt: skip


def _entries(content: bytes) -> tuple[list[_Entry], bool]:
    """Return the entries of a log, and whether its last record is cut off."""
    (extra,) = struct.unpack_from("<I", content, 8)
    at = _HEADER_BYTES + extra
    started: dict[int, _Entry] = {}
    entries: list[_Entry] = []
    while at < len(content):
        lengths = content[at]
        of_entry, of_size, of_time = (lengths & 3) + 1, (lengths >> 2 & 3) + 1, (lengths >> 4 & 7) + 1
        first = at + 1 + of_entry
        begin = first + of_size + of_time
        size = int.from_bytes(content[first : first + of_size], "little")
        if begin + size > len(content):
            return entries, True
        number = int.from_bytes(content[at + 1 : first], "little")
        if number == 0:
            _control(content, begin, size, started, entries)
        elif (entry := started.get(number)) is not None:
            entry.times.append(int.from_bytes(content[first + of_size : begin], "little"))
            entry.places.append((begin, size))
        at = begin + size
    return entries, False


def _control(content: bytes, at: int, size: int, started: dict[int, _Entry], entries: list[_Entry]) -> None:
    """Follow a record that starts or finishes an entry, or changes its metadata."""
    if size < 5:
        return
    kind, number = struct.unpack_from("<BI", content, at)
    if kind == _START:
        texts, place = [], at + 5
        for _ in range(3):
            (length,) = struct.unpack_from("<I", content, place)
            texts.append(content[place + 4 : place + 4 + length].decode())
            place += 4 + length
        started[number] = _Entry(*texts)
        entries.append(started[number])
    elif kind == _FINISH:
        started.pop(number, None)
    elif kind == _SET_METADATA and number in started:
        started[number].metadata = content[at + 9 : at + size].decode()


def _stream(content: bytes, entry: _Entry) -> Stream | None:
    """Return the stream of an entry of numbers, None for texts, structures and what has no values."""
    scalar = entry.kind.removesuffix("[]")
    if scalar not in _NUMBERS or not entry.places:
        return None
    dtype = np.dtype(_NUMBERS[scalar])
    ((size, _),) = Counter(size for _, size in entry.places).most_common(1)
    width = size // dtype.itemsize
    if size != width * dtype.itemsize or not 0 < width <= _WIDEST:
        return None
    whole = [n for n, (_, own) in enumerate(entry.places) if own == size]
    columns = (entry.name,) if width == 1 else tuple(f"{entry.name}/{n}" for n in range(width))

    def load() -> Readings:
        starts = np.array([entry.places[n][0] for n in whole])[:, None]
        values = np.frombuffer(content, np.uint8)[starts + np.arange(size)].reshape(-1).view(dtype)
        table = values.reshape(-1, width).astype(float)
        return np.array([entry.times[n] for n in whole]) * 1e-6, dict(zip(columns, table.T, strict=True))

    unit = _unit(entry)
    return Stream(entry.name, columns, dict.fromkeys(columns, unit) if unit else {}, len(whole), load)


def _unit(entry: _Entry) -> str:
    """Return the unit that an entry states, in its metadata or by the end of its name; '' for none."""
    try:
        stated = json.loads(entry.metadata or "{}")
    except ValueError:
        stated = {}
    if isinstance(stated, dict) and isinstance(unit := stated.get("unit", stated.get("units", "")), str) and unit:
        return unit
    last = entry.name.rsplit("/", 1)[-1].lower()
    return next((unit for ending, unit in _ENDINGS.items() if last.endswith(ending)), "")


def _unique(streams: list[Stream]) -> list[Stream]:
    """Return streams of different names: of entries that were started again, the one with most values."""
    longest: dict[str, Stream] = {}
    for stream in streams:
        if stream.name not in longest or stream.rows > longest[stream.name].rows:
            longest[stream.name] = stream
    return list(longest.values())
