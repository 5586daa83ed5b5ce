"""A brushless motor as one armature: constants of phases, power and torque, and what a case says of its current."""

from __future__ import annotations

import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from jaxmodel import Case, case_model, read_case
from jaxmodel.base.errors import UserError
from jaxmodel.case.writing import write_case
from jaxmodel.data.importing import Options, import_case
from jaxmodel.effects import CATALOGUE
from jaxmodel.fit.distinguishable import is_distinguishable
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import simulate

R, L, PAIRS, FLUX = 0.05, 4e-5, 7, 0.004  # of a phase: ohm, H; pole pairs, Wb
KV = 60.0 / (2.0 * math.pi) / (math.sqrt(3.0) * PAIRS * FLUX)
STAGE = 1e7  # s
CURRENT = {"peak": 1.0, "rms": 1.0 / math.sqrt(2.0)}  # over the amplitude
ROWS = pd.DataFrame({"time_s": [0.0, 1.0, 2.0], "current_A": 3.0, "speed_rad_s": 100.0, "ambient_degC": 20.0})
ROWS["winding_temperature_degC"] = [20.0, 20.1, 20.2]


def made_case(**brushless) -> Case:
    return Case.from_dataframes({"run": ROWS}, kind="motor", load="unknown", brushless=brushless or None)


@pytest.mark.parametrize("current", ["peak", "rms"])
@pytest.mark.parametrize(
    "constants",
    [
        {"R_phase_ohm": R, "L_phase_H": L, "KV_rpm_per_V": KV},
        {"R_line_to_line_ohm": 2.0 * R, "L_line_to_line_H": 2.0 * L, "Nm_per_A_peak": 1.5 * PAIRS * FLUX},
        {"R_phase_ohm": R, "L_phase_H": L, "Nm_per_A_rms": 1.5 * PAIRS * FLUX * math.sqrt(2.0)},
    ],
)
def test_three_phases_and_the_armature_turn_and_warm_alike(current: str, constants: dict[str, float]):
    """The three phases in their own coordinates, driven by v_q in the rotor's, by solve_ivp."""
    v_q, load, J, tau_0 = 6.0, 0.05, 5.42e-5, 0.01
    turn = 2.0 * math.pi / 3.0 * np.arange(3)

    def rates(_, y):
        phases, speed, angle, _heat = y[:3], y[3], y[4], y[5]
        field = PAIRS * angle - turn
        # The magnet's back-EMF is -sin, and so is a current on the q-axis; v_d = -w L i_q holds i_d at 0.
        q = -2.0 / 3.0 * np.sin(field) @ phases
        v_d = -PAIRS * speed * L * q
        volts = v_d * np.cos(field) - v_q * np.sin(field)
        emf = -PAIRS * speed * FLUX * np.sin(field)
        torque = -PAIRS * FLUX * np.sin(field) @ phases
        over_speed = (torque - load - tau_0) / J
        return [*((volts - R * phases - emf) / L), over_speed, speed, R * phases @ phases]

    times = np.linspace(0.0, 0.06, 13)
    # From a current that holds the load, so that the rotor never turns back.
    start = (load + tau_0) / (1.5 * PAIRS * FLUX)
    y_0 = [*(-start * np.sin(-turn)), 0.0, 0.0, 0.0]
    exact = solve_ivp(rates, (0.0, 0.06), y_0, "Radau", t_eval=times, rtol=1e-8, atol=1e-9).y
    q = -2.0 / 3.0 * np.sum(np.sin(PAIRS * exact[4] - turn[:, None]) * exact[:3], axis=0)

    case = made_case(current=current, **constants)
    numbers = {"psi_R": 0.0, "initial_current_A": start * CURRENT[current], "J": J, "tau_0": tau_0}
    numbers |= {"tau_wc": STAGE, "tau_ca": STAGE, "R_wc": 1.0, "R_ca": 1.0}  # stages so slow that they add up
    parameters = with_values(case_model(case), {name: jnp.asarray(x) for name, x in numbers.items()}).parameters
    power = 1.5 * v_q / CURRENT[current]  # volts with which the armature takes the power of the phases
    found = simulate(
        Model("motor", parameters), constant(0.06, 0.005, voltage_V=power, load_torque_Nm=load, ambient_degC=20.0)
    )
    np.testing.assert_allclose(found.readings["speed_rad_s"], exact[3], rtol=2e-6, atol=1e-5)
    np.testing.assert_allclose(found.readings["current_A"], q * CURRENT[current], rtol=2e-6, atol=1e-6)
    heat = np.asarray(found.states["x_case_K"]) * STAGE
    np.testing.assert_allclose(heat[-1], exact[5][-1] + tau_0 * exact[4][-1], rtol=1e-5)


@pytest.mark.parametrize(("current", "factor"), [("rms", 3.0), ("peak", 1.5)])
def test_an_sd_is_that_of_the_phase_times_the_factor(current: str, factor: float):
    known = made_case(current=current, R_phase_ohm={"value": R, "sd": 0.1 * R}, KV_rpm_per_V=(KV, 0.05 * KV)).parameters
    assert (known["R_0"].value, known["R_0"].sd) == pytest.approx((factor * R, 0.1 * factor * R))
    assert known["k_tau"].sd == pytest.approx(0.05 * known["k_tau"].value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"brushless": {"current": "rms", "R_phase_ohm": R, "R_line_to_line_ohm": 2 * R}}, "state the same constant"),
        ({"brushless": {"current": "rms", "R_phase_ohm": R}, "parameters": {"R_0": 0.1}}, "R_phase_ohm and R_0"),
        ({"brushless": {"current": "dc"}}, "rms"),
        ({"brushless": {"current": "rms", "R_phase_ohm": -1.0}}, "R_phase_ohm"),
        ({"brushless": {"R_phase_ohm": R}}, "current"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(changes, said: str):
    with pytest.raises(UserError, match=said):
        Case.from_dataframes({"run": ROWS}, kind="motor", load="unknown", **changes)


def test_it_has_no_brushes():
    brushed, brushless = made_case(), made_case(current="rms")
    for name in ("brush_drop", "brush_current_drop"):
        assert is_distinguishable(brushed, CATALOGUE[name])
        assert not is_distinguishable(brushless, CATALOGUE[name])


def test_an_import_says_it_and_what_is_written_is_read_again(tmp_path: Path):
    log = tmp_path / "log.csv"
    ROWS.assign(voltage_V=[9.0, 9.1, 9.2]).to_csv(log, index=False)
    numbers = {"R_line_to_line_ohm": 2.0 * R, "KV_rpm_per_V": KV}
    options = Options(brushless="rms", brushless_numbers=numbers, load="unknown", ambient=20.0)
    imported = import_case(log, "motor", options=options, progress=False)
    case = read_case(imported.write(tmp_path / "case"))
    assert case.brushless == "rms"
    assert case.parameters["R_0"].value == pytest.approx(3.0 * R)
    write_case(case, tmp_path / "case" / "again.toml")
    again = read_case(tmp_path / "case" / "again.toml")
    assert (again.brushless, again.parameters) == (case.brushless, case.parameters)
    with pytest.raises(UserError, match="KV_rpm_per_V"):
        import_case(log, "motor", options=Options(brushless="rms", brushless_numbers={"KV": 1.0}), progress=False)
