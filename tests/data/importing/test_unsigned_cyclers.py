"""Cyclers of all sorts: tails of a charge without a sign, slow discharges beside fast pulses, a charger's supply."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case

CAPACITY_AH = 4.0


def cell(parts: list[tuple[float, float]], step_s: float = 20.0) -> pd.DataFrame:
    """A full cell under loads of so many seconds and amperes; positive on discharge."""
    current = np.concatenate([np.full(int(seconds / step_s), amperes) for seconds, amperes in parts])
    soc = 1.0 - np.cumsum(current) * step_s / 3600.0 / CAPACITY_AH
    return pd.DataFrame(
        {
            "time_s": step_s * np.arange(current.size),
            "current_A": current,
            "voltage_V": 3.0 + 1.2 * soc - 0.02 * current,
        }
    )


def imported(folder: Path, frame: pd.DataFrame, **options):
    path = folder / "bench.csv"
    frame.to_csv(path, index=False)
    return import_case(path, "cell", ambient=25.0, **options)


def test_the_tail_of_a_charge_is_a_charge(tmp_path: Path):
    """Below 2 % of the largest current, which a pulse of 10 A is here."""
    log = cell([(600, 0.0), (60, 10.0), (600, 0.0), (3600, 2.0), (600, 0.0), (3000, -2.0), (1800, -0.1), (600, 0.0)])
    state = np.where(log.current_A > 0.0, "D", np.where(log.current_A < 0.0, "C", "R"))
    (run,) = imported(tmp_path, log.assign(current_A=log.current_A.abs(), State=state)).runs
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)


def test_a_slow_discharge_beside_fast_pulses_tells_the_capacity(tmp_path: Path):
    hours = 3600.0 * (CAPACITY_AH - 10.0 * 60.0 / 3600.0) / 0.4
    log = cell([(600, 0.0), (60, 10.0), (600, 0.0), (hours, 0.4), (600, 0.0)])
    found = imported(tmp_path, log)
    assert found.capacity is not None
    assert found.capacity.value == pytest.approx(CAPACITY_AH, rel=0.02)
    assert "from full to the cut-off" in found.capacity.why


def test_the_supply_of_a_charger_is_no_voltage_of_the_cell(tmp_path: Path):
    log = cell([(600, 0.0), (3600, 2.0), (600, 0.0)])
    frame = log.rename(columns={"voltage_V": "AvgCellVolts", "current_A": "Amps"})
    found = imported(tmp_path, frame.assign(LSupplyVolts=15.0, SupplyVolts=15.0))
    np.testing.assert_allclose(found.runs[0].log.columns["voltage_V"], log.voltage_V)


def test_an_input_without_a_thermometer_is_left_out(tmp_path: Path):
    log = cell([(600, 0.0), (3600, 2.0), (600, 0.0)])
    found = imported(tmp_path, log.assign(cell_temperature_degC=-75.0 - 0.1 * (log.index % 3)))
    assert "cell_temperature_degC" not in found.runs[0].log.columns
    (said,) = [one.sentence for one in found.findings if one.what == "no thermometer"]
    assert "reads -75 degC at most: no thermometer is connected" in said
