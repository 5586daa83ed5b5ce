"""A robot's own log becomes a case: its columns by their names, duty in percent, an operator's signal, a slope."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import read_case
from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import import_case
from tests.parameterisation.made_robot import drive


def log(incline: bool = False) -> pd.DataFrame:
    """A log under the names that a person would write; the readings are made up."""
    given = drive(0, 300, incline)
    load = given["incline_deg"] / 60.0 if incline else given["load_torque_Nm"]
    current = load / 0.037
    driven = {"V_set [V]": given["V_set"], "Incline [deg]": given["incline_deg"]} if incline else {
        "Duty cycle [%]": 100.0 * given["duty"],
        "Load torque [N m]": load,
    }  # fmt: skip
    read = {
        "Pack voltage [V]": 24.0 - 0.2 * current,
        "Pack current [A]": 0.3 + current,
        "Motor current [mA]": 1000.0 * current,
        "Speed [rpm]": 2000.0 - 30.0 * current,
        "T_winding [°C]": 20.0 + current,
        "T_case [°C]": 20.0 + 0.5 * current,
    }
    return pd.DataFrame({"t [ms]": 1000.0 * given["time_s"], **driven, **read})


@pytest.mark.parametrize("incline", [False, True])
def test_every_column_of_a_robots_log_finds_its_place(tmp_path: Path, incline: bool):
    frame, given = log(incline), drive(0, 300, incline)
    frame.to_csv(tmp_path / "drive.csv", index=False)
    import_case(tmp_path / "drive.csv", "robot", ambient=20.0, out=tmp_path / "case")
    (run,) = read_case(tmp_path / "case").runs
    np.testing.assert_allclose(run.measured.time_s, given["time_s"])
    for name in set(given) - {"time_s"}:
        np.testing.assert_allclose(run.measured.inputs[name], given[name], atol=1e-9)
    expected = {"pack_voltage_V", "pack_current_A", "motor_current_A", "speed_rad_s"}
    assert run.measured.outputs.keys() == expected | {"winding_temperature_degC", "case_temperature_degC"}
    np.testing.assert_allclose(run.measured.outputs["motor_current_A"], frame["Motor current [mA]"] / 1000.0)
    np.testing.assert_allclose(run.measured.outputs["speed_rad_s"], frame["Speed [rpm]"] * np.pi / 30.0)


@pytest.mark.parametrize(
    ("without", "says"),
    [
        (["Duty cycle [%]"], "no column is duty or V_set"),
        (["Load torque [N m]", "Speed [rpm]"], "no column is load_torque_Nm or incline_deg or speed_rad_s.*--load"),
    ],
)
def test_an_input_that_a_robot_needs_is_asked_for(tmp_path: Path, without: list[str], says: str):
    log().drop(columns=without).to_csv(tmp_path / "drive.csv", index=False)
    with pytest.raises(MeasurementError, match=says):
        import_case(tmp_path / "drive.csv", "robot", ambient=20.0)
