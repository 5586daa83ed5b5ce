"""Differences of one specimen: each is the change of a number that the model has anyway."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.differences import DIFFERENCES, WHAT
from jaxmodel.effects.loads import PropellerLoad
from jaxmodel.effects.shifts import SHIFTS
from jaxmodel.model.declaration import describe
from jaxmodel.model.motor import BENDING
from jaxmodel.model.ports import Effect, touches
from tests.effects.test_shifts import sensed

TWICE = np.log(2.0)


def kind_of(name: str) -> str:
    return DIFFERENCES[name].kinds[0]


def difference(name: str, number: float) -> Effect:
    column = {"column": "cell_temperature_degC"} if DIFFERENCES[name].is_sensor else {}
    return DIFFERENCES[name](**column, **{next(iter(describe(DIFFERENCES[name]))): number})


@pytest.mark.parametrize("name", DIFFERENCES)
def test_a_difference_of_zero_is_absent_and_any_other_is_seen(name: str):
    kind = kind_of(name)
    rounding = 1e-9 if touches((difference(name, 0.0),), *BENDING) else 1e-13
    more = (PropellerLoad(c=1e-7),) if kind == "motor" else ()
    base = sensed(kind, *more)
    for column, found in sensed(kind, *more, difference(name, 0.0)).items():
        np.testing.assert_allclose(found, base[column], rtol=rounding, atol=rounding, err_msg=column)
    moved = sensed(kind, *more, difference(name, 0.5))
    assert any(np.max(np.abs(moved[column] - base[column])) > 1e-6 for column in base)


@pytest.mark.parametrize("name", DIFFERENCES)
def test_a_difference_is_one_scalar_with_words_that_is_neither_effect_nor_shift(name: str):
    (info,) = describe(DIFFERENCES[name]).values()
    assert (info.null, name in CATALOGUE, name in SHIFTS, name in WHAT) == (0.0, False, False, True)
    assert info.typical is not None
    low, high = info.typical
    assert info.lower < low == -high < 0.0


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("resistance_difference", "R_0", 0.206),
        ("torque_constant_difference", "k_tau", 0.077),
        ("friction_difference", "tau_0", 0.02),
        ("cell_resistance_difference", "", 0.0),
        ("capacity_difference", "capacity_Ah", 10.4),
    ],
)
def test_twice_a_number_is_twice_its_parameter(name: str, parameter: str, value: float):
    changed = {"series_resistance_scale": 2.0, "rc_resistance_scale": 2.0} if not parameter else {parameter: value}
    found = sensed(kind_of(name), difference(name, TWICE))
    expected = sensed(kind_of(name), **changed)
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-6, atol=1e-6, err_msg=column)
