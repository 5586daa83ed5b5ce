"""Logs of motor controllers, flight controllers and radios become cases, with what their makers fix."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

CELLS = 6


def pack() -> pd.DataFrame:
    """The made cell, six in series, a hundred times as fast."""
    log = cell_log(resistance_ohm=0.03)
    return log.assign(time_s=log.time_s / 10.0, voltage_V=CELLS * log.voltage_V)


def vesc(log: pd.DataFrame) -> str:
    """A log of VESC Tool: semicolons, one of them at the end of each line, milliseconds of the day."""
    columns = {
        "ms_today": (36_000_000 + 1000.0 * log.time_s).astype(int),
        "input_voltage": log.voltage_V,
        "temp_mos_max": 61.0,
        "temp_mos_1": 61.0,
        "temp_motor": 30.0 + 0.01 * log.time_s,
        "current_motor": 2.0 * log.current_A,
        "current_in": log.current_A,
        "d_axis_current": 0.1,
        "q_axis_current": 2.0 * log.current_A,
        "erpm": 7000,
        "duty_cycle": 0.5,
        "amp_hours_used": np.maximum(log.current_A, 0.0).cumsum() / 3600.0,
        "fault_code": "FAULT_CODE_NONE",
        "battery_level": 0.5,
        "current_in_setup": log.current_A,
        "pitch": 0.02,
        "accX": 0.01,
        "gnss_posTime": 0,
        "": "",
    }
    return pd.DataFrame(columns).to_csv(index=False, sep=";")


def blackbox(log: pd.DataFrame, units: bool = True) -> str:
    """A table of Betaflight as blackbox_decode writes it, or in raw counts without units."""
    scale = 1.0 if units else 100.0
    columns = {
        "loopIteration": np.arange(len(log)) * 8,
        "time (us)" if units else "time": (1_234_567 + 1e6 * log.time_s).astype(int),
        "axisP[0]": 3,
        "rcCommand[3]": 1500,
        "vbatLatest (V)" if units else "vbatLatest": scale * log.voltage_V,
        "amperageLatest (A)" if units else "amperageLatest": scale * log.current_A,
        "motor[0]": 412,
        "flightModeFlags (flags)": "ANGLE_MODE",
    }
    return pd.DataFrame(columns).to_csv(index=False).replace(",", ", ")


def radio(log: pd.DataFrame) -> str:
    """A log of OpenTX or EdgeTX that passes midnight: date and time of day in two columns."""
    stamp = pd.Timestamp("2026-07-10 23:59:00") + pd.to_timedelta(log.time_s, unit="s")
    columns = {
        "Date": stamp.dt.strftime("%Y-%m-%d"),
        "Time": stamp.dt.strftime("%H:%M:%S.%f").str[:-3],
        "1RSS(dB)": -60,
        "A1(V)": 5.0,
        "RxBt(V)": log.voltage_V,
        "Curr(A)": log.current_A,
        "Capa(mAh)": 12,
        "Tmp1(@C)": log.temperature_degC,
        "Ptch(rad)": 0.1,
        "FM": "AIR",
        "LSW": "0x0000000000000000",
        "TxBat(V)": 7.9,
    }
    return pd.DataFrame(columns).to_csv(index=False)


@pytest.mark.parametrize("text", [vesc, blackbox, radio])
def test_a_log_of_a_controller_is_a_case_of_its_pack(tmp_path: Path, text):
    path, log = tmp_path / "log.csv", pack()
    path.write_text(text(log))
    (run,) = import_case(path, "cell", ambient=25.0, cells_in_series=CELLS, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.time_s, log.time_s, atol=1e-3)
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A, atol=1e-9)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V / CELLS, atol=1e-9)


def test_a_controllers_log_is_a_case_of_a_robot(tmp_path: Path):
    path, log = tmp_path / "log.csv", pack()
    path.write_text(vesc(log))
    imported = import_case(path, "robot", ambient=25.0, constants={"incline_deg": 0.0})
    columns = imported.runs[0].log.columns
    np.testing.assert_allclose(columns["pack_voltage_V"], log.voltage_V)
    np.testing.assert_allclose(columns["pack_current_A"], log.current_A)
    np.testing.assert_allclose(columns["motor_current_A"], 2.0 * log.current_A)
    np.testing.assert_allclose(columns["duty"], 0.5)
    np.testing.assert_allclose(columns["case_temperature_degC"], 30.0 + 0.01 * log.time_s)
    # What a controller measures of itself is nothing of the robot.
    assert not columns.keys() & {"cell_temperature_degC", "acceleration_m_s2", "winding_temperature_degC"}


def test_a_blackbox_in_raw_counts_is_in_hundredths(tmp_path: Path):
    path, log = tmp_path / "log.csv", pack()
    path.write_text(blackbox(log, units=False))
    (run,) = import_case(path, "cell", ambient=25.0, cells_in_series=CELLS, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V / CELLS)
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)


@pytest.mark.parametrize("name", ["LOG00001.BFL", "blackbox.txt"])
def test_a_binary_blackbox_is_refused_with_what_to_do(tmp_path: Path, name: str):
    path = tmp_path / name
    path.write_bytes(b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n\x00\xfeI\x01")
    with pytest.raises(MeasurementError, match="binary log of a blackbox; decode it with blackbox_decode"):
        read_table(path)


@pytest.mark.parametrize(("text", "name"), [(vesc, "VESC Tool"), (radio, "OpenTX or EdgeTX")])
def test_what_the_readings_do_not_tell_of_the_sign_the_format_does(tmp_path: Path, text, name: str):
    """A pack whose voltage does not move says nothing of the direction of its current."""
    path, log = tmp_path / "log.csv", pack()
    path.write_text(text(log.assign(voltage_V=22.0)))
    assert read_table(path).format == name
    imported = import_case(path, "cell", ambient=25.0, cells_in_series=CELLS, capacity_Ah=3.0)
    np.testing.assert_allclose(imported.runs[0].log.columns["current_A"], log.current_A)
    (sign,) = [one for one in imported.decisions if one.about == "sign of the current"]
    assert (sign.value, sign.source) == ("positive on discharge", "file")


def test_a_thermometer_that_is_not_there_measures_nothing(tmp_path: Path):
    """Controllers write 0 for a sensor that they do not have."""
    path, log = tmp_path / "log.csv", pack()
    path.write_text(radio(log.assign(temperature_degC=0.0)))
    imported = import_case(path, "cell", ambient=25.0, cells_in_series=CELLS, capacity_Ah=3.0)
    assert "cell_temperature_degC" not in imported.runs[0].log.columns
    (found,) = [one for one in imported.findings if one.what == "no sensor"]
    assert "column 'Tmp1(@C)' is 0 throughout" in found.sentence


def test_an_energy_is_no_torque_and_a_gyroscopes_warmth_none_of_a_cell(tmp_path: Path):
    path = tmp_path / "log.csv"
    log = pack().rename(columns={"voltage_V": "pack voltage (V)", "current_A": "pack current (A)"})
    log = log.drop(columns="temperature_degC").assign(**{"EnrgTot (W.s)": log.time_s, "IMU2 temp (degC)": 41.0})
    log.to_csv(path, index=False)
    imported = import_case(path, "robot", ambient=25.0, constants={"duty": 0.5, "incline_deg": 0.0})
    assert not imported.runs[0].log.columns.keys() & {"load_torque_Nm", "cell_temperature_degC"}
