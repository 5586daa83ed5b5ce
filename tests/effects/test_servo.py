"""Controllers, presliding, drag by direction, backlash, compliance: closed forms and independent integrations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.controllers import SERVO, PositionController, ShaftPosition, SpeedController
from jaxmodel.effects.loads import GravityLoad
from jaxmodel.effects.motion import Backlash, Compliance, DirectionalDrag, Presliding
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import Effect
from jaxmodel.model.profile import Profile, constant
from jaxmodel.model.simulation import grid_of, simulate

K, J, TAU_0, B, R = 0.035, 95e-6, 0.02, 2e-4, 0.5
NUMBERS = Parameters(k_tau=K, J=J, tau_0=TAU_0, R_0=R, psi_R=0.0)
VISCOUS = CATALOGUE["viscous_friction"](b=B)


def ran(effects: tuple[Effect, ...], step_s: float, seconds: float, tau_0: float = TAU_0, **inputs):
    time_s = np.arange(0.0, seconds + 0.5 * step_s, step_s)
    given = {name: v(time_s) if callable(v) else np.full(time_s.size, v) for name, v in inputs.items()}
    numbers = Parameters(k_tau=K, J=J, tau_0=tau_0, R_0=R, psi_R=0.0)
    run = simulate(
        Model("motor", numbers, effects=(VISCOUS, *effects)),
        Profile(time_s, given | {"ambient_degC": np.full(time_s.size, 20.0)}),
    )
    return {"time_s": time_s, **{name: np.asarray(values) for name, values in run.readings.items()}}


def loop(**gains: float) -> tuple[Effect, ...]:
    return ShaftPosition(), PositionController(**gains, column="current_A")


def test_what_a_servo_adds_is_not_combined_with_the_catalogue():
    assert not SERVO.keys() & CATALOGUE.keys()
    assert not any(cls.is_candidate for cls in SERVO.values())


def test_a_position_loop_follows_its_differential_equation():
    """k_p and k_d on a current, without friction that sticks: a damped oscillator."""
    k_p, k_d = 4.0, 0.02
    found = ran(loop(k_p=k_p, k_d=k_d), 5e-4, 0.3, tau_0=0.0, reference_position_rad=1.0)

    def rates(_, state):
        position, speed = state
        return speed, (K * (k_p * (1.0 - position) - k_d * speed) - B * speed) / J

    exact = solve_ivp(rates, (0.0, 0.3), (0.0, 0.0), t_eval=found["time_s"], rtol=1e-9, atol=1e-9).y
    assert np.ptp(exact[0]) > 1.1  # it overshoots
    assert np.abs(found["position_rad"] - exact[0]).max() < 0.02


def test_coarse_rows_get_the_steps_that_the_loop_needs():
    model = Model("motor", NUMBERS, effects=(VISCOUS, *loop(k_p=40.0, k_d=0.24)))
    profile = constant(1.0, 0.05, reference_position_rad=1.0, ambient_degC=20.0)
    assert grid_of(model, profile).duration_s.max() < 0.25 / np.sqrt(40.0 * K / J)
    assert grid_of(model, profile).last_step.size == 20
    fine, coarse = (
        ran(loop(k_p=40.0, k_d=0.24), step, 0.5, reference_position_rad=lambda t: np.where(t > 0.2, 1.0, 0.0))
        for step in (1e-3, 0.05)
    )
    np.testing.assert_allclose(coarse["position_rad"], fine["position_rad"][::50], atol=0.05)


def test_friction_leaves_an_error_that_an_integral_takes_away():
    """P alone holds within tau_0 / (k_tau k_p) of the reference; with I the error goes on falling."""
    held, pulled = (
        ran(loop(k_p=1.0, k_d=0.03, k_i=k_i), 1e-3, 8.0, reference_position_rad=3.0)["position_rad"][-1]
        for k_i in (0.0, 3.0)
    )
    assert 0.05 < abs(3.0 - held) <= TAU_0 / (K * 1.0) + 1e-6
    assert abs(3.0 - pulled) < 0.5 * abs(3.0 - held)


def test_the_output_stays_within_its_limit_and_the_integral_does_not_wind_up():
    """A long way at the limit: an integral of the whole error would add k_i 100 rad 0.5 s to the output."""
    pulled, without = (
        ran(loop(k_p=40.0, k_d=0.3, k_i=k_i, limit=2.0), 1e-3, 3.0, reference_position_rad=100.0)
        for k_i in (100.0, 0.0)
    )
    assert np.abs(pulled["current_A"]).max() == 2.0
    assert pulled["position_rad"].max() < without["position_rad"].max() + 2.0
    assert pulled["position_rad"][-1] == pytest.approx(100.0, abs=0.05)


def test_a_speed_loop_may_set_the_voltage():
    controller = SpeedController(k_p=0.1, k_i=1.0, limit=24.0, column="voltage_V")
    found = ran((controller,), 5e-3, 3.0, reference_speed_rad_s=200.0)
    assert found["speed_rad_s"][-1] == pytest.approx(200.0, rel=1e-3)
    needed = R * (TAU_0 + B * 200.0) / K + K * 200.0
    assert found["voltage_V"][-1] == pytest.approx(needed, rel=1e-3)


def dahl(current, d: float, times: np.ndarray) -> np.ndarray:
    """Position, speed and bending of a motor with Dahl's friction, by another integrator."""

    def rates(t, state):
        _, speed, z = state
        return speed, (K * current(t) - TAU_0 * z - B * speed) / J, (speed - abs(speed) * z) / d

    return solve_ivp(rates, (0.0, times[-1]), (0.0,) * 3, t_eval=times, rtol=1e-8, atol=1e-12, max_step=1e-3).y


