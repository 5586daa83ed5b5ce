"""Derivatives: against differences, against each other, against closed forms, and where a value or current is zero."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray

from jaxmodel.base.errors import ParameterError, SweepError
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.cell import cycle_resistance, storage_factor
from jaxmodel.model.curves import CellCurves
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, constant
from jaxmodel.model.simulation import Cutoff
from jaxmodel.sensitivity import by_vectors
from jaxmodel.sensitivity.derivatives import _jacobian_by_xla, choose_mode, jacobian, local_sensitivities
from jaxmodel.sensitivity.response import Response, make_response, steps_of
from jaxmodel.sweeps.metrics import Integral

CURRENT_A, AMBIENT_DEGC, DURATION_S = 3.0, 30.0, 8.0


@pytest.fixture(scope="module")
def plain_cell() -> xarray.Dataset:
    """The cell of the paper at constant current."""
    profile = constant(DURATION_S, 1.0, current_A=CURRENT_A, ambient_degC=AMBIENT_DEGC)
    return local_sensitivities(Model("cell"), profile)


@pytest.fixture(scope="module")
def plain_motor() -> xarray.Dataset:
    """The motor of the paper, started and loaded."""
    return local_sensitivities(
        Model("motor"), constant(20.0, 2.0, voltage_V=9.0, load_torque_Nm=0.15, ambient_degC=10.0)
    )


@eqx.filter_jit
def answers(response: Response, lanes):
    return jax.vmap(response)(lanes)


def central_difference(response: Response):
    """Fourth-order differences of the answer by each parameter's step, from one compiled batch of plain runs."""
    size = jnp.asarray(steps_of(response).size)
    offsets = jnp.diag(size) * 1e-3
    lanes = jnp.stack([response.values() + k * offsets for k in (-2, -1, 1, 2)])
    flat = answers(response, lanes.reshape(-1, size.size))
    weights = jnp.asarray([1.0, -8.0, 8.0, -1.0]) / 12e-3
    return jax.tree.map(lambda y: jnp.tensordot(weights, y.reshape(4, size.size, *y.shape[1:]), axes=1), flat)


@pytest.mark.slow
def test_derivative_is_the_central_difference(response: Response):
    """Of every metric and of every output at every row, by every parameter that enters."""
    answer, derivative = jacobian(response, response.values(), "forward")
    difference = central_difference(response)
    size = steps_of(response).size
    scaled = jax.tree.map(lambda d: np.asarray(d) * size.reshape(-1, *[1] * (d.ndim - 1)), derivative)
    # What rounding leaves of a difference over a thousandth of a parameter; a gradient is a difference itself.
    for exact, rough, base, precision in (
        (scaled.metrics[..., None], difference.metrics[..., None], answer.metrics[:, None], 2e-10),
        (scaled.outputs, difference.outputs, answer.outputs, 1e-11),
    ):
        largest = np.max(np.abs(exact), axis=-1, keepdims=True)
        rounding = precision * np.max(np.abs(base), axis=-1, keepdims=True)
        error = np.abs(exact - np.asarray(rough)) / (1e-6 * largest + rounding)
        worst = np.unravel_index(np.argmax(error), error.shape)
        assert error[worst] < 1.0, (response.names[worst[0]], worst, exact[worst], rough[worst])
    moved = {name for name, d in zip(response.names, scaled.outputs, strict=True) if np.any(d != 0.0)}
    # Between rows of a constant load a course is straight: whether it is interpolated there makes no difference.
    assert moved | {"clock_shift.resampled"} == set(response.names) | {"clock_shift.resampled"}


EXTREMES = {
    "cell": [
        ({"initial_soc": 1.0}, {}),
        ({"initial_soc": 1e-3}, {}),
        ({}, {"current_A": 0.0}),
        ({}, {"current_A": -4.0}),
        ({"cycles": 0.0, "storage_months": 0.0}, {"ambient_degC": 0.0}),
    ],
    "motor": [({}, {"voltage_V": 0.0, "load_torque_Nm": 0.0}), ({}, {"load_torque_Nm": 0.0}), ({"tau_0": 0.0}, {})],
    "robot": [
        ({"initial_soc": 1.0}, {}),
        ({"initial_soc": 0.02}, {}),
        ({}, {"duty": 0.0, "flipper_torque_Nm": 0.0}),
        ({"tau_0": 0.0}, {"arm_duty": 0.0}),
    ],
}


