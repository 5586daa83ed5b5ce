"""Shifts of a single run: each is the change of a number that the model has anyway."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.case.build import make_effect
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.shifts import SHIFTS
from jaxmodel.model.declaration import describe
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.motor import BENDING
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import Effect, touches
from jaxmodel.model.profile import Profile
from tests.model.runs import readings, staircase

LEVELS = staircase(8, 60, 1.0)
AMBIENT = np.linspace(5.0, 40.0, 60)
INPUTS = {
    "cell": {"current_A": 4.0 * LEVELS, "ambient_degC": AMBIENT},
    "motor": {"voltage_V": 12.0 * LEVELS, "load_torque_Nm": 0.05 * LEVELS, "ambient_degC": AMBIENT},
    "robot": {"duty": 0.5 * LEVELS, "load_torque_Nm": 0.05 * LEVELS, "ambient_degC": AMBIENT},
}
COLUMN = {"voltage_shift": "voltage_V", "temperature_shift": "cell_temperature_degC", "ambient_shift": "ambient_degC"}


def sensed(kind: str, *effects: Effect, warmer: float = 0.0, **parameters: float) -> dict[str, np.ndarray]:
    profile = Profile(np.arange(60.0), INPUTS[kind] | {"ambient_degC": AMBIENT + warmer})
    return readings(Model(kind, Parameters(initial_soc=0.7, **parameters), effects=effects), profile)


def shift(name: str, number: float | None = None) -> Effect:
    field = next(iter(describe(SHIFTS[name])))
    column = {"column": COLUMN[name]} if name in COLUMN else {}
    return SHIFTS[name](**column, **({} if number is None else {field: number}))


def kind_of(name: str) -> str:
    return SHIFTS[name].kinds[0]


@pytest.mark.parametrize("name", SHIFTS)
def test_a_shift_of_zero_is_absent_and_any_other_is_seen(name: str):
    """To the bit, unless the linear pair of a motor is then solved by secants: that is other rounding."""
    rounding = 1e-12 if touches((shift(name),), *BENDING) else 0.0
    heating = (CATALOGUE["self_heating"](),) if kind_of(name) == "cell" else ()
    base = sensed(kind_of(name), *heating)
    for column, found in sensed(kind_of(name), *heating, shift(name, 0.0)).items():
        np.testing.assert_allclose(found, base[column], rtol=0.0, atol=rounding, err_msg=column)
    moved = sensed(kind_of(name), *heating, shift(name))
    assert any(np.max(np.abs(moved[column] - base[column])) > 1e-6 for column in base)


@pytest.mark.parametrize("name", SHIFTS)
def test_a_shift_is_one_scalar_that_is_not_in_the_catalogue(name: str):
    (info,) = describe(SHIFTS[name]).values()
    assert (info.null, name in CATALOGUE) == (0.0, False)
    assert info.typical is not None
    low, high = info.typical
    assert info.lower < low == -high < 0.0


def test_a_contact_costs_its_drop():
    base, found = sensed("cell"), sensed("cell", shift("contact_resistance", 0.012))
    np.testing.assert_allclose(base["voltage_V"] - found["voltage_V"], 0.012 * 4.0 * LEVELS, rtol=0.0, atol=1e-13)


def test_the_heat_of_a_contact_does_not_warm_the_cell():
    heating = CATALOGUE["self_heating"](hA=0.2)
    base, found = sensed("cell", heating), sensed("cell", heating, shift("contact_resistance", 0.012))
    np.testing.assert_allclose(found["cell_temperature_degC"], base["cell_temperature_degC"], rtol=1e-12)


@pytest.mark.parametrize("first", [True, False])
def test_a_draught_multiplies_the_heat_transfer_wherever_it_stands(first: bool):
    heating, draught = CATALOGUE["self_heating"](hA=0.2), shift("heat_transfer_shift", 0.6)
    found = sensed("cell", *((draught, heating) if first else (heating, draught)))
    expected = sensed("cell", CATALOGUE["self_heating"](hA=0.2 * np.exp(0.6)))
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)


def test_a_tight_bearing_adds_to_the_no_load_torque():
    found, expected = sensed("motor", shift("friction_shift", 0.004)), sensed("motor", tau_0=0.014)
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, atol=1e-12, err_msg=column)


@pytest.mark.parametrize("kind", ["cell", "motor", "robot"])
def test_a_warmer_place_is_a_warmer_ambient_from_the_start(kind: str):
    heating = (CATALOGUE["self_heating"](),) if kind != "motor" else ()
    found, expected = sensed(kind, *heating, shift("ambient_shift", 2.5)), sensed(kind, *heating, warmer=2.5)
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, atol=1e-12, err_msg=column)


@pytest.mark.parametrize(
    ("kind", "name", "column"),
    [
        ("cell", "voltage_shift", "voltage_V"),
        ("robot", "voltage_shift", "pack_voltage_V"),
        ("motor", "temperature_shift", "winding_temperature_degC"),
    ],
)
def test_a_shifted_reading_is_the_only_one(kind: str, name: str, column: str):
    base, found = sensed(kind), sensed(kind, SHIFTS[name](column=column, c=0.3))
    for other, values in base.items():
        np.testing.assert_allclose(found[other] - values, 0.3 if other == column else 0.0, atol=1e-13, err_msg=other)


def test_an_ambient_shift_knows_its_column():
    assert make_effect("ambient_shift", {"c": 1.0}, "here", SHIFTS).label == "ambient_shift:ambient_degC"
