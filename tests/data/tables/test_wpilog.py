"""A data log of WPILib gives the numbers of its entries on one clock, each held until it changes."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError

ROWS = 100
TIME_S = 3.0 + 0.02 * np.arange(ROWS)
VOLTAGE = np.linspace(12.6, 11.0, ROWS)
CURRENT = np.linspace(2.0, 80.0, ROWS)


def record(entry: int, time_s: float, payload: bytes) -> bytes:
    """One record, its lengths as short as they may be."""
    parts = [entry, len(payload), round(1e6 * time_s)]
    sizes = [max((part.bit_length() + 7) // 8, 1) for part in parts]
    lengths = (sizes[0] - 1) | (sizes[1] - 1) << 2 | (sizes[2] - 1) << 4
    return bytes([lengths]) + b"".join(p.to_bytes(n, "little") for p, n in zip(parts, sizes, strict=True)) + payload


def start(entry: int, name: str, kind: str, metadata: str = "") -> bytes:
    texts = b"".join(struct.pack("<I", len(text)) + text.encode() for text in (name, kind, metadata))
    return record(0, 0.1, struct.pack("<BI", 0, entry) + texts)


def log() -> bytes:
    """A robot's log: a voltage and a current each 20 ms, a duty on change, texts, and an entry that is finished."""
    parts = [b"WPILOG" + struct.pack("<HI", 0x0100, 5) + b"extra"]
    parts += [
        start(1, "NT:/SystemStats/BatteryVoltage", "double"),
        start(2, "NT:/PowerDistribution/TotalCurrent", "float", '{"unit": "A"}'),
        start(3, "NT:/Drive/DutyCycle", "double"),
        start(4, "messages", "string"),
        start(5, "NT:/Drive/VelocityRadPerSec", "double[]"),
        start(300, "NT:/Pose", "struct:Pose2d"),
    ]
    for n, time_s in enumerate(TIME_S):
        parts.append(record(1, time_s, struct.pack("<d", VOLTAGE[n])))
        parts.append(record(2, time_s, struct.pack("<f", CURRENT[n])))
        parts.append(record(5, time_s, struct.pack("<2d", 10.0 * n, -10.0 * n)))
        parts.append(record(300, time_s, bytes(24)))
        if n in (0, 50):
            parts.append(record(3, time_s, struct.pack("<d", 0.25 + 0.005 * n)))
            parts.append(record(4, time_s, b"enabled"))
    parts.append(record(0, TIME_S[-1], struct.pack("<BI", 1, 3)))
    return b"".join(parts)


def test_entries_are_columns_on_one_clock(tmp_path: Path):
    path = tmp_path / "FRC_20260314.wpilog"
    path.write_bytes(log())
    table = read_table(path)
    frame = table.frame
    np.testing.assert_allclose(frame["Time (s)"], TIME_S)
    np.testing.assert_allclose(frame["NT:/SystemStats/BatteryVoltage (V)"], VOLTAGE)
    np.testing.assert_allclose(frame["NT:/PowerDistribution/TotalCurrent (A)"], CURRENT, rtol=1e-6)
    np.testing.assert_allclose(frame["NT:/Drive/DutyCycle"], np.where(np.arange(ROWS) < 50, 0.25, 0.5))
    np.testing.assert_allclose(frame["NT:/Drive/VelocityRadPerSec/1 (rad/s)"], -10.0 * np.arange(ROWS))
    assert table.units["NT:/PowerDistribution/TotalCurrent (A)"] == "A"
    assert table.units["NT:/Drive/VelocityRadPerSec/0 (rad/s)"] == "rad/s"
    assert not any(name.startswith(("messages", "NT:/Pose")) for name in frame)


def test_a_robot_of_frc_is_a_case(tmp_path: Path):
    path = tmp_path / "match.wpilog"
    path.write_bytes(log())
    (run,) = import_case(path, "robot", ambient=20.0, constants={"incline_deg": 0.0}).runs
    np.testing.assert_allclose(run.log.columns["pack_voltage_V"], VOLTAGE)
    np.testing.assert_allclose(run.log.columns["pack_current_A"], CURRENT, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["duty"], np.where(np.arange(ROWS) < 50, 0.25, 0.5))
    np.testing.assert_allclose(run.log.columns["speed_rad_s"], 10.0 * np.arange(ROWS))


def test_a_log_that_is_cut_off_keeps_what_is_whole(tmp_path: Path):
    path = tmp_path / "match.wpilog"
    path.write_bytes(log()[:-40])
    table = read_table(path)
    assert len(table.frame) == ROWS
    assert table.losses == ("The log ends within a record, which was left out.",)


def test_a_log_without_numbers_is_said(tmp_path: Path):
    path = tmp_path / "match.wpilog"
    path.write_bytes(b"WPILOG" + struct.pack("<HI", 0x0100, 0) + start(4, "messages", "string"))
    with pytest.raises(MeasurementError, match="data log of WPILib without numbers"):
        read_table(path)
