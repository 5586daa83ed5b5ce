"""A torque that swings with the angle: rests, the period of small swings, and no work over a turn."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, compare
from jaxmodel.effects.controllers import ShaftPosition
from jaxmodel.effects.motion import Cogging
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate

J, K_TAU, R = 5e-5, 0.0385, 0.5


def ran(cogging: Cogging, seconds: float, start_rad: float = 0.0, step_s: float = 1e-3, tau_0: float = 0.0, **inputs):
    time_s = np.arange(0.0, seconds + 0.5 * step_s, step_s)
    numbers = Parameters(k_tau=K_TAU, J=J, tau_0=tau_0, R_0=R, L_a=7.2e-5, psi_R=0.0)
    effects = (ShaftPosition(initial_position_rad=start_rad), cogging)
    given = {name: v(time_s) if callable(v) else np.full(time_s.size, v) for name, v in inputs.items()}
    run = simulate(Model("motor", numbers, effects=effects), Profile(time_s, given | {"ambient_degC": 0.0 * time_s}))
    return time_s, {name: np.asarray(values) for name, values in run.readings.items()}


def test_a_free_rotor_swings_about_a_tooth():
    """J d2x/dt2 = -c sin(n x): sqrt(c n / J) for small swings, by which the energy is kept."""
    c, n = 0.004, 14.0
    time_s, found = ran(Cogging(c_s=c, n=n), 1.0, start_rad=0.005, current_A=0.0)
    crossings = np.flatnonzero((found["position_rad"][:-1] < 0.0) & (found["position_rad"][1:] >= 0.0))
    period = np.mean(np.diff(time_s[crossings]))
    assert 2.0 * np.pi / period == pytest.approx(np.sqrt(c * n / J), rel=5e-3)
    energy = 0.5 * J * found["speed_rad_s"] ** 2 + c / n * (1.0 - np.cos(n * found["position_rad"]))
    np.testing.assert_allclose(energy[5:], energy[5:].mean(), rtol=0.03)


def test_it_does_no_work_over_a_turn():
    cogging = Cogging(c_s=0.003, c_c=0.002, n=6.0)
    _, with_it = ran(cogging, 3.0, tau_0=0.002, voltage_V=2.0)
    _, without = ran(dataclasses.replace(cogging, c_s=0.0, c_c=0.0), 3.0, tau_0=0.002, voltage_V=2.0)
    late = slice(1000, None)
    assert np.ptp(with_it["speed_rad_s"][late]) > 50.0 * np.ptp(without["speed_rad_s"][late])
    assert with_it["speed_rad_s"][late].mean() == pytest.approx(without["speed_rad_s"][late].mean(), rel=2e-3)


def test_its_size_and_phase_are_found_in_a_log():
    time_s, found = ran(
        Cogging(c_s=0.003, c_c=-0.002, n=7.0), 4.0, tau_0=0.002, voltage_V=lambda t: 0.4 + 0.3 * np.sin(2.0 * t)
    )
    noise = np.random.default_rng(0).standard_normal((2, time_s.size))
    columns = {
        "voltage_V": 0.4 + 0.3 * np.sin(2.0 * time_s),
        "ambient_degC": 0.0 * time_s,
        "current_A": found["current_A"] + 0.002 * noise[0],
        "position_rad": found["position_rad"] + 1e-3 * noise[1],
    }
    case = Case.from_dataframes(
        {"log": pd.DataFrame({"time_s": time_s, **columns})},
        kind="motor",
        load="free",
        drive="voltage",
        parameters={
            "k_tau": K_TAU, "J": J, "tau_0": {"value": 0.002, "sd": 0.001}, "R_0": R, "L_a": 7.2e-5, "psi_R": 0.0,
        },
        effects={"cogging": {"c_s": {"value": 0.0, "sd": 0.005}, "c_c": {"value": 0.0, "sd": 0.005}, "n": 7.0}},
        sensors={"current_A": 0.002, "position_rad": 1e-3},
    )  # fmt: skip
    estimates = compare(case, progress=False).final.estimates
    assert abs(estimates["cogging.c_s"].value - 0.003) < 3.0 * estimates["cogging.c_s"].sd + 2e-5
    assert abs(estimates["cogging.c_c"].value + 0.002) < 3.0 * estimates["cogging.c_c"].sd + 2e-5
