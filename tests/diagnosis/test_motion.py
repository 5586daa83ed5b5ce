"""A servo in a closed loop: presliding, drag by direction and backlash are named where they are, and only there."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.case.measurements import Servo
from jaxmodel.case.records import Case
from jaxmodel.effects import CATALOGUE
from jaxmodel.fit.distinguishable import is_distinguishable
from jaxmodel.model.simulation import simulate
from tests.diagnosis.made_cases import case_of, investigation_of, run_of

ROWS, STEP_S = 1500, 4e-3
NOISE = {"current_A": 0.01, "speed_rad_s": 0.2, "position_rad": 0.002}
STATED = {
    "k_tau": Known(0.035),
    "J": Known(9.5e-5, 5e-6),
    "tau_0": Known(0.02, 0.004),
}
TRUE = STATED | {"J": Known(9.7e-5), "tau_0": Known(0.0215)}
VISCOUS = {"viscous_friction": {"b": 2e-4}}
LOOP = {"position_controller": {"k_p": 4.0, "k_d": 0.04}}
KEPT = ("presliding", "directional_drag", "backlash", "compliance", "stribeck_friction", "current_offset", "windage")
PLANTED: dict[str, dict[str, Any]] = {
    "presliding": {"s": 1.0, "d": 0.2},
    "directional_drag": {"b_d": 4e-5},
    "backlash": {"g": 0.05},
    "compliance": {"c": 1.0},
}


def servo(hidden: Mapping[str, Mapping[str, Any]], *, turns: bool = True) -> Case:
    """Return a servo of a fit run and a check run, simulated with effects hidden and noise added."""
    rng, runs = np.random.default_rng(7), []
    for number, split in ((1, "fit"), (2, "check")):
        time_s = STEP_S * np.arange(ROWS)
        wave = np.random.default_rng(number).uniform(2.0, 6.0, 3)
        swing = 4.0 * sum(np.sin(w * time_s) for w in wave) if turns else 5.0 * time_s
        load = 0.01 * np.sin(7.0 * time_s)  # measured, and of another rhythm than the motion
        inputs = {"reference_position_rad": swing, "load_torque_Nm": load, "ambient_degC": np.full(ROWS, 20.0)}
        true = run_of(number, inputs, {name: np.full(ROWS, swing[0]) for name in NOISE}, step_s=STEP_S)
        known = drive_of(case_of("motor", TRUE, [true]), VISCOUS | LOOP | hidden)
        found = simulate(case_model(known, true), run_profile(true)).readings
        read = {name: np.asarray(found[name]) + sd * rng.standard_normal(ROWS) for name, sd in NOISE.items()}
        runs.append(run_of(number, inputs, read, step_s=STEP_S, split=split))
    return drive_of(case_of("motor", STATED, runs, NOISE), VISCOUS | LOOP)


def drive_of(case: Case, effects: Mapping[str, Mapping[str, Any]]) -> Case:
    return dataclasses.replace(
        case,
        load="free",
        servo=Servo("current", "position"),
        effects={name: dict(values) for name, values in effects.items()},
        effect_sd={"viscous_friction": {"b": 4e-5}},
    )


@pytest.mark.parametrize("name", PLANTED)
def test_what_was_planted_is_named_with_its_size(name: str):
    investigation = investigation_of(servo({name: PLANTED[name]}), *KEPT)
    found = investigation.searching.run()
    assert found.final.added == (name,)
    assert found.tests[name].named
    layout, fit = investigation.cache.space.layout, found.final
    for place, true in zip(layout.of[name], PLANTED[name].values(), strict=True):
        sd = layout.coordinates[place].slope(fit.x[place]) * fit.sd[fit.spec.free.index(place)]
        assert layout.coordinates[place].number(fit.x[place]) == pytest.approx(true, abs=4.0 * abs(sd) + 0.1 * true)


def test_nothing_is_named_of_a_servo_that_has_none_of_them():
    found = investigation_of(servo({}), *KEPT).searching.run()
    assert found.final.added == ()


def test_they_are_no_candidates_where_nothing_turns_round():
    forwards, both = servo({}, turns=False), servo({})
    for name in PLANTED:
        assert is_distinguishable(both, CATALOGUE[name])
        assert not is_distinguishable(forwards, CATALOGUE[name])
    (fit, check) = both.runs
    blind = dataclasses.replace(
        fit, measured=dataclasses.replace(fit.measured, outputs={"speed_rad_s": fit.measured.outputs["speed_rad_s"]})
    )
    unread = dataclasses.replace(both, runs=(blind, check))
    assert not is_distinguishable(unread, CATALOGUE["backlash"])
    assert is_distinguishable(unread, CATALOGUE["presliding"])
