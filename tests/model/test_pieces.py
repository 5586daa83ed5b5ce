"""A run in pieces is the whole run to the bit, whatever the kind, its sensors and its end."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.case.build import make_effect
from jaxmodel.model import pieces
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.pieces import run_in_pieces
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff, Status, simulate

ROWS = 700
LATE = (
    make_effect("temperature_lag", {"tau": 40.0, "column": "cell_temperature_degC"}, "here"),
    make_effect("clock_shift", {"d": 2.5}, "here"),
)
FAULTY = (
    make_effect("voltage_offset", {"c": 0.02, "column": "voltage_V"}, "here"),
    make_effect("self_heating", {}, "here"),
)
MODELS = {
    "cell": Model("cell", Parameters(), effects=FAULTY),
    "cell with late sensors": Model("cell", Parameters(), effects=(*FAULTY, *LATE)),
    "motor": Model("motor", Parameters()),
    "robot with brushes": Model("robot", Parameters(), effects=(make_effect("brush_drop", {}, "here"),)),
}


def profile_of(kind: str) -> Profile:
    rng = np.random.default_rng(0)
    level = np.repeat(rng.uniform(0.1, 1.0, ROWS // 10), 10)
    inputs = {
        "cell": {"current_A": 4.0 * level},
        "motor": {"voltage_V": 12.0 * level, "load_torque_Nm": 0.02 * level[::-1]},
        "robot": {"duty": 0.5 * level, "load_torque_Nm": 0.02 * level[::-1]},
    }[kind]
    time_s = np.cumsum(rng.uniform(0.5, 1.5, ROWS))
    return Profile(time_s, inputs | {"ambient_degC": np.linspace(15.0, 30.0, ROWS)})


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "STEPS", 256)
    monkeypatch.setattr(pieces, "FEW", 128)


@pytest.mark.parametrize("name", MODELS)
def test_pieces_are_the_whole_run_to_the_bit(name: str):
    model = MODELS[name]
    profile = profile_of(model.kind)
    whole, course = simulate(model, profile), run_in_pieces(model, profile)
    assert (course.status, course.end_row) == (Status.COMPLETE, ROWS - 1)
    np.testing.assert_array_equal(course.valid, whole.valid)
    assert course.readings.keys() == whole.readings.keys()
    for column, values in whole.readings.items():
        np.testing.assert_array_equal(course.readings[column], values, err_msg=column)


def test_a_run_in_pieces_ends_where_the_whole_run_does():
    model, profile = MODELS["cell with late sensors"], profile_of("cell")
    cutoff = Cutoff(soc=0.93)
    whole, course = simulate(model, profile, cutoff), run_in_pieces(model, profile, cutoff)
    assert 256 < course.end_row == int(whole.end_row) < ROWS - 1
    assert course.status == Status.REACHED_CUTOFF
    for column, values in whole.readings.items():
        np.testing.assert_array_equal(course.readings[column][: course.end_row + 1], values[: course.end_row + 1])
        assert np.isnan(course.readings[column][course.end_row + 1 :]).all()


def test_numbers_that_are_not_finite_are_said_to_be():
    profile = profile_of("cell")
    course = run_in_pieces(Model("cell", Parameters(capacity_Ah=jnp.asarray(1e-300))), profile)
    assert course.status == Status.NOT_FINITE