@pytest.mark.slow
def test_every_derivative_is_finite_at_the_edges(kind: str, model: Model, profile: Profile, response: Response):
    """Full, empty, at rest, charging, without friction: the same compiled program with other numbers in it."""
    for parameters, inputs in EXTREMES[kind]:
        changed = {name: np.full(profile.time_s.size, inputs.get(name, v[0])) for name, v in profile.inputs.items()}
        there = make_response(
            with_values(model, {name: jnp.asarray(v, dtype=float) for name, v in parameters.items()}),
            dataclasses.replace(profile, inputs=changed),
            names=response.names,
        )
        for tree in jacobian(there, there.values(), "forward"):
            assert np.all(np.isfinite(tree.metrics)), (parameters, inputs)
            assert np.all(np.isfinite(tree.outputs)), (parameters, inputs)


def test_state_of_charge_falls_as_current_by_capacity(plain_cell: xarray.Dataset):
    """Eqs. 1 and 8: gradient -i/(3600 Q F), its derivative by Q exactly i/(3600 Q^2 F)."""
    p = Parameters()
    factor = float(storage_factor(p.storage_months, p.storage_temperature_degC))
    gradient = -CURRENT_A / (3600.0 * 5.2 * factor)
    row = plain_cell.sel(metric="soc_gradient")
    assert float(row.metric_value) == pytest.approx(gradient, rel=1e-12)
    assert float(row.metric_derivative.sel(parameter="capacity_Ah")) == pytest.approx(-gradient / 5.2, rel=1e-12)
    by_months = gradient * (1.0 - factor) / 18.0 / factor
    assert float(row.metric_derivative.sel(parameter="storage_months")) == pytest.approx(by_months, rel=1e-12)
    elasticity = row.elasticity
    assert float(elasticity.sel(parameter="capacity_Ah")) == pytest.approx(-1.0, rel=1e-12)
    assert float(elasticity.sel(parameter="current_A")) == pytest.approx(1.0, rel=1e-12)
    for name in ("initial_soc", "cycles", "series_resistance_scale", "rc_resistance_scale"):
        assert abs(float(elasticity.sel(parameter=name))) < 1e-12


def test_voltage_moves_by_its_own_equation(plain_cell: xarray.Dataset):
    """The terminal voltage V_oc - i (R_ints + R_cyc) - ... of eqs. 7 and 9, differentiated by hand at every row."""
    soc = plain_cell.output_value.sel(output="soc")
    by = plain_cell.output_derivative.sel(output="voltage_V")
    r_ints = jax.vmap(lambda s: CellCurves().R_ints(s, jnp.asarray(AMBIENT_DEGC)))(jnp.asarray(soc.values))
    series = np.asarray(r_ints) + float(cycle_resistance(jnp.asarray(25.0)))
    np.testing.assert_allclose(by.sel(parameter="ocv_offset_V"), 1.0, rtol=1e-12)
    np.testing.assert_allclose(by.sel(parameter="series_resistance_scale"), -CURRENT_A * series, rtol=1e-12)
    np.testing.assert_allclose(by.sel(parameter="cycles"), -CURRENT_A * 0.0015 / (2.0 * np.sqrt(25.0)), rtol=1e-12)
    by_ambient = CURRENT_A * (2.768e-4 + 2.0 * 1.399e-5 * AMBIENT_DEGC)
    np.testing.assert_allclose(by.sel(parameter="ambient_degC"), by_ambient, rtol=1e-12)


def test_a_scale_is_all_the_curves_it_multiplies(plain_cell: xarray.Dataset):
    """Euler: R_TS and R_TL by a factor are together the scale of both, C_TS and C_TL too; R_ints leaves R_cyc out."""
    for change in (plain_cell.metric_change, plain_cell.output_change):
        for scale, curves in (
            ("rc_resistance_scale", ["R_TS", "R_TL"]),
            ("rc_capacitance_scale", ["C_TS", "C_TL"]),
        ):
            both, whole = change.sel(parameter=curves).sum("parameter"), change.sel(parameter=scale)
            np.testing.assert_allclose(both, whole, rtol=1e-9, atol=1e-14)
    ageing = -CURRENT_A * float(cycle_resistance(jnp.asarray(25.0)))
    volts = plain_cell.output_change.sel(output="voltage_V")
    np.testing.assert_allclose(
        volts.sel(parameter="R_ints") + ageing, volts.sel(parameter="series_resistance_scale"), rtol=1e-12
    )


