"""Capacity or open-circuit voltage that depends on temperature: the proposed run decides what the data do not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.independent import simulate
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.advice.next_experiment import (
    EMPTY_SOC,
    FIRST_SOC,
    Proposal,
    _possible,
    best_of_each,
    candidate_runs,
    in_words,
    propose,
)
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import Fit
from jaxmodel.lanes import compiled
from tests.diagnosis.made_cases import NOISE_V, SOC_SD, TRUE, cache_of, case_of, made_cell, run_of

HIDDEN = {"capacity_temperature": {"a": 0.0006}}
RIVALS = ("capacity_temperature", "entropic_ocv")


def rivals_of(case: Case) -> tuple[FitCache, list[Fit]]:
    """Both effects fitted beside the base model, and nothing else to choose from."""
    cache = cache_of(case, *RIVALS)
    return cache, [cache.fit([label]) for label in RIVALS]


def with_run_done(case: Case, what: str) -> Case:
    """The case with one of the candidate runs done on the true cell, by the independent simulator."""
    run = next(one for one in candidate_runs(case) if one.label == what)
    profile = {"time_s": run.measured.time_s, **run.measured.inputs}
    made = simulate("cell", TRUE, profile, HIDDEN, FIRST_SOC)
    noisy = made["voltage_V"] + NOISE_V * np.random.default_rng(7).standard_normal(made["soc"].size)
    noisy[made["soc"] < EMPTY_SOC] = np.nan
    measured = dataclasses.replace(run.measured, outputs={"voltage_V": noisy})
    done = dataclasses.replace(run, name="proposed", initial_soc=Known(FIRST_SOC, SOC_SD), measured=measured)
    return dataclasses.replace(case, runs=(*case.runs, done))


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return made_cell(tmp_path_factory.mktemp("undecided"), HIDDEN).case


@pytest.fixture(scope="module")
def undecided(case: Case) -> tuple[list[Fit], tuple[Proposal, ...]]:
    cache, rivals = rivals_of(case)
    before = compiled._kernel.cache_info()
    proposals = propose(cache, rivals)
    after = compiled._kernel.cache_info()
    assert after.hits > before.hits
    assert after.misses == before.misses, "runs of the bank are run by the programs of the case"
    return rivals, proposals


def evidence_gap(rivals: list[Fit]) -> float:
    return rivals[0].log_evidence() - rivals[1].log_evidence(rivals[0].likelihood)


def test_the_data_do_not_decide(undecided) -> None:
    rivals, _ = undecided
    assert abs(evidence_gap(rivals)) < 3.0


def test_proposals_are_feasible_and_in_order(case: Case, undecided) -> None:
    _, proposals = undecided
    sigmas = [one.sigma for one in proposals]
    assert sigmas == sorted(sigmas, reverse=True)
    assert proposals[0].sigma > 4.0 > 1.0 > proposals[-1].sigma
    assert proposals[0].repeats <= 2
    largest = max(np.abs(run.measured.inputs["current_A"]).max() for run in case.runs)
    for run in candidate_runs(case):
        assert np.abs(run.measured.inputs["current_A"]).max() <= largest


def test_the_proposed_run_decides_and_a_poor_one_does_not(case: Case, undecided) -> None:
    rivals, proposals = undecided
    runs = [one for one in proposals if not one.what.startswith("a separate measurement")]
    gaps = {}
    for proposal in (runs[0], runs[-1]):
        _, after = rivals_of(with_run_done(case, proposal.what))
        gaps[proposal.what] = evidence_gap(after) - evidence_gap(rivals)
    best, poor = gaps[runs[0].what], gaps[runs[-1].what]
    # The log evidence gains half the square of the separation: the least one is foreseen, whichever is true, and the
    # run's own noise moves it by about one sigma.
    assert np.sqrt(2.0 * best) > runs[0].sigma - 2.0
    assert np.sqrt(2.0 * best) < 2.0 * runs[0].sigma
    assert abs(poor) < 2.0


def _robot(*spans_s: float) -> Case:
    """Runs of a robot on a slope, each with 50 readings."""
    runs = []
    for number, span in enumerate(spans_s, start=1):
        inputs = {"duty": np.full(50, 0.6), "incline_deg": np.full(50, 8.0), "ambient_degC": np.full(50, 20.0)}
        run = run_of(number, inputs, {"pack_voltage_V": np.full(50, 24.0)})
        runs.append(
            dataclasses.replace(run, measured=dataclasses.replace(run.measured, time_s=np.linspace(0.0, span, 50)))
        )
    return case_of("robot", {}, runs, {})


def test_candidate_runs_last_as_long_as_the_longest_and_a_slope_is_a_load() -> None:
    designs = {run.label: run.measured for run in candidate_runs(_robot(1800.0, 60.0))}
    assert all(one.time_s[-1] == 1800.0 for one in designs.values())
    flat = designs["full drive without load at 25 degC"].inputs
    assert np.all(flat["incline_deg"] == 0.0)
    assert np.max(flat["duty"]) == 0.6
    assert np.max(designs["full drive and load at 25 degC"].inputs["incline_deg"]) == 8.0


def test_pulses_of_a_short_run_have_rests() -> None:
    (pulses,) = (
        run.measured.inputs["duty"]
        for run in candidate_runs(_robot(0.5))
        if run.label == "starts with rests at 25 degC"
    )
    assert 0.1 < np.mean(pulses > 0.0) < 0.5


def test_runs_are_proposed_for_the_two_specimens_that_differ_most() -> None:
    case = _robot(60.0, 1800.0, 60.0)
    aged = [
        dataclasses.replace(run, overrides={"cycles": Known(cycles), "capacity_Ah": Known(2.0, 0.1)})
        for run, cycles in zip(case.runs, (300.0, 40.0, 800.0), strict=True)
    ]
    designs = list(candidate_runs(dataclasses.replace(case, runs=tuple(aged))))
    assert {run.overrides["cycles"].value for run in designs} == {40.0, 800.0}
    assert {tuple(run.overrides) for run in designs} == {("cycles",)}, "what is unknown belongs to the run replaced"
    (new,) = (run for run in designs if run.label == "full drive and load with cycles = 40 at 25 degC")
    assert new.overrides["cycles"].value == 40.0
    assert len(designs) == 2 * len(list(candidate_runs(case)))
    as_stated = dataclasses.replace(case, parameters={"cycles": Known(800.0)}, runs=(case.runs[0], *aged[2:]))
    assert len(list(candidate_runs(as_stated))) == len(list(candidate_runs(case))), "one age, stated in two ways"


def test_a_run_ends_where_the_cell_is_empty_or_the_motor_has_run_away() -> None:
    predicted = np.array([[[0.5, 100.0], [0.3, 220.0], [0.2, 150.0]], [[0.3, -150.0], [0.05, -160.0], [0.3, -170.0]]])
    assert _possible(("soc", "speed_rad_s"), predicted, 200.0).tolist() == [[True, False, False], [True, False, False]]
    assert _possible(("speed_rad_s",), predicted[..., 1:], np.inf).all()


def test_what_to_do_next_is_said_in_words() -> None:
    proposals = (Proposal("a at 0 degC", 2.6), Proposal("a at 10 degC", 2.0), Proposal("a measurement of R_0", 0.1))
    said = in_words(proposals, ["one", "other"])
    assert (
        said
        == "To distinguish one and other: a at 0 degC (expected separation 2.6 sigma; 5 sigma after 4 repetitions)."
    )
    assert best_of_each(proposals) == (proposals[0], proposals[2])
    assert "no tested run or measurement is sufficient" in in_words(proposals[2:], ["one", "other"])
    assert in_words((), ["one", "other"]) == ""
