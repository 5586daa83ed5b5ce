"""A log of PX4 gives battery and motors in their units; the file is laid out as PX4's page on ULog says."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

LOG = cell_log().assign(time_s=lambda log: log.time_s / 10.0)
CELLS = 4
HEAD = b"ULog\x01\x12\x35\x01"
FORMATS = (
    "battery_status:uint64_t timestamp;float voltage_v;float current_a;float temperature;float[4] voltage_cell_v;",
    "esc_report:uint64_t timestamp;int32_t esc_rpm;float esc_current;",
    "esc_status:uint64_t timestamp;esc_report[2] esc;",
)


def record(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), kind[0]) + content


def flight() -> bytes:
    """A log of a copter: a battery of four cells that are measured, one that is not there, two motors."""
    content = HEAD + struct.pack("<Q", 5_000_000) + record(b"B", bytes(40))
    content += b"".join(record(b"F", form.encode()) for form in FORMATS)
    for number, (instance, topic) in enumerate([(0, "battery_status"), (1, "battery_status"), (0, "esc_status")]):
        content += record(b"A", struct.pack("<BH", instance, number) + topic.encode())
    for row in LOG.itertuples():
        time_us = 5_000_000 + round(1e6 * row.time_s)
        cells = [row.voltage_V] * CELLS
        battery = struct.pack("<HQ7f", 0, time_us, CELLS * row.voltage_V, row.current_A, row.temperature_degC, *cells)
        absent = struct.pack("<HQ7f", 1, time_us, 0.0, -1.0, np.nan, *[0.0] * CELLS)
        motors = struct.pack("<HQQifQif", 2, time_us, time_us, 4000, 3.0, time_us, 4100, 3.5)
        content += record(b"D", battery) + record(b"D", absent) + record(b"D", motors)
    return content


def test_a_log_of_px4_is_a_case_of_its_battery(tmp_path: Path):
    pytest.importorskip("pyulog")
    path = tmp_path / "flight.ulg"
    path.write_bytes(flight())
    (run,) = import_case(path, "cell", ambient=25.0, cells_in_series=CELLS, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.time_s, LOG.time_s, atol=1e-6)
    np.testing.assert_allclose(run.log.columns["voltage_V"], LOG.voltage_V, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["current_A"], LOG.current_A, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], LOG.temperature_degC, rtol=1e-6)


def test_topics_and_arrays_are_columns_and_what_was_not_measured_is_missing(tmp_path: Path):
    pytest.importorskip("pyulog")
    path = tmp_path / "log"  # known by its first bytes
    path.write_bytes(flight())
    table = read_table(path)
    np.testing.assert_allclose(table.frame["battery_status.voltage_cell_v[3] (V)"], LOG.voltage_V, rtol=1e-6)
    np.testing.assert_allclose(table.frame["esc_status.esc[1].esc_rpm (rpm)"], 4100.0)
    assert table.frame["battery_status2.current_a (A)"].isna().all()
    assert table.units["battery_status.temperature (degC)"] == "degC"


def test_a_log_that_is_cut_off_keeps_what_is_whole_and_noise_is_said(tmp_path: Path):
    pytest.importorskip("pyulog")
    path, whole = tmp_path / "flight.ulg", flight()
    path.write_bytes(whole[:-500])
    assert len(LOG) - 10 < len(read_table(path).frame) < len(LOG)
    path.write_bytes(HEAD + bytes(5))
    with pytest.raises(MeasurementError, match=r"cannot be read by pyulog|holds no topics"):
        read_table(path)


def test_a_log_without_its_package_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pyulog", None)
    path = tmp_path / "flight.ulg"
    path.write_bytes(flight())
    with pytest.raises(MeasurementError, match=r"needs the package pyulog: install jaxmodel\[ulog\], or convert it"):
        read_table(path)