def test_changes_know_no_unit_of_voltage(plain_motor: xarray.Dataset):
    """A motor whose volts, ohms, henries, torques and inertia all grow alike runs as before, if its watts warm it less.

    So p dy/dp summed over these, less the thermal resistances (K per watt), is zero for whatever has no volt in its
    unit: Euler's theorem on the elasticities, at every row of current, speed and temperatures.
    """
    data = plain_motor
    grow = ["voltage_V", "R_0", "L_a", "k_tau", "tau_0", "J", "load_torque_Nm"]
    for change in (data.metric_change, data.output_change):
        scale = np.abs(change).max()
        total = change.sel(parameter=grow).sum("parameter") - change.sel(parameter=["R_wc", "R_ca"]).sum("parameter")
        assert float(np.abs(total).max()) < 1e-10 * float(scale)


def test_where_no_proportional_change_exists_a_stated_step_is_used(plain_cell: xarray.Dataset):
    names = plain_cell.parameter.values[~plain_cell.doubles.values]
    assert set(names) == {"ocv_offset_V", "storage_temperature_degC", "ambient_degC"}
    chosen = plain_cell.sel(parameter=names)
    assert np.all(np.isnan(chosen.elasticity))
    assert dict(zip(names, chosen.step.values, strict=True)) == {
        "ocv_offset_V": 0.02,  # a hundredth of its range
        "storage_temperature_degC": 1.0,
        "ambient_degC": 1.0,
    }
    np.testing.assert_array_equal(chosen.metric_change, chosen.metric_derivative * chosen.step)
    assert np.all(chosen.metric_change.sel(metric="final_voltage_V") != 0.0)
    rest = plain_cell.drop_sel(parameter=names)
    rest = rest.sel(metric=rest.metric_unit != "degC")
    np.testing.assert_allclose(rest.elasticity * rest.metric_value, rest.metric_derivative * rest.value, rtol=1e-12)
    np.testing.assert_array_equal(plain_cell.output_change, plain_cell.output_derivative * plain_cell.step)


def test_an_effect_at_its_null_moves_by_a_middling_value():
    effect = CATALOGUE["slow_diffusion"](R_3=0.0)
    model = Model("cell", effects=(effect, CATALOGUE["charge_transfer"](i_0=float("inf"))))
    response = make_response(model, constant(2.0, 1.0, current_A=1.0, ambient_degC=20.0))
    step = dict(zip(response.names, steps_of(response).size, strict=True))
    assert step["slow_diffusion.R_3"] == 0.015
    assert step["charge_transfer.i_0"] == 1.0


@pytest.mark.slow
def test_only_what_enters_is_differentiated():
    level = constant(2.0, 1.0, duty=0.2, load_torque_Nm=0.1, ambient_degC=20.0)
    slope = constant(2.0, 1.0, duty=0.2, incline_deg=3.0, ambient_degC=20.0)
    on_level, on_slope = (set(make_response(Model("robot"), profile).names) for profile in (level, slope))
    hill = {"mass_kg", "friction_coefficient", "wheel_radius_m", "gear_ratio", "drive_efficiency"}
    assert on_slope - on_level == hill | {"incline_deg"}
    assert on_level - on_slope == {"load_torque_Nm"}
    assert not on_level & {"nominal_cell_voltage_V", "n_arm_motors", "n_flipper_motors"}
    blended = Model("robot", effects=(CATALOGUE["constant_power_load"](),))
    with_power = set(make_response(blended, level).names)
    assert with_power - on_level == {"nominal_cell_voltage_V", "constant_power_load.s"}
    assert set(make_response(Model("cell"), constant(2.0, 1.0, current_A=1.0, ambient_degC=20.0)).names).isdisjoint(
        {"R_0", "k_tau", "n_series"}
    )


