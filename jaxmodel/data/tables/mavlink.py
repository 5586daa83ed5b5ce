"""Telemetry logs of MAVLink (.tlog), as ground stations write them, by the package pymavlink: each message a stream.

A record is a time in microseconds since 1970, big-endian, and one packet of MAVLink 1 or 2. Source: MAVLink's guide to
packet serialisation; units and fields are those of the dialect `ardupilotmega`, which holds the common messages too.
"""

from __future__ import annotations

import importlib
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.raw_table import RawTable
from jaxmodel.data.tables.streams import Readings, Stream, join_streams

_OTHERWISE = "give the .bin log of the flight controller"
_TIME_BYTES = 8
_FIRST_US, _LAST_US = 3.2e14, 4.1e15  # the years 1980 and 2100
_MARKS = {0xFE: 1, 0xFD: 2}
_SIGNED, _SIGNATURE_BYTES = 0x01, 13
# Units with a prefix that no bench writes: the factor, and the unit that then stands.
_SCALED = {
    "cV": (0.01, "V"), "cA": (0.01, "A"), "cdegC": (0.01, "degC"), "hJ": (100.0 / 3600.0, "W h"), "cdeg": (0.01, "deg"),
    "d%": (0.1, "%"), "c%": (0.01, "%"), "cm/s": (0.01, "m/s"), "m/s/s": (1.0, "m/s2"),
}  # fmt: skip
# The largest number of these types, and -1 in these fields, say that there is no reading.
_NO_READING = {"uint16_t": 65_535.0, "int16_t": 32_767.0, "uint32_t": 4_294_967_295.0, "int32_t": 2_147_483_647.0}
_NONE_BELOW_ZERO = frozenset(["battery_remaining", "current_consumed", "energy_consumed"])
_NOT_SENT = frozenset(["current_battery"])  # -1, which is -0.01 A
_POSITIVE = "MAVLink: the current of its battery is positive on discharge."


class _Packet(NamedTuple):
    """One packet: its time [s], number of the message, sender, and where it lies in the file."""

    time_s: float
    message: int
    sender: tuple[int, int]
    start: int
    end: int


def read_mavlink(path: Path, keep: Keep | None = None) -> RawTable:
    """Read a telemetry log of MAVLink: the numbers of its messages on one clock.

    Args:
        path: the file.
        keep: chooses from the names of all columns ('SYS_STATUS.voltage_battery (mV)') those to be read; by
            default all.

    Raises:
        MeasurementError: the package is not installed, or the file holds no packets or no readings.
    """
    label = file_label(path)
    try:
        dialect = importlib.import_module("pymavlink.dialects.v20.ardupilotmega")
    except ImportError:
        raise MeasurementError(
            f"{label} needs the package pymavlink: install jaxmodel[mavlink], or {_OTHERWISE}."
        ) from None
    content = path.read_bytes()
    packets, lost = _packets(content)
    groups: dict[tuple[int, tuple[int, int]], list[_Packet]] = {}
    for packet in packets:
        if packet.message in dialect.mavlink_map:
            groups.setdefault((packet.message, packet.sender), []).append(packet)
    streams: list[Stream] = []
    for message in dict.fromkeys(message for message, _ in groups):
        senders = sorted((sender for one, sender in groups if one == message), key=lambda s: -len(groups[message, s]))
        for place, sender in enumerate(senders):
            form = dialect.mavlink_map[message]
            name = form.msgname if place == 0 else f"{form.msgname} of {sender[0]}.{sender[1]}"
            streams += _streams(name, form, _decoded(dialect, content, groups[message, sender]))
    joined = join_streams(streams, keep)
    if joined is None:
        raise MeasurementError(f"{label} holds no messages of MAVLink with numbers; {_OTHERWISE}.")
    losses = (f"{lost:,} bytes between the messages were no messages and were left out.",) if lost else ()
    return RawTable(
        joined.frame, joined.units, path, "MAVLink", (*joined.remarks, _POSITIVE), current_positive_on="discharge",
        left_out=joined.left_out, losses=losses,
    )  # fmt: skip


