"""Coordinates are exact changes of variable that keep physics' signs; candidates are what a case could show."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.case.known import Known
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.battery import ChargeTransfer, EntropicOcv, OcvHysteresis, SelfHeating
from jaxmodel.effects.curves import CURVES
from jaxmodel.effects.drive import MagnetTemperature
from jaxmodel.effects.sensors import VoltageGain
from jaxmodel.fit.candidates import Candidate, candidates, make_candidate
from jaxmodel.fit.coordinates import (
    REACH_OF_A_RUN,
    REACH_OF_ALL,
    Coordinate,
    effect_coordinate,
    known_coordinate,
)
from jaxmodel.fit.fitted_case import FittedNumbers
from jaxmodel.model.declaration import describe
from jaxmodel.model.parameters import info
from tests.diagnosis.made_cases import case_of, run_of

RANGES = {"soc": (0.2, 0.9), "cell_temperature_degC": (10.0, 35.0), "ambient_degC": (10.0, 25.0)}
COORDINATES = st.builds(
    Coordinate,
    name=st.just("x"),
    centre=st.floats(-5.0, 5.0),
    spread=st.floats(0.05, 3.0),
    logarithmic=st.booleans(),
    origin=st.sampled_from([0.0, 1.0]),
    sign=st.sampled_from([-1.0, 1.0]),
)
# A state of charge below the last point of its table.
BELOW = st.builds(
    Coordinate,
    name=st.just("initial_soc"),
    centre=st.floats(0.5, 1.0),
    spread=st.floats(0.005, 0.1),
    ceiling=st.just(1.0),
)
EFFECT_PARAMETERS = [(effect, name) for effect, cls in CATALOGUE.items() for name in describe(cls)]


@given(COORDINATES, st.floats(-3.0, 3.0))
def test_number_and_coordinate_are_each_others_inverse(coordinate: Coordinate, x: float) -> None:
    # Near 1 + exp(-14) five digits are lost to the difference from the origin.
    assert coordinate.at(coordinate.number(x)) == pytest.approx(x, abs=1e-7)


@given(BELOW, st.floats(-6.0, 6.0))
def test_below_a_ceiling_number_coordinate_and_slope_agree(coordinate: Coordinate, x: float) -> None:
    number = coordinate.number(x)
    assert number <= coordinate.ceiling
    if coordinate.ceiling - number > 0.01 * coordinate.bend:
        assert coordinate.at(number) == pytest.approx(x, abs=1e-6)
    difference = (coordinate.number(x + 1e-5) - coordinate.number(x - 1e-5)) / 2e-5
    assert coordinate.slope(x) == pytest.approx(difference, rel=1e-4, abs=1e-9)
    # Far below it is the straight line.
    far = Coordinate("initial_soc", coordinate.centre, coordinate.spread).number(-60.0)
    assert coordinate.number(-60.0) == pytest.approx(far, abs=1e-6)


@given(BELOW, st.floats(-6.0, 6.0))
def test_a_floor_is_a_ceiling_upside_down(below: Coordinate, x: float) -> None:
    above = Coordinate("initial_soc", 1.0 - below.centre, below.spread, ceiling=0.0, is_floor=True)
    assert above.number(x) == pytest.approx(1.0 - below.number(-x), abs=1e-12)
    assert above.slope(x) == pytest.approx(below.slope(-x), rel=1e-6, abs=1e-12)
    assert above.number(x) >= 0.0


@given(COORDINATES, st.floats(-3.0, 3.0))
def test_slope_is_the_derivative(coordinate: Coordinate, x: float) -> None:
    difference = (coordinate.number(x + 1e-4) - coordinate.number(x - 1e-4)) / 2e-4
    assert coordinate.slope(x) == pytest.approx(abs(difference), rel=1e-5, abs=1e-9)


@given(st.sampled_from([("capacity_Ah", 5.2, 0.15), ("initial_soc", 0.5, 0.01)]), st.floats(-60.0, 60.0))
def test_no_number_is_beyond_the_reach_of_what_is_stated(stated: tuple[str, float, float], x: float) -> None:
    name, value, sd = stated
    run = -1 if name == "capacity_Ah" else 0
    coordinate = known_coordinate(name, value, sd, info(name), run)
    nearest, furthest = sorted(coordinate.number(end) for end in (-1e3, 1e3))
    assert nearest <= coordinate.number(x) <= furthest
    assert coordinate.number(coordinate.at(furthest + 10.0 * sd)) == pytest.approx(furthest)
    off = math.log(furthest / value) * value / sd if coordinate.logarithmic else (furthest - value) / sd
    assert off == pytest.approx(REACH_OF_ALL if run < 0 else REACH_OF_A_RUN)
    if abs(x) < 15.0:
        assert coordinate.at(coordinate.number(x)) == pytest.approx(x, abs=1e-3)
        difference = (coordinate.number(x + 1e-4) - coordinate.number(x - 1e-4)) / 2e-4
        assert coordinate.slope(x) == pytest.approx(difference, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize(("name", "value", "sd"), [("capacity_Ah", 5.2, 0.15), ("initial_soc", 0.97, 0.01)])
def test_stated_parameter_is_its_value_with_its_sd(name: str, value: float, sd: float) -> None:
    coordinate = known_coordinate(name, value, sd, info(name))
    assert coordinate.logarithmic == (name == "capacity_Ah")
    assert coordinate.number(0.0) == pytest.approx(value)
    assert coordinate.slope(0.0) == pytest.approx(sd)
    assert coordinate.number(-40.0) > 0.0 or not coordinate.logarithmic


@pytest.mark.parametrize(("effect", "name"), EFFECT_PARAMETERS)
def test_usual_range_of_an_effect_ends_at_one_sd_on_its_side_of_the_null(effect: str, name: str) -> None:
    entry = describe(CATALOGUE[effect])[name]
    low, high = entry.typical
    coordinate = effect_coordinate(name, entry)
    if coordinate.logarithmic:
        # What is possible may end near a usual range: from half the way there numbers approach that, 0.88 sd at 1 sd.
        free = dataclasses.replace(coordinate, above=math.inf, below=math.inf)
        assert sorted(free.number(x) for x in (-1.0, 1.0)) == pytest.approx([low, high])
        for x, reach in ((-1.0, coordinate.below), (1.0, coordinate.above)):
            assert coordinate.off(x) == pytest.approx(x) if reach >= 2.0 else 0.88 < coordinate.off(x) / x < 1.0
        far = [coordinate.number(x) for x in (-8.0, 8.0)]
        assert all(math.copysign(1.0, number - coordinate.origin) == coordinate.sign for number in far)
        assert (low - coordinate.origin) * coordinate.sign > 0.0
    else:
        assert low <= coordinate.centre <= high
        assert max(abs(low), abs(high)) == pytest.approx(coordinate.slope(0.0))


def test_bounded_number_stays_within_what_is_possible() -> None:
    coordinate = effect_coordinate("b", describe(OcvHysteresis())["b"])
    assert [coordinate.number(x) for x in (-50.0, 0.0, 50.0)] == pytest.approx([-1.0, 0.0, 1.0])


@pytest.mark.parametrize(("effect", "name"), EFFECT_PARAMETERS)
@given(x=st.floats(-1e3, 1e3), place=st.floats(0.0, 1.0), share=st.floats(0.01, 1.0))
def test_no_fit_leaves_what_can_be_written(effect: str, name: str, x: float, place: float, share: float) -> None:
    """A fitted number is written as it is: one beyond its bounds would be another model than the one that was judged.

    An activation energy of 177 kJ/mol was written as 100, and 23 mV became 67.
    """
    entry = describe(CATALOGUE[effect])[name]
    low, high = entry.typical
    stated = low + place * (high - low)
    known = known_coordinate(name, stated, share * max(abs(stated), 0.1 * (high - low)), entry)
    for coordinate in (effect_coordinate(name, entry), known):
        number, fitted = coordinate.number(x), FittedNumbers({})
        assert fitted.bounded(name, number, entry) == pytest.approx(number, abs=1e-8 * max(abs(low), abs(high)))
        assert fitted.notes == [], "and nothing is said of a rounding"
        slope = (coordinate.number(1e-4) - coordinate.number(0.0)) / 1e-4
        assert abs(slope) > 0.1 * coordinate.slope(0.0) > 0.0  # from where it begins a fit can move it


def test_candidate_is_tried_at_every_shape_of_its_grid() -> None:
    hysteresis = make_candidate(OcvHysteresis())
    assert [c.name for c in hysteresis.coordinates] == ["ocv_hysteresis.M_V", "ocv_hysteresis.g", "ocv_hysteresis.b"]
    tried = [[c.number(x) for c, x in zip(hysteresis.coordinates, probe, strict=True)] for probe in hysteresis.probes]
    middle = np.sqrt(0.005 * 0.06)
    np.testing.assert_allclose(tried, [[middle, 8.0, 0.0], [middle, 30.0, 0.0], [middle, 120.0, 0.0]])
    assert len(make_candidate(SelfHeating()).probes) == 4


def test_sign_that_physics_allows_is_known() -> None:
    assert make_candidate(OcvHysteresis()).one_sided
    assert make_candidate(MagnetTemperature()).one_sided
    assert make_candidate(MagnetTemperature()).coordinates[0].number(5.0) < 0.0
    assert not make_candidate(EntropicOcv()).one_sided
    assert make_candidate(ChargeTransfer()).null_at_infinity
    assert not make_candidate(OcvHysteresis()).null_at_infinity
    gain = make_candidate(VoltageGain(column="voltage_V"))
    assert (gain.label, gain.is_sensor) == ("voltage_gain:voltage_V", True)


def test_candidates_are_the_effects_of_the_kind_and_the_sensors_that_were_read() -> None:
    rows = np.zeros(20)
    inputs = {"current_A": rows, "ambient_degC": rows}
    outputs = {"voltage_V": rows, "cell_temperature_degC": np.full(20, np.nan)}
    case = case_of("cell", {"capacity_Ah": Known(5.2, 0.1)}, [run_of(1, inputs, outputs)])
    found = {candidate.label: candidate for candidate in candidates(case, RANGES)}
    physics = {n for n, cls in CATALOGUE.items() if "cell" in cls.kinds and cls.is_candidate and not cls.is_sensor}
    sensors = {
        name if not cls.reads else f"{name}:{column}"
        for name, cls in CATALOGUE.items()
        if "cell" in cls.kinds and cls.is_sensor
        for column in ("voltage_V", "current_A", "ambient_degC")
        if not cls.reads or column.endswith(cls.reads)
    }
    curves = {name for name, cls in CURVES.items() if "cell" in cls.kinds}
    # One age for all runs is but another calibration.
    physics -= {name for name in physics if CATALOGUE[name].distinguished_by}
    groups = {
        group: {label for label, candidate in found.items() if candidate.group == group}
        for group in ("effect", "sensor", "curve", "run")
    }
    assert groups == {"effect": physics, "sensor": sensors, "curve": curves, "run": set()}  # one run differs from none

    present = dataclasses.replace(case, effects={"ocv_hysteresis": {"M_V": 0.02}})
    assert {c.label for c in candidates(present, RANGES)} == found.keys() - {"ocv_hysteresis"}


def test_what_comes_with_age_is_a_candidate_where_fitted_runs_differ_in_age() -> None:
    rows = np.zeros(20)
    inputs, outputs = {"current_A": rows, "ambient_degC": rows}, {"voltage_V": rows}
    stated = {"capacity_Ah": Known(5.2, 0.1), "cycles": Known(100.0)}
    aged = {name for name, cls in CATALOGUE.items() if cls.distinguished_by == "cycles"}
    assert aged
    for split, offered in (("fit", aged), ("check", set())):
        runs = [run_of(1, inputs, outputs), run_of(2, inputs, outputs, split=split, cycles=Known(300.0))]
        assert {c.label for c in candidates(case_of("cell", stated, runs), RANGES)} & aged == offered


def test_of_each_fitted_run_some_numbers_may_differ() -> None:
    rows = np.zeros(20)
    inputs, outputs = {"current_A": rows, "ambient_degC": rows}, {"voltage_V": rows}
    runs = [run_of(number, inputs, outputs, split=split) for number, split in enumerate(("fit", "check", "fit"))]
    found = [c for c in candidates(case_of("cell", {"capacity_Ah": Known(5.2, 0.1)}, runs), RANGES) if c.group == "run"]
    contacts = {c.label: c.run for c in found if c.name == "contact_resistance"}
    assert contacts == {"contact_resistance@run-00": 0, "contact_resistance@run-02": 2}
    # One number in the model, absent where a run has none of its own.
    assert {c.effect.label for c in found if c.name == "contact_resistance"} == {"contact_resistance"}
    assert all(float(getattr(c.effect, next(iter(describe(c.effect))))) == 0.0 for c in found)


@pytest.fixture(scope="module")
def curves() -> dict[str, Candidate]:
    rows = np.zeros(20)
    run = run_of(1, {"current_A": rows, "ambient_degC": rows}, {"voltage_V": rows})
    case = case_of("cell", {"capacity_Ah": Known(5.2, 0.1)}, [run])
    return {one.label: one for one in candidates(case, RANGES) if one.group == "curve"}


@pytest.mark.parametrize("name", [name for name, cls in CURVES.items() if "cell" in cls.kinds])
def test_a_curve_is_smooth_over_its_knots_and_of_its_usual_size(name: str, curves: dict[str, Candidate]) -> None:
    cls, curve = CURVES[name], curves[name]
    covariance = curve.mix @ curve.mix.T
    knots = len(cls.usual_knots)
    assert covariance.shape == (knots, knots)
    assert len(curve.coordinates) == curve.mix.shape[1] <= knots
    np.testing.assert_allclose(np.diag(covariance), cls.typical**2, rtol=0.2)  # its faint modes are left out
    assert curve.largest * cls.typical == pytest.approx(cls.largest)
    if knots > 1:
        # Neighbours move together, however far apart they are; the ends hardly.
        sd = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(sd, sd)
        assert np.diag(correlation, 1).min() > 0.75
        assert correlation[0, -1] < 0.2


def test_a_curve_covers_what_the_fitted_runs_covered(curves: dict[str, Candidate]) -> None:
    knots = curves["ocv_curve"].effect.knots
    assert (knots[0], knots[-1]) == pytest.approx(RANGES["soc"])
    assert np.diff(knots)[0] == pytest.approx(0.001 * np.ptp(knots))


def test_a_curve_is_of_a_stated_table_or_not(curves: dict[str, Candidate]) -> None:
    assert not any(one.stated for one in curves.values()), "the case states no table"


@pytest.mark.parametrize("capacity_Ah", [1e-6, 3e-3, 0.04, 5.0, 280.0, 5e3])
def test_an_effect_whose_range_has_collapsed_is_no_candidate(capacity_Ah: float) -> None:
    """From a coin cell to a truck's pack each coordinate has a width, and each probe is a number."""
    current = np.full(20, 0.1 * capacity_Ah)
    runs = [run_of(n, {"current_A": current, "ambient_degC": 0.0 * current}, {"voltage_V": current}) for n in (1, 2)]
    case = case_of("cell", {"capacity_Ah": Known(capacity_Ah)}, runs)
    found = {one.label: one for one in candidates(case, RANGES)}
    for one in found.values():
        assert all(0.0 < coordinate.spread < math.inf for coordinate in one.coordinates)
        assert np.all(np.isfinite(np.array(one.probes)))
        if not one.is_vector and one.probes:
            assert np.all(np.isfinite(one.at(np.array(one.probes[0]), 2.0)))
    assert ("contact_heating" in found) == (capacity_Ah > 1e-2), "its range for a coin cell is beyond its bounds"