@pytest.mark.slow
def test_mode_follows_the_counts_and_is_recorded(plain_cell: xarray.Dataset):
    """Break-evens as measured: reverse mode costs as much as a few tangents, of a run in blocks as some fifty."""
    assert choose_mode(parameters=2, numbers=1) == "forward"
    assert choose_mode(parameters=16, numbers=8) == "reverse"
    assert choose_mode(parameters=16, numbers=40) == "forward"
    assert choose_mode(parameters=27, numbers=1, steps=100_000) == "forward"
    assert choose_mode(parameters=500, numbers=1, steps=100_000) == "reverse"
    assert (plain_cell.attrs["mode"], plain_cell.attrs["passes"]) == ("forward", plain_cell.sizes["parameter"])
    profile = constant(DURATION_S, 1.0, current_A=CURRENT_A, ambient_degC=AMBIENT_DEGC)
    reverse = local_sensitivities(Model("cell"), profile, outputs=(), mode="reverse")
    assert (reverse.attrs["mode"], reverse.attrs["passes"]) == ("reverse", reverse.sizes["metric"])
    np.testing.assert_allclose(reverse.metric_derivative, plain_cell.metric_derivative, rtol=1e-9, atol=1e-15)
    with pytest.raises(ValueError, match="metrics alone"):
        local_sensitivities(Model("cell"), profile, mode="reverse")


@dataclasses.dataclass(frozen=True)
class Counted(Integral):
    """An integral that tells how often it was traced."""

    traces: ClassVar[list[str]] = []

    def init(self, first):
        self.traces.append(self.name)
        return super().init(first)


def test_metric_of_ones_own_and_no_second_compilation():
    """An elasticity is the same in joules as in watt hours, and other numbers in a model need no other program."""
    own = Counted("energy_J", "J", "in SI", ("cell",), ("voltage_V", "current_A"))
    counts = []
    for capacity in (2.0, 3.0):
        data = local_sensitivities(
            Model("cell", Parameters(capacity_Ah=capacity)),
            constant(DURATION_S, 1.0, current_A=CURRENT_A, ambient_degC=AMBIENT_DEGC),
            names=("capacity_Ah", "rc_resistance_scale"),
            metrics=("delivered_energy_Wh", own),
            outputs=(),
        )
        counts.append(len(Counted.traces))
        np.testing.assert_allclose(data.metric_value[1], 3600.0 * data.metric_value[0], rtol=1e-12)
        np.testing.assert_allclose(data.elasticity[1], data.elasticity[0], rtol=1e-12)
    assert counts[0] > 0
    assert counts[1] == counts[0]


def test_temperatures_have_changes_but_no_elasticities(plain_motor: xarray.Dataset):
    row = plain_motor.sel(metric="final_winding_temperature_degC")
    assert np.all(np.isnan(row.elasticity))
    assert float(row.metric_change.sel(parameter="R_wc")) > 0.0
    assert float(row.metric_change.sel(parameter="ambient_degC")) == pytest.approx(1.0, abs=0.1)


def test_slope_is_that_of_the_straight_line_through_the_rows():
    """Also where the rows are unevenly spaced: NumPy's least squares, of the voltage and of its derivatives."""
    profile = Profile(
        np.array([0.0, 3.0, 4.0, 9.0, 20.0, 21.0]), {"current_A": np.array(4.0), "ambient_degC": np.array(5.0)}
    )
    data = local_sensitivities(Model("cell"), profile, metrics=("voltage_gradient",), outputs=("voltage_V",))
    slope = np.polyfit(profile.time_s, np.asarray(data.output_value[0]), 1)[0]
    slopes = np.polyfit(profile.time_s, np.asarray(data.output_derivative[0]).T, 1)[0]
    assert float(data.metric_value[0]) == pytest.approx(slope, rel=1e-9)
    np.testing.assert_allclose(data.metric_derivative[0], slopes, rtol=1e-9, atol=1e-15)


def test_ideal_sensors_read_what_a_sweep_keeps(profiles: dict[str, Profile]):
    """The two ways to the outputs, in one pass or in a run for the sensors, are one where the sensors add nothing."""
    names, outputs = ("capacity_Ah", "cycles"), ("voltage_V", "soc")
    silent = CATALOGUE["voltage_offset"](column="voltage_V", c=0.0)
    both = [
        local_sensitivities(Model("cell", effects=effects), profiles["cell"], names, ("final_voltage_V",), outputs)
        for effects in ((), (silent,))
    ]
    for name in ("output_value", "output_derivative", "metric_derivative"):
        np.testing.assert_allclose(both[1][name], both[0][name], rtol=1e-12, atol=1e-15)


