"""The physics-based proving ground: seeds draw what they drew, twins decide what is right, answers are judged."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import typer

from benchmarks.physics.__main__ import numbers
from benchmarks.physics.base import OCV_SOC, RESISTANCE_SOC, Base, drops
from benchmarks.physics.draw import EVERY, FAULTS, MOST_J_MOL, REFERENCE_DEGC, draw
from benchmarks.physics.judge import Row, is_named, summary
from benchmarks.physics.profiles import rows_of_steps, steps
from benchmarks.physics.reality import Trace
from benchmarks.physics.sets import LEFT_OUT, SETS
from benchmarks.physics.simulate import Simulated, SimulatedRun, keep, kept
from benchmarks.physics.table import sentences
from benchmarks.physics.truth import ALWAYS_ALLOWED, NAMES, Truth, decide, recalibrated, truth_of
from benchmarks.physics.writing import COLUMN_OF, misread, write_case
from jaxmodel.case.reading import read_case
from jaxmodel.effects import CATALOGUE

CELLS = [draw(7, index) for index in range(80)]


def made_up(index: int) -> Simulated:
    """A cell whose reality is its own base model, and whose twins are 20 mV higher while it is driven."""
    recipe = draw(7, index)
    base = Base(
        recipe.capacity_Ah,
        3.0 + OCV_SOC,
        {name: np.full(RESISTANCE_SOC.size, 0.02 / recipe.capacity_Ah) for name in ("R_ints", "R_TS", "R_TL")},
        {
            name: np.full(RESISTANCE_SOC.size, farad * recipe.capacity_Ah)
            for name, farad in (("C_TS", 5e2), ("C_TL", 1e4))
        },
        0.0,
    )
    runs = []
    for plan in recipe.plans:
        time_s, current = rows_of_steps(steps(plan, base.capacity_Ah), 20.0)
        voltage = drops(base, time_s, current, plan.first_soc).voltage_V
        degC = np.full(time_s.size, plan.ambient_degC)
        moved = voltage + 0.02 * np.sin(time_s / 100.0)
        twins = {name: Trace(time_s, current, moved, degC) for name in recipe.hidden if plan.split == "fit"}
        runs.append(SimulatedRun(plan, plan.first_soc, Trace(time_s, current, voltage, degC), twins))
    return Simulated(recipe, base, tuple(runs))


def said(verdict: str, *names: str, after: float = 0.003, tried: float = 0.002, **more: Any) -> dict[str, Any]:
    effects = [{"name": name, "parameters": {"E_i": {"value": 30e3, "sd": 5e3}}} for name in names]
    error = {"voltage_V": {"noise_floor": 0.001, "before": {"check": 0.005}, "after": {"check": after}}}
    ladder = [{"name": name, "error": {"voltage_V": {"check": e}}} for name, e in (("first", tried), ("last", after))]
    return {"verdict": verdict, "effects": effects, "error": error, "ladder": ladder, "seconds": 5.0} | more


def row(expected: tuple[str, ...], answer: dict[str, Any], reference: float | None = None, name: str = "") -> Row:
    allowed = {*ALWAYS_ALLOWED, *expected}
    errors = {} if reference is None else {"errors": {"voltage_V": {"check": reference}}}
    return Row(name, "", Truth(expected, tuple(allowed), ("missing_effect",), {}), answer, errors)


def test_a_seed_draws_the_same_cell_and_another_after_a_failure():
    assert draw(7, 3) == draw(7, 3)
    assert draw(7, 3).name == draw(7, 3).name
    assert len({draw(7, 3).name, draw(7, 3, attempt=1).name, draw(7, 4).name, draw(8, 3).name}) == 4


def test_every_fourth_cell_hides_nothing_but_a_sensor_fault_and_all_others_hide_something():
    for recipe in CELLS:
        special = recipe.index % EVERY == EVERY - 1
        assert recipe.null == special
        if not special:
            assert recipe.hidden
            assert not recipe.fault
        elif not recipe.fault.startswith("temperature"):
            assert not recipe.hidden
            assert {plan.ambient_degC for plan in recipe.plans} == {REFERENCE_DEGC}


def test_draws_keep_to_what_is_stated():
    assert not SETS.keys() & LEFT_OUT.keys()
    for recipe in CELLS:
        assert all(0.0 <= energy <= MOST_J_MOL for energy in recipe.energies_J_mol.values())
        assert recipe.thermometer == ("cell_temperature_degC" in recipe.noise)
        assert recipe.heat == "lumped" or not recipe.thermometer
        assert (recipe.hysteresis == "silicon") <= SETS[recipe.parameter_set].composite
        assert recipe.hysteresis == "none" or not SETS[recipe.parameter_set].half_cell
        assert {plan.split for plan in recipe.plans} == {"fit", "check"}
        assert recipe.thermometer or not recipe.fault.startswith("temperature")


def test_names_are_those_of_the_catalogue():
    assert set(FAULTS) == COLUMN_OF.keys()
    assert {*FAULTS, *ALWAYS_ALLOWED} <= CATALOGUE.keys()
    for either in NAMES.values():
        ways = (one.partition(":") for one in either.split("|"))
        assert all(name == "curve" or name in CATALOGUE for name, _, _ in ways)


def test_a_current_holds_until_its_row_and_no_charge_is_lost():
    for plan in CELLS[0].plans:
        parts = steps(plan, 5.0)
        time_s, current = rows_of_steps(parts, plan.every_s)
        assert np.all(np.diff(time_s) > 0.0)
        assert np.sum(np.diff(time_s) * current[1:]) == pytest.approx(sum(s * i for s, i in parts), abs=1e-6)


def test_what_numbers_can_take_is_no_hidden_thing():
    rows = np.linspace(0.0, 1.0, 500)
    designs = [0.01 * np.column_stack([rows, np.sin(9.0 * rows), np.ones(rows.size)]) for _ in range(2)]
    taken = [designs[0] @ [0.5, 0.3, 1.0], designs[1] @ [0.5, 0.3, -1.0]]  # the last number is of each run
    assert np.max(np.abs(recalibrated(designs, taken, 1e-3))) < 1e-3
    other = [1e-2 * np.sin(60.0 * rows), 1e-2 * np.sin(60.0 * rows)]
    assert np.std(recalibrated(designs, other, 1e-3)) == pytest.approx(np.std(other[0]), rel=0.05)


def test_material_things_are_expected_and_small_ones_allowed():
    sizes = {
        "activation": {"voltage_V": {"moves": 9e-3, "left": 5e-3, "noise": 2e-3}},
        "entropy": {"voltage_V": {"moves": 9e-3, "left": 1e-3, "noise": 2e-3}},
    }
    truth = decide(sizes, "")
    assert truth.expected == (NAMES["activation"],)
    assert {"arrhenius_resistance", "entropic_ocv", *ALWAYS_ALLOWED} <= set(truth.allowed)
    assert "self_heating" not in truth.allowed
    assert "adequate" not in truth.verdicts
    fault = decide({"current_gain": {"voltage_V": {"moves": 9e-3, "left": 5e-3, "noise": 2e-3}}}, "current_gain")
    assert fault.expected == ("current_gain",)
    assert "sensor_fault" in fault.verdicts
    assert "adequate" in decide({}, "").verdicts


def test_a_name_is_right_in_each_of_its_ways():
    assert is_named("a|b", said("missing_effect", "b"))
    assert is_named("a|charge_transfer:E_i", said("missing_effect", "charge_transfer"))
    vague = {"name": "charge_transfer", "parameters": {"E_i": {"value": 5e3, "sd": 5e3}}}
    assert not is_named("a|charge_transfer:E_i", {"effects": [vague]})
    assert is_named("a|curve:entropy_coefficient", said("adequate", curves=[{"port": "entropy_coefficient"}]))
    assert not is_named("a|curve:entropy_coefficient", said("adequate"))


def test_an_answer_is_right_with_all_that_is_expected_and_nothing_wrong():
    assert row(("a",), said("missing_effect", "a", "slow_diffusion")).right
    assert row(("a",), said("missing_effect", "slow_diffusion")).missed == ("a",)
    wrong = row(("a",), said("missing_effect", "a", "core_temperature"))
    assert wrong.wrong == ("core_temperature",)
    assert not wrong.right
    assert not row((), {"failed": "not done after 5 s", "seconds": 5.0}).right
    assert row((), said("adequate")).right


def test_the_held_out_error_is_over_the_best_of_all_that_was_tried():
    assert row((), said("adequate", after=0.003, tried=0.002)).ratios() == {"voltage_V": pytest.approx(1.5)}
    assert row((), said("adequate", after=0.003, tried=0.002), reference=0.001).ratios()["voltage_V"] == pytest.approx(
        3
    )
    assert row((), said("adequate", after=0.002, tried=0.004), reference=0.009).ratios()["voltage_V"] == 1.0


def test_a_summary_counts_failures_as_not_right_and_says_it_in_sentences():
    rows = [
        row(("a",), said("missing_effect", "a", after=0.004, tried=0.002)),
        row(("a",), said("undecided", "core_temperature", after=0.002, tried=0.002), name="other"),
        row(("a",), {"failed": "not done after 5 s", "seconds": 5.0}),
        row(("a",), {}),
    ]
    found = summary(rows)
    assert (found["cells"], found["asked"], found["right"]) == (4, 3, {"hits": 1, "of": 3})
    assert found["with_a_wrong_name"] == {"hits": 1, "of": 2}
    assert found["expected_named"] == [1, 2]
    assert found["geometric_mean_ratio"] == pytest.approx(np.sqrt(2.0))
    assert found["median_ratio"] == pytest.approx(1.5)
    assert any("1 of 3 (33%)" in sentence for sentence in sentences(found))
    assert list(sentences(summary([row(("a",), {})]))) == ["0 of 1 cells are diagnosed, 0 of these failed."]


def test_a_kept_cell_is_the_same_and_its_case_can_be_read(tmp_path):
    found = made_up(0)
    keep(found, tmp_path)
    again = kept(found.recipe, tmp_path)
    assert truth_of(again) == truth_of(found)
    assert truth_of(found).expected == tuple(NAMES[thing] for thing in found.recipe.hidden)  # 20 mV, each of them
    write_case(again, tmp_path / "case")
    case = read_case(tmp_path / "case")
    assert [run.split for run in case.runs] == [plan.split for plan in found.recipe.plans]
    read, true = case.runs[0].measured, found.runs[0].trace
    noise = found.recipe.noise["voltage_V"]
    assert np.std(read.outputs["voltage_V"] - true.voltage_V) == pytest.approx(noise, rel=0.2)
    assert case.sensors.keys() == found.recipe.noise.keys()


def test_a_fault_that_the_numbers_take_is_not_expected():
    found = made_up(0)
    faulty = dataclasses.replace(found.recipe, fault="voltage_offset", fault_size=0.01)
    offset = truth_of(dataclasses.replace(found, recipe=faulty))
    assert "voltage_offset" in offset.allowed
    assert "voltage_offset" not in offset.expected  # a constant is the base's `ocv_offset_V` too
    faulty = dataclasses.replace(found.recipe, fault="current_offset", fault_size=0.05 * found.recipe.capacity_Ah)
    assert "current_offset" in truth_of(dataclasses.replace(found, recipe=faulty)).expected


def test_sensors_misread_as_the_catalogue_says():
    time_s, values = np.arange(0.0, 500.0), np.linspace(20.0, 30.0, 500)
    assert misread("temperature_offset", 1.5, time_s, values) == pytest.approx(values + 1.5)
    assert misread("current_gain", 0.02, time_s, values) == pytest.approx(1.02 * values)
    late = misread("temperature_lag", 50.0, time_s, values)
    assert late[0] == values[0]
    assert values[-1] - late[-1] == pytest.approx(50.0 * 10.0 / 499.0, rel=0.02)


def test_numbers_of_cells_are_read_from_a_list():
    assert numbers("0,3,10-12", 60) == [0, 3, 10, 11, 12]
    assert numbers("", 3) == [0, 1, 2]
    for wrong in ("a", "60"):
        with pytest.raises(typer.BadParameter):
            numbers(wrong, 60)
