"""A data log of WPILib gives the numbers of its entries on one clock, each held until it changes."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.tables.made_logs import FRC_CURRENT, FRC_ROWS, FRC_TIME_S, FRC_VOLTAGE, frc, start


def test_entries_are_columns_on_one_clock(tmp_path: Path):
    path = tmp_path / "FRC_20260314.wpilog"
    path.write_bytes(frc())
    table = read_table(path)
    frame = table.frame
    np.testing.assert_allclose(frame["Time (s)"], FRC_TIME_S)
    np.testing.assert_allclose(frame["NT:/SystemStats/BatteryVoltage (V)"], FRC_VOLTAGE)
    np.testing.assert_allclose(frame["NT:/PowerDistribution/TotalCurrent (A)"], FRC_CURRENT, rtol=1e-6)
    np.testing.assert_allclose(frame["NT:/Drive/DutyCycle"], np.where(np.arange(FRC_ROWS) < 50, 0.25, 0.5))
    np.testing.assert_allclose(frame["NT:/Drive/VelocityRadPerSec/1 (rad/s)"], -10.0 * np.arange(FRC_ROWS))
    assert table.units["NT:/PowerDistribution/TotalCurrent (A)"] == "A"
    assert table.units["NT:/Drive/VelocityRadPerSec/0 (rad/s)"] == "rad/s"
    assert not any(name.startswith(("messages", "NT:/Pose")) for name in frame)


def test_a_robot_of_frc_is_a_case(tmp_path: Path):
    path = tmp_path / "match.wpilog"
    path.write_bytes(frc())
    (run,) = import_case(path, "robot", ambient=20.0, constants={"incline_deg": 0.0}).runs
    np.testing.assert_allclose(run.log.columns["pack_voltage_V"], FRC_VOLTAGE)
    np.testing.assert_allclose(run.log.columns["pack_current_A"], FRC_CURRENT, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["duty"], np.where(np.arange(FRC_ROWS) < 50, 0.25, 0.5))
    np.testing.assert_allclose(run.log.columns["speed_rad_s"], 10.0 * np.arange(FRC_ROWS))


def test_a_log_that_is_cut_off_keeps_what_is_whole(tmp_path: Path):
    path = tmp_path / "match.wpilog"
    path.write_bytes(frc()[:-40])
    table = read_table(path)
    assert len(table.frame) == FRC_ROWS
    assert table.losses == ("The log ends within a record, which was left out.",)


def test_a_log_without_numbers_is_said(tmp_path: Path):
    path = tmp_path / "match.wpilog"
    path.write_bytes(b"WPILOG" + struct.pack("<HI", 0x0100, 0) + start(4, "messages", "string"))
    with pytest.raises(MeasurementError, match="data log of WPILib without numbers"):
        read_table(path)
