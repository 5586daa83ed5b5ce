"""First parameters of motors whose load follows a law or is unknown, from simulated logs with noise."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.model.parameters import Parameters
from jaxmodel.parameterisation.motor_rows import motor_rows
from jaxmodel.parameterisation.motor_size import by_size
from jaxmodel.parameterisation.parameterise import parameterise

TIME_S = np.arange(0.0, 30.0, 0.05)
MOTOR = {"R_0": 0.5, "k_tau": 0.03, "J": 4e-5, "tau_0": 0.008}
LOAD = {"propeller": {"propeller_load": {"c": 4e-7}}, "gravity": {"gravity_load": {"mass_kg": 0.4, "arm_m": 0.1}}}


def log(law: str, columns: tuple[str, ...]) -> pd.DataFrame:
    volts = 6.0 + 3.0 * np.sign(np.sin(0.9 * TIME_S)) + 2.0 * np.sin(0.31 * TIME_S)
    frame = pd.DataFrame({"time_s": TIME_S, "voltage_V": volts, "ambient_degC": 20.0})
    truth = Case.from_dataframes({"a": frame}, kind="motor", parameters=MOTOR, effects=LOAD[law])
    table, random = simulate_case(truth, progress=False)[0].table, np.random.default_rng(4)
    for column, sd in (("current_A", 0.02), ("speed_rad_s", 0.3)):
        if column in columns:
            frame[column] = table[column] + random.normal(0.0, sd, len(frame))
    return frame


def test_the_propeller_is_found_with_the_motor():
    case = Case.from_dataframes({"a": log("propeller", ("current_A", "speed_rad_s"))}, kind="motor", load="propeller")
    found = parameterise(case)
    assert found["propeller_load.c"].value == pytest.approx(4e-7, rel=0.1)
    assert found["k_tau"].value == pytest.approx(0.03, rel=0.03)
    assert found.case.effects["propeller_load"]["c"] == pytest.approx(4e-7, rel=0.1)


def test_a_propeller_without_a_current_is_known_beside_the_resistance():
    """Only c R_0 is in voltage and speed."""
    given = {"R_0": 0.5}
    case = Case.from_dataframes(
        {"a": log("propeller", ("speed_rad_s",))}, kind="motor", load="propeller", parameters=given
    )
    found = parameterise(case)
    assert found["propeller_load.c"].value == pytest.approx(4e-7, rel=0.3)
    assert found["k_tau"].value == pytest.approx(0.03, rel=0.1)


def test_an_unknown_load_leaves_friction_and_inertia_to_others():
    case = Case.from_dataframes({"a": log("propeller", ("current_A", "speed_rad_s"))}, kind="motor", load="unknown")
    found = parameterise(case)
    assert found["R_0"].value == pytest.approx(0.5, rel=0.05)
    assert found["k_tau"].value == pytest.approx(0.03, rel=0.03)
    assert not any(one.found for one in found.extractions if one.name in ("tau_0", "J"))


def rows_of(k: float, volts: float):
    frame = pd.DataFrame({"time_s": TIME_S, "voltage_V": volts, "speed_rad_s": volts / k, "ambient_degC": 20.0})
    case = Case.from_dataframes({"a": frame}, kind="motor", load="free")
    return [motor_rows(case, run) for run in case.runs]


def test_a_motor_of_seven_millimetres_is_not_given_the_numbers_of_fifty():
    """Of a coreless motor of 7 x 16 mm, 1 ohm and some ten seconds of its winding are usual."""
    usual = by_size(rows_of(0.00091, 3.7), 0.00091, None)
    assert 0.2 < usual["R_0"].value < 2.0
    assert 5.0 < usual["tau_wc"].value < 25.0
    assert usual["R_wc"].value > 10.0 * float(Parameters().R_wc)
    assert all(known.sd and known.sd >= 0.5 * known.value for known in usual.values())


def test_a_motor_as_large_or_with_a_gear_keeps_what_is_stated():
    assert by_size(rows_of(0.0385, 22.8), 0.0385, None) == {}
    assert set(by_size(rows_of(1.4, 7.4), 1.4, 4.0)) == {"J"}
