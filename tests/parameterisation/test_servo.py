"""First parameters of a servo under control: from what the drive set, with gains that are stated or not."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, simulate_case
from jaxmodel.parameterisation.motor import parameterise_motor

ROWS, STEP_S = 1500, 4e-3
TIME = STEP_S * np.arange(ROWS)
REFERENCE = 4.0 * (np.sin(2.0 * TIME) + np.sin(3.3 * TIME) + np.sin(5.1 * TIME))
TRUE = {"k_tau": 0.035, "J": 9.5e-5, "tau_0": 0.02, "R_0": 0.6}
FRICTION = {"viscous_friction": {"b": 2e-4}}
GAINS = {"current": {"k_p": 4.0, "k_d": 0.04}, "voltage": {"k_p": 4.0, "k_d": 0.02}}
SD = {"current_A": 0.01, "voltage_V": 0.02, "speed_rad_s": 0.2, "position_rad": 0.002}


def servo(drive: str) -> Case:
    """Return a run of a servo whose numbers are those of another motor."""
    rng = np.random.default_rng(3)
    read = ["current_A", "speed_rad_s", "position_rad", *(["voltage_V"] if drive == "voltage" else [])]
    frame: dict[str, Any] = {"time_s": TIME, "ambient_degC": 20.0, "reference_position_rad": REFERENCE}
    stated: dict[str, Any] = {"kind": "motor", "load": "free", "drive": drive, "controller": "position"}

    def case_of(columns, parameters, effects) -> Case:
        table = pd.DataFrame(frame | columns)
        return Case.from_dataframes({"run": table}, parameters=parameters, effects=effects, **stated)

    loop = {"position_controller": GAINS[drive]}
    truth = simulate_case(case_of({"position_rad": 0.0}, TRUE, FRICTION | loop), progress=False)[0].table
    noisy = {name: truth[name].to_numpy() + SD[name] * rng.standard_normal(ROWS) for name in read}
    return case_of(noisy, {"k_tau": 0.035}, loop)


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_a_closed_loop_gives_inertia_and_friction(drive: str):
    found = parameterise_motor(servo(drive)).case
    assert found.parameters["J"].value == pytest.approx(TRUE["J"], rel=0.05)
    assert found.parameters["tau_0"].value == pytest.approx(TRUE["tau_0"], rel=0.1)
    assert found.effects["viscous_friction"]["b"] == pytest.approx(2e-4, rel=0.1)
    if drive == "voltage":
        assert found.parameters["R_0"].value == pytest.approx(TRUE["R_0"], rel=0.05)
    assert found.effects["position_controller"] == GAINS[drive]


def test_gains_that_are_not_known_are_found_with_the_rest():
    case = servo("current")
    unsure = {"position_controller": {"k_p": 3.0, "k_d": 0.06}}
    sd = {"position_controller": {"k_p": 1.0, "k_d": 0.02}}
    found = parameterise_motor(dataclasses.replace(case, effects=unsure, effect_sd=sd))
    gains = {one.name: one for one in found.extractions if one.name.startswith("position_controller")}
    for name, true in GAINS["current"].items():
        one = gains[f"position_controller.{name}"]
        assert one.value == pytest.approx(true, rel=0.02)
        assert found.case.effect_sd["position_controller"][name] <= one.sd < sd["position_controller"][name]
    assert found.case.parameters["J"].value == pytest.approx(TRUE["J"], rel=0.05)
