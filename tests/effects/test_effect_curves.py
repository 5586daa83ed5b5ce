"""Curves as effects: absent at zero, straight between knots, and by closed forms what their equations say."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.base.errors import EffectError
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.curves import CURVES, Curve, OcvCurve
from jaxmodel.model.curves import CURVE_NAMES, CellCurves, Table
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import value, with_values
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import PORTS, CellContext, Effect, MotorContext
from jaxmodel.model.profile import Profile, constant
from jaxmodel.model.simulation import run_track
from tests.model.runs import padded, readings, staircase

CONSTANT = {"ocv": 3.7, "R_ints": 0.05, "R_TS": 0.03, "C_TS": 900.0, "R_TL": 0.04, "C_TL": 5000.0}
LEVELS = staircase(8, 60, 1.0)
AMBIENT = np.linspace(-10.0, 45.0, 60)
PROFILES = {
    "cell": Profile(np.arange(60.0) * 20.0, {"current_A": 4.0 * LEVELS, "ambient_degC": AMBIENT}),
    "motor": Profile(
        np.arange(60.0), {"voltage_V": 12.0 * LEVELS, "load_torque_Nm": 0.05 * LEVELS, "ambient_degC": AMBIENT}
    ),
}
NOTHING = jnp.zeros(())
PARAMETERS = Parameters(initial_soc=0.7)


def kind_of(name: str) -> str:
    return "cell" if "cell" in CURVES[name].kinds else "motor"


def values_of(name: str) -> np.ndarray:
    cls = CURVES[name]
    return cls.typical * np.cos(1.7 * np.arange(len(cls.usual_knots)))


def sensed(kind: str, *effects: Effect, **parameters: float) -> dict[str, np.ndarray]:
    return readings(Model(kind, Parameters(initial_soc=0.7, **parameters), effects=effects), PROFILES[kind])


def constant_cell(*effects: Effect) -> Model:
    curves = CellCurves(**{name: Table([0.0, 1.0], [CONSTANT[name]] * 2) for name in CURVE_NAMES})
    parameters = Parameters(initial_soc=0.7, cycles=0.0, storage_months=0.0, capacity_Ah=1e4)
    return Model("cell", parameters, curves, effects)


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_is_told_in_full(name: str):
    cls = CURVES[name]
    assert cls.name == name
    assert cls.port in PORTS
    assert hasattr(cls, cls.port)
    fields = (CellContext if kind_of(name) == "cell" else MotorContext).__dataclass_fields__
    assert cls.over in fields
    assert cls.typical > 0.0
    assert cls().knots == cls.usual_knots
    assert name not in CATALOGUE


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_of_zeros_is_absent_to_the_bit_and_so_is_one_switched_off(name: str):
    """Beside the model without curves to rounding: a motor has other steps where its torque bends."""
    kind = kind_of(name)
    base = sensed(kind)
    absent, off = (sensed(kind, curve) for curve in (CURVES[name](), CURVES[name](values_of(name), switch=NOTHING)))
    moved = sensed(kind, CURVES[name](values_of(name)))
    for column, expected in base.items():
        np.testing.assert_array_equal(absent[column], off[column], err_msg=column)
        if kind == "cell":
            np.testing.assert_array_equal(absent[column], expected, err_msg=column)
        np.testing.assert_allclose(absent[column], expected, rtol=1e-5, atol=1e-5, err_msg=column)
    assert any(np.max(np.abs(moved[column] - base[column])) > 1e-4 for column in base)


@pytest.mark.parametrize("name", CURVES)
def test_the_slope_by_the_values_is_that_of_the_readings(name: str):
    """And the slope by the switch at 0 points along the curve, so that one derivative tests it."""
    kind, direction = kind_of(name), values_of(name)
    column = "voltage_V" if kind == "cell" else "speed_rad_s"

    def read(values, switch=None):
        return jnp.asarray(
            readings_traced(Model(kind, PARAMETERS, effects=(CURVES[name](values, switch=switch),)), kind)[column]
        )

    zero = jnp.zeros(direction.shape)
    slope = jax.jvp(read, (zero,), (jnp.asarray(direction),))[1]
    step = 1e-4
    difference = (read(step * direction) - read(-step * direction)) / (2.0 * step)
    tolerance = 2e-4 * float(jnp.max(jnp.abs(difference)))
    np.testing.assert_allclose(slope, difference, rtol=0.0, atol=tolerance)
    small = 1e-5
    by_switch = jax.jvp(lambda s: read(small * direction, s), (jnp.zeros(()),), (jnp.ones(()),))[1]
    np.testing.assert_allclose(by_switch / small, slope, rtol=0.0, atol=max(tolerance, 1e-6))


def readings_traced(model: Model, kind: str):
    return run_track(model, *padded(model, PROFILES[kind])).readings


def test_an_ocv_curve_is_straight_between_its_knots_and_held_beyond():
    curve = OcvCurve(values=[0.01, -0.02, 0.04], knots=[0.6, 0.65, 0.72])
    base, found = sensed("cell"), sensed("cell", curve)
    expected = np.interp(base["soc"], [0.6, 0.65, 0.72], [0.01, -0.02, 0.04])
    np.testing.assert_allclose(found["voltage_V"] - base["voltage_V"], expected, rtol=0.0, atol=1e-13)
    assert base["soc"].min() < 0.65 < base["soc"].max()


@pytest.mark.parametrize(
    ("name", "scaled"),
    [
        ("series_resistance_curve", {"series_resistance_scale": 1.5}),
        ("series_resistance_temperature_curve", {"series_resistance_scale": 1.5}),
        ("rc_resistance_curve", {"rc_resistance_scale": 1.5}),
        ("rc_resistance_temperature_curve", {"rc_resistance_scale": 1.5}),
        ("rc_capacitance_curve", {"rc_capacitance_scale": 1.5}),
        ("rc_capacitance_temperature_curve", {"rc_capacitance_scale": 1.5}),
    ],
)
def test_a_level_curve_of_a_logarithm_is_the_scale_itself(name: str, scaled: dict[str, float]):
    level = np.full(len(CURVES[name].usual_knots), np.log(1.5))
    found, expected = sensed("cell", CURVES[name](level)), sensed("cell", **scaled)
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)


@pytest.mark.parametrize("degC", [-40.0, -10.0, 13.0, 70.0])
def test_a_curve_over_temperature_acts_at_the_cells_own(degC: float):
    curve = CURVES["series_resistance_temperature_curve"]
    values = values_of(curve.name)
    profile = constant(10.0, 1.0, current_A=2.0, ambient_degC=degC)
    base, found = (readings(constant_cell(*effects), profile)["voltage_V"] for effects in ((), (curve(values),)))
    factor = np.exp(np.interp(degC, curve.usual_knots, values))
    np.testing.assert_allclose(base - found, 2.0 * 0.05 * (factor - 1.0), rtol=0.0, atol=1e-13)


def test_a_level_entropy_curve_is_the_entropy_coefficient():
    heating = CATALOGUE["self_heating"]()
    curve = CURVES["entropy_curve"](np.full(15, -3e-4))
    found = sensed("cell", heating, curve)
    expected = sensed("cell", heating, CATALOGUE["entropic_ocv"](dU_dT=-3e-4))
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)


def test_a_friction_curve_is_coulomb_friction_and_viscous_friction():
    """c + b |w| is what the no-load torque and viscous friction are together."""
    knots = (0.0, 100.0, 700.0)
    curve = CURVES["friction_curve"](values=[0.004, 0.006, 0.018], knots=knots)
    found = sensed("motor", curve)
    expected = sensed("motor", CATALOGUE["viscous_friction"](b=2e-5), tau_0=0.014)
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-9, atol=1e-9, err_msg=column)


def test_friction_does_not_drive():
    curve = CURVES["friction_curve"](values=np.full(10, -0.02))
    still = constant(20.0, 1.0, voltage_V=0.0, load_torque_Nm=0.0, ambient_degC=20.0)
    found = readings(Model("motor", Parameters(initial_speed_rad_s=0.0), effects=(curve,)), still)
    np.testing.assert_array_equal(found["speed_rad_s"], 0.0)


def test_a_torque_constant_curve_scales_the_torque_of_a_current():
    """w = (k_tau i e^f - tau_0) t / J."""
    curve = CURVES["torque_constant_curve"](values=[0.0, -0.1, -0.4], knots=[0.0, 2.0, 8.0])
    drive = constant(2.0, 0.1, current_A=5.0, load_torque_Nm=0.0, ambient_degC=20.0)
    found = readings(Model("motor", effects=(curve,)), drive)["speed_rad_s"]
    torque = 0.0385 * 5.0 * np.exp(-0.25) - 0.01
    np.testing.assert_allclose(found, torque * drive.time_s / 5.42e-5, rtol=1e-10)


def test_the_values_of_a_curve_have_a_name():
    model = Model("cell", effects=(OcvCurve(),))
    changed = with_values(model, {"ocv_curve.values": jnp.full(15, 0.01)})
    np.testing.assert_array_equal(value(changed, "ocv_curve.values"), np.full(15, 0.01))


@pytest.mark.parametrize(
    ("values", "knots", "part"),
    [([1.0, 2.0], [0.0, 0.5, 1.0], "has 3 knots and values of shape"), (None, [0.5, 0.5], "do not increase")],
)
def test_a_curve_that_cannot_be_is_refused(values, knots, part: str):
    with pytest.raises(EffectError, match=part):
        OcvCurve(values, knots)


def test_the_same_knots_compile_once():
    assert isinstance(OcvCurve(), Curve)
    assert jax.tree.structure(OcvCurve()) == jax.tree.structure(OcvCurve(np.ones(15)))
    assert jax.tree.structure(OcvCurve()) != jax.tree.structure(OcvCurve(knots=np.linspace(0.0, 1.0, 15)))
