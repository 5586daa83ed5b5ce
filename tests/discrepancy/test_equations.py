"""A law in an equation is found there, though the readings show it on every channel at once."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from discrepancy import lanes
from discrepancy.failure import failure
from discrepancy.law_file import law_file
from discrepancy.leftover import leftover_laws
from discrepancy.session import Session
from jaxmodel.cases import Case, Known
from jaxmodel.model import Model
from jaxmodel.parameters import Parameters
from jaxmodel.profile import Profile
from jaxmodel.simulate import simulate
from tests.discrepancy.made_cases import case_of, run_of, with_candidates
from tests.jaxmodel.runs import staircase

NOISE = {"current_A": 0.02, "speed_rad_s": 0.3, "winding_temperature_degC": 0.2}
ROWS, STEP_S = 300, 4.0
# What a bench reports of itself, and what truly acted.
LAWS = {
    "a brake that fades": ("load_torque_Nm", lambda torque, given: torque * (1.0 - 0.15 * given["time_s"] / 1200.0)),
    "an amplifier that gives way": ("voltage_V", lambda volts, given: volts - 0.002 * volts * np.abs(volts)),
}


def session_of(case: Case) -> Session:
    return with_candidates(case, "viscous_friction", "windage")


def measured(law: str, seed: int = 0) -> Case:
    column, acts = LAWS[law]
    rng = np.random.default_rng(seed)
    time = STEP_S * np.arange(ROWS)
    runs = []
    for number in range(3):
        reported = {
            "voltage_V": staircase(10 + number, ROWS, 14.0),
            "load_torque_Nm": np.abs(staircase(20 + number, ROWS, 0.15)),
            "ambient_degC": np.full(ROWS, 20.0),
        }
        true = reported | {column: acts(reported[column], {"time_s": time})}
        readings = simulate(Model("motor"), Profile(time, true)).readings
        outputs = {name: np.asarray(readings[name]) + sd * rng.standard_normal(ROWS) for name, sd in NOISE.items()}
        runs.append(run_of(number + 1, reported, outputs, step_s=STEP_S, split="check" if number == 2 else "fit"))
    known = {"R_0": Known(0.103, 0.003), "k_tau": Known(0.0385, 0.001), "tau_0": Known(0.01, 0.0015)}
    return case_of("motor", known, runs, NOISE)


@pytest.mark.parametrize(
    ("law", "equation", "variable", "multiplier"),
    [
        ("a brake that fades", "torque balance", "time_s", "load_torque_Nm"),
        ("an amplifier that gives way", "armature voltage", "voltage_V", ""),
    ],
)
def test_a_law_is_found_in_its_equation(law: str, equation: str, variable: str, multiplier: str):
    session = session_of(measured(law))
    base = session.hypothesis()
    blocks = leftover_laws(session, base, session.screen(base))
    assert equation in blocks[0].channel
    assert (blocks[0].variable, blocks[0].multiplier) == (variable, multiplier)
    assert blocks[0].significant
    # It moves several channels, so that it explains more than any law of one.
    assert blocks[0].drop > max(block.drop for block in blocks if not block.in_equation)
    assert f"{blocks[0].unit} over" in blocks[0].sentence()


def test_the_law_itself_comes_out():
    """The brake has lost 15 % of the torque after 20 minutes, whatever the calibration made of its mean."""
    session = session_of(measured("a brake that fades"))
    base = session.hypothesis()
    block = leftover_laws(session, base, session.screen(base))[0]
    slope = np.polyfit(block.knots, block.law, 1)[0]
    assert slope * 1200.0 == pytest.approx(-0.15, rel=0.15)


def cell_that_fades() -> Case:
    """Three runs of one cell at 0, 200 and 500 cycles: it has lost 0, 6 and 15 % of its charge, as nobody stated."""
    rng = np.random.default_rng(0)
    runs = []
    for number, cycles in enumerate((0.0, 200.0, 500.0)):
        given = {"current_A": np.abs(staircase(30 + number, ROWS, 6.0)), "ambient_degC": np.full(ROWS, 20.0)}
        true = {"cycles": cycles, "capacity_Ah": 3.5 * (1.0 - 3e-4 * cycles), "storage_months": 0.0, "initial_soc": 0.9}
        cell = Model("cell", Parameters(**{name: jnp.asarray(value) for name, value in true.items()}))
        readings = simulate(cell, Profile(STEP_S * np.arange(ROWS), given)).readings
        outputs = {"voltage_V": np.asarray(readings["voltage_V"]) + 1e-3 * rng.standard_normal(ROWS)}
        runs.append(run_of(number + 1, given, outputs, step_s=STEP_S, cycles=Known(cycles)))
    known = {"capacity_Ah": Known(3.5, 0.1), "series_resistance_scale": Known(1.0, 0.1), "storage_months": Known(0.0)}
    return case_of("cell", known, runs, {"voltage_V": 1e-3})


def test_a_capacity_that_falls_with_age_is_counted_so():
    session = with_candidates(cell_that_fades(), "resistance_ageing", "self_discharge")
    base = session.hypothesis()
    law = leftover_laws(session, base, session.screen(base))[0]
    assert (law.channel, law.multiplier, law.variable) == ("the counting of charge (eq. 1)", "current_A", "cycles")
    assert law.knots.tolist() == [0.0, 200.0, 500.0]
    # As much charge is counted as if the capacity were what it is: 1 / 0.85 of what an ampere at first was.
    assert np.ptp(law.law) == pytest.approx(1.0 / 0.85 - 1.0, rel=0.15)
    (capacity,) = (one for one in failure(session, base).shifts if one.parameter == "capacity_Ah")
    assert capacity.goes_with == "cycles"
    assert law_file(law, "cell", "aged") is not None


def test_laws_of_a_model_with_fewer_effects_are_asked_by_the_same_program():
    session = session_of(measured("a brake that fades"))
    base, richer = session.hypothesis(), session.hypothesis(("windage",))
    screened = session.screen(base)
    by_its_own = leftover_laws(session, base, screened)
    assert any(block.in_equation for block in leftover_laws(session, richer, session.screen(richer)))
    compiled = len(lanes.PROGRAMS.compiled)
    shared = leftover_laws(session, base, screened, richer)
    assert len(lanes.PROGRAMS.compiled) == compiled
    assert [(one.channel, one.variable) for one in shared] == [(one.channel, one.variable) for one in by_its_own]
    np.testing.assert_allclose([one.drop for one in shared], [one.drop for one in by_its_own], rtol=1e-4)


def test_a_right_model_asks_no_equation():
    case = measured("a brake that fades")
    runs = []
    for run in case.runs:
        given = Profile(run.measured.time_s, run.measured.inputs)
        readings = simulate(Model("motor"), given).readings
        rng = np.random.default_rng(5)
        outputs = {name: np.asarray(readings[name]) + sd * rng.standard_normal(ROWS) for name, sd in NOISE.items()}
        runs.append(dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs)))
    session = session_of(dataclasses.replace(case, runs=tuple(runs)))
    base = session.hypothesis()
    blocks = leftover_laws(session, base, session.screen(base))
    assert not any(block.significant or block.in_equation for block in blocks)


def test_where_a_motor_fails_is_told_by_the_current_it_draws_too():
    session = session_of(measured("a brake that fades"))
    told = failure(session, session.hypothesis()).cells["speed_rad_s"]
    assert {"current_A", "voltage_V"} <= {cell.regressor for cell in told}
