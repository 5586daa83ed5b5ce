"""A motor that is warm when its run begins is modelled as warm: its thermometer is believed, not called faulty."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from jaxmodel import read_case, simulate_case
from jaxmodel.data.importing import import_case
from tests.data.importing.benches import motor_log


def log_of(tmp_path: Path, **thermometers: float) -> Path:
    path = tmp_path / "drive.csv"
    pd.DataFrame(motor_log().assign(**thermometers)).to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("thermometers", "rises"),
    [
        ({"case_temperature_degC": 36.0}, {"initial_case_rise_K": 11.0}),
        ({"case_temperature_degC": 15.0}, {"initial_case_rise_K": -10.0}),
        ({"case_temperature_degC": 26.0}, {}),  # two thermometers at one temperature
        ({"winding_temperature_degC": 36.0}, {"initial_case_rise_K": 11.0}),
        (
            {"case_temperature_degC": 30.0, "winding_temperature_degC": 70.0},
            {"initial_case_rise_K": 5.0, "initial_winding_rise_K": 40.0},
        ),
        ({}, {}),
    ],
)
def test_first_readings_state_how_warm_a_motor_begins(tmp_path: Path, thermometers, rises):
    imported = import_case(log_of(tmp_path, **thermometers), "motor", ambient=25.0)
    assert imported.runs[0].rises == pytest.approx(rises)


def test_the_model_begins_where_the_thermometers_do(tmp_path: Path):
    path = log_of(tmp_path, case_temperature_degC=30.0, winding_temperature_degC=70.0)
    import_case(path, "motor", ambient=25.0, out=tmp_path / "case")
    run = simulate_case(read_case(tmp_path / "case")).runs[0].table
    assert float(run["case_temperature_degC"].iloc[0]) == pytest.approx(30.0, abs=0.1)
    assert float(run["winding_temperature_degC"].iloc[0]) == pytest.approx(70.0, abs=0.5)
