"""The robot around the motors: equations 14 and 18 to 22 by hand, and the pack that feeds all."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.effects import CATALOGUE
from jaxmodel.model import robot as robots
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, constant
from tests.model.runs import readings


@pytest.mark.parametrize(("signal", "duty"), [(0.0, -1.0), (2.5, 0.0), (3.25, 0.3), (5.0, 1.0)])
def test_duty_is_equation_22(signal: float, duty: float):
    assert robots.duty_of_signal(signal) == pytest.approx(duty, abs=1e-15)


@pytest.mark.parametrize(
    ("incline", "acceleration", "torque"),
    # (40 a + 40 * 9.81 (0.7 cos + sin)) 0.1 / (156 * 0.94), in N m
    [(0.0, 0.0, 0.1873159), (20.0, 0.0, 0.2675419), (-35.0, 0.0, -0.0000455), (0.0, 0.5, 0.2009547)],
)
def test_track_torque_is_equation_18(incline: float, acceleration: float, torque: float):
    found = robots.track_torque(Parameters(), jnp.asarray(incline), jnp.asarray(acceleration))
    assert float(found) == pytest.approx(torque, abs=1e-6)


def test_flipper_torque_is_equation_19():
    # 3 kg at the end of 0.4 m: 0.5 * 3 * 9.81 * 0.4 / (100 * 0.8)
    found = robots.flipper_torque(*(jnp.asarray(x) for x in (3.0, 0.4, 100.0, 0.8)))
    assert float(found) == pytest.approx(0.073575, rel=1e-12)


def test_onboard_current_is_equation_20():
    found = robots.onboard_current(*(jnp.asarray(x) for x in (0.2, 0.06, 0.86)))
    assert float(found) == pytest.approx(0.26 * 1.14, rel=1e-12)


@pytest.fixture(scope="module")
def drive():
    """A robot that starts, drives, reverses and rests, with flippers and arm at work; and its inputs."""
    rows = 40
    duty = np.repeat([0.0, 0.35, -0.2, 0.5], 10)
    inputs = {
        "duty": duty,
        "load_torque_Nm": 0.15 * np.sign(duty),
        "flipper_torque_Nm": np.repeat([0.0, 0.08], 20),
        "flipper_duty": np.full(rows, 0.4),
        "arm_torque_Nm": np.full(rows, 0.05),
        "arm_duty": np.repeat([0.0, 0.25], 20),
        "ambient_degC": np.full(rows, 20.0),
    }
    found = readings(Model("robot", Parameters(initial_soc=0.8)), Profile(np.arange(rows), inputs))
    return found, inputs


def test_the_pack_carries_all_that_is_drawn(drive):
    """Eq. 21, with eq. 14 for each track motor and the limbs in equilibrium at their torque."""
    found, inputs = drive
    flippers = np.where(inputs["flipper_torque_Nm"] > 0.0, 2.0 * 0.4 * (0.08 + 0.01) / 0.0385, 0.0)
    arm = inputs["arm_duty"] * (0.05 + 0.01) / 0.0385
    expected = 2.0 * inputs["duty"] * found["motor_current_A"] + flippers + arm + 0.3
    np.testing.assert_allclose(found["pack_current_A"], expected, rtol=1e-13)


def test_the_pack_is_its_cells_in_series(drive):
    """A cell driven alone by the pack's current, where that is constant, reads a sixth of the pack's voltage."""
    found, _ = drive
    resting = constant(9.0, 1.0, current_A=0.3, ambient_degC=20.0)
    alone = readings(Model("cell", Parameters(initial_soc=0.8)), resting)
    np.testing.assert_allclose(found["pack_voltage_V"][:10], 6.0 * alone["voltage_V"], rtol=1e-13)
    np.testing.assert_allclose(found["soc"][:10], alone["soc"], rtol=1e-14)


def test_the_motors_see_the_pack_through_the_bridge(drive):
    """In equilibrium rho V_pack = R i + k w; the loop through pack and motor is solved, not lagged."""
    found, inputs = drive
    resistance = 0.103 * (1.0 + 0.0039 * (found["winding_temperature_degC"] - 25.0))
    terminals = resistance * found["motor_current_A"] + 0.0385 * found["speed_rad_s"]
    settled = [15, 19, 25, 29, 35, 39]
    np.testing.assert_allclose(terminals[settled], (inputs["duty"] * found["pack_voltage_V"])[settled], rtol=2e-5)


def test_incline_and_its_torque_are_the_same_run():
    time, incline = np.arange(20.0), np.repeat([0.0, 12.0], 10)
    weight = 40.0 * 9.81 * (0.7 * np.cos(np.deg2rad(incline)) + np.sin(np.deg2rad(incline)))
    both = {"duty": np.full(20, 0.4), "ambient_degC": np.full(20, 20.0)}
    sloping = readings(Model("robot"), Profile(time, {**both, "incline_deg": incline}))
    torque = weight * 0.1 / (156.0 * 0.94)
    loaded = readings(Model("robot"), Profile(time, {**both, "load_torque_Nm": torque}))
    for name, values in loaded.items():
        np.testing.assert_allclose(sloping[name], values, rtol=1e-10, err_msg=name)


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_a_constant_power_load_draws_its_power(share: float):
    """The draw depends on the voltage that it changes: at every row both hold at once."""
    load = CATALOGUE["constant_power_load"](s=share)
    profile = constant(20.0, 1.0, duty=0.0, load_torque_Nm=0.0, ambient_degC=-15.0)
    found = readings(Model("robot", Parameters(onboard_current_A=5.0, initial_soc=0.2), effects=(load,)), profile)
    expected = 5.0 * (1.0 - share) + share * 5.0 * 6.0 * 3.8 / found["pack_voltage_V"]
    np.testing.assert_allclose(found["pack_current_A"], expected, rtol=1e-13)
