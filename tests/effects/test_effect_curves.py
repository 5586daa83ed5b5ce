"""Curves as effects: absent at zero, straight between knots, and by closed forms what their equations say."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxmodel.base.errors import EffectError
from jaxmodel.case.forms import MOTOR_TABLES
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
COVERED = {
    "soc": (0.55, 0.75),
    "temperature_degC": (0.0, 60.0),
    "temperature_rise_K": (0.0, 10.0),
    "current_A": (0.0, 6.0),
    "speed_rad_s": (0.0, 300.0),
}
NOTHING = jnp.zeros(())
HEAT = dict.fromkeys(("convection_curve", "short_heat", "long_heat"), "cell_temperature_degC")
PARAMETERS = Parameters(initial_soc=0.7)


def kind_of(name: str) -> str:
    return "cell" if "cell" in CURVES[name].kinds else "motor"


def values_of(name: str) -> np.ndarray:
    cls = CURVES[name]
    return cls.typical * np.cos(1.7 * np.arange(len(cls.usual_knots)))


def curve_of(name: str, values=None, switch=None) -> Curve:
    """A curve over what the runs of its kind cover."""
    low, high = COVERED[CURVES[name].over]
    return CURVES[name](values, low, high, switch)


def sensed(kind: str, *effects: Effect, **parameters: float) -> dict[str, np.ndarray]:
    """Readings of a model; a cell heats itself."""
    own = (*([CATALOGUE["self_heating"]()] if kind == "cell" else []), *effects)
    return readings(Model(kind, Parameters(initial_soc=0.7, **parameters), effects=own), PROFILES[kind])


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
    assert cls.over in {*fields, "temperature_rise_K"}
    assert 0.0 < cls.typical < cls.largest
    np.testing.assert_array_equal(cls().knots, cls.usual_knots)
    assert cls.usual_knots[0] == 0.0
    assert np.all(np.diff(cls.usual_knots) > 0.0)
    assert len(cls.usual_knots) == 1 or cls.usual_knots[-1] == 1.0
    assert set(cls.tables) <= {*CURVE_NAMES, "dU_dT", *MOTOR_TABLES}
    assert set(cls.tables.values()) <= {1.0, -1.0}
    assert set(cls.needs) <= set(CATALOGUE)
    assert name not in CATALOGUE


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_of_zeros_is_absent_to_the_bit_and_so_is_one_switched_off(name: str):
    """Beside the model without curves to rounding: a motor has other steps where its torque bends."""
    kind = kind_of(name)
    base = sensed(kind)
    absent, off = (sensed(kind, curve) for curve in (curve_of(name), curve_of(name, values_of(name), NOTHING)))
    moved = sensed(kind, curve_of(name, values_of(name)))
    for column, expected in base.items():
        np.testing.assert_array_equal(absent[column], off[column], err_msg=column)
        if kind == "cell":
            np.testing.assert_array_equal(absent[column], expected, err_msg=column)
        np.testing.assert_allclose(absent[column], expected, rtol=1e-5, atol=1e-5, err_msg=column)
    assert any(np.max(np.abs(moved[column] - base[column])) > 1e-4 for column in base)


@pytest.mark.slow("friction_curve", "torque_constant_curve")
@pytest.mark.parametrize("name", CURVES)
def test_the_slope_by_the_values_is_that_of_the_readings(name: str):
    """And the slope by the switch at 0 points along the curve, so that one derivative tests it."""
    kind, direction = kind_of(name), values_of(name)
    column = "speed_rad_s" if kind == "motor" else HEAT.get(name, "voltage_V")
    heating = () if kind == "motor" else (CATALOGUE["self_heating"](),)

    def read(values, switch=None):
        model = Model(kind, PARAMETERS, effects=(*heating, curve_of(name, values, switch)))
        return jnp.asarray(readings_traced(model, kind)[column])

    zero = jnp.zeros(direction.shape)
    slope = jax.jvp(read, (zero,), (jnp.asarray(direction),))[1]
    step = 1e-3
    difference = (read(step * direction) - read(-step * direction)) / (2.0 * step)
    tolerance = 2e-4 * float(jnp.max(jnp.abs(difference)))
    np.testing.assert_allclose(slope, difference, rtol=0.0, atol=tolerance)
    small = 1e-5
    by_switch = jax.jvp(lambda s: read(small * direction, s), (jnp.zeros(()),), (jnp.ones(()),))[1]
    np.testing.assert_allclose(by_switch / small, slope, rtol=0.0, atol=max(tolerance, 1e-6))


def readings_traced(model: Model, kind: str):
    return run_track(model, *padded(model, PROFILES[kind])).readings


def test_an_ocv_curve_is_straight_between_its_knots_and_held_beyond():
    low, high = 0.6, 0.72
    values = 0.01 * np.random.default_rng(0).standard_normal(len(OcvCurve.usual_knots))
    base, found = sensed("cell"), sensed("cell", OcvCurve(values, low, high))
    knots = low + (high - low) * np.array(OcvCurve.usual_knots)
    np.testing.assert_allclose(OcvCurve(values, low, high).knots, knots)
    # Its heat is that of the overpotential alone, which stays.
    np.testing.assert_allclose(found["cell_temperature_degC"], base["cell_temperature_degC"], atol=1e-12)
    expected = np.interp(base["soc"], knots, values)
    np.testing.assert_allclose(found["voltage_V"] - base["voltage_V"], expected, rtol=0.0, atol=1e-12)
    assert base["soc"].min() < high
    assert base["soc"].max() > low


@pytest.mark.parametrize(
    ("names", "scaled"),
    [
        (("series_resistance_curve",), {"series_resistance_scale": 1.5}),
        # Of a factor on a pair's resistance the time constant stays.
        (
            ("short_resistance_curve", "long_resistance_curve"),
            {"rc_resistance_scale": 1.5, "rc_capacitance_scale": 1.0 / 1.5},
        ),
        (("short_time_curve", "long_time_curve"), {"rc_capacitance_scale": 1.5}),
    ],
)
def test_a_level_curve_of_a_logarithm_is_the_scale_itself(names: tuple[str, ...], scaled: dict[str, float]):
    level = [curve_of(name, np.full(len(CURVES[name].usual_knots), np.log(1.5))) for name in names]
    found, expected = sensed("cell", *level), sensed("cell", **scaled)
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)


@pytest.mark.parametrize("pair", ["short", "long"])
def test_curves_of_one_pair_leave_the_other(pair: str):
    """After a step of the current, V = R (1 - exp(-t / R C)) of the pair alone has changed."""
    resistance = curve_of(f"{pair}_resistance_curve", np.full(13, 0.2))
    time = curve_of(f"{pair}_time_curve", np.full(6, -0.3))
    profile = constant(300.0, 5.0, current_A=2.0, ambient_degC=20.0)
    base, found = (readings(constant_cell(*effects), profile)["voltage_V"] for effects in ((), (resistance, time)))
    R, C = (CONSTANT[f"R_T{pair[0].upper()}"], CONSTANT[f"C_T{pair[0].upper()}"])

    def drop(r: float, tau: float) -> np.ndarray:
        return 2.0 * r * (1.0 - np.exp(-profile.time_s / tau))

    changed = drop(R * np.exp(0.2), R * C * np.exp(-0.3)) - drop(R, R * C)
    np.testing.assert_allclose(base - found, changed, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("degC", [-20.0, 5.0, 20.0, 50.0])
def test_an_energy_is_that_of_arrhenius_at_the_cells_own_temperature(degC: float):
    profile = constant(10.0, 1.0, current_A=2.0, ambient_degC=degC)
    curve = curve_of("series_energy", [15e3])
    base, found = (readings(constant_cell(*effects), profile)["voltage_V"] for effects in ((), (curve,)))
    factor = np.exp(15e3 / 8.314 * (1.0 / (degC + 273.15) - 1.0 / 293.15))
    np.testing.assert_allclose(base - found, 2.0 * 0.05 * (factor - 1.0), rtol=0.0, atol=1e-13)


def test_energies_of_all_three_resistances_are_the_effects_of_the_catalogue():
    energies = [curve_of(f"{name}_energy", [12e3]) for name in ("series", "short", "long")]
    found = sensed("cell", *energies)
    expected = sensed("cell", CATALOGUE["arrhenius_resistance"](E_a=12e3))
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-9, err_msg=column)
    polarised = sensed("cell", *energies[1:])
    expected = sensed("cell", CATALOGUE["arrhenius_polarisation"](E_rc=12e3))
    for column in expected:
        np.testing.assert_allclose(polarised[column], expected[column], rtol=1e-9, err_msg=column)


def test_a_level_entropy_curve_is_the_entropy_coefficient():
    found = sensed("cell", curve_of("entropy_curve", np.full(13, -3e-4)))
    expected = sensed("cell", CATALOGUE["entropic_ocv"](dU_dT=-3e-4))
    for column in expected:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)


@pytest.mark.parametrize("pair", ["short", "long"])
def test_a_share_of_heat_is_that_of_a_pairs_loss(pair: str):
    """In a cell that loses no heat, C_th dT/dt grows by f i V: from a step of the current on, V as of an RC pair."""
    heating = CATALOGUE["self_heating"](C_th=50.0, hA=1e-9)
    profile = constant(120.0, 1.0, current_A=3.0, ambient_degC=20.0)
    curve = curve_of(f"{pair}_heat", [-0.5])
    base, found = (
        readings(constant_cell(heating, *effects), profile)["cell_temperature_degC"] for effects in ((), (curve,))
    )
    R, C = (CONSTANT[f"R_T{pair[0].upper()}"], CONSTANT[f"C_T{pair[0].upper()}"])
    of_pair = 3.0**2 * R * (profile.time_s - R * C * (1.0 - np.exp(-profile.time_s / (R * C))))
    np.testing.assert_allclose(found - base, -0.5 * of_pair / 50.0, rtol=1e-4, atol=5e-6)


def test_convection_grows_with_the_rise_of_temperature():
    """A cell that cools: dT/dt = -hA exp(f (T - T_amb) / 10) (T - T_amb) / C_th."""
    f, rise, hA, C_th = 0.1, 25.0, 0.1, 50.0
    heating, curve = CATALOGUE["self_heating"](C_th=C_th, hA=hA), curve_of("convection_curve", [f])
    profile = constant(600.0, 5.0, current_A=0.0, ambient_degC=15.0)
    model = constant_cell(heating, curve)
    model = with_values(model, {"initial_temperature_rise_K": jnp.asarray(rise)})
    found = readings(model, profile)["cell_temperature_degC"] - 15.0
    solution = solve_ivp(
        lambda _, y: -hA * np.exp(f * y / 10.0) * y / C_th, (0.0, 600.0), [rise], t_eval=profile.time_s, rtol=1e-9
    )
    np.testing.assert_allclose(found, solution.y[0], atol=5e-3)


def test_a_friction_curve_is_coulomb_friction_and_viscous_friction():
    """c + b |w| is what the no-load torque and viscous friction are together."""
    knots = 700.0 * np.array(CURVES["friction_curve"].usual_knots)
    found = sensed("motor", CURVES["friction_curve"](0.004 + 2e-5 * knots, 0.0, 700.0))
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
    curve = CURVES["torque_constant_curve"]([0.0, -0.1, -0.2, -0.3, -0.4, -0.5], 0.0, 10.0)
    drive = constant(2.0, 0.1, current_A=5.0, load_torque_Nm=0.0, ambient_degC=20.0)
    found = readings(Model("motor", effects=(curve,)), drive)["speed_rad_s"]
    torque = 0.0385 * 5.0 * np.exp(-0.25) - 0.01
    np.testing.assert_allclose(found, torque * drive.time_s / 5.42e-5, rtol=1e-10)


def test_the_values_of_a_curve_have_a_name():
    model = Model("cell", effects=(OcvCurve(),))
    values = jnp.full(len(OcvCurve.usual_knots), 0.01)
    np.testing.assert_array_equal(value(with_values(model, {"ocv_curve.values": values}), "ocv_curve.values"), values)


@pytest.mark.parametrize(
    ("values", "span", "part"),
    [([1.0, 2.0], (0.0, 1.0), "knots and values of shape"), (None, (0.5, 0.5), "its range 0.5 to 0.5 is empty")],
)
def test_a_curve_that_cannot_be_is_refused(values, span: tuple[float, float], part: str):
    with pytest.raises(EffectError, match=part):
        OcvCurve(values, *span)


def test_every_range_compiles_once():
    assert jax.tree.structure(OcvCurve()) == jax.tree.structure(OcvCurve(low=0.1, high=0.6))
