"""MCAP files whose messages are JSON or Protocol Buffers, by the package mcap; those of ROS 2 are read as bags."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxmodel.base.errors import MeasurementError, listed
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.raw_table import RawTable
from jaxmodel.data.tables.ros import PICTURES
from jaxmodel.data.tables.streams import Readings, Stream, join_streams, not_read

_MARK = b"\x89MCAP0\r\n"
_PROFILE_AT = len(_MARK) + 1 + 8  # behind the mark, the kind of the first record and its length
_OTHERWISE = "export its topics as CSV"
_DEEPEST = 4
_WIDEST = 32  # values of an array that become columns
_NO_READINGS = frozenset(["header", "stamp", "timestamp", "time", "frame_id", "seq"])

Decode = Callable[[bytes], Any]


def is_of_ros(path: Path) -> bool:
    """Return whether an MCAP file says that its messages are of ROS."""
    with path.open("rb") as stream:
        start = stream.read(_PROFILE_AT + 4 + 3)
    return start.startswith(_MARK) and start[_PROFILE_AT + 4 :] == b"ros"


def read_mcap(path: Path, keep: Keep | None = None) -> RawTable:
    """Read the numbers of the topics of an MCAP file on one clock.

    Args:
        path: the file.
        keep: chooses from the names of all columns ('/battery.voltage') those to be read; by default all.

    Raises:
        MeasurementError: the package is not installed, or the file is damaged or holds no messages that are read.
    """
    label = file_label(path)
    try:
        package = importlib.import_module("mcap.reader")
    except ImportError:
        raise MeasurementError(f"{label} needs the package mcap: install jaxmodel[mcap], or {_OTHERWISE}.") from None
    decoders: dict[int, Decode | None] = {}
    topics: dict[str, list[tuple[int, dict[str, float]]]] = {}
    others: set[str] = set()
    try:
        with path.open("rb") as stream:
            for schema, channel, message in package.make_reader(stream).iter_messages():
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(channel.message_encoding, schema, label)
                decode = decoders[channel.id]
                if decode is None:
                    others.add(channel.message_encoding)
                    continue
                numbers = dict(_numbers(decode(message.data)))
                topics.setdefault(channel.topic, []).append((message.log_time, numbers))
    except MeasurementError:
        raise
    except Exception as error:  # a damaged file fails in as many ways as that package has lines
        raise not_read(label, "mcap", error, _OTHERWISE) from error
    streams = [stream for topic, rows in topics.items() if (stream := _stream(topic, rows)) is not None]
    joined = join_streams(streams, keep)
    if joined is None:
        forms = listed([f"'{one}'" for one in sorted(others)], 3)
        what = f"messages in {forms}" if others else "no messages with numbers"
        raise MeasurementError(f"{label} holds {what}, and JSON or protobuf with numbers is read; {_OTHERWISE}.")
    return RawTable(joined.frame, joined.units, path, "MCAP", joined.remarks, left_out=joined.left_out)


def _decoder(encoding: str, schema: Any, label: str) -> Decode | None:
    """Return what makes a mapping of the bytes of a message, None for a form or a sort that is not read."""
    if schema is not None and schema.name.split(".")[-1].split("/")[-1] in PICTURES:
        return None
    if encoding == "json":
        return json.loads
    if encoding != "protobuf":
        return None
    try:
        of_protobuf = importlib.import_module("mcap_protobuf.decoder").DecoderFactory().decoder_for(encoding, schema)
        to_mapping = importlib.import_module("google.protobuf.json_format").MessageToDict
    except ImportError:
        raise MeasurementError(
            f"{label} needs the package mcap-protobuf-support: install jaxmodel[mcap], or {_OTHERWISE}."
        ) from None
    if of_protobuf is None:
        return None
    options = {"preserving_proto_field_name": True, "always_print_fields_with_no_presence": True}
    return lambda data: to_mapping(of_protobuf(data), **options)


def _numbers(value: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message by the path of their field; the root itself has the path ''."""
    if depth > _DEEPEST:
        return
    if isinstance(value, Mapping):
        for name, inner in value.items():
            if str(name) not in _NO_READINGS:
                yield from _numbers(inner, f"{path}.{name}" if path else str(name), depth + 1)
    elif isinstance(value, list):
        if len(value) <= _WIDEST:
            for number, inner in enumerate(value):
                yield from _numbers(inner, f"{path}.{number}" if path else str(number), depth + 1)
    elif isinstance(value, bool | int | float):
        yield path, float(value)


def _stream(topic: str, rows: list[tuple[int, dict[str, float]]]) -> Stream | None:
    fields = list(dict.fromkeys(name for _, numbers in rows for name in numbers))
    if not fields:
        return None
    # A topic of one number is called by its name alone: '/motor_temperature'.
    names = {field: topic if len(fields) == 1 else f"{topic}.{field}" for field in fields}

    def load() -> Readings:
        times = np.array([time_ns for time_ns, _ in rows]) * 1e-9
        columns = {name: np.array([numbers.get(field, np.nan) for _, numbers in rows]) for field, name in names.items()}
        return times, columns

    return Stream(topic, tuple(names.values()), {}, len(rows), load)
