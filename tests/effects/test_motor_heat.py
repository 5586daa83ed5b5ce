"""Heat of iron and case: against independent integrations and closed forms, and where a case shows it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from jaxmodel.case.records import Case
from jaxmodel.effects import CATALOGUE
from jaxmodel.fit.distinguishable import is_distinguishable
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, constant
from jaxmodel.model.simulation import simulate


def readings(model: Model, profile: Profile) -> dict[str, np.ndarray]:
    return {name: np.asarray(values) for name, values in simulate(model, profile).readings.items()}


T_H, W_E = 0.012, 150.0
IRON = CATALOGUE["iron_loss"](T_h=T_H, w_e=W_E)


def test_a_driven_motor_follows_an_independent_integration():
    """Eqs. 11 to 17 with the iron's drag in the torque balance and its heat in the case, by solve_ivp."""
    p, load, air = Parameters(), 0.05, 30.0
    voltage = np.repeat([6.0, 18.0, 9.0], 100)
    time = np.arange(301.0)
    inputs = {"voltage_V": np.append(voltage[0], voltage), "load_torque_Nm": load, "ambient_degC": air}
    found = readings(Model("motor", effects=(IRON,)), Profile(time, inputs))
    R_0, k, L, J, tau_0 = (float(getattr(p, name)) for name in ("R_0", "k_tau", "L_a", "J", "tau_0"))
    psi, T_0, R_wc, R_ca, tau_wc, tau_ca = (
        float(getattr(p, name)) for name in ("psi_R", "T_0", "R_wc", "R_ca", "tau_wc", "tau_ca")
    )

    def rates(_, y, volts):
        current, speed, winding, case = y
        R = R_0 * (1.0 + psi * (air + winding + case - T_0))
        iron = T_H * (1.0 + speed / W_E)  # forwards alone
        loss = current**2 * R + tau_0 * speed
        return (
            (volts - R * current - k * speed) / L,
            (k * current - load - tau_0 - iron) / J,
            (R_wc * loss - winding) / tau_wc,
            (R_ca * (loss + iron * speed) - case) / tau_ca,
        )

    y, ends = np.array([0.0, 1e-9, 0.0, 0.0]), []
    for volts in (6.0, 18.0, 9.0):
        y = solve_ivp(rates, (0.0, 100.0), y, "Radau", args=(volts,), rtol=1e-9, atol=1e-9).y[:, -1]
        ends.append(y)
    current, speed, winding, case = np.transpose(ends)
    at = [100, 200, 300]
    np.testing.assert_allclose(found["current_A"][at], current, rtol=2e-4)
    np.testing.assert_allclose(found["speed_rad_s"][at], speed, rtol=1e-4)
    np.testing.assert_allclose(found["case_temperature_degC"][at] - air, case, rtol=3e-4)
    np.testing.assert_allclose(found["winding_temperature_degC"][at] - air, winding + case, rtol=3e-4)


@pytest.mark.parametrize("speed", [-300.0, 300.0])
def test_its_heat_is_of_the_case_alone(speed: float):
    """The winding's rise over the case stays, and the case gains R_ca P (1 - e^(-t/tau_ca))."""
    profile = constant(600.0, 2.0, current_A=4.0, speed_rad_s=speed, ambient_degC=20.0)
    without, found = (readings(Model("motor", effects=one), profile) for one in ((), (IRON,)))
    power = T_H * abs(speed) * (1.0 + abs(speed) / W_E)
    gained = 3.8 * power * (1.0 - np.exp(-profile.time_s / 1370.0))
    more = found["case_temperature_degC"] - without["case_temperature_degC"]
    # The warmer winding has more resistance, and loses a little more.
    assert np.all(more[1:] > gained[1:])
    cold = Parameters(psi_R=0.0)
    without, found = (readings(Model("motor", cold, effects=one), profile) for one in ((), (IRON,)))
    for name in ("case_temperature_degC", "winding_temperature_degC"):
        np.testing.assert_allclose(found[name] - without[name], gained, rtol=1e-10, atol=1e-10, err_msg=name)


@pytest.mark.parametrize("share", [0.4, 1.0])
@pytest.mark.parametrize("row_s", [2.0, 600.0])
def test_heat_reaches_the_case_through_the_winding(share: float, row_s: float):
    """The linear pair of eq. 15 with a share of the heat through the winding, by its matrix exponential."""
    path = CATALOGUE["heat_path"](s=share)
    cold = Parameters(psi_R=0.0)
    profile = constant(6000.0, row_s, current_A=8.0, speed_rad_s=300.0, ambient_degC=20.0)
    found = readings(Model("motor", cold, effects=(IRON, path)), profile)
    C_w, C_c = 71.7 / 1.2, 1370.0 / 3.8
    iron = T_H * 300.0 * (1.0 + 300.0 / W_E)
    loss = 64.0 * 0.103 + 0.01 * 300.0
    stores = np.array([[C_w, share * C_w], [0.0, C_c]])
    gives = np.array([[-1.0 / 1.2, 0.0], [share / 1.2, -1.0 / 3.8]])
    takes = np.array([loss, (1.0 - share) * loss + iron])
    A, b = np.linalg.solve(stores, gives), np.linalg.solve(stores, takes)
    settled = -np.linalg.solve(A, b)
    over, case = np.transpose([settled - expm(A * t) @ settled for t in profile.time_s])
    rtol = 1e-4 if row_s < 10.0 else 0.05  # rows of eight time constants of the winding are coarse, and stable
    np.testing.assert_allclose(found["case_temperature_degC"] - 20.0, case, rtol=rtol, atol=1e-4)
    np.testing.assert_allclose(found["winding_temperature_degC"] - 20.0, over + case, rtol=rtol, atol=1e-4)
    np.testing.assert_allclose(settled, [1.2 * loss, 3.8 * (loss + iron)], rtol=1e-12)


@pytest.mark.parametrize(("load", "turns"), [(0.0215, False), (0.0225, True)])
def test_hysteresis_holds_at_rest(load: float, turns: bool):
    """A load of tau_0 + T_h does not turn a rotor without voltage; a larger one does."""
    profile = constant(2.0, 0.1, voltage_V=0.0, load_torque_Nm=load, ambient_degC=20.0)
    found = readings(Model("motor", effects=(IRON,)), profile)
    assert bool(np.any(np.abs(found["speed_rad_s"]) > 1e-6)) is turns


def made_case(speeds: tuple[float, float], *, both: bool = True) -> Case:
    frames = {}
    for run, levels in (("a", speeds), ("b", speeds[::-1])):
        profile = constant(100.0, 1.0, current_A=3.0, speed_rad_s=0.0, ambient_degC=20.0)
        speed = np.where(profile.time_s < 50.0, *levels)
        profile = dataclasses.replace(profile, inputs=profile.inputs | {"speed_rad_s": speed})
        frame = readings(Model("motor", effects=(IRON,)), profile)
        columns = ["winding_temperature_degC", *(["case_temperature_degC"] if both else [])]
        frames[run] = pd.DataFrame(
            {"time_s": profile.time_s, **profile.inputs, **{name: frame[name] for name in columns}}
        )
    return Case.from_dataframes(frames, kind="motor", load="unknown")


@pytest.mark.parametrize(
    ("speeds", "both", "told"),
    [((100.0, 400.0), True, True), ((100.0, 400.0), False, False), ((300.0, 300.0), True, False)],
)
def test_it_is_tried_where_speed_varies_and_both_temperatures_are_read(speeds, both: bool, told: bool):
    assert is_distinguishable(made_case(speeds, both=both), CATALOGUE["iron_loss"]) is told
