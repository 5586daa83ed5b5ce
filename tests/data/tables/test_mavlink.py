"""A telemetry log of MAVLink gives battery and motors in their units, in either version of the protocol."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

LOG = cell_log().assign(time_s=lambda log: log.time_s / 10.0)
EPOCH_US = 1_760_000_000_000_000
CELLS = 4


def telemetry(version: int = 2, wrong: int = -1) -> bytes:
    """A log of a copter with two batteries and four motors; the check sum of one packet may be wrong."""
    dialect: Any = pytest.importorskip(f"pymavlink.dialects.v{version}0.ardupilotmega")
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    ground = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    content = bytearray()
    empty = [65_535] * 10
    for row in LOG.itertuples():
        current_cA, volts = round(100.0 * row.current_A), 1000.0 * CELLS * row.voltage_V
        degC = round(100.0 * row.temperature_degC)
        messages = [
            sender.sys_status_encode(0, 0, 0, 500, round(volts), current_cA, -1, 0, 0, 0, 0, 0, 0),
            sender.battery_status_encode(0, 0, 1, degC, [round(volts), *empty[1:]], current_cA, -1, -1, 55),
            sender.battery_status_encode(1, 0, 1, 32_767, empty, 0, -1, -1, -1),
        ]
        if version == 2:  # its number is above those of version 1
            rpm = [4000, 4100, 4200, 4300]
            messages.append(sender.esc_telemetry_1_to_4_encode([30] * 4, [1200] * 4, [250] * 4, [0] * 4, rpm, [0] * 4))
        packets = [*(message.pack(sender) for message in messages), ground.heartbeat_encode(6, 8, 0, 0, 0).pack(ground)]
        for packet in map(bytearray, packets):
            packet[-1] ^= 0xFF * (row.Index == wrong)
            content += struct.pack(">Q", EPOCH_US + round(1e6 * row.time_s)) + packet
    return bytes(content)


@pytest.mark.parametrize("version", [1, 2])
def test_telemetry_is_a_case_of_its_battery(tmp_path: Path, version: int):
    path = tmp_path / "flight.tlog"
    path.write_bytes(telemetry(version))
    imported = import_case(path, "cell", ambient=25.0, cells_in_series=CELLS, capacity_Ah=3.0)
    (run,) = imported.runs
    np.testing.assert_allclose(run.log.time_s, LOG.time_s, atol=1e-5)
    np.testing.assert_allclose(run.log.columns["voltage_V"], LOG.voltage_V, atol=0.5e-3)
    np.testing.assert_allclose(run.log.columns["current_A"], LOG.current_A, atol=0.5e-2)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], LOG.temperature_degC, atol=0.5e-2)


def test_what_was_not_measured_is_missing(tmp_path: Path):
    path = tmp_path / "flight.tlog"
    path.write_bytes(telemetry())
    table = read_table(path)
    assert "SYS_STATUS.battery_remaining (%)" not in table.frame
    assert "BATTERY_STATUS2.temperature (degC)" not in table.frame
    assert "BATTERY_STATUS.voltages.1 (mV)" not in table.frame
    np.testing.assert_allclose(table.frame["BATTERY_STATUS.battery_remaining (%)"], 55.0)
    np.testing.assert_allclose(table.frame["ESC_TELEMETRY_1_TO_4.rpm.2 (rpm)"], 4200.0)
    np.testing.assert_allclose(table.frame["SYS_STATUS.load (%)"], 50.0)


def test_damaged_packets_are_left_out(tmp_path: Path):
    path, whole = tmp_path / "flight.tlog", telemetry(wrong=3)
    place = whole.index(struct.pack(">Q", EPOCH_US + 100_000_000))
    path.write_bytes(whole[:place] + b"noise" + whole[place:-5])
    table = read_table(path)
    assert len(table.frame) == len(LOG) - 1
    assert "bytes between the messages were no messages" in table.losses[0]


def test_a_file_that_is_no_telemetry_is_said(tmp_path: Path):
    pytest.importorskip("pymavlink")
    path = tmp_path / "flight.tlog"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(MeasurementError, match=r"holds no messages of MAVLink with numbers; give the \.bin log"):
        read_table(path)


def test_telemetry_without_its_package_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.ardupilotmega", None)
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"\0" * 20)
    with pytest.raises(MeasurementError, match=r"needs the package pymavlink: install jaxmodel\[mavlink\], or give"):
        read_table(path)
