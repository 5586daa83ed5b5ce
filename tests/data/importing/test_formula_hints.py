"""What a file lacks is computed from what it has: the message gives the option, and the option works."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import import_case
from jaxmodel.data.importing.formula_hints import hint_for
from tests.data.importing.benches import cell_log, motor_log


def option_in(text: str) -> dict[str, str]:
    """Return the column of the case and the formula of the option that a sentence names."""
    found = re.search(r'--column (\w+)="([^"]+)"', text)
    assert found
    return {found[1]: found[2]}


def test_the_current_of_a_power_analyser_is_power_over_voltage(tmp_path: Path):
    log = cell_log()
    power = log.current_A * log.voltage_V
    path = tmp_path / "analyser.csv"
    pd.DataFrame({"Time (s)": log.time_s, "Udc (V)": log.voltage_V, "P (W)": power}).to_csv(path, index=False)
    with pytest.raises(MeasurementError, match=r"compute it with --column current_A") as refused:
        import_case(path, "cell", ambient=25.0)
    run = import_case(path, "cell", ambient=25.0, columns=option_in(str(refused.value))).runs[0]
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A, atol=1e-6)


@pytest.mark.parametrize("name", ["C-rate (1/h)", "C-rate", "c_rate"])
def test_a_rate_is_a_current_over_the_capacity(tmp_path: Path, name: str):
    log, path = cell_log(), tmp_path / "rate.csv"
    table = {"Time (s)": log.time_s, "Voltage (V)": log.voltage_V, name: log.current_A / 3.0}
    pd.DataFrame(table).to_csv(path, index=False)
    with pytest.raises(MeasurementError, match=r"CAPACITY_AH") as refused:
        import_case(path, "cell", ambient=25.0)
    formula = option_in(str(refused.value))["current_A"].replace("CAPACITY_AH", "3")
    (run,) = import_case(path, "cell", ambient=25.0, columns={"current_A": formula}).runs
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A, atol=1e-6)


def test_a_controller_logs_the_supply_and_the_field(tmp_path: Path):
    """With 7 pole pairs the field turns 7 times as fast as the shaft; a fan of the supply's voltage is no motor's."""
    log, supply = motor_log(), 24.0
    path = tmp_path / "esc.csv"
    pd.DataFrame(
        {
            "Time (s)": log.time_s,
            "Throttle [%]": 100.0 * log.voltage_V / supply,
            "Voltage [V]": supply,
            "eRPM": log.speed_rad_s * 7.0 * 30.0 / np.pi,
            "Current [A]": log.current_A,
        }
    ).to_csv(path, index=False)
    given = {"ambient": 25.0, "constants": {"load_torque_Nm": 0.0}}
    first = import_case(path, "motor", **given)
    assert "speed_rad_s" not in first.runs[0].log.columns
    said = [one.sentence for one in first.findings if one.what in ("voltage of the supply", "speed of the field")]
    assert len(said) == 2
    columns = {name: text.replace("PAIRS", "7") for one in said for name, text in option_in(one).items()}
    run = import_case(path, "motor", **given, columns=columns).runs[0]
    np.testing.assert_allclose(run.log.columns["speed_rad_s"], log.speed_rad_s, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V, atol=1e-6)


def test_no_formula_is_made_up():
    assert not hint_for("current_A", "cell", {"P (W)": "", "t": "time_s"})  # without a voltage
    assert not hint_for("voltage_V", "motor", {"pwm": "", "rpm": "speed_rad_s"})  # without a supply
    assert not hint_for("speed_rad_s", "motor", {"rpm": "speed_rad_s"})
    assert not hint_for("load_torque_Nm", "motor", {"P (W)": "", "U": "voltage_V"})


def test_a_robot_whose_voltage_was_not_logged_lacks_its_drive_and_not_its_readings(tmp_path: Path):
    path = tmp_path / "wheels.csv"
    t = np.arange(0.0, 20.0, 0.15)
    pd.DataFrame({"time_s": t, "left_motor_current_A": 3.0 + np.sin(t), "left_wheel_speed_m_s": 0.4}).to_csv(path)
    with pytest.raises(MeasurementError, match="no column is duty or V_set, which a robot needs"):
        import_case(path, "robot", ambient=15.0)


def test_readings_of_a_vesc_get_the_formula_of_its_maker():
    names = ["avgMotorCurrent", "avgInputCurrent", "rpm", "dutyCycleNow", "inpVoltage", "t"]
    assert hint_for("speed_rad_s", "motor", dict.fromkeys(names, "")) == '--column speed_rad_s="rpm * 0.10472 / PAIRS"'


@pytest.mark.parametrize(
    ("names", "target", "meant"),
    [
        (["goal_position", "goal_velocity", "position_error"], "reference_position_rad", "goal_position"),
        (["goal_position", "desired speed [rad/s]"], "reference_speed_rad_s", "desired speed [rad/s]"),
        (["target current", "setpoint"], "reference_position_rad", "setpoint"),
        (["position", "speed", "voltage"], "reference_position_rad", ""),
    ],
)
def test_what_a_loop_may_follow_is_proposed(names: list[str], target: str, meant: str):
    found = hint_for(target, "motor", dict.fromkeys(names, ""))
    assert found == (f'--column {target}="{meant}"' if meant else "")
