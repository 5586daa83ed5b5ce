"""Faults are planted as they are named, and answers on them are judged by what an engineer can know."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.planted import faults
from benchmarks.planted.judge import judge
from benchmarks.planted.plantings import PLANTINGS, Planting, plant, seen
from benchmarks.planted.table import Row, refusals, sentences, summary
from benchmarks.real.cases import CASES, build
from jaxmodel.base.remark import Remark
from jaxmodel.case.reading import read_case
from jaxmodel.diagnosis.answer import findings
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.shifts import SHIFTS
from jaxmodel.fit.preparation.stuck import without_stuck


@pytest.fixture(scope="module")
def samsung(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(CASES["samsung_30q"], Path(), tmp_path_factory.mktemp("plain"))


@pytest.fixture
def rows() -> pd.DataFrame:
    time_s = np.arange(0.0, 1000.0, 2.0)
    return pd.DataFrame(
        {
            "time_s": time_s,
            "current_A": np.where(time_s < 600.0, 3.0, 0.0),
            "ambient_degC": 20.0,
            "voltage_V": np.round(4.0 - 1e-4 * time_s, 4),
            "cell_temperature_degC": np.round(20.0 + 0.02 * time_s, 2),
        }
    )


def changed(rows: pd.DataFrame, found: pd.DataFrame) -> set[str]:
    return {name for name in rows if not rows[name].equals(found[name])}


# Planting


def test_a_thermometer_offset_and_a_contact_change_one_column_by_their_size(rows: pd.DataFrame):
    off = faults.offset(rows, 1.5)
    assert changed(rows, off) == {"cell_temperature_degC"}
    np.testing.assert_allclose(off.cell_temperature_degC - rows.cell_temperature_degC, 1.5)
    behind = faults.contact(rows, 0.01)
    assert changed(rows, behind) == {"voltage_V"}
    np.testing.assert_allclose(behind.voltage_V - rows.voltage_V, -0.01 * rows.current_A, atol=1e-9)


def test_a_lagging_thermometer_is_behind_a_steady_rise_by_rate_times_time_constant(rows: pd.DataFrame):
    late = faults.lag(rows, 90.0)
    assert changed(rows, late) == {"cell_temperature_degC"}
    behind = rows.cell_temperature_degC - late.cell_temperature_degC
    assert behind.iloc[0] == 0.0
    np.testing.assert_allclose(behind[rows.time_s.between(600.0, 900.0)], 0.02 * 90.0, rtol=0.01)


def test_a_lag_leaves_the_noise_of_the_sensor_as_it_is(rows: pd.DataFrame):
    noise = np.random.default_rng(1).normal(0.0, 0.1, len(rows))
    noisy = rows.assign(cell_temperature_degC=20.0 + noise)
    late = faults.lag(noisy, 90.0)
    scatter = np.std(np.diff(late.cell_temperature_degC)) / np.std(np.diff(noise))
    assert scatter == pytest.approx(1.0, abs=0.1)


def test_a_first_order_lag_is_exact_for_uneven_rows():
    time_s = np.array([0.0, 1.0, 40.0, 41.0])
    found = faults.first_order(time_s, np.array([0.0, 1.0, 1.0, 1.0]), 10.0)
    ramp = 1.0 - 10.0 * (1.0 - np.exp(-0.1))
    np.testing.assert_allclose(found[1:], [ramp, 1.0 - (1.0 - ramp) * np.exp(-3.9), 1.0 - (1.0 - ramp) * np.exp(-4.0)])


def test_a_thermometer_sticks_in_the_middle_of_the_load(rows: pd.DataFrame):
    held = faults.stuck(rows, 0.5)
    first = faults.stuck_row(rows, 0.5)
    assert rows.time_s[first] == pytest.approx(300.0, abs=4.0)
    assert held.cell_temperature_degC[first:].nunique() == 1
    assert held.cell_temperature_degC[:first].equals(rows.cell_temperature_degC[:first])


def test_a_late_voltage_comes_later_and_a_high_current_is_higher(rows: pd.DataFrame):
    late = faults.late_voltage(rows, 5.0)
    np.testing.assert_allclose(late.voltage_V[10:], 4.0 - 1e-4 * (rows.time_s[10:] - 5.0), atol=1e-4)
    assert late.voltage_V[0] == rows.voltage_V[0]
    np.testing.assert_allclose(faults.high_current(rows, 0.05).current_A, 1.05 * rows.current_A)


def test_a_column_keeps_its_digits(rows: pd.DataFrame):
    assert faults.digits(rows.cell_temperature_degC) == 2
    assert faults.digits(faults.lag(rows, 90.0).cell_temperature_degC) <= 2
    assert faults.digits(pd.Series([0.1234567, 1.0])) == faults.MOST_DIGITS


@pytest.mark.parametrize("planting", [one for one in PLANTINGS if one.case == "samsung_30q"], ids=lambda one: one.fault)
def test_a_planted_case_is_valid_differs_where_it_should_and_can_be_seen(
    samsung: Path, planting: Planting, tmp_path: Path
):
    folder = plant(samsung, planting, tmp_path / planting.name)
    assert read_case(folder).kind == "cell"
    differing = {path.stem for path in folder.glob("*.csv") if path.read_bytes() != (samsung / path.name).read_bytes()}
    assert differing == (set(planting.runs) or {path.stem for path in samsung.glob("*.csv")})
    assert seen(samsung, folder, planting.column) > 2.0


def test_a_stuck_thermometer_is_told_by_the_preparation(samsung: Path, tmp_path: Path):
    planting = next(one for one in PLANTINGS if one.fault == "stuck thermometer" and one.case == "samsung_30q")
    _, remarks = without_stuck(read_case(plant(samsung, planting, tmp_path / "stuck")))
    assert judge(planting, 0.5, {}, {"findings": findings(remarks)}).verdict == "told"


def test_each_fault_is_planted_in_three_cases_or_more_and_told_by_what_exists():
    cases = {fault: {one.case for one in PLANTINGS if one.fault == fault} for fault in {p.fault for p in PLANTINGS}}
    assert min(map(len, cases.values())) >= 3
    for one in PLANTINGS:
        assert one.case in CASES
        names = {label.partition("@")[0].partition(":")[0] for label in one.labels}
        assert names <= CATALOGUE.keys() | SHIFTS.keys()
    assert len({(one.case, one.name) for one in PLANTINGS}) == len(PLANTINGS)


# Judging


def of(fault: str, case: str = "samsung_30q") -> Planting:
    return next(one for one in PLANTINGS if one.fault == fault and one.case == case)


def effect(name: str, column: str = "", beside: tuple[str, ...] = (), **numbers: float) -> dict:
    parameters = {number: {"value": value, "sd": 0.1} for number, value in numbers.items()}
    return {
        "name": name,
        "parameters": parameters | ({"column": column} if column else {}),
        "cannot_tell_apart_from": list(beside),
    }


def run(stem: str, parameter: str, value: float) -> dict:
    return {"file": f"{stem}.csv", "parameter": parameter, "value": value}


WARMS = effect("self_heating", C_th=40.0)
PLAIN = {"effects": [WARMS]}
THERMOMETER, CHAMBER = "cell_temperature_degC", "ambient_degC"


@pytest.mark.parametrize(
    ("named", "verdict"),
    [
        (effect("temperature_offset", THERMOMETER, c=1.4), "told"),
        (effect("chamber_offset", CHAMBER, c=-1.4), "told"),
        (effect("chamber_offset", CHAMBER, c=1.4), "possible"),
        (effect("temperature_offset", THERMOMETER, c=0.3), "possible"),
        (effect("temperature_gain", THERMOMETER, g=0.1), "missed"),
    ],
)
def test_an_offset_is_told_of_either_thermometer_with_its_sign_and_size(named: dict, verdict: str):
    found = judge(of("thermometer offset"), 1.5, PLAIN, {"effects": [WARMS, named]})
    assert found.verdict == verdict
    assert found.lost == ()
    assert bool(found.new) == (named["name"] == "temperature_gain")


def test_an_offset_that_the_plain_case_has_too_is_told_by_what_it_grew():
    before = {"effects": [effect("temperature_offset", THERMOMETER, c=2.0)]}
    after = {"effects": [effect("temperature_offset", THERMOMETER, c=3.4)]}
    assert judge(of("thermometer offset"), 1.5, before, after).verdict == "told"


def test_an_offset_is_told_by_a_shift_of_every_run_and_not_of_one():
    shift = f"temperature_shift:{THERMOMETER}"
    runs = [run(stem, shift, 1.5) for stem in ("cc1C", "cc2C", "cc3C")]
    assert judge(of("thermometer offset"), 1.5, {}, {"runs": runs}).verdict == "told"
    assert judge(of("thermometer offset"), 1.5, {}, {"runs": runs[:1]}).verdict == "possible"


def test_a_contact_is_told_in_its_run_and_nothing_else_tells_it():
    contact = of("contact")
    told = judge(contact, 0.0103, PLAIN, {"effects": [WARMS], "runs": [run("cc2C", "series_resistance_ohm", 0.009)]})
    assert (told.verdict, told.size) == ("told", 0.009)
    other = judge(contact, 0.0103, PLAIN, {"effects": [WARMS], "runs": [run("cc3C", "series_resistance_ohm", -0.01)]})
    assert (other.verdict, other.new) == ("missed", ("contact_resistance@cc3C",))
    points = judge(contact, 0.0103, PLAIN, {"effects": [WARMS], "runs": [run("cc2C", "voltage_shift:voltage_V", 0.1)]})
    assert (points.verdict, points.new) == ("possible", ())


def test_a_high_current_of_one_run_is_possible_where_its_start_was_moved():
    moved = Remark("The start was moved.", "start_moved", "initial_soc@cc2C")
    of_another = Remark("The start was moved.", "start_moved", "initial_soc@cc1C")
    assert judge(of("high current"), 0.05, {}, {"findings": findings([moved])}).verdict == "possible"
    assert judge(of("high current"), 0.05, {}, {"findings": findings([of_another])}).verdict == "missed"


def test_a_run_that_was_doubted_without_the_fault_does_not_point_to_it():
    shift = run("cc2C", "voltage_shift:voltage_V", 0.02)
    doubted = {"runs": [run("cc2C", "series_resistance_ohm", -0.01)]}
    assert judge(of("stuck thermometer"), 0.5, {}, {"runs": [shift]}).verdict == "possible"
    found = judge(of("stuck thermometer"), 0.5, doubted, {"runs": [shift]})
    assert (found.verdict, found.lost) == ("missed", ("contact_resistance@cc2C",))
    moved = findings([Remark("The start was moved to 0.94.", "start_moved", "initial_soc@cc2C")])
    again = findings([Remark("The start was moved to 0.93.", "start_moved", "initial_soc@cc2C")])
    assert judge(of("high current"), 0.05, {"findings": moved}, {"findings": again}).verdict == "missed"


def test_what_is_only_possible_is_no_telling():
    lag = of("thermometer lag")
    assert judge(lag, 90.0, {}, {"immaterial": [{"name": "temperature_lag"}]}).verdict == "possible"
    beside = {"effects": [effect("clock_shift", d=3.0, beside=("temperature_lag",))]}
    assert judge(lag, 90.0, {}, beside).verdict == "possible"
    hypothesis = {"candidates": [{"name": "self_heating+temperature_lag", "probability": 0.2}]}
    assert judge(lag, 90.0, {}, hypothesis).verdict == "possible"
    hypothesis["candidates"][0]["probability"] = 0.01
    assert judge(lag, 90.0, {}, hypothesis).verdict == "missed"


def test_what_is_lost_and_new_is_counted_but_not_what_is_said_beside_or_expected():
    lag = effect("temperature_lag", THERMOMETER, tau=100.0)
    plain = {"effects": [WARMS, effect("ocv_hysteresis"), effect("entropic_ocv")]}
    after = {"effects": [lag, effect("capacity_fade", beside=("entropic_ocv",)), effect("arrhenius_resistance")]}
    found = judge(of("thermometer lag"), 90.0, plain, after, CASES["samsung_30q"].expects)
    assert found.lost == ("self_heating", "ocv_hysteresis")
    assert found.new == ("capacity_fade",)


def test_shares_are_counted_and_refusals_are_said():
    test = {"gain": 3.0, "odds": 9.0, "share": 0.0, "named": False, "why_not": "it is needed in only 0 %"}
    asked = {"a@b": {"no_candidate": True}, "c": {"test": test, "place_by_own": 1, "numbers": {"c.tau": 80.0}}}
    first = judge(of("contact"), 0.01, {}, {"runs": [run("cc2C", "series_resistance_ohm", 0.01)]})
    rows = [Row(of("contact"), 0.01, 9.0, first, {}, 1.0)]
    rows += [Row(of("thermometer lag"), 90.0, 9.0, judge(of("thermometer lag"), 90.0, PLAIN, {}), asked, 1.0)]
    found = summary(rows)
    assert {name: found["all"][name] for name in ("plantings", "told", "missed", "with_something_lost")} == {
        "plantings": 2,
        "told": 1,
        "missed": 1,
        "with_something_lost": 1,
    }
    assert found["by_fault"]["contact"]["told"] == 1
    assert any("told in 1 of 2" in sentence for sentence in sentences(found))
    said = list(refusals(rows[1]))
    assert "no candidate" in said[0]
    assert "gain 3.0 of 9.0" in said[1]
    assert dataclasses.replace(rows[1], asked={}).plain()["verdict"] == "missed"
