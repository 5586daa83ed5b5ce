"""The motor: its steady state, standstill, symmetry, and the energy of a start (eqs. 11-13, 15-17)."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.model import motor as motors
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, constant
from tests.model.runs import readings, staircase

# Coefficients that do not depend on temperature: what follows is then exact.
COLD = {"psi_R": 0.0}
R, K, TAU_0, J, L = 0.103, 0.0385, 0.010, 5.42e-5, 7.2e-5


def run_motor(parameters: dict[str, float], **inputs: np.ndarray) -> dict[str, np.ndarray]:
    """A motor with a row a second."""
    rows = len(next(iter(inputs.values())))
    profile = Profile(np.arange(rows), {"load_torque_Nm": np.zeros(rows), "ambient_degC": np.full(rows, 20.0)} | inputs)
    return readings(Model("motor", Parameters(**parameters)), profile)


@given(st.floats(2.0, 24.0), st.floats(0.0, 0.3), st.sampled_from([-1.0, 1.0]))
def test_steady_state(voltage: float, load: float, direction: float):
    """V = R i + k w and k i = tau_l + tau_0, a second after the start."""
    current = (load + TAU_0) / K
    speed = (voltage - R * current) / K
    profile = constant(4.0, 1.0, voltage_V=direction * voltage, load_torque_Nm=direction * load, ambient_degC=20.0)
    found = readings(Model("motor", Parameters(**COLD)), profile)
    np.testing.assert_allclose(found["current_A"][1:], direction * current, rtol=1e-9)
    np.testing.assert_allclose(found["speed_rad_s"][1:], direction * speed, rtol=1e-9)


def test_a_run_that_begins_with_the_motor_turning_goes_on_where_another_left_it():
    """The second half of a run equals a run that starts at the speed of its middle, once the current has built up."""
    voltage, load = staircase(3, 60, 12.0), np.abs(staircase(4, 60, 0.1))
    whole = run_motor(COLD, voltage_V=voltage, load_torque_Nm=load)
    middle = {"initial_speed_rad_s": float(whole["speed_rad_s"][30])}
    half = run_motor(COLD | middle, voltage_V=voltage[30:], load_torque_Nm=load[30:])
    assert half["speed_rad_s"][0] == whole["speed_rad_s"][30] != 0.0
    np.testing.assert_allclose(half["speed_rad_s"][1:], whole["speed_rad_s"][31:], rtol=1e-6, atol=1e-6)


def test_temperatures_settle_where_the_loss_of_the_warm_motor_puts_them():
    profile = Profile(
        (time := np.concatenate([np.arange(0.0, 60.0, 5.0), np.arange(60.0, 25000.0, 250.0)])),
        {"voltage_V": 0.0 * time + 12.0, "load_torque_Nm": 0.0 * time + 0.15, "ambient_degC": 0.0 * time + 35.0},
    )
    found = readings(Model("motor"), profile)
    current, speed, winding = (
        float(found[name][-1]) for name in ("current_A", "speed_rad_s", "winding_temperature_degC")
    )
    resistance = R * (1.0 + 0.0039 * (winding - 25.0))
    loss = current**2 * resistance + TAU_0 * speed
    assert current == pytest.approx(0.16 / K, rel=1e-9)
    assert speed == pytest.approx((12.0 - resistance * current) / K, rel=1e-6)
    assert winding == pytest.approx(35.0 + (1.2 + 3.8) * loss, abs=1e-3)
    assert float(found["case_temperature_degC"][-1]) == pytest.approx(35.0 + 3.8 * loss, abs=1e-3)


def test_a_held_motor_warms_in_two_exponentials():
    profile = constant(3000.0, 50.0, current_A=4.0, load_torque_Nm=4.0 * K, ambient_degC=25.0)
    found = readings(Model("motor", Parameters(**COLD)), profile)
    loss, time = 4.0**2 * R, profile.time_s
    case = 3.8 * loss * -np.expm1(-time / 1370.0)
    winding = 1.2 * loss * -np.expm1(-time / 71.7)
    np.testing.assert_array_equal(found["speed_rad_s"], 0.0)
    np.testing.assert_allclose(found["case_temperature_degC"], 25.0 + case, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found["winding_temperature_degC"], 25.0 + case + winding, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("voltage", "load"), [(0.0, 0.0099), (0.0, -0.0099), (0.5, 0.19), (-0.5, -0.19)])
def test_standstill_holds_below_breakaway(voltage: float, load: float):
    """At 0.5 V the motor's own torque is 0.187 N m: it holds loads from 0.177 to 0.197."""
    found = run_motor(COLD, voltage_V=np.full(20, voltage), load_torque_Nm=np.full(20, load))
    np.testing.assert_allclose(found["speed_rad_s"], 0.0, atol=1e-12)
    np.testing.assert_allclose(found["current_A"][1:], voltage / R, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("load", [0.0101, -0.0101, 0.2])
def test_a_load_beyond_breakaway_drives_the_motor(load: float):
    """At zero voltage the motor then brakes itself: k w = -R i."""
    found = run_motor(COLD, voltage_V=np.zeros(30), load_torque_Nm=np.full(30, load))
    current = (load - np.sign(load) * TAU_0) / K
    assert float(found["current_A"][-1]) == pytest.approx(current, rel=1e-9)
    assert float(found["speed_rad_s"][-1]) == pytest.approx(-R * current / K, rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_reversed_run_is_the_mirror_image(seed: int):
    voltage, load = staircase(seed, 120, 15.0), staircase(seed + 10, 120, 0.2)
    forward, backward = (run_motor({}, voltage_V=sign * voltage, load_torque_Nm=sign * load) for sign in (1.0, -1.0))
    for name in ("current_A", "speed_rad_s"):
        assert float(np.abs(forward[name]).max()) > 1.0
        np.testing.assert_array_equal(backward[name], -forward[name])
    for name in ("winding_temperature_degC", "case_temperature_degC"):
        np.testing.assert_array_equal(backward[name], forward[name])


@pytest.mark.parametrize("step_s", [0.3, 1.0, 30.0])
@pytest.mark.parametrize("overshoot", [1.0, 20.0], ids=["smooth start", "overshooting start"])
def test_the_heat_of_a_start_is_the_energy_that_went_nowhere_else(step_s: float, overshoot: float):
    """Every joule of the first seconds, the 4 ms of inrush included, whatever the step.

    The integrals of current and speed follow from eqs. 11 and 13, integrated over the whole run. So slow a winding
    loses nothing: its rise is the heat.
    """
    voltage, load, inductance = 12.0, 0.1, L * overshoot
    profile = constant(30.0, step_s, voltage_V=voltage, load_torque_Nm=load, ambient_degC=20.0)
    slow = {"tau_wc": 1e7, "tau_ca": 1e7, "R_wc": 1.0, "R_ca": 1.0, "L_a": inductance}
    found = readings(Model("motor", Parameters(**COLD, **slow)), profile)
    current, speed = (float(found[name][-1]) for name in ("current_A", "speed_rad_s"))
    charge = (J * speed + (load + TAU_0) * 30.0) / K
    angle = (voltage * 30.0 - R * charge - inductance * current) / K
    heat = voltage * charge - load * angle - 0.5 * J * speed**2 - 0.5 * inductance * current**2
    rise = float(found["case_temperature_degC"][-1]) - 20.0
    assert rise * 1e7 == pytest.approx(heat, rel=2e-6)  # rise is 1e7 times smaller than what it is added to


def test_speed_at_an_imposed_current_is_a_straight_line():
    found = run_motor(COLD, current_A=np.full(11, 2.0), load_torque_Nm=np.full(11, 0.06))
    np.testing.assert_allclose(found["speed_rad_s"], (2.0 * K - 0.07) / J * np.arange(11.0), rtol=1e-12)
    np.testing.assert_array_equal(found["current_A"][1:], 2.0)


def test_a_warm_winding_is_equation_17():
    parameters = Parameters(psi_R=0.004, psi_L=-0.001)
    state = {"x_winding_K": 30.0, "x_case_K": 12.0, "motor_current_A": 2.0, "speed_rad_s": 50.0}
    state = {name: jnp.asarray(value) for name, value in state.items()}
    torque, duty, voltage = jnp.asarray(0.1), jnp.asarray(1.0), jnp.asarray(12.0)
    motor = motors.evaluate(parameters, (), state, jnp.asarray(8.0), torque, duty, voltage)
    assert (float(motor.context.winding_degC), float(motor.context.case_degC)) == (50.0, 20.0)
    assert float(motor.winding_resistance_ohm) == pytest.approx(R * 1.1, rel=1e-14)
    assert float(motor.inductance_H) == pytest.approx(L * 0.975, rel=1e-14)
    assert float(motor.torque_constant) == K
