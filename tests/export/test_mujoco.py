"""A motor as an actuator of MuJoCo: the numbers of the file, and what MuJoCo makes of them."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, case_model, run_profile, simulate
from jaxmodel.base.errors import ParameterError
from tests.export.other_python import run_by
from tests.export.test_c_model import made_up

# A start, more voltage under a load, a reversal; rows are whole steps of MuJoCo.
TIME_S = np.concatenate([np.arange(0.0, 0.5, 0.002), np.arange(0.5, 12.0, 0.05)])
VOLTAGE_V = np.where(TIME_S == 0.0, 0.0, np.where(TIME_S < 4.0, 6.0, np.where(TIME_S < 8.0, 12.0, -6.0)))


def driven(load_Nm: float = 0.005, **more) -> Case:
    load = np.where(TIME_S > 2.0, load_Nm, 0.0)
    columns = {"voltage_V": VOLTAGE_V, "load_torque_Nm": load, "ambient_degC": 20.0, "speed_rad_s": 0.0}
    frame = pd.DataFrame({"time_s": TIME_S} | columns)
    return Case.from_dataframes({"a": frame}, kind="motor", name="a motor", **more)


def attributes(case: Case, tag: str, **options) -> dict[str, str]:
    element = ET.fromstring(case.export("mujoco", **options).content).find(f".//{tag}")
    assert element is not None
    return dict(element.attrib)


def numbers(text: str) -> list[float]:
    return [float(number) for number in text.split()]


def test_the_actuator_has_the_numbers_of_the_motor() -> None:
    case = driven(effects={"viscous_friction": {"b": 2e-5}})
    p, motor, joint = case_model(case).parameters, attributes(case, "dcmotor"), attributes(case, "joint")
    body = float(attributes(case, "inertial")["diaginertia"].split()[2])
    assert numbers(motor["motorconst"]) == pytest.approx([float(p.k_tau)] * 2)
    assert float(motor["resistance"]) == pytest.approx(float(p.R_0))
    assert numbers(motor["inductance"]) == pytest.approx([float(p.L_a), 0.0])
    assert float(motor["armature"]) + body == pytest.approx(float(p.J), rel=1e-9)
    assert float(motor["damping"]) == pytest.approx(2e-5)
    assert float(joint["frictionloss"]) == pytest.approx(float(p.tau_0))
    resistance, capacitance, _, coefficient, reference, ambient = numbers(motor["thermal"])
    assert resistance == pytest.approx(float(p.R_wc))
    assert resistance * capacitance == pytest.approx(float(p.tau_wc))
    assert (coefficient, reference, ambient) == pytest.approx((float(p.psi_R), float(p.T_0), 20.0))


def test_presliding_is_lugre_friction_without_a_stribeck_curve() -> None:
    case = driven(effects={"presliding": {"s": 0.8, "d": 0.02}})
    tau_0 = float(case_model(case).parameters.tau_0)
    stiffness, damping, coulomb, static, _ = numbers(attributes(case, "dcmotor")["lugre"])
    assert coulomb == static == pytest.approx(0.8 * tau_0)
    assert stiffness * 0.02 == pytest.approx(coulomb)
    assert damping == 0.0
    assert float(attributes(case, "joint")["frictionloss"]) == pytest.approx(0.2 * tau_0)


def test_the_general_actuator_has_the_line_of_torque_over_speed() -> None:
    case = driven()
    p, motor = case_model(case).parameters, attributes(case, "general", actuator="general")
    warm = float(p.R_0) * (1.0 + float(p.psi_R) * (20.0 - float(p.T_0)))
    assert float(motor["gainprm"]) == pytest.approx(float(p.k_tau) / warm)
    assert numbers(motor["biasprm"]) == pytest.approx([0.0, 0.0, -(float(p.k_tau) ** 2) / warm])


def servo(gear_ratio: float = 1.0, k_d: float = 0.1) -> Case:
    """A geared motor that holds a weight on an arm, its reference a sum of two sines."""
    time_s = np.arange(0.0, 6.0, 0.004)
    reference = 0.8 * np.sin(2.0 * time_s) * np.sin(0.7 * time_s)
    columns = {"reference_position_rad": reference, "ambient_degC": 25.0, "position_rad": 0.1}
    effects = {
        "gravity_load": {"mass_kg": 0.5, "arm_m": 0.1, "gear_ratio": gear_ratio},
        "position_controller": {"k_p": 12.0, "k_d": k_d, "limit": 7.0},
    }
    parameters = {"k_tau": 0.4 / gear_ratio, "R_0": 4.5, "J": 3e-3 / gear_ratio**2, "tau_0": 0.1 / gear_ratio}
    frame = pd.DataFrame({"time_s": time_s} | columns)
    return Case.from_dataframes(
        {"a": frame}, kind="motor", load="gravity", controller="position", effects=effects, parameters=parameters
    )


def test_a_servo_has_its_weight_and_its_controller_in_torque() -> None:
    """v = R/K (kp e - kd w) + K w is k_p e - k_d w."""
    case = servo(gear_ratio=50.0)
    motor, body = attributes(case, "dcmotor"), attributes(case, "inertial")
    k_p, k_i, k_d, _, _, limit = numbers(motor["controller"])
    (k, _), R = numbers(motor["motorconst"]), float(motor["resistance"])
    assert (R / k * k_p * 50.0, R / k * k_d - k, k_i, limit) == pytest.approx((12.0, 0.1, 0.0, 7.0))
    assert (float(motor["gear"]), motor["input"]) == (50.0, "pos")
    assert (float(body["mass"]), numbers(body["pos"])) == (0.5, [0.0, 0.0, -0.1])
    assert float(attributes(case, "joint")["frictionloss"]) == pytest.approx(0.1)
    assert float(attributes(case, "key")["qpos"]) == 0.1
    assert "inductance" not in motor
    assert any("inductance is left out" in sentence for sentence in case.export("mujoco").left_out)


@pytest.mark.parametrize("gear_ratio", [1.0, 50.0])
def test_a_servo_follows_ours(gear_ratio: float, tmp_path: Path) -> None:
    found, ours = rolled_out(servo(gear_ratio), tmp_path, gear=gear_ratio)
    error = np.array(found["position_rad"]) - ours["position_rad"]
    assert np.ptp(ours["position_rad"]) > 0.5
    assert np.abs(error).max() < 0.01
    assert np.sqrt(np.mean(error**2)) < 0.002


def test_what_mujoco_has_not_is_said() -> None:
    case = driven(effects={"brush_drop": {}, "viscous_friction": {}})
    found = case.export("mujoco")
    (sentence,) = [one for one in found.left_out if "brush_drop" in one]
    assert "viscous_friction" not in sentence
    comment = " ".join(found.content.split("-->")[0].replace("\n  ", " ").split())
    assert all(one in comment for one in found.left_out)


def test_a_cell_and_an_unknown_actuator_are_refused() -> None:
    with pytest.raises(ParameterError, match="of a cell"):
        made_up("cell").export("mujoco")
    with pytest.raises(ParameterError, match="'servo' is not one of"):
        driven().export("mujoco", actuator="servo")


def rolled_out(case: Case, folder: Path, gear: float = 1.0, **options) -> tuple[dict, dict]:
    """Return what MuJoCo and what we make of the run; a reference is that of the motor, before its gear."""
    profile = run_profile(case.runs[0])
    ours = simulate(case_model(case, case.runs[0]), profile)
    case.export("mujoco", folder / "motor.xml", **options)
    given = {"time_s": profile.time_s.tolist()} | {name: values.tolist() for name, values in profile.inputs.items()}
    if "reference_position_rad" in given:
        given["reference_position_rad"] = [gear * one for one in given["reference_position_rad"]]
    (folder / "run.json").write_text(json.dumps(given), encoding="utf-8")
    found = run_by("mujoco", "by_mujoco.py", folder / "motor.xml", folder / "run.json")
    readings = {name: np.asarray(values) for name, values in ours.readings.items()}
    return found, readings | {"rise_K": np.asarray(ours.states["x_winding_K"])}


@pytest.mark.parametrize("effect", ["", "viscous_friction", "presliding"])
def test_a_rollout_follows_ours(effect: str, tmp_path: Path) -> None:
    """Within 0.5 % of the largest speed and 1.5 % of the inrush, in which MuJoCo's first-order steps lag."""
    found, ours = rolled_out(driven(effects={effect: {}} if effect else {}), tmp_path)
    speed, current = (ours[name] - np.array(found[name]) for name in ("speed_rad_s", "current_A"))
    assert np.abs(speed).max() < 0.005 * np.abs(ours["speed_rad_s"]).max()
    assert np.sqrt(np.mean(speed**2)) < 0.0005 * np.abs(ours["speed_rad_s"]).max()
    assert np.abs(current).max() < 0.015 * np.abs(ours["current_A"]).max()


def test_a_winding_under_load_warms_alike(tmp_path: Path) -> None:
    """Without friction, whose heat MuJoCo leaves out."""
    found, ours = rolled_out(driven(0.2, parameters={"tau_0": 1e-9}), tmp_path)
    assert found["winding_rise_K"][-1] == pytest.approx(ours["rise_K"][-1], rel=1e-3)


def test_the_general_actuator_ends_at_the_same_speed(tmp_path: Path) -> None:
    """It has no inductance, so that it starts faster."""
    found, ours = rolled_out(driven(), tmp_path, actuator="general")
    assert found["speed_rad_s"][-1] == pytest.approx(ours["speed_rad_s"][-1], rel=1e-3)
