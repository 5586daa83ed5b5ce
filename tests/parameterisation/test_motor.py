"""A motor of known truth is recovered, and what its readings cannot give is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case
from jaxmodel.base.errors import FitError
from jaxmodel.parameterisation import Parameterisation, parameterise
from jaxmodel.parameterisation.motor_friction import _told_apart
from tests.parameterisation import made

SIGMAS = 4.0


@pytest.fixture(scope="module")
def found() -> Parameterisation:
    return parameterise(Case.from_dataframes({"steps": made.measured_motor()}, kind="motor", name="made"))


@pytest.mark.parametrize("name", ["R_0", "k_tau", "J", "tau_0"])
def test_numbers_are_recovered(found: Parameterisation, name: str) -> None:
    one = found[name]
    assert abs(one.value - made.MOTOR[name]) < SIGMAS * one.sd + 0.005 * made.MOTOR[name]
    assert found.case.parameters[name].sd == pytest.approx(one.sd, rel=1.0)


def test_friction_that_grows_with_speed_is_an_effect_of_the_case(found: Parameterisation) -> None:
    assert found.case.effects["viscous_friction"]["b"] == pytest.approx(made.VISCOUS, rel=0.05)


def test_forward_simulation_is_as_good_as_the_sensors(found: Parameterisation) -> None:
    errors = found.errors.set_index("reading")["rms"]
    assert errors["current_A"] < 0.03
    assert errors["speed_rad_s"] < 0.3


def test_a_gear_that_loses_a_share_of_the_load_is_an_effect_of_the_case() -> None:
    """Steady points at three voltages under several loads: R, k, constant friction and the share are told apart."""
    volts, load = (one.ravel() for one in np.meshgrid([6.0, 9.0, 12.0], np.linspace(0.0, 0.4, 9)))
    frame = pd.DataFrame({"time_s": 10.0 * np.arange(volts.size), "voltage_V": volts, "load_torque_Nm": load})
    frame["current_A"] = (0.05 + 1.3 * load) / 0.7
    frame["speed_rad_s"] = (volts - 5.0 * frame["current_A"]) / 0.7
    noise = np.random.default_rng(3).normal(0.0, 1.0, (2, volts.size))
    frame = frame.assign(current_A=frame.current_A + 2e-3 * noise[0], speed_rad_s=frame.speed_rad_s + 0.02 * noise[1])
    exact = {"psi_R": 0.0, "J": 1e-4}
    case = Case.from_dataframes({"points": frame.assign(ambient_degC=25.0)}, kind="motor", parameters=exact)
    found = parameterise(case)
    assert found.case.effects["gear_loss"]["e"] == pytest.approx(0.3, rel=0.1)
    assert found["k_tau"].value == pytest.approx(0.7, rel=0.02)
    assert found["tau_0"].value == pytest.approx(0.05, rel=0.1)


def test_heating_without_a_thermometer_is_not_in_the_data(found: Parameterisation) -> None:
    for name in ("R_wc", "R_ca", "L_a"):
        assert not found[name].found
        assert found[name].test


def test_without_a_current_a_known_load_tells_the_resistance() -> None:
    frame = made.measured_motor(columns=("speed_rad_s",))
    found = parameterise(Case.from_dataframes({"steps": frame}, kind="motor", parameters={"R_0": (0.3, 0.1)}))
    assert found["R_0"].found
    assert found["R_0"].value == pytest.approx(made.MOTOR["R_0"], rel=0.05)
    assert not found["L_a"].found  # no lag is made up


def test_without_a_current_and_a_load_the_resistance_is_not_in_the_data() -> None:
    frame = made.measured_motor(columns=("speed_rad_s",), load=0.0)
    found = parameterise(Case.from_dataframes({"steps": frame}, kind="motor", parameters={"R_0": (0.3, 0.1)}))
    assert not found["R_0"].found
    assert "locked" in found["R_0"].test
    assert not found["L_a"].found  # no lag is made up
    assert found["k_tau"].value == pytest.approx(made.MOTOR["k_tau"], rel=0.05)


def test_torques_of_a_motor_of_unknown_resistance_are_known_as_sizes_only() -> None:
    """Voltage and speed tell J R/k^2: with half the resistance the inertia is twice as large."""
    frame = made.measured_motor(columns=("speed_rad_s",), load=0.0)
    found = parameterise(Case.from_dataframes({"steps": frame}, kind="motor"))
    for name in ("J", "tau_0"):
        assert found[name].sd >= 0.99 * found[name].value
        assert "in proportion to 1 / R_0, which no reading tells" in found[name].method
        assert found.case.parameters[name].sd == pytest.approx(found[name].sd, rel=0.01)
    assert found["k_tau"].sd < 0.1 * found["k_tau"].value


def test_a_known_torque_constant_gives_the_resistance_that_one_speed_does_not() -> None:
    """At one speed V = R i + k w has one equation for two numbers: R is (V - k w) / i, as sure as k is."""
    random = np.random.default_rng(4)
    k, R, speed, current = 7.6e-4, 1.05, 2400.0, 1.0
    frame = pd.DataFrame({"time_s": np.arange(60.0), "voltage_V": R * current + k * speed, "ambient_degC": 20.0})
    frame["current_A"] = current + 1e-3 * random.normal(size=60)
    frame["speed_rad_s"] = speed + random.normal(size=60)
    stated = {"k_tau": k, "psi_R": 0.0}
    found = parameterise(Case.from_dataframes({"full": frame}, kind="motor", load="propeller", parameters=stated))
    assert found["R_0"].value == pytest.approx(R, rel=2e-3)
    assert not [one for one in found.extractions if one.name == "k_tau"]


def test_a_preset_keeps_its_torque_constant_where_no_current_was_read(tmp_path: Path) -> None:
    frame = made.measured_motor(columns=("speed_rad_s",)).drop(columns="load_torque_Nm")
    head = 'title = "Sheet"\nkinds = ["motor"]\ndata = "data sheet"\nlicence = "none"\n'
    (tmp_path / "sheet.toml").write_text(f"{head}[parameters]\nk_tau = {{ value = 0.03, sd = 0.003 }}\n", "utf-8")
    case = Case.from_dataframes({"steps": frame}, kind="motor", load="propeller", preset=str(tmp_path / "sheet.toml"))
    one = parameterise(case)["k_tau"]
    assert (one.value, one.sd, one.found) == (0.03, 0.003, False)
    assert "sheet.toml" in one.method


def test_a_lag_between_voltage_and_speed_is_found() -> None:
    frame = made.measured_motor(columns=("speed_rad_s",), L_a=0.03)
    exact = {"R_0": made.MOTOR["R_0"]}
    one = parameterise(Case.from_dataframes({"steps": frame}, kind="motor", parameters=exact))["L_a"]
    assert one.found
    assert abs(one.value - 0.03) < SIGMAS * one.sd + 0.0015


def test_heating_gives_thermal_resistances() -> None:
    time = np.arange(0.0, 6000.0, 10.0)
    power = 20.0
    rise = 2.0 * power * (1.0 - np.exp(-time / 900.0))
    frame = made.motor_frame().iloc[: time.size].assign(time_s=time, voltage_V=6.0, load_torque_Nm=0.0)
    frame["current_A"] = np.sqrt(power / made.MOTOR["R_0"])
    frame["case_temperature_degC"] = 25.0 + rise
    exact = {"R_0": made.MOTOR["R_0"], "psi_R": 0.0, "k_tau": 0.05, "tau_0": 0.0}
    found = parameterise(Case.from_dataframes({"heat": frame}, kind="motor", parameters=exact))
    assert found["R_ca"].value == pytest.approx(2.0, rel=0.03)
    assert found["tau_ca"].value == pytest.approx(900.0, rel=0.03)


def test_a_motor_without_readings_is_refused() -> None:
    with pytest.raises(FitError, match="speed_rad_s"):
        parameterise(Case.from_dataframes({"steps": made.motor_frame()}, kind="motor"))


def stepped(viscous: float, seed: int) -> pd.DataFrame:
    """A step of the voltage, no current: a motor of 0.05 V s/rad and 1 ohm that rubs in proportion to its speed."""
    time_s = np.arange(0.0, 6.0, 0.01)
    volts = np.where(time_s < 2.0, 5.0, 15.0)
    gain, lag_s = 0.05 / (0.05**2 + viscous), 1e-4 / (0.05**2 + viscous)
    speed = np.full(time_s.size, 5.0 * gain)
    for row in range(1, time_s.size):
        speed[row] = speed[row - 1] + 0.01 * (gain * volts[row] - speed[row - 1]) / lag_s
    noise = 0.05 * np.random.default_rng(seed).normal(size=time_s.size)
    return pd.DataFrame(
        {
            "time_s": time_s,
            "voltage_V": volts,
            "speed_rad_s": speed + noise,
            "load_torque_Nm": 0.0,
            "ambient_degC": 22.0,
        }
    )


@pytest.mark.parametrize(("viscous", "expected"), [(2e-3, True), (1e-4, False)])
def test_runs_of_a_motor_with_another_brake_contradict_each_other(viscous: float, expected: bool) -> None:
    frames = {"off": stepped(1e-4, 1), "half": stepped(viscous, 2)}
    found = parameterise(Case.from_dataframes(frames, kind="motor", name="made"))
    said = [remark for remark in found.remarks if remark.code == "runs_contradict"]
    assert bool(said) is expected
    if expected:
        assert "one motor for all of off, half leaves" in said[0]
        assert said[0].numbers["alone"] < 0.25 * said[0].numbers["together"]


def test_a_constant_torque_is_told_apart_where_the_motor_turns_both_ways() -> None:
    speed = np.concatenate([np.linspace(10.0, 100.0, 50), -np.linspace(10.0, 100.0, 50)])
    columns = {"tau_0": np.sign(speed), "direction": np.ones(speed.size)}
    assert _told_apart(columns, ["tau_0"], "direction")
    one_way = {name: values[:50] for name, values in columns.items()}
    assert not _told_apart(one_way, ["tau_0"], "direction"), "it is friction there"