@pytest.mark.slow
def test_a_run_that_ends_is_summed_up_to_its_end():
    """To SOC 0.9: the gradient is that of the run, and the energy stops growing there."""
    profile = constant(2000.0, 100.0, current_A=5.0, ambient_degC=20.0)
    cutoff = Cutoff(soc=0.9)
    metrics = ("soc_gradient", "delivered_energy_Wh")
    ended = local_sensitivities(Model("cell"), profile, metrics=metrics, outputs=("soc",), cutoff=cutoff)
    whole = local_sensitivities(Model("cell"), profile, metrics=metrics, outputs=("soc",))
    np.testing.assert_allclose(ended.metric_value[0], whole.metric_value[0], rtol=1e-12)
    last = int(np.argmin(ended.output_value.values[0]))
    short = Profile(profile.time_s[: last + 1], {name: v[: last + 1] for name, v in profile.inputs.items()})
    alone = local_sensitivities(Model("cell"), short, metrics=metrics, outputs=("soc",))
    assert 0 < last < profile.time_s.size - 1
    for name in ("metric_value", "metric_derivative"):
        np.testing.assert_allclose(ended[name], alone[name], rtol=1e-10, atol=1e-18)


@pytest.mark.parametrize(
    ("asked", "error", "message"),
    [
        ({"names": ["capacity"]}, ParameterError, "Did you mean 'capacity_Ah'"),
        ({"names": []}, ParameterError, "at least one"),
        ({"names": ["ambient"]}, ParameterError, "Did you mean 'ambient_degC'"),
        ({"metrics": ["final_voltage"]}, SweepError, "Did you mean 'final_voltage_V'"),
        ({"metrics": ["mean_speed_rad_s"]}, SweepError, "no metric 'mean_speed_rad_s'"),
        ({"metrics": ["valid_share"]}, SweepError, "with a derivative"),
        ({"outputs": ["voltage"]}, ParameterError, "Did you mean 'voltage_V'"),
    ],
)
def test_a_wrong_name_is_answered_with_the_nearest(asked: dict, error: type[Exception], message: str):
    with pytest.raises(error, match=message):
        local_sensitivities(Model("cell"), constant(2.0, 1.0, current_A=1.0, ambient_degC=20.0), **asked)


@pytest.mark.slow
def test_vector_instructions_agree_with_xla(model: Model, profiles: dict[str, Profile]):
    """With all effects but the sensors that have a state."""
    inputs = {name: np.full(601, column[0]) for name, column in profiles[model.kind].inputs.items()}
    model = dataclasses.replace(model, effects=tuple(effect for effect in model.effects if not effect.has_state))
    profile = Profile(np.arange(601.0), inputs)
    names = make_response(model, profile).names[::11]
    response = make_response(model, profile, names)
    at = np.asarray(response.values())
    answer, slopes = by_vectors.slopes(response, at[None], len(names))
    wanted, exact = _jacobian_by_xla(response, jnp.asarray(at), "forward")
    for found, true in ((answer.metrics[0], wanted.metrics), (answer.outputs[0], wanted.outputs)):
        np.testing.assert_allclose(found, true, rtol=1e-12, atol=1e-12)
    for found, true in ((slopes.metrics[0], exact.metrics), (slopes.outputs[0], exact.outputs)):
        largest = np.max(np.abs(true), axis=tuple(range(1, true.ndim)), keepdims=True)
        assert np.all(np.abs(found - true) <= 1e-9 * np.abs(true) + 1e-12 * largest)
    # Along a direction of each lane it is the sum of the derivatives.
    along = np.array([[1.0, *np.zeros(at.size - 1)], at])
    moved, slope, outcome = by_vectors.pushed(response, np.tile(at, (2, 1)), along)
    np.testing.assert_allclose(moved.metrics[1], answer.metrics[0], rtol=1e-13)
    np.testing.assert_allclose(slope.metrics, along @ slopes.metrics[0], rtol=1e-9, atol=1e-12)
    assert not outcome.status.any()
