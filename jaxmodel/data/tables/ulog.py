"""Logs of PX4 (.ulg) by the package pyulog: each topic a stream. Sources: PX4's `msg/*.msg` and its page on ULog."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.raw_table import RawTable
from jaxmodel.data.tables.streams import Readings, Stream, join_streams, not_read

_MARK = b"ULog\x01\x12\x35"
_OTHERWISE = "convert it with ulog2csv of pyulog, and give the CSV of battery_status"
# By topic and field (without the number of an array), the units that the definitions state in comments.
_UNITS = {
    "battery_status": {
        "voltage_v": "V", "voltage_filtered_v": "V", "ocv_estimate": "V", "ocv_estimate_filtered": "V",
        "current_a": "A", "current_filtered_a": "A", "current_average_a": "A",
        "discharged_mah": "mA h", "remaining": "1", "temperature": "degC", "voltage_cell_v": "V", "capacity": "mA h",
        "internal_resistance_estimate": "ohm",
    },
    "esc_status": {
        "esc.esc_rpm": "rpm", "esc.esc_voltage": "V", "esc.esc_current": "A", "esc.esc_temperature": "degC",
        "esc.motor_temperature": "degC",
    },
    "system_power": {"voltage5v_v": "V", "voltage_payload_v": "V"},
}  # fmt: skip
# Numbers that say that there is no reading, by topic and field.
_NO_READING = {
    "battery_status": {"current_a": -1.0, "current_filtered_a": -1.0, "current_average_a": -1.0, "voltage_cell_v": 0.0},
}  # fmt: skip
_PLACE = re.compile(r"\[\d+\]")
_POSITIVE = "PX4: the current of its battery is positive on discharge."


def is_ulog(path: Path) -> bool:
    """Return whether a file is a log of PX4."""
    with path.open("rb") as stream:
        return stream.read(len(_MARK)) == _MARK


def read_ulog(path: Path, keep: Keep | None = None) -> RawTable:
    """Read a log of PX4: the numbers of its topics on one clock.

    Args:
        path: the file.
        keep: chooses from the names of all columns ('battery_status.voltage_v (V)') those to be read; by default all.

    Raises:
        MeasurementError: the package is not installed, or the file is damaged or holds no numbers.
    """
    label = file_label(path)
    try:
        package = importlib.import_module("pyulog")
    except ImportError:
        raise MeasurementError(f"{label} needs the package pyulog: install jaxmodel[ulog], or {_OTHERWISE}.") from None
    try:
        with path.open("rb") as stream:
            content = package.ULog(stream)
        joined = join_streams([_stream(topic) for topic in content.data_list if "timestamp" in topic.data], keep)
    except Exception as error:  # a damaged file fails in as many ways as that package has lines
        raise not_read(label, "pyulog", error, _OTHERWISE) from error
    if joined is None:
        raise MeasurementError(f"{label} holds no topics with numbers; give the log that holds the readings.")
    lost_s = 1e-3 * sum(one.duration for one in content.dropouts)
    losses = [f"The controller lost {lost_s:.3g} s of readings in {len(content.dropouts):,} places."] if lost_s else []
    if content.file_corruption:
        losses.append("Parts of the file are damaged and were left out.")
    return RawTable(
        joined.frame, joined.units, path, "PX4", (*joined.remarks, _POSITIVE), current_positive_on="discharge",
        left_out=joined.left_out, losses=tuple(losses),
    )  # fmt: skip


def _stream(topic: Any) -> Stream:
    """Return the stream of a topic, of its second instance 'battery_status2'."""
    name = topic.name if topic.multi_id == 0 else f"{topic.name}{topic.multi_id + 1}"
    fields = {
        field: f"{name}.{field}"
        for field, values in topic.data.items()
        if field != "timestamp" and values.dtype.kind in "iufb"
    }
    plain = {field: _PLACE.sub("", field) for field in fields}
    units = {fields[field]: _UNITS.get(topic.name, {}).get(plain[field], "") for field in fields}
    absent = _NO_READING.get(topic.name, {})

    def load() -> Readings:
        columns = {}
        for field, column in fields.items():
            values = topic.data[field].astype(float)
            columns[column] = (
                np.where(values == absent[plain[field]], np.nan, values) if plain[field] in absent else values
            )
        return topic.data["timestamp"].astype(float) * 1e-6, columns

    return Stream(name, tuple(fields.values()), units, topic.data["timestamp"].size, load)