@pytest.mark.parametrize(("step_s", "tolerance"), [(1e-3, 0.03), (1e-2, 0.1)])
def test_below_breakaway_a_contact_bends_and_holds(step_s: float, tolerance: float):
    """At rest tau = tau_0 z; the travel is a little more than -d log(1 - z), as every swing on the way adds to it."""
    d, share = 0.05, 0.8

    def current(t):
        return share * TAU_0 / K * np.minimum(t / 3.0, 1.0)

    found = ran((Presliding(s=1.0, d=d), ShaftPosition()), step_s, 4.0, current_A=current)
    exact = dahl(current, d, found["time_s"])
    assert exact[2][-1] == pytest.approx(share, rel=0.01)
    assert found["position_rad"][-1] == pytest.approx(exact[0][-1], rel=tolerance)
    assert found["position_rad"][-1] > -d * np.log(1.0 - share)


def test_a_loop_of_presliding_is_that_of_an_independent_integration():
    def current(t):
        return 0.9 * np.sin(2.0 * np.pi * t)

    found = ran((Presliding(s=1.0, d=0.5), ShaftPosition()), 5e-4, 2.0, current_A=current)
    exact = dahl(current, 0.5, found["time_s"])
    assert np.abs(found["speed_rad_s"] - exact[1]).max() < 0.01 * np.abs(exact[1]).max()


def test_a_long_travel_makes_dry_friction_of_presliding():
    """Once it slides both models have the same friction, and both hold a torque below it."""
    for current in (1.5, 0.4):
        bent, dry = (
            ran(effects, 5e-3, 10.0, current_A=current)["speed_rad_s"][-1]
            for effects in ((Presliding(s=1.0, d=0.01),), ())
        )
        assert bent == pytest.approx(dry, abs=1e-3)


def test_drag_by_direction_adds_forwards_what_it_takes_backwards():
    forwards, backwards = (
        ran((DirectionalDrag(b_d=0.2 * B),), 0.01, 10.0, current_A=current)["speed_rad_s"][-1]
        for current in (1.5, -1.5)
    )
    torque = K * 1.5 - TAU_0
    assert forwards == pytest.approx(torque / (1.2 * B), rel=1e-3)
    assert backwards == pytest.approx(-torque / (0.8 * B), rel=1e-3)


def test_backlash_loses_its_gap_at_a_reversal():
    gap = 0.4
    inputs = {"current_A": lambda t: np.where(t < 1.0, 1.5, -1.5)}
    behind = ran((ShaftPosition(), Backlash(g=gap)), 1e-3, 2.0, **inputs)
    motor = ran((ShaftPosition(),), 1e-3, 2.0, **inputs)
    lag = motor["position_rad"] - behind["position_rad"]
    np.testing.assert_array_equal(motor["speed_rad_s"], behind["speed_rad_s"])
    assert lag[0] == 0.0
    assert lag[900] == pytest.approx(gap / 2.0, rel=1e-6)
    assert lag[-1] == pytest.approx(-gap / 2.0, rel=1e-6)
    turning = int(np.argmax(motor["position_rad"]))
    first = slice(turning, turning + 8)  # the load stands while the motor begins to cross the gap
    assert np.ptp(behind["position_rad"][first]) < 0.2 * np.ptp(motor["position_rad"][first])


def test_a_shaft_twists_in_proportion_to_its_load():
    """A weight held at 0.5 rad, and the same measured torque on a shaft without one."""
    weight = {"mass_kg": 0.5, "arm_m": 0.1, "initial_position_rad": 0.5}
    asked = 0.5 * 9.81 * 0.1 * np.sin(0.5)
    held = ran((GravityLoad(**weight), Compliance(c=0.3)), 1e-3, 0.01, tau_0=1.0, current_A=asked / K)
    assert held["position_rad"][-1] == pytest.approx(0.5 - 0.3 * asked, abs=1e-6)
    twisted, stiff = (
        ran((ShaftPosition(), *more), 1e-3, 1.0, current_A=1.5, load_torque_Nm=0.01)["position_rad"]
        for more in ((Compliance(c=0.3),), ())
    )
    np.testing.assert_allclose(stiff - twisted, 0.003, rtol=1e-9)


@pytest.mark.parametrize("effect", [Presliding(s=0.0), DirectionalDrag(b_d=0.0), Backlash(g=0.0), Compliance(c=0.0)])
def test_at_its_null_an_effect_is_not_there(effect: Effect):
    inputs = {"current_A": lambda t: np.sin(9.0 * t)}
    base, found = (ran((ShaftPosition(), *more), 0.01, 2.0, **inputs) for more in ((), (effect,)))
    for name, values in base.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
