"""Laws of a load that is not measured, against independent integrations; a speed that drives the model."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.loads import GravityLoad, PropellerLoad, RollingLoad
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate

R, K, J, L, TAU_0 = (float(getattr(Parameters(), name)) for name in ("R_0", "k_tau", "J", "L_a", "tau_0"))
COLD = {"psi_R": 0.0}


def ran(model: Model, step_s: float, seconds: float, **inputs) -> dict[str, np.ndarray]:
    time_s = np.arange(0.0, seconds + 0.5 * step_s, step_s)
    given = {
        name: values(time_s) if callable(values) else np.full(time_s.size, values) for name, values in inputs.items()
    }
    model = with_values(model, COLD) if model.kind != "cell" else model
    run = simulate(model, Profile(time_s, given | {"ambient_degC": np.full(time_s.size, 20.0)}))
    return {"time_s": time_s, **{name: np.asarray(values) for name, values in run.readings.items()}}


def test_a_propeller_turns_where_the_motor_drives_what_it_asks():
    found = ran(Model("motor", effects=(PropellerLoad(c=1e-6),)), 0.1, 20.0, voltage_V=12.0)
    speed, current = found["speed_rad_s"][-1], found["current_A"][-1]
    assert K * current == pytest.approx(TAU_0 + 1e-6 * speed**2, rel=1e-6)
    assert 12.0 == pytest.approx(R * current + K * speed, rel=1e-9)


def test_thin_air_asks_for_less():
    low, high = (
        ran(Model("motor", effects=(PropellerLoad(c=1e-6, air_kg_m3=air),)), 0.1, 20.0, voltage_V=12.0)["current_A"][-1]
        for air in (0.7, 1.2)
    )
    assert low < high


def test_a_weight_on_an_arm_swings_as_a_pendulum():
    """J and mass turn through the position; the winding is open but for its resistance, so that it brakes."""
    mass, arm = 0.5, 0.1
    model = Model(
        "motor", Parameters(tau_0=0.0), effects=(GravityLoad(mass_kg=mass, arm_m=arm, initial_position_rad=1.5),)
    )
    found = ran(model, 0.002, 2.0, voltage_V=0.0)

    def rates(_, state):
        position, speed, current = state
        torque = K * current - mass * 9.81 * arm * np.sin(position)
        return speed, torque / (J + mass * arm**2), (-R * current - K * speed) / L

    exact = solve_ivp(rates, (0.0, 2.0), (1.5, 0.0, 0.0), t_eval=found["time_s"], rtol=1e-9, atol=1e-9, method="LSODA")
    assert np.abs(found["position_rad"] - exact.y[0]).max() < 1e-4
    assert np.ptp(exact.y[0]) > 1.0


def test_a_gear_divides_what_a_weight_asks():
    weight = {"mass_kg": 1.0, "arm_m": 0.2, "initial_position_rad": np.pi / 2}
    held = ran(Model("motor", effects=(GravityLoad(gear_ratio=100.0, **weight),)), 0.001, 0.05, current_A=1.0)
    asked = 1.0 * 9.81 * 0.2 / 100.0
    started = (K * 1.0 - TAU_0 - asked) / (J + 1.0 * (0.2 / 100.0) ** 2)
    assert np.gradient(held["speed_rad_s"], held["time_s"])[5] == pytest.approx(started, rel=1e-3)


@pytest.mark.parametrize("incline", [0.0, 10.0])
def test_a_vehicle_pushes_off_and_then_rolls_by_eq_18(incline: float):
    numbers = Parameters(
        mass_kg=20.0, wheel_radius_m=0.1, gear_ratio=50.0, drive_efficiency=0.9, friction_coefficient=0.1
    )
    model = Model("motor", numbers, effects=(RollingLoad(),))
    found = ran(model, 0.05, 30.0, voltage_V=12.0, incline_deg=incline)
    slope = np.deg2rad(incline)
    force = 20.0 * 9.81 * (np.sin(slope) + 0.1 * np.cos(slope))
    asked = force * 0.1 / (50.0 * 0.9)
    assert K * found["current_A"][-1] == pytest.approx(TAU_0 + asked, rel=1e-3)
    inertia = J + 20.0 * 0.1**2 / (50.0**2 * 0.9)
    found = ran(model, 0.0002, 0.002, voltage_V=12.0, incline_deg=incline)
    pushed = np.diff(found["speed_rad_s"])[6] / 0.0002
    drive = K * 0.5 * (found["current_A"][6] + found["current_A"][7])
    assert pushed == pytest.approx((drive - TAU_0 - asked) / inertia, rel=0.01)


def test_what_rubs_on_the_ground_does_not_warm_the_motor():
    numbers = Parameters(friction_coefficient=0.3)
    loaded = ran(Model("motor", numbers, effects=(RollingLoad(),)), 1.0, 600.0, voltage_V=12.0)
    course = {name: (lambda t, values=loaded[name]: values) for name in ("current_A", "speed_rad_s")}
    free = ran(Model("motor", numbers), 1.0, 600.0, **course)
    assert loaded["case_temperature_degC"][-1] - 20.0 > 1.0
    assert loaded["case_temperature_degC"][-1] == pytest.approx(free["case_temperature_degC"][-1], abs=0.05)


def test_a_vehicle_at_rest_stays_there():
    found = ran(Model("motor", effects=(RollingLoad(),)), 0.1, 2.0, voltage_V=0.1)
    assert np.abs(found["speed_rad_s"]).max() < 1e-12


EFFECTS = ("", "brush_drop", "saturation", "magnet_temperature", "windage")


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_measured_speed_in_place_of_the_load_gives_the_same_current(effect: str):
    """The speed of a run with a known load, given to the model without it, gives back current and heat."""
    effects = (CATALOGUE[effect](),) if effect else ()
    inputs = {"voltage_V": lambda t: 12.0 + 6.0 * np.sin(t), "load_torque_Nm": lambda t: 0.1 + 0.05 * np.sin(3.0 * t)}
    whole = ran(Model("motor", effects=effects), 0.01, 20.0, **inputs)
    inputs |= {"speed_rad_s": lambda t: np.interp(t, whole["time_s"], whole["speed_rad_s"])}
    del inputs["load_torque_Nm"]
    driven = ran(Model("motor", effects=effects), 0.01, 20.0, **inputs)
    late = slice(20, None)
    assert np.abs(driven["current_A"] - whole["current_A"])[late].max() < 0.02
    rise = np.ptp(whole["winding_temperature_degC"])
    assert np.abs(driven["winding_temperature_degC"] - whole["winding_temperature_degC"]).max() < 0.1 * rise


def test_a_robot_driven_by_its_speed_draws_the_same_from_its_pack():
    inputs = {"duty": lambda t: 0.3 + 0.1 * np.sin(0.5 * t), "load_torque_Nm": lambda t: 0.2 + 0.05 * np.sin(t)}
    whole = ran(Model("robot"), 0.02, 20.0, **inputs)
    del inputs["load_torque_Nm"]
    inputs["speed_rad_s"] = lambda t: np.interp(t, whole["time_s"], whole["speed_rad_s"])
    driven = ran(Model("robot"), 0.02, 20.0, **inputs)
    for name, most in (("pack_voltage_V", 2e-3), ("pack_current_A", 0.02), ("motor_current_A", 0.05), ("soc", 2e-5)):
        assert np.abs(driven[name] - whole[name])[20:].max() < most, name


def test_the_step_at_an_imposed_speed_has_derivatives():
    time_s = np.arange(0.0, 5.0, 0.1)
    speed = 100.0 + 50.0 * np.sin(time_s)
    profile = Profile(
        time_s, {"voltage_V": 0.04 * speed + 1.0, "speed_rad_s": speed, "ambient_degC": np.full(50, 20.0)}
    )

    def current(R_0):
        model = with_values(Model("motor", effects=(CATALOGUE["brush_drop"](),)), {"R_0": R_0, **COLD})
        return simulate(model, profile).readings["current_A"][-1]

    by_difference = (current(R + 1e-5) - current(R - 1e-5)) / 2e-5
    assert float(jax.jvp(current, (R,), (1.0,))[1]) == pytest.approx(float(by_difference), rel=1e-4)


@pytest.mark.parametrize("law", [PropellerLoad(c=1e-6), RollingLoad()])
def test_what_a_start_takes_is_motion_load_or_heat(law):
    """Energy from the terminals: copper and own friction heat the motor, the rest is motion and what the load takes."""
    numbers = Parameters(friction_coefficient=0.3, tau_wc=1e9, tau_ca=1e9, R_wc=1.0, R_ca=1.0)
    time_s = np.append(0.0, np.geomspace(1e-5, 10.0, 300))
    inputs = {"voltage_V": 10.0, "ambient_degC": 25.0}
    profile = Profile(time_s, {name: np.full(time_s.size, value) for name, value in inputs.items()})
    found = simulate(with_values(Model("motor", numbers, effects=(law,)), COLD), profile)
    current, speed = (np.asarray(found.readings[name]) for name in ("current_A", "speed_rad_s"))

    def integral(values: np.ndarray) -> float:
        return float(CubicSpline(time_s, values).integrate(0.0, 10.0))

    inertia, taken = J, 1e-6 * integral(speed**3)
    if isinstance(law, RollingLoad):
        per_force = float(numbers.wheel_radius_m / (numbers.gear_ratio * numbers.drive_efficiency))
        inertia += float(numbers.mass_kg) * per_force * float(numbers.wheel_radius_m / numbers.gear_ratio)
        taken = 0.3 * float(numbers.mass_kg) * 9.81 * per_force * integral(speed)
    heat = float(found.states["x_case_K"][-1]) * 1e9
    stored = 0.5 * inertia * speed[-1] ** 2 + 0.5 * L * current[-1] ** 2
    given = 10.0 * integral(current)
    assert given == pytest.approx(heat + stored + taken, rel=1e-4)


@pytest.mark.parametrize("step_s", [0.02, 1.0, 30.0])
@pytest.mark.parametrize("law", [PropellerLoad(c=1e-6), RollingLoad(share=0.5)])
def test_any_step_is_stable(law, step_s: float):
    voltage = np.array([0.0, 12.0, 12.0, -12.0, -12.0, 0.0, 3.0, 12.0, 12.0])
    time_s = step_s * np.arange(voltage.size)
    profile = Profile(time_s, {"voltage_V": voltage, "ambient_degC": np.full(voltage.size, 20.0)})
    speed = np.asarray(simulate(Model("motor", effects=(law,)), profile).readings["speed_rad_s"])
    assert np.all(np.abs(speed) < 12.0 / K)
    if step_s > 0.5:
        assert speed[2] == pytest.approx(-speed[4], rel=1e-2)


def test_teeth_take_more_to_drive_a_load_than_they_give_back():
    """At a steady speed the current drives tau_l (1 + f) + tau_0 upwards, and holds tau_l (1 - f) - tau_0 downwards."""
    rub = CATALOGUE["gear_friction"](f=0.4)
    up, down = (
        ran(Model("motor", effects=(rub,)), 0.01, 2.0, voltage_V=volts, load_torque_Nm=0.2)["current_A"][-1] * K
        for volts in (12.0, -4.0)
    )
    assert up == pytest.approx(0.2 * 1.4 + TAU_0, rel=1e-6)
    assert down == pytest.approx(0.2 * 0.6 - TAU_0, rel=1e-6)


def test_a_gear_that_rubs_as_much_as_it_carries_locks():
    found = ran(
        Model("motor", effects=(CATALOGUE["gear_friction"](f=1.1),)), 0.01, 1.0, voltage_V=0.0, load_torque_Nm=0.3
    )
    assert np.abs(found["speed_rad_s"]).max() < 1e-9


def test_friction_of_the_motor_side_follows_its_torque():
    rub = CATALOGUE["torque_friction"](f=0.3)
    found = ran(Model("motor", effects=(rub,)), 0.01, 3.0, voltage_V=12.0, load_torque_Nm=0.14)
    current = found["current_A"][-1]
    assert K * current * 0.7 == pytest.approx(0.14 + TAU_0, rel=1e-3)