def _packets(content: bytes) -> tuple[list[_Packet], int]:
    """Return the packets of a log, and how many bytes belong to none."""
    found, at, lost = [], 0, 0
    while at + _TIME_BYTES + 8 <= len(content):
        (time_us,) = struct.unpack_from(">Q", content, at)
        start = at + _TIME_BYTES
        end = _end_of(content, start) if _FIRST_US < time_us < _LAST_US else 0
        if not end or end > len(content):
            at, lost = at + 1, lost + 1
            continue
        at_sender, id_bytes = (start + 5, 3) if _MARKS[content[start]] == 2 else (start + 3, 1)
        sender = content[at_sender], content[at_sender + 1]
        message = int.from_bytes(content[at_sender + 2 : at_sender + 2 + id_bytes], "little")
        found.append(_Packet(time_us * 1e-6, message, sender, start, end))
        at = end
    return found, lost + len(content) - at


def _end_of(content: bytes, start: int) -> int:
    """Return where the packet that begins at a place ends, 0 where none begins."""
    version = _MARKS.get(content[start])
    if version is None:
        return 0
    if version == 1:
        return start + 6 + content[start + 1] + 2
    return start + 10 + content[start + 1] + 2 + (_SIGNATURE_BYTES if content[start + 2] & _SIGNED else 0)


def _decoded(dialect: Any, content: bytes, packets: Sequence[_Packet]) -> tuple[np.ndarray, list[Any]]:
    """Return times [s] and messages of packets; those with a wrong check sum are left out."""
    reader = dialect.MAVLink(None)
    times, messages = [], []
    for packet in packets:
        try:
            messages.append(reader.decode(bytearray(content[packet.start : packet.end])))
        except (dialect.MAVError, struct.error):
            continue
        times.append(packet.time_s)
    return np.array(times), messages


def _streams(name: str, form: Any, decoded: tuple[np.ndarray, Sequence[Any]]) -> list[Stream]:
    """Return a stream for each sensor of a message: 'BATTERY_STATUS', and of the second 'BATTERY_STATUS2'."""
    times, messages = decoded
    if not messages:
        return []
    instance = form.instance_field
    numbers = np.array([getattr(one, instance) if instance else 0 for one in messages])
    columns = _columns(form, messages)
    streams = []
    for place, number in enumerate(np.unique(numbers)):
        which = name if place == 0 else f"{name}{int(number) + 1}"
        rows = numbers == number
        units = {f"{which}.{field}": unit for field, (_, unit) in columns.items()}
        readings = {f"{which}.{field}": values[rows] for field, (values, _) in columns.items()}
        readings = {column: values for column, values in readings.items() if np.isfinite(values).any()}
        streams.append(_stream(which, times[rows], readings, units))
    return streams


def _stream(name: str, times: np.ndarray, readings: dict[str, np.ndarray], units: Mapping[str, str]) -> Stream:
    def load() -> Readings:
        return times, readings

    return Stream(name, tuple(readings), {column: units[column] for column in readings}, times.size, load)


def _columns(form: Any, messages: Sequence[Any]) -> dict[str, tuple[np.ndarray, str]]:
    """Return the numbers of messages and their units by field; an array is a column for each place."""
    found = {}
    for field, kind in zip(form.fieldnames, form.fieldtypes, strict=True):
        if kind == "char" or field == form.instance_field:
            continue
        factor, unit = _SCALED.get(
            form.fieldunits_by_name.get(field, ""), (1.0, form.fieldunits_by_name.get(field, ""))
        )
        values = np.array([getattr(one, field) for one in messages], dtype=float)
        missing = values == _NO_READING.get(kind, np.inf)
        if field in _NONE_BELOW_ZERO:
            missing |= values < 0.0
        elif field in _NOT_SENT:
            missing |= values == -1.0
        values = np.where(missing, np.nan, values) * factor
        if values.ndim > 1:
            found |= {f"{field}.{place}": (values[:, place], unit) for place in range(values.shape[1])}
        else:
            found[field] = (values, unit)
    return found
