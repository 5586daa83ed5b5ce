"""The table of parameters: complete, consistent with the paper's numbers, and firm about bounds."""

from __future__ import annotations

import math

import equinox as eqx
import jax
import pytest

from jaxmodel.base.errors import ParameterError
from jaxmodel.model.declaration import ParameterInfo, describe, parameter
from jaxmodel.model.parameters import TABLE, Parameters, info

# Printed in the paper, or in the data sheet it refers to.
PRINTED = {
    "capacity_Ah": 5.2,
    "cycles": 25.0,
    "storage_months": 18.0,
    "n_series": 6.0,
    "nominal_cell_voltage_V": 3.8,
    "R_0": 0.103,
    "psi_R": 0.0039,
    "tau_0": 0.010,
    "gear_ratio": 156.0,
    "drive_efficiency": 0.94,
    "friction_coefficient": 0.7,
    "k_tau": 0.0385,
    "L_a": 7.2e-5,
    "J": 5.42e-5,
    "R_wc": 1.2,
    "R_ca": 3.8,
    "tau_wc": 71.7,
    "tau_ca": 1370.0,
    "T_0": 25.0,
}


def test_defaults_are_the_numbers_of_the_paper_and_the_data_sheet():
    assert {name: float(getattr(Parameters(), name)) for name in PRINTED} == PRINTED
    assert all(TABLE[name].source != "assumed" for name in PRINTED)


@pytest.mark.parametrize("entry", TABLE.values(), ids=list(TABLE))
def test_every_entry_is_told_in_full(entry: ParameterInfo):
    assert entry.meaning
    assert entry.source
    assert entry.lower <= entry.default <= entry.upper
    assert math.isfinite(entry.lower)
    assert math.isfinite(entry.upper)
    assert entry.transform == "identity" or entry.lower >= 0.0
    unit_in_name = {"_Ah": "A h", "_degC": "degC", "_V": "V", "_A": "A", "_kg": "kg", "_m": "m", "_months": "months"}
    for ending, unit in unit_in_name.items():
        assert not entry.name.endswith(ending) or entry.unit == unit


def test_a_set_is_a_tree_of_scalars_in_the_order_of_the_table():
    leaves = jax.tree.leaves(Parameters(capacity_Ah=4.0))
    assert len(leaves) == len(TABLE)
    assert {(leaf.shape, str(leaf.dtype)) for leaf in leaves} == {((), "float64")}
    assert float(leaves[list(TABLE).index("capacity_Ah")]) == 4.0


@pytest.mark.parametrize("value", [5.2, 1e-7, 1e4, 5])
def test_a_value_within_its_bounds_is_taken(value: float):
    assert info("capacity_Ah").check(value, "case") == value


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (0.0, "case: 'capacity_Ah' = 0 is outside its range 1e-07 to 10000 A h; correct the value or its unit."),
        (math.nan, "case: 'capacity_Ah' = nan is outside its range 1e-07 to 10000 A h; correct the value or its unit."),
        ("5.2", "case: 'capacity_Ah' must be a number, not '5.2'; write it without quotes."),
        (True, "case: 'capacity_Ah' must be a number, not True; write it without quotes."),
    ],
)
def test_a_value_that_cannot_be_is_refused(value, sentence: str):
    with pytest.raises(ParameterError) as error:
        info("capacity_Ah").check(value, "case")
    assert str(error.value) == sentence


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(
        ParameterError, match=r"bench: no parameter is called 'capcity_Ah'\. Did you mean 'capacity_Ah'\?"
    ):
        info("capcity_Ah", "bench")


def test_what_is_declared_is_described():
    class Spring(eqx.Module):
        stiffness: float = parameter(2.0, unit="N/m", meaning="of the spring", lower=0.0, typical=(1.0, 3.0))
        other: float = 1.0

    assert list(describe(Spring)) == ["stiffness"]
    entry = describe(Spring())["stiffness"]
    assert (entry.unit, entry.default, entry.typical, entry.null) == ("N/m", 2.0, (1.0, 3.0), None)


def test_a_number_of_things_is_whole():
    assert TABLE["n_series"].check(7, "case") == 7.0
    with pytest.raises(ParameterError) as raised:
        TABLE["n_series"].check(6.5, "case")
    assert str(raised.value) == "case: 'n_series' = 6.5 is a count; give a whole number."
