"""Lines that name their numbers, as a controller prints them, are a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from tests.data.importing.benches import cell_log, motor_log, stamps


@pytest.mark.parametrize(
    "line",
    [
        "{clock}.000 -> V:{V},I:{I},T:{T}",
        "t={t} s; U = {V} V; I = {I} A; temp = {T} °C",
        "[{clock}] V={V}V I={I}A T={T}C",
    ],
)
def test_a_printed_log_is_a_case(tmp_path: Path, line: str):
    path, log = tmp_path / "monitor.txt", cell_log()
    clock = stamps(log, "%H:%M:%S")
    columns = zip(log.time_s, clock, log.voltage_V, log.current_A, log.temperature_degC, strict=True)
    lines = [line.format(t=t, clock=at, V=voltage, I=current, T=warmth) for t, at, voltage, current, warmth in columns]
    path.write_text("\n".join(["ready", *lines[:40], "lost a beat", *lines[40:]]))
    imported = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0)
    (run,) = imported.runs
    np.testing.assert_allclose(run.log.time_s, log.time_s)
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], log.temperature_degC)
    assert any(f"2 of {len(log) + 2:,} lines name other numbers" in one.sentence for one in imported.findings)


def test_units_behind_the_numbers_count(tmp_path: Path):
    path, log = tmp_path / "motor.txt", motor_log()
    rows = zip(log.time_s, log.voltage_V, log.current_A, log.speed_rad_s, strict=True)
    path.write_text(
        "\n".join(f"t={1e3 * t:.0f} ms, U={u} V, I={1e3 * i} mA, n={w * 30 / np.pi} rpm" for t, u, i, w in rows)
    )
    (run,) = import_case(path, "motor", ambient=25.0, constants={"load_torque_Nm": 0.0}).runs
    np.testing.assert_allclose(run.log.time_s, log.time_s, atol=1e-9)
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.log.columns["speed_rad_s"], log.speed_rad_s)


def test_settings_above_a_table_are_not_taken_for_it(tmp_path: Path):
    path = tmp_path / "log.csv"
    head = [f"channel {n}: 1.0, gain: 2.0" for n in range(10)]
    path.write_text("\n".join([*head, "time,V,I", *(f"{n},3.7,{n % 2}" for n in range(40))]))
    assert [*read_table(path).frame] == ["time", "V", "I"]
