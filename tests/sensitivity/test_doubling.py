"""The doubling test: against separate runs, against closed forms, and against its own predictions."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray

from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import value, with_values
from jaxmodel.model.parameters import TABLE, Parameters
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import Cutoff, Status, simulate
from jaxmodel.sensitivity.derivatives import local_sensitivities
from jaxmodel.sensitivity.doubling import doubling_test
from jaxmodel.sensitivity.response import make_response, steps_of

CELL = Model("cell", Parameters(initial_soc=0.5))
CELL_PROFILE = constant(20.0, 2.0, current_A=3.0, ambient_degC=10.0)
MOTOR = Model("motor")
MOTOR_PROFILE = constant(20.0, 2.0, voltage_V=9.0, load_torque_Nm=0.15, ambient_degC=10.0)


@pytest.fixture(scope="module")
def cell() -> xarray.Dataset:
    return doubling_test(CELL, CELL_PROFILE)


@pytest.fixture(scope="module")
def motor() -> xarray.Dataset:
    return doubling_test(MOTOR, MOTOR_PROFILE)


def test_capacity_doubled_halves_the_gradient(cell: xarray.Dataset):
    """y = c/p: elasticity -1 foretells -100 %, the curvature alone takes it to 0, the power law knows the -50 %."""
    row = cell.sel(metric="soc_gradient", parameter="capacity_Ah")
    assert float(row.effect) == pytest.approx(-0.5, rel=1e-12)
    assert float(row.linear) == pytest.approx(-1.0, rel=1e-12)
    assert float(row.curvature) == pytest.approx(1.0, rel=1e-7)
    assert float(row.power_law) == pytest.approx(-0.5, rel=1e-12)


def test_what_is_linear_or_quadratic_is_foretold_in_full(cell: xarray.Dataset):
    """The voltage is linear in a scale of its resistance, and quadratic in an ambient that eq. 9 alone sees."""
    volts = cell.sel(metric="final_voltage_V")
    scale, ambient = volts.sel(parameter="series_resistance_scale"), volts.sel(parameter="ambient_degC")
    assert float(scale.effect) == pytest.approx(float(scale.linear), rel=1e-11)
    assert abs(float(scale.curvature)) < 1e-12
    assert float(ambient.curvature) != 0.0
    assert float(ambient.effect) == pytest.approx(float(ambient.linear + ambient.curvature), rel=1e-8)
    assert np.isnan(float(ambient.power_law))


@pytest.mark.parametrize("name", ["R_ca", "k_tau", "J", "tau_0", "T_0", "psi_L"])
def test_each_lane_is_the_run_of_a_moved_parameter(motor: xarray.Dataset, name: str):
    moved = with_values(MOTOR, {name: value(MOTOR, name) + jnp.asarray(float(motor.step.sel(parameter=name)))})
    readings = simulate(moved, MOTOR_PROFILE).readings
    lane = motor.sel(parameter=name)
    for output in motor.output.values:
        np.testing.assert_allclose(lane.output_moved.sel(output=output), readings[output], rtol=1e-9, atol=1e-12)
    case = lane.sel(metric="final_case_temperature_degC")
    assert float(case.metric_moved) == pytest.approx(float(readings["case_temperature_degC"][-1]), rel=1e-9)
    assert np.isnan(float(case.effect))
    speed = lane.sel(metric="mean_speed_rad_s")
    assert float(speed.effect) == pytest.approx(float(speed.metric_moved / speed.metric_value) - 1.0, abs=1e-14)


def test_doubled_input_is_a_doubled_profile(motor: xarray.Dataset):
    doubled = constant(20.0, 2.0, voltage_V=18.0, load_torque_Nm=0.15, ambient_degC=10.0)
    lane = motor.output_moved.sel(parameter="voltage_V", output="speed_rad_s")
    np.testing.assert_allclose(lane, simulate(MOTOR, doubled).readings["speed_rad_s"], rtol=1e-9)


def test_slopes_are_the_elasticities_of_the_local_study(motor: xarray.Dataset):
    local = local_sensitivities(MOTOR, MOTOR_PROFILE)
    np.testing.assert_array_equal(local.doubles, motor.doubles)
    proportional = local.parameter[local.doubles]
    np.testing.assert_allclose(
        motor.linear.sel(parameter=proportional), local.elasticity.sel(parameter=proportional), rtol=1e-9, atol=1e-13
    )
    predicted = (motor.output_value + local.output_change).transpose(*motor.output_linear.dims)
    np.testing.assert_allclose(motor.output_linear, predicted, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(motor.linear_change, local.metric_change, rtol=1e-9, atol=1e-13)


@pytest.mark.slow
def test_curvature_is_the_second_derivative(cell: xarray.Dataset):
    """Differences of exact slopes against a jvp of a jvp."""
    response = make_response(CELL, CELL_PROFILE)
    values = response.values()

    @jax.jit
    def second(direction):
        def slope(at):
            return jax.jvp(response, (at,), (direction,))[1]

        return jax.jvp(slope, (values,), (direction,))[1]

    exact = jax.vmap(second)(jnp.diag(jnp.asarray(steps_of(response).size)))
    slopes = np.abs(cell.linear_change.values)
    error = np.abs(cell.curvature_change.values - 0.5 * np.asarray(exact.metrics).T)
    assert np.all(error <= 1e-6 * np.abs(cell.curvature_change.values) + 1e-7 * slopes + 1e-13)
    assert np.any(np.abs(cell.curvature_change.values) > 0.1 * slopes)


def test_what_may_not_be_doubled_is_not(cell: xarray.Dataset):
    """A cell at full charge has no double; its prediction stays, and its neighbours are as they were."""
    full = doubling_test(Model("cell"), CELL_PROFILE)
    lane = full.sel(parameter="initial_soc")
    assert not bool(lane.in_bounds)
    assert np.all(np.isnan(lane.effect))
    assert np.all(np.isnan(lane.output_moved))
    assert np.all(np.isfinite(lane.linear_change))
    assert np.all(np.isfinite(lane.output_linear))
    assert bool(cell.in_bounds.sel(parameter="initial_soc"))
    rest = full.drop_sel(parameter="initial_soc")
    assert np.all(rest.in_bounds)
    assert np.all(np.isfinite(rest.metric_moved))
    assert TABLE["initial_soc"].upper < 2.0


def test_lanes_say_how_they_ended():
    """Twice the current empties the cell before the end: the lane says so, and its gradient is that of its own run."""
    profile = constant(400.0, 20.0, current_A=3.0, ambient_degC=20.0)
    ended = doubling_test(CELL, profile, metrics=("soc_gradient",), outputs=(), cutoff=Cutoff(soc=0.4))
    assert int(ended.status.sel(parameter="current_A")) == Status.REACHED_CUTOFF
    assert int(ended.status.sel(parameter="capacity_Ah")) == Status.COMPLETE
    assert float(ended.effect.sel(parameter="current_A").item()) == pytest.approx(1.0, rel=1e-12)
    assert np.all(ended.valid_share == 1.0)
    assert ended.attrs["simulations"] == 4 * ended.sizes["parameter"]


def test_no_current_gives_no_relative_change():
    """At rest the gradient is zero: a share of it does not exist, its derivatives do."""
    rest = constant(20.0, 2.0, current_A=0.0, ambient_degC=10.0)
    data = doubling_test(CELL, rest)
    row = data.sel(metric="soc_gradient")
    assert float(row.metric_value) == 0.0
    assert np.all(np.isnan(row.effect))
    assert np.all(row.metric_moved == 0.0)
    volts = data.sel(metric="final_voltage_V")
    assert np.all(np.isfinite(volts.effect.where(volts.in_bounds, 0.0)))
    assert np.all(np.isfinite(volts.curvature))
