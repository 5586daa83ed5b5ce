"""Charge transfer with an activated exchange current, and what a final model can state beside its tables."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.independent import simulate
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.curves import CURVES
from jaxmodel.model.cell import ZERO_DEGC_IN_K
from jaxmodel.model.curves import CURVE_NAMES, CellCurves, Table
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import CellContext, Effect
from jaxmodel.model.profile import Profile, constant
from tests.model.runs import readings, staircase

CONSTANT = {"ocv": 3.7, "R_ints": 0.05, "R_TS": 0.03, "C_TS": 900.0, "R_TL": 0.04, "C_TL": 5000.0}
LOAD = Profile(
    np.arange(60.0) * 20.0, {"current_A": 4.0 * staircase(8, 60, 1.0), "ambient_degC": np.linspace(-10.0, 45.0, 60)}
)


class OldChargeTransfer(Effect):
    """The law with one exchange current for all temperatures."""

    name: ClassVar[str] = "old_charge_transfer"
    kinds: ClassVar[tuple[str, ...]] = ("cell",)
    equation: ClassVar[str] = ""
    i_0: float = 0.7

    def overpotential(self, value, context):
        thermal = 2.0 * 8.314 * (context.temperature_degC + ZERO_DEGC_IN_K) / 96485.0
        return value + thermal * jnp.arcsinh(context.current_A / (2.0 * self.i_0))


def of_cell(*effects: Effect, curves: CellCurves | None = None) -> dict[str, np.ndarray]:
    parameters = Parameters(initial_soc=0.7)
    return readings(Model("cell", parameters, curves or CellCurves(), effects), LOAD)


def carrying(current_A: float, degC: float) -> CellContext:
    """What a law of the overpotential sees."""
    blank = dict.fromkeys(CellContext.__dataclass_fields__, jnp.zeros(()))
    known = {"parameters": Parameters(), "curves": CellCurves(), "state": {}}
    return CellContext(**blank | known | {"current_A": jnp.asarray(current_A), "temperature_degC": jnp.asarray(degC)})


def test_charge_transfer_without_an_energy_is_the_old_law_to_the_bit():
    """A compiled run may add in another order, and is the same but for the last bit."""
    new, old = CATALOGUE["charge_transfer"](i_0=0.7), OldChargeTransfer()
    for current in (-5.0, 0.0, 1e-6, 3.3):
        for degC in (-20.0, 11.0, 40.0):
            context = carrying(current, degC)
            value = jnp.asarray(0.01)
            assert float(new.overpotential(value, context)) == float(old.overpotential(value, context))
    heating = CATALOGUE["self_heating"]()
    found = of_cell(heating, new)
    for column, expected in of_cell(heating, old).items():
        np.testing.assert_allclose(found[column], expected, rtol=1e-13, atol=1e-13, err_msg=column)


@pytest.mark.parametrize("degC", [-10.0, 25.0, 45.0])
def test_an_energy_makes_the_exchange_current_smaller_in_the_cold(degC: float):
    curves = CellCurves(**{name: Table([0.0, 1.0], [CONSTANT[name]] * 2) for name in CURVE_NAMES})
    parameters = Parameters(initial_soc=0.7, cycles=0.0, storage_months=0.0, capacity_Ah=1e4)
    transfer = CATALOGUE["charge_transfer"](i_0=0.7, E_i=35e3)
    profile = constant(10.0, 1.0, current_A=2.0, ambient_degC=degC)
    base, found = (
        readings(Model("cell", parameters, curves, effects), profile)["voltage_V"] for effects in ((), (transfer,))
    )
    kelvin = degC + 273.15
    exchange = 0.7 * np.exp(-35e3 / 8.314 * (1.0 / kelvin - 1.0 / 298.15))
    lost = 2.0 * 8.314 * kelvin / 96485.0 * np.arcsinh(2.0 / (2.0 * exchange))
    np.testing.assert_allclose(base - found, lost, rtol=0.0, atol=1e-13)
    assert (exchange < 0.7) == (degC < 25.0)


def test_activated_charge_transfer_is_that_of_the_second_simulator():
    inputs = {"current_A": 4.0 * staircase(3, 60, 1.0), "ambient_degC": np.linspace(-5.0, 40.0, 60)}
    given = {"charge_transfer": {"i_0": 0.6, "E_i": 30e3}, "self_heating": {"C_th": 45.0, "hA": 0.1}}
    profile = Profile(np.arange(60.0), inputs)
    effects = tuple(CATALOGUE[name](**numbers) for name, numbers in given.items())
    found = readings(Model("cell", Parameters(initial_soc=0.7), effects=effects), profile)
    expected = simulate("cell", {}, {"time_s": profile.time_s, **inputs}, given, 0.7)
    np.testing.assert_allclose(found["voltage_V"], expected["voltage_V"], atol=2e-4)


def test_a_loop_that_is_wider_when_full_is_that_of_the_second_simulator():
    inputs = {"current_A": 4.0 * staircase(3, 60, 1.0), "ambient_degC": np.full(60, 25.0)}
    given = {"ocv_hysteresis": {"M_V": 0.04, "g": 60.0, "b": -0.5}}
    profile = Profile(np.arange(60.0) * 20.0, inputs)
    model = Model("cell", Parameters(initial_soc=0.9), effects=(CATALOGUE["ocv_hysteresis"](M_V=0.04, g=60.0, b=-0.5),))
    found = readings(model, profile)["voltage_V"]
    expected = simulate("cell", {}, {"time_s": profile.time_s, **inputs}, given, 0.9)["voltage_V"]
    np.testing.assert_allclose(found, expected, atol=2e-4)
    even = simulate("cell", {}, {"time_s": profile.time_s, **inputs}, {"ocv_hysteresis": {"M_V": 0.04, "g": 60.0}}, 0.9)
    assert np.abs(found - even["voltage_V"]).max() > 5e-3


def test_an_energy_of_the_long_pair_is_that_of_its_curve():
    found = of_cell(CATALOGUE["arrhenius_long_polarisation"](E_l=12e3))
    expected = of_cell(CURVES["long_energy"]([12e3]))
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)


def test_details_of_heat_are_those_of_their_curves():
    heating = CATALOGUE["self_heating"]()
    found = of_cell(heating, CATALOGUE["heat_details"](s=-0.4, l=0.3, c=0.1))
    curves = {"short_heat": -0.4, "long_heat": 0.3, "convection_curve": 0.1}
    expected = of_cell(heating, *(CURVES[name]([value]) for name, value in curves.items()))
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)
    nothing = of_cell(heating, CATALOGUE["heat_details"]())
    for column, values in of_cell(heating).items():
        np.testing.assert_array_equal(nothing[column], values, err_msg=column)


def test_a_table_of_the_entropy_coefficient_is_that_of_the_effect():
    heating = CATALOGUE["self_heating"]()
    table = CellCurves(dU_dT=Table([0.0, 1.0], [-3e-4, -3e-4]))
    expected = of_cell(heating, CATALOGUE["entropic_ocv"](dU_dT=-3e-4))
    for column, values in of_cell(heating, curves=table).items():
        np.testing.assert_allclose(values, expected[column], rtol=1e-12, err_msg=column)


def test_a_pair_cools_no_cell():
    """At -1 its loss is no heat; below that a cell would cool as it loses energy, and run away to the absolute zero."""
    heating = CATALOGUE["self_heating"]()
    at_least, below = (of_cell(heating, CATALOGUE["heat_details"](s=share, l=share)) for share in (-1.0, -1.8))
    for name, values in at_least.items():
        np.testing.assert_array_equal(below[name], values)


@pytest.mark.parametrize("name", ["arrhenius_long_polarisation", "heat_details"])
def test_what_a_case_may_state_is_not_searched_for(name: str):
    assert not CATALOGUE[name].is_candidate
