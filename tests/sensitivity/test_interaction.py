"""Second derivatives: against closed forms, a jvp of a jvp, extrapolated differences, and runs of both moved."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray

from jaxmodel.base.errors import ParameterError
from jaxmodel.model.cell import storage_factor
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import simulate
from jaxmodel.sensitivity.derivatives import pushforward
from jaxmodel.sensitivity.interaction import second_derivatives
from jaxmodel.sensitivity.response import make_response

CURRENT_A, DURATION_S = 3.0, 40.0
CELL = Model("cell", Parameters(initial_soc=0.5))
PROFILE = constant(DURATION_S, 4.0, current_A=CURRENT_A, ambient_degC=10.0)
NAMES = ("capacity_Ah", "current_A", "rc_capacitance_scale", "ambient_degC")
METRICS = ("soc_gradient", "final_voltage_V", "delivered_energy_Wh")


@pytest.fixture(scope="module")
def cell() -> xarray.Dataset:
    return second_derivatives(CELL, PROFILE, itertools.combinations_with_replacement(NAMES, 2), METRICS)


def of_pair(data: xarray.Dataset, first: str, second: str, metric: str) -> xarray.Dataset:
    [place] = np.flatnonzero((data["first"].values == first) & (data["second"].values == second))
    return data.sel(metric=metric).isel(pair=place)


def test_gradient_of_charge_has_the_second_derivatives_of_a_quotient(cell: xarray.Dataset):
    """Eqs. 1 and 8: y = -i/(3600 Q F). By a factor f on i and Q: y_ff = 0, y_fQ = -y/Q, y_QQ = 2 y/Q^2."""
    p = Parameters()
    y = -CURRENT_A / (3600.0 * 5.2 * float(storage_factor(p.storage_months, p.storage_temperature_degC)))
    for first, second, expected in (
        ("current_A", "current_A", 0.0),
        ("capacity_Ah", "current_A", -y / 5.2),
        ("capacity_Ah", "capacity_Ah", 2.0 * y / 5.2**2),
        ("current_A", "ambient_degC", 0.0),
    ):
        got = float(of_pair(cell, first, second, "soc_gradient").second_derivative)
        assert got == pytest.approx(expected, rel=1e-10, abs=1e-11 * abs(y)), (first, second)


def test_joint_effect_of_a_product_of_powers_is_that_of_its_elasticities(cell: xarray.Dataset):
    """y = c f / Q: twice the current at twice the capacity is the run itself; 0 - 1 - (-1/2) = -1/2."""
    row = of_pair(cell, "capacity_Ah", "current_A", "soc_gradient")
    assert float(row.effect_both) == pytest.approx(0.0, abs=1e-12)
    assert float(row.effect_joint) == pytest.approx(-0.5, rel=1e-12)
    assert float(row.power_law) == pytest.approx(-0.5, rel=1e-12)
    assert float(row.interaction) == pytest.approx(-1.0, rel=1e-10)
    with_itself = of_pair(cell, "capacity_Ah", "capacity_Ah", "soc_gradient")
    assert float(with_itself.effect_both) == pytest.approx(1.0 / 3.0 - 1.0, rel=1e-12)


def test_second_derivative_is_that_of_differentiating_twice(cell: xarray.Dataset):
    response = make_response(CELL, PROFILE, NAMES, METRICS, ())
    hessian = jax.jit(jax.jacfwd(jax.jacfwd(lambda x: response(x).metrics)))
    exact = np.asarray(hessian(response.values()))
    size = cell["step"].values
    scale = np.max(np.abs(exact * size[:, None] * size), axis=(1, 2))
    for place, (first, second) in enumerate(zip(cell["first"].values, cell["second"].values, strict=True)):
        i, j = NAMES.index(first), NAMES.index(second)
        error = np.abs(cell.second_derivative.values[:, place] - exact[:, i, j]) * size[i] * size[j]
        assert np.all(error < 1e-9 * scale), (first, second, error / scale)


def test_motor_against_extrapolated_differences():
    """The stiff pair: plain runs at 1 and 2 % of a step to either side of both, extrapolated by Richardson's rule."""
    model, profile = Model("motor"), constant(20.0, 2.0, voltage_V=9.0, load_torque_Nm=0.15, ambient_degC=10.0)
    names, metrics = ("k_tau", "R_0", "load_torque_Nm"), ("mean_speed_rad_s", "final_winding_temperature_degC")
    data = second_derivatives(model, profile, itertools.combinations_with_replacement(names, 2), metrics)
    response = make_response(model, profile, names, metrics, ())
    lanes_compiled = data.attrs["simulations"]
    by = np.diag(data["step"].values)
    one, other = (by[[names.index(name) for name in data[end].values]] for end in ("first", "second"))
    signs = np.array([(1, 1, 0.25), (1, -1, -0.25), (-1, 1, -0.25), (-1, -1, 0.25)])

    def differences(share: float) -> np.ndarray:
        lanes = np.concatenate([np.asarray(response.values()) + share * (a * one + b * other) for a, b, _ in signs])
        filled = jnp.asarray(np.resize(lanes, (lanes_compiled, len(names))))
        values = np.asarray(pushforward(response, filled, jnp.zeros_like(filled))[0].metrics)[: len(lanes)]
        return np.tensordot(signs[:, 2], values.reshape(4, len(one), -1), axes=1).T / share**2

    rough = (4.0 * differences(0.01) - differences(0.02)) / 3.0
    scale = np.max(np.abs(data.predicted_joint.values), axis=1, keepdims=True)
    np.testing.assert_allclose(rough / scale, data.predicted_joint.values / scale, atol=1e-5)
    assert np.all(scale > 1e-3 * np.abs(data.metric_value.values[:, None]))


def test_both_moved_is_a_run_of_both_moved(cell: xarray.Dataset):
    moved = simulate(
        Model("cell", Parameters(initial_soc=0.5, capacity_Ah=10.4)),
        constant(DURATION_S, 4.0, current_A=2.0 * CURRENT_A, ambient_degC=10.0),
    )
    row = of_pair(cell, "capacity_Ah", "current_A", "final_voltage_V")
    assert float(row.metric_value + row.change_both) == pytest.approx(float(moved.readings["voltage_V"][-1]), rel=1e-12)
    assert float(row.change_joint) == pytest.approx(
        float(row.change_both - row.change_first - row.change_second), abs=1e-15
    )
    # Near by, what both do together is the second derivative: a hundredth of the ambient's step of 1 K is not near.
    ambient = of_pair(cell, "current_A", "ambient_degC", "final_voltage_V")
    assert np.isnan(float(ambient.power_law))
    assert float(ambient.change_joint) == pytest.approx(float(ambient.predicted_joint), rel=0.1)


def test_out_of_bounds_is_not_run_and_a_pair_is_needed():
    data = second_derivatives(Model("cell"), PROFILE, [("initial_soc", "capacity_Ah")], ("final_voltage_V",))
    assert np.isnan(data.change_both.item())
    assert np.isfinite(data.change_second.item())
    assert np.isfinite(data.second_derivative.item())
    with pytest.raises(ParameterError, match="two parameters"):
        second_derivatives(CELL, PROFILE, [])
    with pytest.raises(ParameterError, match="Did you mean 'capacity_Ah'"):
        second_derivatives(CELL, PROFILE, [("capacity", "cycles")])
