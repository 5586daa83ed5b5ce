"""Fields that hold a number with its unit or a list of numbers, and lines of names that come again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case, read_table
from tests.data.importing.benches import cell_log, stamps


@pytest.mark.parametrize("decimal", [".", ","])
def test_a_meter_that_changes_its_range_states_its_units(tmp_path: Path, decimal: str):
    path, log = tmp_path / "meter.csv", cell_log()
    lines = ["Time;Voltage;Current;Temp"]
    for at, row in zip(stamps(log, "%H:%M:%S"), log.itertuples(), strict=True):
        current = f"{1e3 * row.current_A:.1f} mA" if abs(row.current_A) < 2.5 else f"{row.current_A:.4f} A"
        lines.append(f"{at};{row.voltage_V}V;{current};{row.temperature_degC} °C".replace(".", decimal))
    path.write_text("\n".join(lines))
    table = read_table(path)
    assert dict(table.units) == {"Voltage": "V", "Current": "A", "Temp": "°C"}
    (run,) = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A, atol=1e-4)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], log.temperature_degC)


def test_a_field_without_its_unit_is_missing(tmp_path: Path):
    path = tmp_path / "meter.csv"
    path.write_text("t,U\n" + "\n".join(f"{n}.0,{'OL' if n == 7 else f'{n} mV'}" for n in range(40)))
    values = read_table(path).frame["U"].to_numpy()
    assert np.flatnonzero(np.isnan(values)).tolist() == [7]
    assert values[8] == 8.0


def test_a_list_in_a_field_is_as_many_columns(tmp_path: Path):
    path, log = tmp_path / "bms.csv", cell_log()
    offsets_V = np.array([0.004, -0.003, 0.0, -0.001])
    table = pd.DataFrame(
        {
            "timestamp": stamps(log, "%Y-%m-%d %H:%M:%S"),
            "pack_current": log.current_A,
            "cell_voltages": [str([round(v + by, 4) for by in offsets_V.tolist()]) for v in log.voltage_V.tolist()],
            "temperatures": [f"[{warmth}, 20.0]" for warmth in log.temperature_degC],
        }
    )
    table.to_csv(path, index=False)
    read = read_table(path)
    assert [*read.frame][2:] == [*(f"cell_voltage {n}" for n in (1, 2, 3, 4)), "temperature 1", "temperature 2"]
    (run,) = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V, atol=1e-4)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], log.temperature_degC)
    assert [*read_table(path, columns=["cell_voltage 2"]).frame] == ["cell_voltage 2"]


def test_names_that_come_again_are_left_out_and_said_once(tmp_path: Path):
    path = tmp_path / "trips.csv"
    header = "Time (s), Battery Voltage(V), Battery Current(A), Mode"
    rows = [f"{n}.5, {4.0 - 0.01 * n:.2f}, 1.0, drive" for n in range(30)]
    path.write_text("\n".join([header, *rows[:20], header, *rows[20:]]))
    table = read_table(path)
    assert table.losses == ("1 line that repeats the names of the columns was left out.",)
    np.testing.assert_allclose(table.frame["Time (s)"], np.arange(30) + 0.5)
    assert table.frame["Battery Voltage(V)"].dtype == float
