"""The cell: equations 1, 2, 7 and 8 by hand, charge conserved, closed forms where the curves are constant."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.model import cell as cells
from jaxmodel.model.cell import cycle_resistance, initial_soc, storage_factor
from jaxmodel.model.curves import CURVE_NAMES, CellCurves, Table
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, constant
from tests.model.runs import readings

CONSTANT = {"ocv": 3.7, "R_ints": 0.05, "R_TS": 0.03, "C_TS": 900.0, "R_TL": 0.04, "C_TL": 5000.0}


def cell_of_constants(**parameters: float) -> Model:
    curves = CellCurves(**{name: Table([0.0, 1.0], [CONSTANT[name]] * 2) for name in CURVE_NAMES})
    return Model("cell", Parameters(**({"cycles": 0.0, "storage_months": 0.0} | parameters)), curves)


@pytest.mark.parametrize(("difference", "soc"), [(0.0, 0.99977408), (-0.714932, 1.0), (10.0, 0.94925408)])
def test_initial_charge_is_equation_2(difference: float, soc: float):
    assert float(initial_soc(jnp.asarray(difference))) == pytest.approx(soc, abs=1e-8)


@pytest.mark.parametrize(("cycles", "ohm"), [(0.0, 0.0), (25.0, 0.0075), (400.0, 0.03)])
def test_cycle_resistance_is_equation_7(cycles: float, ohm: float):
    assert float(cycle_resistance(jnp.asarray(cycles))) == pytest.approx(ohm, abs=1e-15)


def test_cycle_resistance_has_a_finite_derivative_at_a_new_cell():
    slope = jax.grad(cycle_resistance)
    assert float(slope(jnp.asarray(0.0))) == 0.0
    assert float(slope(jnp.asarray(25.0))) == pytest.approx(0.00015, rel=1e-12)


@pytest.mark.parametrize(
    ("months", "degC", "share"),
    [(0.0, 20.0, 1.0), (18.0, 20.0, 0.831024), (18.0, 0.0, 0.949943), (6.0, 40.0, 0.837230)],
)
def test_storage_loss_is_equation_8(months: float, degC: float, share: float):
    assert float(storage_factor(jnp.asarray(months), jnp.asarray(degC))) == pytest.approx(share, abs=2e-6)


@given(st.integers(0, 2**31), st.floats(0.5, 20.0), st.floats(0.0, 36.0))
def test_charge_taken_is_charge_lost(seed: int, capacity_Ah: float, months: float):
    rng = np.random.default_rng(seed)
    time, current = np.cumsum(rng.uniform(0.1, 20.0, 60)), np.round(rng.uniform(-3.0, 6.0, 60), 2)
    parameters = Parameters(initial_soc=0.7, capacity_Ah=capacity_Ah, storage_months=months)
    profile = Profile(time, {"current_A": current, "ambient_degC": np.full(60, 20.0)})
    taken = np.concatenate([[0.0], np.cumsum(current[1:] * np.diff(time))])
    usable = 3600.0 * capacity_Ah * float(storage_factor(jnp.asarray(months), jnp.asarray(20.0)))
    lost = 0.7 - readings(Model("cell", parameters), profile)["soc"]
    np.testing.assert_allclose(lost, taken / usable, rtol=0.0, atol=1e-13)


@given(st.floats(0.1, 5.0), st.floats(-20.0, 60.0))
def test_discharge_is_monotone(current: float, degC: float):
    """While charge is taken at a constant rate, charge and voltage fall at every row, down to empty."""
    profile = constant(60.0, 1.0, current_A=current, ambient_degC=degC)
    takes_four_fifths = current * 60.0 / 3600.0 / 0.8
    found = readings(Model("cell", Parameters(initial_soc=0.98, capacity_Ah=takes_four_fifths)), profile)
    assert np.diff(found["soc"]).max() < 0.0
    assert np.diff(found["voltage_V"]).max() < 0.0


def test_two_pairs_charge_and_relax_exactly_where_the_curves_are_constant():
    model = cell_of_constants(
        series_resistance_scale=1.5, rc_resistance_scale=2.0, rc_capacitance_scale=0.5, ocv_offset_V=0.1, cycles=100.0
    )
    time = np.concatenate([np.linspace(0.0, 400.0, 9), np.linspace(450.0, 1200.0, 6)])
    current = np.where(time <= 400.0, 3.0, 0.0)
    found = readings(model, Profile(time, {"current_A": current, "ambient_degC": np.full(time.size, 20.0)}))
    polarised = 0.0
    for resistance, capacitance in ((0.03, 900.0), (0.04, 5000.0)):
        tau = resistance * capacitance
        charged = 3.0 * 2.0 * resistance * -np.expm1(-np.minimum(time, 400.0) / tau)
        polarised += charged * np.exp(-np.maximum(time - 400.0, 0.0) / tau)
    ohmic = current * 1.5 * (0.05 + 0.015)
    np.testing.assert_allclose(found["voltage_V"], 3.8 - ohmic - polarised, rtol=0.0, atol=1e-13)


def test_terminal_voltage_is_the_sum_of_its_parts():
    state = {"soc": jnp.asarray(0.4), "v_ts_V": jnp.asarray(0.02), "v_tl_V": jnp.asarray(0.03)}
    parameters = Parameters(cycles=25.0)
    cell = cells.evaluate(parameters, CellCurves(), (), state, jnp.asarray(10.0))
    open_circuit = -1.031 * np.exp(-14.0) + 3.685 + 0.2156 * 0.4 - 0.1178 * 0.16 + 0.3201 * 0.064
    series = -1.399e-5 * 100.0 - 2.768e-4 * 10.0 + 0.1562 * np.exp(-24.37 * 0.4) + 0.07446 + 0.0075
    assert float(cells.voltage(cell, jnp.asarray(2.5))) == pytest.approx(open_circuit - 2.5 * series - 0.05, abs=1e-14)


def test_heat_is_what_the_losses_make():
    """i (V_oc - V) at a steady current; the ohmic heat alone of one that swings about zero."""
    cell = cells.evaluate(
        Parameters(cycles=0.0), cell_of_constants().curves, (), cells.initial_state(Parameters()), jnp.asarray(20.0)
    )
    assert float(cells.heat(cell, jnp.asarray(4.0), jnp.asarray(0.0))) == pytest.approx(4.0**2 * 0.05, rel=1e-12)
    assert float(cells.heat(cell, jnp.asarray(0.0), jnp.asarray(9.0))) == pytest.approx(9.0 * 0.05, rel=1e-12)


def test_a_table_replaces_the_formula_at_every_temperature():
    """Given over charge alone, R_ints is the whole of it: eq. 9 adds nothing."""
    drops = []
    for degC in (-20.0, 20.0, 60.0):
        profile = constant(1.0, 1.0, current_A=2.0, ambient_degC=degC)
        drops.append(3.7 - readings(cell_of_constants(), profile)["voltage_V"][0])
    np.testing.assert_allclose(drops, 2.0 * 0.05, atol=1e-14)
