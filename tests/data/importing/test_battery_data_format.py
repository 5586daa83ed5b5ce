"""The Battery Data Format: labels and machine-readable names are both known, and its sign is fixed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import read_table
from jaxmodel.data.importing import import_case
from tests.data.importing.benches import cell_log

NAMES = {  # of machines: of persons
    "test_time_second": "Test Time / s",
    "voltage_volt": "Voltage / V",
    "current_ampere": "Current / A",
    "unix_time_second": "Unix Time / s",
    "cycle_count": "Cycle Count / 1",
    "step_count": "Step Count / 1",
    "ambient_temperature_celsius": "Ambient Temperature / degC",
    "temperature_t1_celsius": "Temperature T1 / degC",
}


def written(folder: Path, log: pd.DataFrame, suffix: str, labels: bool) -> Path:
    columns = (log.time_s, log.voltage_V, -log.current_A, 1.7e9 + log.time_s, 1, log.step, 24.0, log.temperature_degC)
    table = pd.DataFrame(dict(zip(NAMES, columns, strict=True)))
    path = folder / f"cell.bdf{suffix}"
    table = table.rename(columns=NAMES) if labels else table
    table.to_parquet(path) if suffix == ".parquet" else table.to_csv(path, index=False)
    return path


@pytest.mark.parametrize("labels", [True, False])
@pytest.mark.parametrize("suffix", ["", ".csv", ".parquet"])
def test_every_column_of_the_format_finds_its_place(tmp_path: Path, suffix: str, labels: bool):
    log = cell_log()[::4].reset_index(drop=True)
    path = written(tmp_path, log, suffix, labels)
    table = read_table(path)
    assert (table.format, table.current_positive_on) == ("Battery Data Format", "charge")
    (run,) = import_case(path, "cell").runs
    np.testing.assert_allclose(run.log.time_s, log.time_s)
    np.testing.assert_array_equal(run.log.columns["current_A"], log.current_A)
    np.testing.assert_array_equal(run.log.columns["voltage_V"], log.voltage_V)
    np.testing.assert_array_equal(run.log.columns["cell_temperature_degC"], log.temperature_degC)
    np.testing.assert_array_equal(run.log.columns["ambient_degC"], 24.0)


def test_the_format_settles_a_sign_that_physics_cannot(tmp_path: Path):
    log = cell_log()[::4].reset_index(drop=True).assign(voltage_V=3.7)
    (run,) = import_case(written(tmp_path, log, ".csv", labels=False), "cell").runs
    np.testing.assert_array_equal(run.log.columns["current_A"], log.current_A)


def test_names_of_another_table_are_not_the_format(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("Test Time / s,Voltage / V\n0,4.0\n1,3.9\n2,3.8\n")
    assert read_table(path).current_positive_on is None
