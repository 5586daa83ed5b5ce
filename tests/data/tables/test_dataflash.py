"""A log of ArduPilot gives its battery and motors in their units, from the binary form and from text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.tables.made_logs import FLIGHT, flight, flight_text, message


@pytest.mark.parametrize("form", ["binary", "binary without units", "text"])
def test_a_log_of_ardupilot_is_a_case_of_its_battery(tmp_path: Path, form: str):
    path = tmp_path / ("flight.log" if form == "text" else "00000012.BIN")
    path.write_bytes(flight_text().encode() if form == "text" else flight(form == "binary"))
    (run,) = import_case(path, "cell", ambient=25.0, cells_in_series=4, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.time_s, FLIGHT.time_s, atol=1e-6)
    np.testing.assert_allclose(run.log.columns["voltage_V"], FLIGHT.voltage_V, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["current_A"], FLIGHT.current_A, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], 25.5)


def test_units_and_factors_are_those_that_the_log_states(tmp_path: Path):
    path = tmp_path / "flight.bin"
    path.write_bytes(flight())
    table = read_table(
        path, columns=["BAT.Volt (V)", "BAT.Curr (A)", "BAT.CurrTot (Ah)", "BAT2.Volt (V)", "ESC2.RPM (rpm)"]
    )
    assert table.units["BAT.CurrTot (Ah)"] == "Ah"
    np.testing.assert_allclose(table.frame["BAT.CurrTot (Ah)"], FLIGHT.time_s, rtol=1e-6)
    np.testing.assert_allclose(table.frame["BAT2.Volt (V)"], 12.0)
    np.testing.assert_allclose(table.frame["ESC2.RPM (rpm)"].dropna(), 4000.0)


def test_bytes_that_are_no_message_are_left_out_and_counted(tmp_path: Path):
    path, whole = tmp_path / "flight.bin", flight()
    place = whole.index(b"\xa3\x95\x14", len(whole) // 2)
    path.write_bytes(whole[:place] + b"\x00\xa3\x07noise" + whole[place:-5])
    table = read_table(path)
    assert len(table.frame) == len(FLIGHT)
    assert "bytes between the messages were no messages" in table.losses[0]


def test_a_log_without_readings_is_said(tmp_path: Path):
    path = tmp_path / "flight.bin"
    path.write_bytes(message(128, 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"))
    with pytest.raises(MeasurementError, match="log of ArduPilot without messages of a battery or motor"):
        read_table(path)
