"""The rare effects: absent at their null, by closed forms, and against the second simulator where it knows them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.independent import simulate
from jaxmodel.case.build import make_effect
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.curves import CURVE_NAMES, CellCurves, Table
from jaxmodel.model.declaration import describe
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import Effect
from jaxmodel.model.profile import Profile, constant
from tests.model.runs import readings, staircase

RARE = [name for name, cls in CATALOGUE.items() if cls.rare]
CONSTANT = {"ocv": 3.7, "R_ints": 0.05, "R_TS": 0.03, "C_TS": 900.0, "R_TL": 0.04, "C_TL": 5000.0}
LEVELS = staircase(8, 60, 1.0)
AMBIENT = np.linspace(-5.0, 40.0, 60)
INPUTS = {
    "cell": {"current_A": 4.0 * LEVELS},
    "motor": {"voltage_V": 12.0 * LEVELS, "load_torque_Nm": 0.05 * LEVELS},
    "robot": {"duty": 0.5 * LEVELS, "load_torque_Nm": 0.05 * LEVELS},
}
COLUMN = {
    "current_gain": {"motor": "current_A", "cell": "current_A", "robot": "pack_current_A"},
    "temperature_offset": {kind: "winding_temperature_degC" for kind in ("motor", "robot")},
    "temperature_gain": {"cell": "cell_temperature_degC", "motor": "case_temperature_degC"},
    "speed_gain": {kind: "speed_rad_s" for kind in ("motor", "robot")},
}


def effect_of(name: str, kind: str, **numbers: float) -> Effect:
    column = COLUMN.get(name, {}).get(kind)
    return CATALOGUE[name](**numbers, **({} if column is None else {"column": column}))


def sensed(kind: str, *effects: Effect, changes: dict[str, np.ndarray] | None = None, **parameters: float):
    profile = Profile(np.arange(60.0), INPUTS[kind] | {"ambient_degC": AMBIENT} | (changes or {}))
    return readings(Model(kind, Parameters(initial_soc=0.7, **parameters), effects=effects), profile)


def constant_cell(*effects: Effect) -> Model:
    curves = CellCurves(**{name: Table([0.0, 1.0], [CONSTANT[name]] * 2) for name in CURVE_NAMES})
    parameters = Parameters(initial_soc=0.7, cycles=0.0, storage_months=0.0, capacity_Ah=1e4)
    return Model("cell", parameters, curves, effects)


def lost(profile: Profile, *effects: Effect) -> np.ndarray:
    """What effects take off the voltage of a cell of constants, in V."""
    without, with_them = (readings(constant_cell(*chosen), profile)["voltage_V"] for chosen in ((), effects))
    return without - with_them


def test_rare_effects_come_last():
    assert list(CATALOGUE)[-len(RARE) :] == RARE
    assert len(RARE) == 24
    assert not any(cls.rare for name, cls in CATALOGUE.items() if name not in RARE)


@pytest.mark.parametrize("name", [n for n in RARE if CATALOGUE[n].is_sensor])
def test_a_sensor_without_its_fault_reads_the_truth_to_the_bit(name: str):
    """The same of physics, in one program for all effects, is in test_laws.py."""
    kind = CATALOGUE[name].kinds[0]
    (amplitude,) = describe(CATALOGUE[name])
    base, found = sensed(kind), sensed(kind, effect_of(name, kind, **{amplitude: 0.0}))
    for column, values in base.items():
        np.testing.assert_array_equal(found[column], values, err_msg=column)


@pytest.mark.parametrize("name", RARE)
def test_an_effect_is_told_in_full(name: str):
    infos = describe(CATALOGUE[name])
    assert next(iter(infos.values())).null in (0.0, np.inf)  # a resistance beside the cell is none at infinity
    assert all(info.typical is not None and info.lower <= info.default <= info.upper for info in infos.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "column"),
    [
        ("arrhenius_polarisation", "cell", "voltage_V"),
        ("capacity_fade", "cell", "soc"),
        ("discharge_resistance", "cell", "voltage_V"),
        ("directional_friction", "motor", "speed_rad_s"),
        ("brush_current_drop", "motor", "speed_rad_s"),
        ("heat_path", "motor", "winding_temperature_degC"),
        ("heat_path", "motor", "case_temperature_degC"),
        ("iron_loss", "motor", "speed_rad_s"),
        ("iron_loss", "motor", "winding_temperature_degC"),
        ("iron_loss", "motor", "case_temperature_degC"),
        ("bridge_dead_time", "robot", "motor_current_A"),
        ("current_gain", "cell", "voltage_V"),
        ("current_gain", "motor", "current_A"),
        ("temperature_offset", "motor", "winding_temperature_degC"),
        ("temperature_gain", "motor", "case_temperature_degC"),
        ("speed_gain", "motor", "speed_rad_s"),
        ("torque_offset", "motor", "speed_rad_s"),
        ("torque_gain", "motor", "speed_rad_s"),
        ("chamber_offset", "cell", "voltage_V"),
    ],
)
def test_the_second_simulator_reads_the_same(name: str, kind: str, column: str):
    effect = effect_of(name, kind)
    numbers = {field: info.default for field, info in describe(effect).items()}
    faulty = {name: numbers | ({"column": effect.column} if effect.is_sensor else {})}
    inputs = {"time_s": np.arange(60.0), **INPUTS[kind], "ambient_degC": AMBIENT}
    other, other_base = (simulate(kind, {}, inputs, effects, 0.7)[column] for effects in (faulty, {}))
    found, base = sensed(kind, effect)[column], sensed(kind)[column]
    size = np.max(np.abs(other - other_base))
    assert size > 1e-5
    np.testing.assert_allclose(found - base, other - other_base, rtol=0.0, atol=0.02 * size)


def test_polarisation_has_an_energy_of_its_own():
    """Beside that of all resistances the two add up where they act on both."""
    both = sensed("cell", CATALOGUE["arrhenius_resistance"](E_a=12e3), CATALOGUE["arrhenius_polarisation"](E_rc=-12e3))
    at_20 = sensed("cell", CATALOGUE["arrhenius_polarisation"](), changes={"ambient_degC": np.full(60, 20.0)})
    np.testing.assert_allclose(
        at_20["voltage_V"], sensed("cell", changes={"ambient_degC": np.full(60, 20.0)})["voltage_V"], rtol=1e-14
    )
    # All energy is taken off the pairs again: what is left is on the series drop, proportional to the present current.
    base = sensed("cell")["voltage_V"]
    np.testing.assert_allclose((both["voltage_V"] - base)[LEVELS == 0.0], 0.0, atol=1e-12)


def test_a_charge_is_spared_the_resistance_of_a_discharge():
    profile = Profile(np.arange(4.0), {"current_A": np.array([5e3, 5e3, -5e3, 0.0]), "ambient_degC": np.full(4, 20.0)})
    found = lost(profile, CATALOGUE["discharge_resistance"](d=0.2))
    np.testing.assert_allclose(found, [0.2 * 0.05 * 5e3] * 2 + [0.0, 0.0], rtol=1e-9, atol=1e-9)


def test_a_contact_warms_with_the_square_of_the_current():
    profile = constant(300.0, 3.0, current_A=-4.0, ambient_degC=20.0)
    found = lost(profile, CATALOGUE["contact_heating"](k=1e-4, tau_c=50.0))
    gained = 1e-4 * 16.0 * (1.0 - np.exp(-profile.time_s / 50.0))
    np.testing.assert_allclose(found, -4.0 * gained, rtol=1e-9, atol=1e-14)


def test_a_contact_drifts_with_time_whatever_flows():
    profile = constant(360.0, 3.0, current_A=2.0, ambient_degC=20.0)
    found = lost(profile, CATALOGUE["contact_drift"](r=0.01))
    np.testing.assert_allclose(found, 2.0 * 0.01 * profile.time_s / 3600.0, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("core_first", [True, False])
def test_a_core_is_warmer_by_its_heat_and_a_thermometer_sees_the_surface(core_first: bool):
    """Constant curves make the heat of i^2 R; the surface is that of self-heating alone, the core x above it."""
    profile = constant(600.0, 5.0, current_A=5.0, ambient_degC=20.0)
    heating, core = CATALOGUE["self_heating"](C_th=80.0, hA=0.3), CATALOGUE["core_temperature"](R_i=3.0, tau_i=30.0)
    alone = readings(constant_cell(heating), profile)
    found = readings(constant_cell(*((core, heating) if core_first else (heating, core))), profile)
    np.testing.assert_allclose(found["cell_temperature_degC"], alone["cell_temperature_degC"], rtol=1e-12)
    # A temperature coefficient of the OCV shows the core: V = ... + dU_dT (T_core - 20).
    cold, warm = (
        readings(constant_cell(heating, core, CATALOGUE["entropic_ocv"](dU_dT=slope)), profile)["voltage_V"]
        for slope in (0.0, 1e-7)
    )
    inside = (warm - cold) / 1e-7 + 20.0
    time, power, core_s = profile.time_s, 25.0 * np.array([0.05, 0.03, 0.04]), 30.0
    expected = power[0] * (1.0 - np.exp(-time / core_s))
    for watt, pair_s in zip(power[1:], (0.03 * 900.0, 0.04 * 5000.0), strict=True):
        late = (pair_s * np.exp(-time / pair_s) - core_s * np.exp(-time / core_s)) / (pair_s - core_s)
        expected += watt * (1.0 - late)
    np.testing.assert_allclose(inside - alone["cell_temperature_degC"], 3.0 * expected, rtol=0.0, atol=0.02)


def test_friction_of_one_direction_costs_more_that_way():
    drive = {"load_torque_Nm": 0.0, "ambient_degC": 20.0}
    effect = CATALOGUE["directional_friction"](a=0.3)
    forwards, backwards = (
        readings(Model("motor", effects=(effect,)), constant(60.0, 1.0, voltage_V=volts, **drive))
        for volts in (6.0, -6.0)
    )
    assert forwards["current_A"][-1] == pytest.approx(1.3 * 0.01 / 0.0385, rel=1e-4)
    assert backwards["current_A"][-1] == pytest.approx(-0.7 * 0.01 / 0.0385, rel=1e-4)


def test_brushes_lose_a_logarithm_of_the_current():
    drive = constant(60.0, 1.0, voltage_V=12.0, load_torque_Nm=0.2, ambient_degC=25.0)
    base = readings(Model("motor"), drive)
    found = readings(Model("motor", effects=(CATALOGUE["brush_current_drop"](V_l=0.2, i_b=0.5),)), drive)
    missing = 0.0385 * (base["speed_rad_s"][-1] - found["speed_rad_s"][-1])
    assert missing == pytest.approx(0.2 * np.arcsinh(found["current_A"][-1] / 0.5), rel=1e-3)


def test_a_bridge_loses_the_same_duty_at_all_larger_ones_and_never_turns_around():
    speeds = []
    for duty in (0.6, -0.6, 0.005):
        drive = constant(200.0, 2.0, duty=duty, load_torque_Nm=0.0, ambient_degC=25.0)
        parameters = Parameters(tau_0=0.0, psi_R=0.0, onboard_current_A=0.0)
        found = readings(Model("robot", parameters, effects=(CATALOGUE["bridge_dead_time"](d=0.05),)), drive)
        speeds.append(found["speed_rad_s"][-1] * 0.0385 / found["pack_voltage_V"][-1])
    np.testing.assert_allclose(speeds[:2], [0.55, -0.55], rtol=1e-3)
    assert 0.0 < speeds[2] < 0.005


@pytest.mark.parametrize(
    ("name", "numbers", "kind", "column", "seen"),
    [
        ("current_gain", {"g": 0.02}, "robot", "pack_current_A", lambda x: 1.02 * x),
        ("temperature_offset", {"c": 1.5}, "motor", "winding_temperature_degC", lambda x: x + 1.5),
        ("temperature_gain", {"g": 0.1}, "cell", "cell_temperature_degC", lambda x: 25.0 + 1.1 * (x - 25.0)),
        ("speed_gain", {"g": -0.02}, "robot", "speed_rad_s", lambda x: 0.98 * x),
    ],
)
def test_a_faulty_scale_changes_one_reading(name: str, numbers, kind: str, column: str, seen):
    base, found = sensed(kind), sensed(kind, effect_of(name, kind, **numbers))
    for other, values in base.items():
        expected = seen(values) if other == column else values
        np.testing.assert_allclose(found[other], expected, rtol=1e-14, atol=1e-13, err_msg=other)


@pytest.mark.parametrize(
    ("name", "numbers", "kind", "column", "true"),
    [
        ("current_gain", {"g": 0.02}, "cell", "current_A", lambda x: x / 1.02),
        ("torque_offset", {"c": 0.01}, "robot", "load_torque_Nm", lambda x: x - 0.01),
        ("torque_gain", {"g": 0.05}, "motor", "load_torque_Nm", lambda x: x / 1.05),
        ("chamber_offset", {"c": 2.0}, "cell", "ambient_degC", lambda x: x - 2.0),
    ],
)
def test_a_faulty_input_tells_what_truly_acted(name: str, numbers, kind: str, column: str, true):
    heating = (CATALOGUE["self_heating"](),) if kind == "cell" else ()
    reported = (INPUTS[kind] | {"ambient_degC": AMBIENT})[column]
    acted = sensed(kind, *heating, changes={column: true(reported)})
    found = sensed(kind, *heating, effect_of(name, kind, **numbers))
    for other, values in acted.items():
        np.testing.assert_allclose(found[other], values, rtol=1e-11, atol=1e-11, err_msg=other)


@pytest.mark.parametrize("name", ["torque_offset", "torque_gain", "chamber_offset"])
def test_a_fault_that_can_sit_on_one_column_alone_knows_it(name: str):
    effect = make_effect(name, {}, "here")
    assert effect.column == effect.reads
