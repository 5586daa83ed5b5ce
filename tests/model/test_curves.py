"""Curves over state of charge: the paper's formulas by hand, tables against NumPy and SciPy."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from jaxmodel.model.curves import CURVE_NAMES, LUT_SOC, LUT_TEMPERATURE_DEGC, CellCurves, Table, look_up_curves

CURVES = CellCurves()
LUT = look_up_curves(CURVES)

# Eqs. 3-6 and 10 (at 0 degC) and the open-circuit voltage of reference [6], by pocket calculator.
BY_HAND = {
    "ocv": {0.0: 2.654, 0.2: 3.7250286, 1.0: 4.1029},
    "R_ints": {0.2: 0.0756538, 1.0: 0.07446},
    "R_TS": {0.2: 0.0476344, 1.0: 0.04669},
    "C_TS": {0.2: 653.1021, 1.0: 703.5990},
    "R_TL": {0.2: 0.04984, 1.0: 0.04984},
    "C_TL": {0.2: 4448.2962, 1.0: 4475.0},
}


def knots(count: int, smallest_gap: float):
    """Strictly increasing breakpoints from -0.3 upwards."""
    gaps = st.lists(st.floats(smallest_gap, 0.6), min_size=count - 1, max_size=count - 1)
    return gaps.map(lambda steps: np.cumsum([-0.3, *steps]))


@jax.jit
def interpolated(table: Table, soc: jax.Array, temperature_degC: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The values at many points, and whether they lie inside the table."""
    return jax.vmap(table)(soc, temperature_degC), jax.vmap(table.inside)(soc, temperature_degC)


@pytest.mark.parametrize("name", BY_HAND)
def test_formula_is_the_printed_one(name: str):
    for soc, value in BY_HAND[name].items():
        assert float(getattr(CURVES, name)(jnp.asarray(soc), jnp.asarray(0.0))) == pytest.approx(value, rel=2e-6)


@pytest.mark.parametrize(("temperature", "shift"), [(-20.0, -6e-5), (25.0, -0.01566375), (100.0, -0.16758)])
def test_series_resistance_moves_with_temperature_as_printed(temperature: float, shift: float):
    at = [float(CURVES.R_ints(jnp.asarray(0.6), jnp.asarray(degC))) for degC in (0.0, temperature)]
    assert at[1] - at[0] == pytest.approx(shift, abs=1e-12)


def test_series_resistance_says_where_it_turns_negative():
    degC = jnp.linspace(40.0, 100.0, 601)
    resistance = jax.vmap(CURVES.R_ints, (None, 0))(jnp.asarray(1.0), degC)
    inside = jax.vmap(CURVES.R_ints.inside, (None, 0))(jnp.asarray(1.0), degC)
    # -1.399e-5 T^2 - 2.768e-4 T + 0.07446 = 0
    crossing = (-2.768e-4 + math.sqrt(2.768e-4**2 + 4 * 1.399e-5 * 0.07446)) / (2 * 1.399e-5)
    assert 63.0 < crossing < 65.0
    np.testing.assert_array_equal(inside, resistance > 0.0)
    np.testing.assert_array_equal(inside, degC < crossing)


@given(st.floats(-0.2, 1.2), st.floats(-40.0, 100.0))
def test_pairs_are_positive_at_any_charge(soc: float, temperature: float):
    for name in ("R_TS", "C_TS", "R_TL", "C_TL"):
        assert float(getattr(CURVES, name)(jnp.asarray(soc), jnp.asarray(temperature))) > 0.0


@pytest.mark.parametrize("name", CURVE_NAMES[1:])
def test_formula_is_held_where_it_would_turn_negative(name: str):
    curve = getattr(CURVES, name)
    empty, floor = (curve(jnp.asarray(soc), jnp.asarray(20.0)) for soc in (0.0, 0.012))
    assert float(empty) == float(floor)
    assert [bool(curve.inside(jnp.asarray(soc), jnp.asarray(20.0))) for soc in (0.0, 0.011, 0.013)] == [0, 0, 1]


def test_open_circuit_voltage_rises_with_charge():
    slope = jax.vmap(jax.grad(CURVES.ocv), (0, None))(jnp.linspace(0.0, 1.0, 1001), jnp.asarray(20.0))
    assert float(slope.min()) > 0.0
    assert not bool(CURVES.ocv.inside(jnp.asarray(-1e-9), jnp.asarray(20.0)))


