"""A motor as settings of a DC-motor actuator: its torque by their law is that of the model at a held speed."""

from __future__ import annotations

import sys
import types
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, case_model, run_profile, simulate
from jaxmodel.base.errors import ParameterError
from tests.export.test_mujoco import driven

LIMIT_V, K_P, K_D = 12.0, 40.0, 0.03
SERVO = {
    "gravity_load": {"mass_kg": 0.2, "arm_m": 0.1, "gear_ratio": 20.0},
    "position_controller": {"k_p": K_P, "k_d": K_D, "limit": LIMIT_V},
    "viscous_friction": {"b": 2e-6},
}


def settings_of(
    case: Case, monkeypatch: pytest.MonkeyPatch, library: str = "isaaclab", **options: Any
) -> dict[str, Any]:
    """Run the file with a library that only keeps what it is given."""
    name = {"isaaclab": "isaaclab.actuators", "mjlab": "mjlab.actuator"}[library]
    module = types.ModuleType(name)
    for cfg in ("DCMotorCfg", "DcMotorActuatorCfg"):
        setattr(module, cfg, dict)
    monkeypatch.setitem(sys.modules, library, types.ModuleType(library))
    monkeypatch.setitem(sys.modules, name, module)
    found: dict[str, Any] = {}
    exec(str(case.export("actuator", library=library, **options).content), found)
    return found["MOTOR"]


def servo() -> Case:
    time_s = np.arange(0.0, 1.0, 0.01)
    columns = {"reference_position_rad": 0.5, "ambient_degC": 25.0, "position_rad": 0.0}
    frame = pd.DataFrame({"time_s": time_s} | columns)
    return Case.from_dataframes(
        {"a": frame},
        kind="motor",
        name="a servo",
        load="gravity",
        controller="position",
        effects=SERVO,
        parameters={"R_0": 2.0, "k_tau": 0.01, "L_a": 1e-5, "J": 1e-7, "tau_0": 1e-4},
    )


def of_model(case: Case, voltage_V: float, speed_rad_s: float) -> float:
    """The torque of the winding at a speed that is held, without its warming."""
    p = case_model(case).parameters
    names = ("R_0", "k_tau", "L_a", "J", "tau_0", "psi_R", "T_0")
    columns = {"voltage_V": voltage_V, "speed_rad_s": speed_rad_s, "ambient_degC": 25.0}
    frame = pd.DataFrame({"time_s": [0.0, 0.05, 0.1]} | columns)
    held = Case.from_dataframes(
        {"a": frame}, kind="motor", load="unknown", parameters={name: float(getattr(p, name)) for name in names}
    )
    readings = simulate(case_model(held), run_profile(held.runs[0])).readings
    return float(p.k_tau) * float(readings["current_A"][1])


def by_settings(motor: dict[str, Any], error_rad: float, speed_rad_s: float) -> float:
    """The law of both libraries."""
    stall, fastest = motor["saturation_effort"], motor["velocity_limit"]
    wanted = motor["stiffness"] * error_rad - motor["damping"] * speed_rad_s
    within = np.clip(wanted, stall * (-1.0 - speed_rad_s / fastest), stall * (1.0 - speed_rad_s / fastest))
    return float(np.clip(within, -motor["effort_limit"], motor["effort_limit"]))


@pytest.mark.parametrize(
    ("error_rad", "speed_rad_s"), [(0.1, 0.0), (0.1, 20.0), (0.6, 10.0), (-0.6, 10.0), (0.6, 45.0)]
)
def test_the_torque_of_a_servo_is_that_of_the_model(
    error_rad: float, speed_rad_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, gear = servo(), 20.0
    motor = settings_of(case, monkeypatch)
    of_motor = gear * speed_rad_s
    voltage = float(np.clip(K_P * error_rad - K_D * of_motor, -LIMIT_V, LIMIT_V))
    expected = gear * of_model(case, voltage, of_motor)
    wanted = motor["stiffness"] * error_rad - motor["damping"] * speed_rad_s
    inside = abs(voltage) < LIMIT_V
    if inside:  # what rubs is in the damping; at the limit the line of torque over speed is without it
        expected -= gear**2 * 2e-6 * speed_rad_s
    assert inside == (abs(wanted - by_settings(motor, error_rad, speed_rad_s)) < 1e-9)
    assert by_settings(motor, error_rad, speed_rad_s) == pytest.approx(expected, rel=2e-3, abs=1e-6)
    assert motor["armature"] == pytest.approx(gear**2 * 1e-7)
    assert motor["friction"] == pytest.approx(gear * 1e-4)
    assert motor["joint_names_expr"] == [".*"]


def test_mjlab_has_other_names_for_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = (settings_of(servo(), monkeypatch, library) for library in ("isaaclab", "mjlab"))
    assert other.pop("target_names_expr") == tuple(one.pop("joint_names_expr"))
    assert other.pop("frictionloss") == one.pop("friction")
    assert other == one


def test_a_motor_without_a_controller_is_driven_by_torques(monkeypatch: pytest.MonkeyPatch) -> None:
    case = driven(effects={"viscous_friction": {"b": 2e-5}})
    motor = settings_of(case, monkeypatch)
    k, R = (float(getattr(case_model(case).parameters, name)) for name in ("k_tau", "R_0"))
    assert motor["velocity_limit"] == pytest.approx(12.0 / k), "the largest voltage of its runs"
    assert motor["saturation_effort"] == pytest.approx(k * 12.0 / R, rel=0.05)
    assert motor["stiffness"] == motor["damping"] == 0.0
    assert any("commands are torques" in sentence for sentence in case.export("actuator").left_out)
    higher = settings_of(case, monkeypatch, voltage_V="24", joints="wheel_.*")
    assert higher["velocity_limit"] == pytest.approx(24.0 / k)
    assert higher["joint_names_expr"] == ["wheel_.*"]


def test_what_cannot_be_written_is_one_sentence() -> None:
    with pytest.raises(ParameterError, match="There is no library 'isaac' to write settings for"):
        driven().export("actuator", library="isaac")
    with pytest.raises(ParameterError, match="voltage_V is a number in V, not 'high'"):
        driven().export("actuator", voltage_V="high")
    with pytest.raises(ParameterError, match="state the bridge's as voltage_V=12"):
        driven().export("actuator", voltage_V=0.0)