@pytest.mark.parametrize(("R_0", "k_tau"), [(1e-4, 1e-4), (20.0, 2e-3), (0.05, 3.0), (1e3, 500.0)])
def test_motors_of_any_size_have_candidates_with_a_width(R_0: float, k_tau: float) -> None:
    volts = np.full(20, 12.0)
    inputs = {"voltage_V": volts, "load_torque_Nm": 0.0 * volts, "ambient_degC": 0.0 * volts}
    runs = [run_of(n, inputs, {"speed_rad_s": volts}) for n in (1, 2)]
    case = case_of("motor", {"R_0": Known(R_0), "k_tau": Known(k_tau)}, runs)
    for one in candidates(case, RANGES):
        assert all(0.0 < coordinate.spread < math.inf for coordinate in one.coordinates)
        assert np.all(np.isfinite(np.array(one.probes)))


def test_shifts_of_a_motors_clock_are_tried_from_a_row_to_the_length_of_the_run() -> None:
    volts = np.full(800, 12.0)
    inputs = {"voltage_V": volts, "load_torque_Nm": 0.0 * volts, "ambient_degC": 0.0 * volts}
    case = case_of("motor", {}, [run_of(1, inputs, {"speed_rad_s": volts}, step_s=0.004)])
    clock = next(one for one in candidates(case, RANGES) if one.label == "clock_shift")
    tried = sorted({abs(clock.coordinates[0].number(probe[0])) for probe in clock.probes})
    assert tried[0] == pytest.approx(0.004)
    assert tried[-1] == pytest.approx(3.196)
    assert all(later <= 2.01 * earlier for earlier, later in itertools.pairwise(tried))
    cell = case_of("cell", {}, [run_of(1, {"current_A": volts, "ambient_degC": volts}, {"voltage_V": volts})])
    of_cell = next(one for one in candidates(cell, RANGES) if one.label == "clock_shift")
    assert max(abs(of_cell.coordinates[0].number(probe[0])) for probe in of_cell.probes) == 20.0
