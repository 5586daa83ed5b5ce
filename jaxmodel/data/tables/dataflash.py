"""Logs of ArduPilot's flight controllers: DataFlash, binary (.bin) and as text (.log), each message a stream.

Messages FMT describe the others, FMTU and UNIT state units and MULT the factors. Source: ArduPilot's
`libraries/AP_Logger/LogStructure.h`.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.raw_table import RawTable
from jaxmodel.data.tables.streams import Readings, Stream, join_streams
from jaxmodel.data.tables.units import is_unit

_HEAD = b"\xa3\x95"
_FMT = 128
_FMT_BYTES = 89
_TEXT_START = "FMT,"
# NumPy's type and the factor of each letter of a format; letters that are not here hold text.
_LETTERS = {
    "b": ("<i1", 1.0), "B": ("<u1", 1.0), "M": ("<u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0), "i": ("<i4", 1.0),
    "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0), "q": ("<i8", 1.0), "Q": ("<u8", 1.0), "c": ("<i2", 0.01),
    "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "g": ("<f2", 1.0),
}  # fmt: skip
_TEXTS = {"n": 4, "N": 16, "Z": 64, "a": 64}
_ABOUT_THE_LOG = frozenset(["FMT", "UNIT", "MULT", "FMTU", "PARM"])
# Columns that tell several sensors of one message apart.
_INSTANCES = ("Instance", "Inst", "I")
_MOST_SENSORS = 255
_CLOCKS = {"TimeUS": 1e-6, "TimeMS": 1e-3}
# Until a log states units of its own: those of the battery and of motor controllers, of all versions.
_UNITS = {
    "BAT": {"Volt": "V", "VoltR": "V", "Curr": "A", "CurrTot": "mA h", "EnrgTot": "W h", "Temp": "degC", "RemPct": "%"},
    "BATT": {"Volt": "V", "Curr": "A", "CurrTot": "mA h"},
    "CURR": {"Volt": "V", "Curr": "A", "CurrTot": "mA h"},
    "ESC": {"RPM": "rpm", "Volt": "V", "Curr": "A", "Temp": "degC", "MotTemp": "degC", "CTot": "mA h"},
}


class _Format(NamedTuple):
    """How a message is written: its name, the letters of its fields and their names."""

    name: str
    letters: str
    fields: tuple[str, ...]
    size: int


def is_dataflash(path: Path) -> bool:
    """Return whether a file is a log of ArduPilot, binary or text."""
    with path.open("rb") as stream:
        start = stream.read(256)
    return start.startswith(_HEAD + bytes([_FMT])) or start.lstrip().startswith(_TEXT_START.encode())


def read_dataflash(path: Path, keep: Keep | None = None) -> RawTable:
    """Read a log of ArduPilot: the messages of battery, motors and what else is wanted, on one clock.

    Args:
        path: the file.
        keep: chooses from the names of all columns ('BAT.Volt') those to be read; by default all.

    Raises:
        MeasurementError: it is damaged, or holds no messages with readings.
    """
    label = file_label(path)
    try:
        binary = path.read_bytes()
        if binary.startswith(_HEAD):
            streams, lost = _binary(binary)
        else:
            streams, lost = _text(binary.decode("utf-8", errors="replace"))
    except (ValueError, KeyError, IndexError, struct.error) as error:
        raise MeasurementError(f"{label} cannot be read as a log of ArduPilot ({error}); download it again.") from error
    joined = join_streams(streams, keep)
    if joined is None:
        raise MeasurementError(
            f"{label} is a log of ArduPilot without messages of a battery or motor; give one that has."
        )
    losses = (f"{lost:,} bytes between the messages were no messages and were left out.",) if lost else ()
    return RawTable(
        joined.frame, joined.units, path, "ArduPilot", joined.remarks, left_out=joined.left_out, losses=losses
    )  # fmt: skip


def _binary(content: bytes) -> tuple[list[Stream], int]:
    """Return the streams of a binary log, and how many bytes belong to no message."""
    formats: dict[int, _Format] = {}
    sizes = [0] * 256
    sizes[_FMT] = _FMT_BYTES
    places: dict[int, list[int]] = {}
    at, end, lost = 0, len(content) - 3, 0
    while at < end:
        kind = content[at + 2]
        size = sizes[kind] if content[at] == _HEAD[0] and content[at + 1] == _HEAD[1] else 0
        if not size or at + size > len(content):
            following = content.find(_HEAD, at + 1)
            following = len(content) if following < 0 else following
            lost, at = lost + following - at, following
            continue
        if kind == _FMT:
            number, length = content[at + 3], content[at + 4]
            name, letters, fields = struct.unpack_from("<4s16s64s", content, at + 5)
            text = [_ascii(part) for part in (name, letters, fields)]
            formats[number] = _Format(text[0], text[1], tuple(text[2].split(",")), length)
            sizes[number] = length
        else:
            places.setdefault(kind, []).append(at)
        at += size
    tables = {}
    for kind, starts in places.items():
        if (form := formats.get(kind)) is not None and (dtype := _dtype(form)) is not None:
            offsets = np.asarray(starts)[:, None] + np.arange(3, 3 + dtype.itemsize)
            tables[form.name] = (form, np.frombuffer(content, np.uint8)[offsets].reshape(-1).view(dtype))
    stated = _stated({kind: form.name for kind, form in formats.items()}, tables)
    streams = []
    for name, (form, rows) in tables.items():
        if name in _ABOUT_THE_LOG:
            continue
        units, factors = stated.get(name, ({}, {}))
        letters = {
            field: letter for field, letter in zip(form.fields, form.letters, strict=False) if letter in _LETTERS
        }
        # A letter that has a factor of its own is written so that the stated one is the same.
        own = {field: _LETTERS[letter][1] for field, letter in letters.items()}
        scales = {field: factor if factor != 1.0 else factors.get(field, 1.0) for field, factor in own.items()}
        streams += _streams(name, {field: rows[field] for field in letters}, scales, units)
    return streams, lost


def _ascii(part: bytes) -> str:
    return part.split(b"\0")[0].decode("ascii", errors="replace")


def _dtype(form: _Format) -> np.dtype | None:
    """Return how the bytes of a message are read, None for a format that is not as long as it says."""
    parts = []
    for field, letter in zip(form.fields, form.letters, strict=False):
        parts.append((field, _LETTERS[letter][0] if letter in _LETTERS else f"V{_TEXTS.get(letter, 0)}"))
    if len({field for field, _ in parts}) != len(parts) or not parts:
        return None
    dtype = np.dtype(parts)
    return dtype if dtype.itemsize == form.size - 3 else None


def _stated(
    names: Mapping[int, str], tables: Mapping[str, tuple[_Format, np.ndarray]]
) -> dict[str, tuple[dict[str, str], dict[str, float]]]:
    """Return units and factors that a log states for the fields of its messages, by message and field."""
    if not tables.keys() >= {"UNIT", "MULT", "FMTU"}:
        return {}
    units = {chr(int(row["Id"])): _ascii(bytes(row["Label"])) for row in tables["UNIT"][1]}
    factors = {chr(int(row["Id"])): float(row["Mult"]) for row in tables["MULT"][1]}
    found = {}
    for row in tables["FMTU"][1]:
        name = names.get(int(row["FmtType"]), "")
        if name in tables:
            fields = tables[name][0].fields
            of_units, of_factors = _ascii(bytes(row["UnitIds"])), _ascii(bytes(row["MultIds"]))
            found[name] = (
                {field: units.get(letter, "") for field, letter in zip(fields, of_units, strict=False)},
                {field: factors.get(letter) or 1.0 for field, letter in zip(fields, of_factors, strict=False)},
            )
    return found


def _text(content: str) -> tuple[list[Stream], int]:
    """Return the streams of a log as text: 'BAT, 5000000, 0, 24.1, ...'."""
    formats: dict[str, tuple[str, ...]] = {}
    rows: dict[str, list[list[str]]] = {}
    for line in content.splitlines():
        name, *fields = (part.strip() for part in line.split(","))
        if name == "FMT" and len(fields) >= 5:
            formats[fields[2]] = tuple(field for field in fields[4:] if field)
        elif name in formats and len(fields) >= len(formats[name]):
            rows.setdefault(name, []).append(fields[: len(formats[name])])
    streams = []
    for name, table in rows.items():
        if any(field in _CLOCKS for field in formats[name]):
            columns = {field: _numbers([row[n] for row in table]) for n, field in enumerate(formats[name])}
            columns = {field: values for field, values in columns.items() if np.isfinite(values).any()}
            streams += _streams(name, columns, dict.fromkeys(columns, 1.0), {})
    return streams, 0


def _numbers(texts: Sequence[str]) -> np.ndarray:
    def number(text: str) -> float:
        try:
            return float(text)
        except ValueError:
            return np.nan

    return np.array([number(text) for text in texts])


def _streams(
    name: str, values: Mapping[str, np.ndarray], scales: Mapping[str, float], units: Mapping[str, str]
) -> list[Stream]:
    """Return a stream for each sensor of a message, with columns such as 'BAT.Volt', of the second 'BAT2.Volt'."""
    clock = next((field for field in _CLOCKS if field in values), None)
    if clock is None:
        return []
    instance = next((field for field in _INSTANCES if field in values), None)
    numbers = np.unique(values[instance]) if instance else np.array([np.nan])
    numbers = numbers[(numbers >= 0) & (numbers <= _MOST_SENSORS)] if instance else numbers
    fields = [field for field in values if field not in (clock, instance)]
    streams = []
    for number in numbers:
        which = name if number == numbers[0] or np.isnan(number) else f"{name}{int(number) + 1}"
        there = values[instance] == number if instance else np.ones(values[clock].size, dtype=bool)
        names = {field: f"{which}.{field}" for field in fields}

        def load(there: np.ndarray = there, names: Mapping[str, str] = names) -> Readings:
            time_s = values[clock][there].astype(float) * _CLOCKS[clock]
            return time_s, {names[field]: values[field][there].astype(float) * scales[field] for field in names}

        known = _UNITS.get(name, {})  # a log may say that it does not know a unit
        stated = {
            names[field]: units[field] if is_unit(units.get(field, "")) else known.get(field, "") for field in fields
        }
        streams.append(Stream(which, tuple(names.values()), stated, int(there.sum()), load))
    return streams
