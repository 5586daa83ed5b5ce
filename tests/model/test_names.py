"""Every number of a model by its name, to read and to replace."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import pytest

from jaxmodel.base.errors import ParameterError
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import parameter_table, value, with_values
from jaxmodel.model.parameters import TABLE, Parameters

MODEL = Model(
    "cell",
    Parameters(capacity_Ah=4.0),
    effects=(
        CATALOGUE["ocv_hysteresis"](M_V=0.03),
        CATALOGUE["voltage_offset"](column="voltage_V", c=0.2),
        CATALOGUE["temperature_lag"](column="cell_temperature_degC", tau=9.0),
    ),
)
NUMBERS = {
    "capacity_Ah": 4.0,
    "R_0": 0.103,
    "ocv_hysteresis.M_V": 0.03,
    "ocv_hysteresis.g": 40.0,
    "ocv_hysteresis.b": 0.0,
    "voltage_offset:voltage_V.c": 0.2,
    "temperature_lag:cell_temperature_degC.tau": 9.0,
}


def test_names_are_those_of_the_base_and_of_each_effect():
    of_effects = [name for name in NUMBERS if "." in name]
    assert list(parameter_table(MODEL)) == [*TABLE, *of_effects]
    assert parameter_table(MODEL)["ocv_hysteresis.M_V"].unit == "V"


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_is_read_and_replaced_alone(name: str):
    assert float(value(MODEL, name)) == NUMBERS[name]
    changed = with_values(MODEL, {name: jnp.asarray(0.77)})
    assert {other: float(value(changed, other)) for other in NUMBERS} == NUMBERS | {name: 0.77}


def test_several_numbers_are_replaced_at_once_and_may_be_traced_or_carry_lanes():
    names = ["capacity_Ah", "ocv_hysteresis.g"]
    lanes = with_values(MODEL, {name: jnp.arange(3.0) for name in names})
    assert [value(lanes, name).shape for name in names] == [(3,), (3,)]
    slope = jax.grad(lambda x: value(with_values(MODEL, {"capacity_Ah": x}), "capacity_Ah") ** 2)(jnp.asarray(3.0))
    assert float(slope) == 6.0


def test_the_switch_of_an_effect_has_a_name_too():
    switched = with_values(MODEL, {"ocv_hysteresis.switch": jnp.asarray(0.5)})
    assert MODEL.effects[0].switch is None
    assert float(value(switched, "ocv_hysteresis.switch")) == 0.5


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("capacity", "capacity_Ah"),
        ("ocv_hysteresis.M", "ocv_hysteresis.M_V"),
        ("ocv_hysterisis.g", "ocv_hysteresis.g"),
        ("voltage_offset.c", "voltage_offset:voltage_V.c"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(name: str, meant: str):
    for attempt in (lambda: value(MODEL, name), lambda: with_values(MODEL, {name: jnp.asarray(1.0)})):
        with pytest.raises(ParameterError) as error:
            attempt()
        assert str(error.value) == f"model: no number is called '{name}'. Did you mean '{meant}'?"


def test_the_base_has_no_switch():
    with pytest.raises(ParameterError, match="no number is called 'switch'"):
        value(MODEL, "switch")
