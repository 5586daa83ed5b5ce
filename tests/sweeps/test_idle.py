"""An axis on which no result can depend is said, with what would make it matter; it stops nothing."""

from __future__ import annotations

import warnings
from typing import Any

import pytest

from jaxmodel import sweeps
from jaxmodel.base.errors import RemarkWarning
from jaxmodel.sweeps.idle import idle

CELL: dict[str, Any] = {
    "kind": "cell",
    "profile": {"duration_s": 60, "step_s": 5, "ambient_degC": 20, "current_A": 4.0},
    "metrics": ["final_soc", "min_voltage_V"],
}
ROBOT: dict[str, Any] = {
    "kind": "robot",
    "profile": {"duration_s": 10, "step_s": 0.5, "ambient_degC": 20, "duty": 0.6, "load_torque_Nm": 0.05},
    "metrics": ["final_soc"],
}


@pytest.mark.parametrize(
    ("study", "axes", "said"),
    [
        (CELL, {"mass_kg": [5.0, 9.0], "cycles": [1, 100]}, {"mass_kg": 'set kind = "robot"'}),
        (CELL, {"k_tau": [0.03, 0.04]}, {"k_tau": 'set kind = "motor" or "robot"'}),
        (CELL, {"initial_temperature_rise_K": [0.0, 5.0]}, {"initial_temperature_rise_K": "turn on self_heating"}),
        (CELL, {"scale.current_A": [0.5, 1.0], "initial.soc": [0.5, 1.0], "ambient_degC": [0.0, 20.0]}, {}),
        (
            ROBOT,
            {"mass_kg": [5.0, 9.0], "R_0": [0.1, 0.2], "gear_ratio": [100.0, 150.0]},
            {"gear_ratio": "add distance_m to the metrics", "mass_kg": "state incline_deg instead of load_torque_Nm"},
        ),
    ],
    ids=["of a robot", "of a motor", "of an effect", "inputs and starts", "beside a stated torque"],
)
def test_what_no_result_depends_on_is_found(study: dict[str, Any], axes: dict[str, Any], said: dict[str, str]):
    assert idle(sweeps.Study(**study, axes=axes)) == said


def test_with_the_effect_it_matters():
    study = sweeps.Study(**CELL, effects={"self_heating": {}}, axes={"initial_temperature_rise_K": [0.0, 5.0]})
    assert idle(study) == {}


def test_a_sweep_says_it_and_runs():
    study = sweeps.Study(**CELL, axes={"initial_temperature_rise_K": [0.0, 5.0]})
    said = r"axes\.initial_temperature_rise_K: no metric .* of this cell depends on it; turn on self_heating"
    with pytest.warns(RemarkWarning, match=said):
        found = sweeps.run(study)
    assert float(found["min_voltage_V"].std()) == 0.0
    with pytest.warns(RemarkWarning, match=said):
        sweeps.forecast(study)


def test_a_sweep_whose_axes_matter_says_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error", RemarkWarning)
        sweeps.run(sweeps.Study(**CELL, axes={"cycles": [1, 100]}))
