"""Two inertias on a spring: resonances, energy, and a gap against an independent integration."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from jax import numpy as jnp
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from jaxmodel.effects.controllers import ShaftPosition
from jaxmodel.effects.motion import FlexibleShaft
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import grid_of, simulate

J, K_TAU, R, L = 5e-5, 0.0385, 0.5, 7.2e-5


def ran(shaft: FlexibleShaft | None, step_s: float, seconds: float, tau_0: float = 0.0, **inputs):
    time_s = np.arange(0.0, seconds + 0.5 * step_s, step_s)
    given = {name: v(time_s) if callable(v) else np.full(time_s.size, v) for name, v in inputs.items()}
    numbers = Parameters(k_tau=K_TAU, J=J, tau_0=tau_0, R_0=R, L_a=L, psi_R=0.0)
    effects = (ShaftPosition(), *([shaft] if shaft else []))
    run = simulate(Model("motor", numbers, effects=effects), Profile(time_s, given | {"ambient_degC": 0.0 * time_s}))
    columns = {**run.readings, **run.states}
    return {"time_s": time_s, **{name: np.asarray(values) for name, values in columns.items()}}


def frequency(time_s: np.ndarray, values: np.ndarray) -> float:
    """Return the mean angular frequency of an oscillation by its upward crossings of zero."""
    roots = CubicSpline(time_s, values).roots(extrapolate=False)
    return 2.0 * np.pi * 0.5 * (roots.size - 1) / (roots[-1] - roots[0])


@pytest.mark.parametrize(("J_l", "k"), [(2e-5, 0.5), (1e-4, 0.5), (5e-4, 8.0)])
def test_a_kicked_pair_rings_at_its_resonance(J_l: float, k: float):
    """Both ends free: sqrt(k (1/J + 1/J_l)); the rotor held by its friction: sqrt(k/J_l)."""
    shaft = FlexibleShaft(J_l=J_l, k=k, d=0.0)
    kicked = ran(shaft, 1e-3, 0.8, current_A=lambda t: np.where(t < 2e-3, 2.0, 0.0))
    coasting = kicked["time_s"] > 4e-3
    twist = kicked["flexible_shaft.twist_rad"][coasting]
    assert frequency(kicked["time_s"][coasting], twist) == pytest.approx(np.sqrt(k * (1 / J + 1 / J_l)), rel=1e-3)
    held = ran(shaft, 1e-3, 0.8, tau_0=10.0, current_A=0.0, load_torque_Nm=lambda t: np.where(t < 4e-3, 0.05, 0.0))
    np.testing.assert_allclose(held["speed_rad_s"], 0.0, atol=1e-12)
    swinging = held["position_rad"][held["time_s"] > 6e-3]
    assert frequency(held["time_s"][held["time_s"] > 6e-3], swinging) == pytest.approx(np.sqrt(k / J_l), rel=1e-3)


def test_a_free_pair_keeps_its_energy_and_its_momentum():
    J_l, k = 1e-4, 2.0
    found = ran(FlexibleShaft(J_l=J_l, k=k, d=0.0), 1e-3, 1.0, current_A=lambda t: np.where(t < 2.5e-3, 3.0, 0.0))
    rotor, load, twist = (
        found[name][5:] for name in ("speed_rad_s", "flexible_shaft.load_speed_rad_s", "flexible_shaft.twist_rad")
    )
    energy = 0.5 * J * rotor**2 + 0.5 * J_l * load**2 + 0.5 * k * twist**2
    relative = energy - 0.5 * (J * rotor + J_l * load) ** 2 / (J + J_l)  # of the oscillation alone
    periods = 0.995 * np.sqrt(k * (1.0 / J + 1.0 / J_l)) / (2.0 * np.pi)
    assert periods > 30.0
    assert 0.0 < relative[-1] / relative[0] - 1.0 < 2e-4 * periods
    np.testing.assert_allclose(J * rotor + J_l * load, K_TAU * 3.0 * 2e-3, rtol=1e-9)


@pytest.mark.parametrize("gap", [0.0, 0.03])
def test_a_driven_pair_follows_an_independent_integration(gap: float):
    """Voltage both ways on the rotor, a torque on the load, dry friction, a damper, and a gap."""
    J_l, k, d, tau_0, load = 8e-5, 1.5, 4e-4, 0.01, 0.02
    found = ran(
        FlexibleShaft(J_l=J_l, k=k, d=d, gap=gap), 1e-3, 0.4, tau_0, load_torque_Nm=load,
        voltage_V=lambda t: np.where((t < 0.0995) | (t > 0.2505), 6.0, -6.0),
    )  # fmt: skip

    def rates(t, y):
        current, speed, twist, load_speed, _ = y
        volts = 6.0 if t < 0.099 or t > 0.25 else -6.0  # an input holds over the step that ends at its row
        beyond = twist - np.clip(twist, -0.5 * gap, 0.5 * gap)
        spring = k * beyond + d * (speed - load_speed) * (abs(twist) >= 0.5 * gap)
        drive = K_TAU * current - spring - tau_0 * np.tanh(speed / 1e-2)
        return (
            (volts - R * current - K_TAU * speed) / L, drive / J, speed - load_speed, (spring - load) / J_l, load_speed
        )  # fmt: skip

    exact = solve_ivp(
        rates, (0.0, 0.4), np.zeros(5), "LSODA", t_eval=found["time_s"], rtol=1e-8, atol=1e-10, max_step=2e-4
    ).y
    for name, row in (("speed_rad_s", 1), ("flexible_shaft.load_speed_rad_s", 3), ("position_rad", 4)):
        off = np.abs(found[name] - exact[row]).max() / np.ptp(exact[row])
        assert off < (0.005 if gap == 0.0 else 0.02), (name, off)


def test_without_a_load_inertia_or_switched_off_it_is_not_there():
    inputs = {"voltage_V": lambda t: 6.0 * np.sin(9.0 * t), "load_torque_Nm": 0.02}
    base = ran(None, 0.01, 1.0, 0.01, **inputs)
    null = ran(FlexibleShaft(J_l=0.0), 0.01, 1.0, 0.01, **inputs)
    off = ran(dataclasses.replace(FlexibleShaft(), switch=jnp.zeros(())), 0.01, 1.0, 0.01, **inputs)
    for name in ("current_A", "speed_rad_s", "position_rad", "winding_temperature_degC"):
        np.testing.assert_allclose(off[name], base[name], rtol=1e-11, atol=1e-11, err_msg=name)
        np.testing.assert_allclose(null[name], base[name], rtol=1e-11, atol=1e-11, err_msg=name)


def test_rows_are_cut_to_the_resonance_and_no_others():
    profile = Profile(np.arange(3.0), {name: np.zeros(3) for name in ("current_A", "ambient_degC")})
    numbers = Parameters(J=J)
    stiff = Model("motor", numbers, effects=(FlexibleShaft(J_l=J, k=1.0),))
    assert grid_of(stiff, profile).duration_s.max() <= 0.05 / np.sqrt(2.0 / J)
    assert grid_of(stiff, profile).last_step.size == 2
    off = Model("motor", numbers, effects=(FlexibleShaft(J_l=J, k=1.0, switch=jnp.zeros(())),))
    np.testing.assert_array_equal(
        grid_of(off, profile).duration_s, grid_of(Model("motor", numbers), profile).duration_s
    )
