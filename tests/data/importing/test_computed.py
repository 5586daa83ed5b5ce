"""Columns from formulas, chosen rows, and a speed from a position."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import import_case
from tests.data.importing.benches import motor_log


def write(folder: Path, frame: pd.DataFrame, name: str = "log.csv") -> Path:
    frame.to_csv(folder / name, index=False)
    return folder / name


def test_a_formula_is_a_column_and_has_the_unit_of_the_case(tmp_path: Path):
    log = motor_log()
    frame = log.drop(columns=["voltage_V", "speed_rad_s"])
    frame = frame.assign(duty=log.voltage_V / 24.0, supply_mV=24.0, **{"wheel speed": 0.1 * log.speed_rad_s})
    columns = {"voltage_V": "duty * supply_mV", "speed_rad_s": "`wheel speed` / 0.1"}
    imported = import_case(write(tmp_path, frame), "motor", ambient=23.0, columns=columns)
    for name in ("voltage_V", "speed_rad_s"):
        np.testing.assert_allclose(imported.runs[0].log.columns[name], log[name])
    millivolts = import_case(
        tmp_path / "log.csv", "motor", ambient=23.0, columns=columns, units={"duty * supply_mV": "mV"}
    )
    np.testing.assert_allclose(millivolts.runs[0].log.columns["voltage_V"], 1e-3 * log.voltage_V)


def test_only_the_rows_that_a_condition_names_are_imported(tmp_path: Path):
    log = motor_log().assign(state=np.where(np.arange(400) < 300, "lift", "lower"))
    path = write(tmp_path, log)
    imported = import_case(path, "motor", ambient=23.0, rows="state == 'lift' and voltage_V > 6")
    np.testing.assert_array_equal(imported.runs[0].log.columns["voltage_V"], log.voltage_V[100:300])
    assert any(one.about == "rows" and one.why == "200 of 400 rows" for one in imported.decisions)


def test_two_columns_of_the_case_may_be_one_of_the_file(tmp_path: Path):
    """Steady points without a clock: the voltage is what tells the runs apart."""
    path = write(tmp_path, motor_log(seconds=0.8).drop(columns="time_s"))
    stated = {"step": "voltage_V", "voltage_V": "voltage_V"}
    imported = import_case(path, "motor", ambient=23.0, columns=stated, split_at="steps", seconds_per_row=10.0)
    assert [set(run.log.columns["voltage_V"]) for run in imported.runs] == [{6.0}, {12.0}, {18.0}, {24.0}]
    assert [run.label.split(", ")[-1] for run in imported.runs] == ["6 V", "12 V", "18 V", "24 V"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"rows": "speed > 1"}, "lacks a column of 'speed > 1'"),
        ({"rows": "voltage_V > 1000"}, "holds for no row"),
        ({"rows": "voltage_V >"}, "is not a formula"),
        ({"columns": {"voltage_V": "duty * supply"}}, "or the columns of that formula"),
        ({"columns": {"voltage_V": "voltage_V * ("}}, "nor a formula of columns"),
        ({"columns": {"voltage_V": "voltage_V.to_csv('stolen.csv')"}}, "nor a formula of columns"),
        ({"columns": {"voltage_V": "voltage_V + @pd"}}, "nor a formula of columns"),
        ({"columns": {"voltage_V": "1 * voltage_V.__class__"}}, "nor a formula of columns"),
        ({"columns": {"voltage_V": "voltage_V[0] + 1"}}, "nor a formula of columns"),
        ({"columns": {"voltage_V": "voltage_V * 9**9**9**9"}}, "nor a formula of columns"),
        ({"columns": {"voltage_V": "(" * 5000 + "voltage_V"}}, "nor a formula of columns"),
        ({"rows": "open('log.csv') == 1"}, "is not a formula"),
    ],
)
def test_a_wrong_formula_gets_one_sentence(tmp_path: Path, options, says):
    with pytest.raises(MeasurementError, match=says.replace("(", r"\(")) as caught:
        import_case(write(tmp_path, motor_log()), "motor", ambient=23.0, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("rounding_rad", [1e-6, 0.02, 0.5])
def test_the_speed_of_an_encoder_is_the_slope_of_its_angle(tmp_path: Path, rounding_rad: float):
    time_s = np.arange(0.0, 10.0, 0.005)
    speed = 20.0 * (1.0 - np.cos(time_s))
    angle = np.round(20.0 * (time_s - np.sin(time_s)) / rounding_rad) * rounding_rad
    frame = pd.DataFrame({"time_s": time_s, "voltage_V": 12.0, "load_torque_Nm": 0.0, "angle_deg": np.degrees(angle)})
    run = import_case(write(tmp_path, frame), "motor", ambient=23.0).runs[0].log
    assert "position_rad" not in run.columns
    error = run.columns["speed_rad_s"] - speed
    assert np.sqrt(np.mean(error**2)) < 0.2 + 0.5 * rounding_rad


def test_a_measured_speed_comes_before_a_position(tmp_path: Path):
    log = motor_log()
    frame = log.assign(position_rad=np.linspace(0.0, 1.0, len(log)))
    run = import_case(write(tmp_path, frame), "motor", ambient=23.0).runs[0].log
    np.testing.assert_array_equal(run.columns["speed_rad_s"], log.speed_rad_s)
