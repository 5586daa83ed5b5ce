"""Bags of ROS (.bag, .db3, .mcap) by the package rosbags: each topic a stream, each number of its messages a column."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.raw_table import RawTable
from jaxmodel.data.tables.streams import Readings, Stream, join_streams, not_read

SUFFIXES = (".bag", ".db3", ".mcap")
_OTHERWISE = "export its topics as CSV"
_DEEPEST = 4
_WIDEST = 32  # values of an array that become columns
# By message, the units of its fields (their definitions, REP 103) and their plain names.
_BATTERY = "sensor_msgs/msg/BatteryState"
_UNITS = {
    _BATTERY: {"voltage": "V", "current": "A", "temperature": "degC", "percentage": "1", "charge": "A h"},
    "sensor_msgs/msg/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N m"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
    "geometry_msgs/msg/WrenchStamped": {"torque": "N m"},
}
_PLAIN = {
    _BATTERY: {
        "voltage": "battery voltage", "current": "battery current", "temperature": "battery temperature",
        "percentage": "battery level",
    },
    "sensor_msgs/msg/JointState": {"effort": "torque"},
}  # fmt: skip
# What a bench does not have, and takes long to read.
PICTURES = ("Image", "CompressedImage", "PointCloud", "PointCloud2", "LaserScan", "OccupancyGrid", "CameraInfo", "Log")
# Bookkeeping of messages.
_NO_READINGS = frozenset(["header", "stamp", "seq", "covariance", "variance", "design_capacity", "layout"])
_OF_NAMES = ("name", "names", "joint_names")


def read_ros(path: Path, keep: Keep | None = None) -> RawTable:
    """Read a bag of ROS 1 or 2: the topics of battery, joints and what else is wanted, on one clock.

    Args:
        path: the file.
        keep: chooses from the names of all columns ('/battery_state.voltage') those to be read; by default all.

    Raises:
        MeasurementError: the package is not installed, or the file is damaged or holds no messages with numbers.
    """
    label = file_label(path)
    try:
        package = importlib.import_module("rosbags.highlevel")
        types = importlib.import_module("rosbags.typesys")
    except ImportError:
        raise MeasurementError(f"{label} needs the package rosbags: install jaxmodel[ros], or {_OTHERWISE}.") from None
    store = types.Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else types.Stores.LATEST
    logging.getLogger("rosbags").setLevel(logging.ERROR)
    try:
        with package.AnyReader([path], default_typestore=types.get_typestore(store)) as bag:
            topics = _topics(bag)
            streams = [stream for connections in topics.values() if (stream := _stream(bag, connections)) is not None]
            joined = join_streams(streams, keep)
    except MeasurementError:
        raise
    except Exception as error:  # a damaged file fails in as many ways as that package has lines
        raise not_read(label, "rosbags", error, _OTHERWISE) from error
    if joined is None:
        raise MeasurementError(f"{label} holds no messages with numbers; give the bag that holds the readings.")
    columns = [str(name) for name in joined.frame]
    used = {of[0].msgtype for topic, of in topics.items() if any(name.startswith(topic) for name in columns)}
    positive: Literal["charge"] | None = "charge" if _BATTERY in used else None
    remark = "sensor_msgs/BatteryState: its current is positive on charge."
    return RawTable(
        joined.frame,
        joined.units,
        path,
        "bag of ROS",
        (*joined.remarks, remark) if positive else joined.remarks,
        current_positive_on=positive,
        left_out=joined.left_out,
        plain=dict(_plain(topics, [*columns, *joined.left_out])),
    )


def _topics(bag: Any) -> dict[str, list[Any]]:
    """Return the connections of each topic that may hold readings; all of one type."""
    topics: dict[str, list[Any]] = {}
    for connection in bag.connections:
        if not connection.msgtype.endswith(tuple(f"/{name}" for name in PICTURES)):
            of_topic = topics.setdefault(connection.topic, [])
            if not of_topic or of_topic[0].msgtype == connection.msgtype:
                of_topic.append(connection)
    return topics


def _stream(bag: Any, connections: list[Any]) -> Stream | None:
    """Return the stream of a topic, None for one without numbers or of a type that the bag does not describe."""
    topic, kind = connections[0].topic, connections[0].msgtype
    rows = sum(connection.msgcount for connection in connections)
    first = next(((raw, conn) for conn, _, raw in bag.messages(connections=connections)), None)
    if first is None or kind not in bag.typestore.fielddefs:
        return None
    fields = [name for name, _ in _numbers(bag.deserialize(first[0], kind))]
    if not fields:
        return None
    # A topic of one number is called by its name alone: '/motor_temperature'.
    names = {field: topic if len(fields) == 1 else f"{topic}.{field}" for field in fields}

    def load() -> Readings:
        times: list[int] = []
        found: dict[str, list[float]] = {name: [] for name in names.values()}
        for connection, time_ns, raw in bag.messages(connections=connections):
            values = dict(_numbers(bag.deserialize(raw, connection.msgtype)))
            times.append(time_ns)
            for field, name in names.items():
                found[name].append(values.get(field, np.nan))
        return np.array(times) * 1e-9, {name: np.array(values) for name, values in found.items()}

    units = {names[field]: unit for field in fields if (unit := _UNITS.get(kind, {}).get(field.split(".")[0]))}
    return Stream(topic, tuple(names.values()), units, rows, load)


def _numbers(message: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message by the path of their field; those of an array by the names beside it."""
    if depth > _DEEPEST:
        return
    fields = {name: getattr(message, name) for name in getattr(message, "__dataclass_fields__", {})}
    labels: Sequence[str] = next((fields[name] for name in _OF_NAMES if isinstance(fields.get(name), list)), ())
    for name, value in fields.items():
        if name in _NO_READINGS or name.startswith("__"):
            continue
        where = f"{path}.{name}" if path else name
        if isinstance(value, bool | int | float | np.number):
            yield where, float(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and 0 < value.size <= _WIDEST:
            own = labels if len(labels) == value.size else [str(number) for number in range(value.size)]
            for label, one in zip(own, value.ravel().tolist(), strict=True):
                yield f"{where}.{label}", float(one)
        elif hasattr(value, "__dataclass_fields__"):
            yield from _numbers(value, where, depth + 1)


def _plain(topics: dict[str, list[Any]], names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the plain names of columns of messages that are known; one without a plain name keeps its own."""
    for topic, connections in topics.items():
        for field, plain in _PLAIN.get(connections[0].msgtype, {}).items():
            yield from ((name, plain) for name in names if _is_of(name, f"{topic}.{field}"))


def _is_of(name: str, field: str) -> bool:
    """Return whether a column is of a field, with its unit or the name of a joint behind it."""
    return name.startswith((f"{field}.", f"{field} (")) or name == field
