"""Bags of ROS give battery, joints and thermometers on the clock of the battery; what is not installed is said."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

LOG = cell_log().assign(time_s=lambda log: log.time_s / 10.0)
EPOCH_S = 1_720_000_000
MCAP_OF_ROS = b"\x89MCAP0\r\n\x01" + (12).to_bytes(8, "little") + (4).to_bytes(4, "little") + b"ros2"


def messages(store: Any, write: Callable[[str, str, float, Any], None]) -> None:
    """A battery of four cells, two joints 30 ms later, a thermometer every tenth time, a switch."""
    kinds = store.types
    stamp, header = kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0), kinds["std_msgs/msg/Header"]
    head = header(**({"seq": 0} if "seq" in header.__dataclass_fields__ else {}), stamp=stamp, frame_id="")
    none = np.array([], dtype=np.float32)
    battery = kinds["sensor_msgs/msg/BatteryState"]
    with_temperature = "temperature" in battery.__dataclass_fields__
    for place, row in enumerate(LOG.itertuples()):
        state = {
            **({"temperature": 25.5} if with_temperature else {}),
            **{"header": head, "voltage": 4 * row.voltage_V, "current": -row.current_A, "charge": np.nan},
            **{
                "capacity": np.nan,
                "design_capacity": 3.0,
                "percentage": 0.5,
                "power_supply_status": 2,
                "present": True,
            },
            **{"power_supply_health": 1, "power_supply_technology": 3, "location": "", "serial_number": ""},
            **{"cell_voltage": none, "cell_temperature": none},
        }
        state = {name: value for name, value in state.items() if name in battery.__dataclass_fields__}
        write("/battery_state", "sensor_msgs/msg/BatteryState", row.time_s, battery(**state))
        joints = {"position": [row.time_s, 0.0], "velocity": [3.0 * row.time_s, -7.0], "effort": [0.5, 0.0]}
        arrays = {name: np.array(values) for name, values in joints.items()}
        joint = kinds["sensor_msgs/msg/JointState"](header=head, name=["left_motor", "right_motor"], **arrays)
        write("/joint_states", "sensor_msgs/msg/JointState", row.time_s + 0.03, joint)
        if place % 10 == 0:
            warm = kinds["sensor_msgs/msg/Temperature"](
                header=head, temperature=30.0 + row.time_s / 100.0, variance=0.0
            )
            write("/motor_temperature", "sensor_msgs/msg/Temperature", row.time_s, warm)
            write("/enabled", "std_msgs/msg/Bool", row.time_s, kinds["std_msgs/msg/Bool"](data=True))


def bag(folder: Path, form: str) -> Path:
    """Write a bag of ROS 1, or of ROS 2 in SQLite or MCAP."""
    pytest.importorskip("rosbags")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if form == "bag" else Stores.ROS2_HUMBLE)
    topics: dict[str, Any] = {}
    path = folder / ("drive.bag" if form == "bag" else "drive")
    if form == "bag":
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = {"db3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}[form]
        writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
    pack = store.serialize_ros1 if form == "bag" else store.serialize_cdr
    with writer:

        def write(topic: str, kind: str, time_s: float, message: Any) -> None:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], EPOCH_S * 10**9 + round(1e9 * time_s), pack(message, kind))

        messages(store, write)
    return path if form == "bag" else path / f"drive.{form}"


@pytest.mark.parametrize("form", ["bag", "db3", "mcap"])
def test_topics_are_columns_on_the_clock_of_the_battery(tmp_path: Path, form: str):
    table = read_table(bag(tmp_path, form))
    frame, time_s = table.frame, LOG.time_s.to_numpy()
    np.testing.assert_allclose(frame["Time (s)"], EPOCH_S + time_s)
    np.testing.assert_allclose(frame["/battery_state.current (A)"], -LOG.current_A, rtol=1e-6)
    inside = time_s >= 0.03
    np.testing.assert_allclose(
        frame["/joint_states.velocity.left_motor (rad/s)"][inside], 3.0 * (time_s[inside] - 0.03), atol=1e-5
    )
    thermometer = frame["/motor_temperature (degC)"].dropna()
    np.testing.assert_allclose(thermometer, 30.0 + time_s[: thermometer.size] / 100.0)
    assert table.units["/joint_states.effort.left_motor (N m)"] == "N m"
    assert table.current_positive_on == "charge"


@pytest.mark.parametrize("form", ["bag", "db3", "mcap"])
def test_a_bag_is_a_case_of_its_battery(tmp_path: Path, form: str):
    (run,) = import_case(bag(tmp_path, form), "cell", ambient=25.0, cells_in_series=4, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.columns["voltage_V"], LOG.voltage_V, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["current_A"], LOG.current_A, rtol=1e-6)
    assert run.start is not None
    assert run.start.value == pytest.approx(0.5)


def test_a_bag_is_a_case_of_a_robot_whose_pack_discharges(tmp_path: Path):
    imported = import_case(bag(tmp_path, "mcap"), "robot", ambient=25.0, constants={"duty": 0.5})
    columns = imported.runs[0].log.columns
    np.testing.assert_allclose(columns["pack_current_A"], LOG.current_A, rtol=1e-6)
    np.testing.assert_allclose(columns["pack_voltage_V"], 4 * LOG.voltage_V, rtol=1e-6)
    np.testing.assert_allclose(columns["load_torque_Nm"], 0.5)
    assert columns["case_temperature_degC"][0] == pytest.approx(30.0)
    assert any(one.about == "sign of pack_current_A" for one in imported.decisions)


def test_a_bag_without_its_package_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    path = tmp_path / "drive.mcap"
    path.write_bytes(MCAP_OF_ROS)
    with pytest.raises(
        MeasurementError, match=r"needs the package rosbags: install jaxmodel\[ros\], or export its topics"
    ):
        read_table(path)


@pytest.mark.parametrize("name", ["drive.mcap", "drive.db3", "drive.bag"])
def test_a_damaged_bag_is_said(tmp_path: Path, name: str):
    pytest.importorskip("rosbags")
    path = tmp_path / name
    path.write_bytes(MCAP_OF_ROS + bytes(range(200)))
    with pytest.raises(MeasurementError, match="cannot be read by rosbags"):
        read_table(path)