@given(knots(6, 1e-3), st.integers(0, 2**31))
def test_table_over_charge_is_linear_interpolation(soc: np.ndarray, seed: int):
    values = np.random.default_rng(seed).normal(size=soc.size)
    points = np.concatenate([np.linspace(-0.6, 3.5, 41), soc])
    found, inside = interpolated(Table(soc, values), jnp.asarray(points), jnp.full(points.size, 33.0))
    np.testing.assert_allclose(found, np.interp(points, soc, values), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(inside, (points >= soc[0]) & (points <= soc[-1]))


@given(knots(5, 1e-2), knots(4, 1e-2), st.integers(0, 2**31))
def test_table_over_charge_and_temperature_is_bilinear_and_held(soc: np.ndarray, tenths: np.ndarray, seed: int):
    rng = np.random.default_rng(seed)
    degC = 30.0 * tenths
    values = rng.normal(size=(degC.size, soc.size))
    points = rng.uniform(-1.0, 3.0, (50, 2)) * [30.0, 1.0]
    held = np.clip(points, [degC[0], soc[0]], [degC[-1], soc[-1]])
    expected = RegularGridInterpolator((degC, soc), values)(held)
    found, inside = interpolated(Table(soc, values, degC), jnp.asarray(points[:, 1]), jnp.asarray(points[:, 0]))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)
    np.testing.assert_array_equal(inside, np.all(held == points, axis=1))


@pytest.mark.parametrize("temperatures", [1, 13])
def test_large_table_is_looked_up_with_the_values_and_slopes_of_the_sum(monkeypatch, temperatures: int):
    rng = np.random.default_rng(7)
    degC = None if temperatures == 1 else np.linspace(-20.0, 60.0, temperatures)
    soc = np.sort(rng.random(200))
    table = Table(soc, rng.random((temperatures, 200)), degC)
    points = jnp.asarray(np.stack([rng.uniform(-0.1, 1.1, 400), rng.uniform(-40.0, 80.0, 400)]))

    def values_and_slopes():
        both = jax.vmap(jax.value_and_grad(table, argnums=(0, 1)))
        return both(*points)

    looked_up = values_and_slopes()
    monkeypatch.setattr("jaxmodel.model.curves.MOST_SUMMED", 10_000)
    for one, other in zip(jax.tree.leaves(looked_up), jax.tree.leaves(values_and_slopes()), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)


def test_table_of_one_point_is_a_constant():
    table = Table([0.5], [4000.0])
    assert [float(table(jnp.asarray(soc), jnp.asarray(20.0))) for soc in (0.0, 0.5, 2.0)] == [4000.0] * 3


def test_slope_of_a_table_is_that_of_the_segment_and_none_beyond():
    table = Table([0.1, 0.4, 1.0], [3.0, 3.6, 4.2])
    slopes = [float(jax.grad(table)(jnp.asarray(soc), jnp.asarray(20.0))) for soc in (0.0, 0.2, 0.7, 1.1)]
    np.testing.assert_allclose(slopes, [0.0, 2.0, 1.0, 0.0], atol=1e-14)


def test_slope_at_the_ends_of_a_table_is_the_inner_one():
    """A full cell is where every run starts: half a slope there would halve the derivative by the initial charge."""
    table = Table([0.0, 0.4, 1.0], [3.0, 3.6, 4.2])
    slopes = [float(jax.grad(table)(jnp.asarray(soc), jnp.asarray(20.0))) for soc in (0.0, 1.0)]
    np.testing.assert_allclose(slopes, [1.5, 1.0], rtol=1e-14)
    warm = jax.grad(LUT.R_ints, argnums=1)(jnp.asarray(0.5), jnp.asarray(100.0))
    assert float(warm) == pytest.approx(-2.768e-4 - 1.399e-5 * 180.0, rel=1e-10)


@pytest.mark.parametrize("name", CURVE_NAMES)
def test_look_up_table_is_the_formula_at_its_breakpoints(name: str):
    formula, table = getattr(CURVES, name), getattr(LUT, name)
    for soc in LUT_SOC:
        for degC in LUT_TEMPERATURE_DEGC:
            at = jnp.asarray(soc), jnp.asarray(degC)
            assert float(table(*at)) == pytest.approx(float(formula(*at)), rel=1e-13)


def test_look_up_tables_have_the_size_of_the_papers():
    assert LUT.R_ints.values.shape == (7, 6)
    assert {getattr(LUT, name).values.shape for name in CURVE_NAMES[2:]} == {(1, 6)}
    assert LUT.ocv is CURVES.ocv
