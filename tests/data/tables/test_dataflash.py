"""A log of ArduPilot gives its battery and motors in their units, from the binary form and from text."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

_STRUCTS = {"n": "4s", "N": "16s", "Z": "64s", "c": "h", "e": "i", "M": "B"}
FORMATS = {
    128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    10: ("UNIT", "QbZ", "TimeUS,Id,Label"),
    11: ("MULT", "Qbd", "TimeUS,Id,Mult"),
    12: ("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    20: ("BAT", "QBffffc", "TimeUS,Inst,Volt,Curr,CurrTot,Res,Temp"),
    21: ("ESC", "QBe", "TimeUS,Instance,RPM"),
    22: ("IMU", "QBf", "TimeUS,I,GyrX"),
    23: ("MSG", "QZ", "TimeUS,Message"),
}
LOG = cell_log().assign(time_s=lambda log: log.time_s / 10.0)


def message(kind: int, *values: object) -> bytes:
    """One message: two bytes of head, its kind, and the fields of its format."""
    letters = FORMATS[kind][1]
    packed = struct.pack("<" + "".join(_STRUCTS.get(letter, letter) for letter in letters), *values)
    return b"\xa3\x95" + bytes([kind]) + packed


def flight(units: bool = True) -> bytes:
    """Two batteries, two motor controllers and a gyroscope; of the second battery a constant voltage."""
    parts = []
    for kind, (name, letters, fields) in FORMATS.items():
        size = 3 + struct.calcsize("<" + "".join(_STRUCTS.get(letter, letter) for letter in letters))
        parts.append(message(128, kind, size, name.encode(), letters.encode(), fields.encode()))
    if units:
        for letter, unit in {"s": "s", "#": "instance", "v": "V", "A": "A", "a": "Ah", "O": "degC", "q": "rpm"}.items():
            parts.append(message(10, 1, ord(letter), unit.encode()))
        for letter, factor in {"F": 1e-6, "0": 1.0, "C": 1e-3, "B": 1e-2, "-": 0.0}.items():
            parts.append(message(11, 1, ord(letter), factor))
        parts.append(message(12, 1, 20, b"s#vAa-O", b"F-00C-B"))
        parts.append(message(12, 1, 21, b"s#q", b"F-B"))
    parts.append(message(23, 5, b"ArduRover"))
    for row in LOG.itertuples():
        at = round(1e6 * row.time_s) + 7_000_000
        parts.append(message(20, at, 0, 4 * row.voltage_V, row.current_A, 1e3 * row.time_s, 0.01, 2550))
        parts.append(message(20, at, 1, 12.0, 0.5, 0.0, 0.01, 2000))
        parts += [message(21, at + 1000, motor, 100 * (3000 + 1000 * motor)) for motor in (0, 1)]
        parts += [message(22, at + 100 * n, 0, 0.1) for n in range(3)]
    return b"".join(parts)


def text() -> str:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += ["FMT, 20, 46, BAT, QBffffc, TimeUS,Inst,Volt,Curr,CurrTot,Res,Temp", "PARM, 3, BATT_MONITOR, 4"]
    for row in LOG.itertuples():
        at = round(1e6 * row.time_s) + 7_000_000
        lines.append(f"BAT, {at}, 0, {4 * row.voltage_V:.6f}, {row.current_A}, {1e3 * row.time_s:.3f}, 0.01, 25.50")
    return "\n".join(lines)


@pytest.mark.parametrize("form", ["binary", "binary without units", "text"])
def test_a_log_of_ardupilot_is_a_case_of_its_battery(tmp_path: Path, form: str):
    path = tmp_path / ("flight.log" if form == "text" else "00000012.BIN")
    path.write_bytes(text().encode() if form == "text" else flight(form == "binary"))
    (run,) = import_case(path, "cell", ambient=25.0, cells_in_series=4, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.time_s, LOG.time_s, atol=1e-6)
    np.testing.assert_allclose(run.log.columns["voltage_V"], LOG.voltage_V, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["current_A"], LOG.current_A, rtol=1e-6)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], 25.5)


def test_units_and_factors_are_those_that_the_log_states(tmp_path: Path):
    path = tmp_path / "flight.bin"
    path.write_bytes(flight())
    table = read_table(
        path, columns=["BAT.Volt (V)", "BAT.Curr (A)", "BAT.CurrTot (Ah)", "BAT2.Volt (V)", "ESC2.RPM (rpm)"]
    )
    assert table.units["BAT.CurrTot (Ah)"] == "Ah"
    np.testing.assert_allclose(table.frame["BAT.CurrTot (Ah)"], LOG.time_s, rtol=1e-6)
    np.testing.assert_allclose(table.frame["BAT2.Volt (V)"], 12.0)
    np.testing.assert_allclose(table.frame["ESC2.RPM (rpm)"].dropna(), 4000.0)


def test_bytes_that_are_no_message_are_left_out_and_counted(tmp_path: Path):
    path, whole = tmp_path / "flight.bin", flight()
    place = whole.index(b"\xa3\x95\x14", len(whole) // 2)
    path.write_bytes(whole[:place] + b"\x00\xa3\x07noise" + whole[place:-5])
    table = read_table(path)
    assert len(table.frame) == len(LOG)
    assert "bytes between the messages were no messages" in table.losses[0]


def test_a_log_without_readings_is_said(tmp_path: Path):
    path = tmp_path / "flight.bin"
    path.write_bytes(message(128, 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"))
    with pytest.raises(MeasurementError, match="log of ArduPilot without messages of a battery or motor"):
        read_table(path)
