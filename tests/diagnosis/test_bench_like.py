"""Tests of the whole diagnosis on small cells with realistic measurements.

Each case is diagnosed once, and only its answer is read. The data are tested first: with the true model only noise
remains, and what is hidden is far above it.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.discrepancy.visible import residuals, stands_out, with_truth, without
from jaxmodel.case.known import Table
from jaxmodel.case.records import Case
from jaxmodel.diagnosis import diagnose
from tests.diagnosis import bench_cases as made
from tests.diagnosis.bench_cases import NOISE, Made

CLAIMED = 0.5
# By what the hidden things are to stand out, so that no miss is excused.
CLEAR_SIGMA = 15.0


def answer_of(case: Case) -> dict[str, Any]:
    """Return the answer of a diagnosis; all that is asked of the package."""
    return diagnose(case).answer()


CASES: dict[str, dict[str, Any]] = {
    "three effects": {"which": "three", "seed": 1},
    "four with a fault": {"which": "four", "seed": 2},
    "wrong ocv": {"seed": 3, "stated": {"ocv": made.TRUE["ocv"] | {"voltage_V": (made.OCV + made.OCV_OFF_V).tolist()}}},
    "wrong resistance": {
        "seed": 4,
        "stated": {"R_ints": made.TRUE["R_ints"] | {"ohm": (made.R_INTS * np.exp(made.R_INTS_OFF)).tolist()}},
    },
    "bad run": {"seed": 5, "contact_ohm": {made.BAD_RUN: made.CONTACT_OHM}},
    "noise stated too small": {
        "which": "diffusion",
        "seed": 6,
        "stated_noise": {"voltage_V": 0.2 * NOISE["voltage_V"]},
    },
    "noise stated too large": {
        "which": "diffusion",
        "seed": 6,
        "stated_noise": {"voltage_V": 5.0 * NOISE["voltage_V"]},
    },
    "capacity far off": {"seed": 7, "stated": {"capacity_Ah": (made.TRUE["capacity_Ah"] + 0.2, 0.04)}},
    "drifting contact": {"which": "arrhenius", "seed": 8, "drift_ohm_per_h": made.DRIFT_OHM_PER_H},
    "cold check run": {"seed": 9, "cold_check": True},
    "stuck thermometer": {"which": "three", "seed": 10, "stuck": True},
    "uneven logger": {"which": "three", "seed": 11, "uneven": True},
}


@pytest.fixture(scope="session")
def bench(tmp_path_factory: pytest.TempPathFactory):
    """Return a made case by name."""

    @functools.cache
    def case(name: str) -> Made:
        folder: Path = tmp_path_factory.mktemp("bench") / name.replace(" ", "-")
        return made.make(folder, **CASES[name])

    return case


@pytest.fixture(scope="session")
def said(bench):
    """Return the answer about a made case by name."""
    return functools.cache(lambda name: answer_of(bench(name).case))


def claimed(answer: dict[str, Any]) -> set[str]:
    """The effects that an answer names with some belief."""
    return {effect["name"] for effect in answer["effects"] if effect["probability"] >= CLAIMED}


def remarked(answer: dict[str, Any], pattern: str) -> bool:
    """Whether a remark speaks of something."""
    return any(re.search(pattern, remark, re.IGNORECASE) for remark in answer.get("remarks") or ())


# The made data.
def truth(one: Made) -> Case:
    """The case with all that is hidden in its model; the drop of contacts is added to the readings."""
    tables = {
        name: Table(np.array(table["soc"]), np.array(table["voltage_V" if name == "ocv" else "ohm"]))
        for name, table in one.tables.items()
    }
    case = with_truth(one.case, one.numbers, one.starts, one.effects, tables, one.of_runs)
    runs = []
    for run in case.runs:
        outputs = run.measured.outputs
        outputs = outputs | {"voltage_V": outputs["voltage_V"] + one.drop_V[run.name]}
        runs.append(dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs)))
    return dataclasses.replace(case, runs=tuple(runs))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_of_the_truth_nothing_but_the_noise_is_left(bench, name: str):
    case = truth(bench(name))
    for place, (run, left) in enumerate(zip(case.runs, residuals(case), strict=True)):
        for channel, values in zip(sorted(run.measured.outputs), left, strict=True):
            if name == "stuck thermometer" and place == made.STUCK_RUN and channel != "voltage_V":
                values = values[: made.STUCK_FROM]
            values = values[np.isfinite(values)]
            # A current that is logged coarsely adds its own.
            noise = np.hypot(NOISE[channel], 0.13 * made.COARSE_A / np.sqrt(12.0) if name == "uneven logger" else 0.0)
            assert np.sqrt(np.mean(values**2)) == pytest.approx(noise, rel=0.15), (run.name, channel)
            if name != "uneven logger":
                assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.2, (run.name, channel)


def lacking(name: str, one: Made, true: Case) -> dict[str, Case]:
    """By name, the case in whose model one hidden thing is not."""
    found = {effect: without(true, effect) for effect in one.effects}
    for table in {"ocv", "R_ints"} & set(CASES[name].get("stated", {})):
        found[table] = dataclasses.replace(true, tables={**true.tables, table: one.case.tables[table]})
    if any(np.any(drop) for drop in one.drop_V.values()):
        runs = [dataclasses.replace(t, measured=r.measured) for t, r in zip(true.runs, one.case.runs, strict=True)]
        found["contact"] = dataclasses.replace(true, runs=tuple(runs))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name not in ("capacity far off", "cold check run")])
def test_what_is_hidden_stands_out(bench, name: str):
    one = bench(name)
    true = truth(one)
    seen = stands_out(true, NOISE, lacking(name, one, true))
    assert seen
    assert {hidden: sigma for hidden, sigma in seen.items() if sigma < CLEAR_SIGMA} == {}


# What the diagnosis says of them.
@pytest.mark.slow
def test_three_effects_at_once_are_named(said):
    answer = said("three effects")
    assert claimed(answer) == set(made.THREE)
    assert answer["verdict"] == "missing_effect"


@pytest.mark.slow
def test_four_effects_are_named_of_which_one_is_a_sensor_fault(said):
    answer = said("four with a fault")
    assert claimed(answer) == set(made.FOUR)
    fault = next(effect for effect in answer["effects"] if effect["name"] == "current_offset")
    assert fault["parameters"]["column"] == "current_A"
    assert answer["verdict"] == "missing_effect"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "port", "off"),
    [
        ("wrong ocv", "open_circuit_voltage", made.OCV_OFF_V),
        ("wrong resistance", "series_resistance", made.R_INTS_OFF),
    ],
)
def test_a_wrong_table_is_reported_as_that_table_over_soc(said, name: str, port: str, off: np.ndarray):
    answer = said(name)
    assert claimed(answer) == set()
    assert answer["verdict"] == "adequate"
    curves = [curve for curve in answer["curves"] if curve["port"] == port]
    assert [curve["over"] for curve in curves] == ["soc"]
    assert {curve["port"] for curve in answer["curves"]} == {port}
    at, value = np.array(curves[0]["at"]), np.array(curves[0]["value"])
    driven = (at >= 0.4) & (at <= 0.9)
    true = -np.interp(at, made.SOC, off)
    assert np.corrcoef(value[driven], true[driven])[0, 1] > 0.9


@pytest.mark.slow
def test_one_bad_run_is_reported_as_that_run(said):
    answer = said("bad run")
    assert [run["file"] for run in answer["runs"]] == [f"run-{made.BAD_RUN + 1:02d}.csv"]
    assert claimed(answer) == set()
    assert answer["verdict"] == "adequate"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["noise stated too small", "noise stated too large"])
def test_a_noise_that_is_stated_wrong_changes_no_name(said, name: str):
    answer = said(name)
    assert claimed(answer) == set(made.DIFFUSION)
    assert answer["verdict"] == "missing_effect"
    assert remarked(answer, r"\b(noise|sd|scatter)\b")


@pytest.mark.slow
def test_a_capacity_far_from_its_stated_value_is_adequate_with_a_remark(said):
    answer = said("capacity far off")
    assert answer["verdict"] == "adequate"
    assert claimed(answer) == set()
    assert remarked(answer, "capacity[_ ]Ah")


@pytest.mark.slow
def test_a_drifting_contact_is_reported_with_the_other_effects(said):
    answer = said("drifting contact")
    assert set(made.ARRHENIUS) <= claimed(answer) <= {*made.ARRHENIUS, "contact_drift"}
    over_time = any("time" in str(curve["over"]) for curve in answer.get("curves") or ())
    assert "contact_drift" in claimed(answer) or answer["verdict"] == "unknown_effect" or over_time


@pytest.mark.slow
def test_a_condition_of_a_check_run_alone_is_not_called_adequate(said):
    answer = said("cold check run")
    assert answer["verdict"] in ("undecided", "unknown_effect", "missing_effect")
    beyond = [each for each in answer["extrapolated"] if each["condition"] == "ambient_degC"]
    assert [each["file"] for each in beyond] == ["run-04.csv"]


@pytest.mark.slow
def test_a_stuck_thermometer_is_reported_and_changes_no_name(said):
    answer = said("stuck thermometer")
    of_thermometer = {e["name"] for e in answer["effects"] if e["parameters"].get("column") == "cell_temperature_degC"}
    assert claimed(answer) - of_thermometer == set(made.THREE)
    assert of_thermometer or remarked(answer, r"cell_temperature_degC|thermometer")


@pytest.mark.slow
def test_uneven_times_gaps_and_a_coarse_current_change_no_name(said):
    answer = said("uneven logger")
    assert claimed(answer) == set(made.THREE)
    assert answer["verdict"] == "missing_effect"
