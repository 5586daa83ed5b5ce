"""Runs of a case padded to one shape give the same as each run by itself."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.records import Case, Run
from jaxmodel.case.simulation import end_of, simulate_case
from jaxmodel.model.simulation import Cutoff, Status, simulate


def cut_short(run: Run, rows: int) -> Run:
    measured = run.measured
    shorter = dataclasses.replace(
        measured,
        time_s=measured.time_s[:rows],
        inputs={name: values[:rows] for name, values in measured.inputs.items()},
        outputs={name: values[:rows] for name, values in measured.outputs.items()},
    )
    return dataclasses.replace(run, measured=shorter)


def test_runs_of_different_length_are_simulated_as_if_alone(case: Case) -> None:
    uneven = dataclasses.replace(case, runs=(case.runs[0], cut_short(case.runs[1], 20)))
    for outcome in simulate_case(uneven):
        alone = simulate(case_model(uneven, outcome.run), run_profile(outcome.run))
        assert len(outcome.table) == outcome.run.measured.time_s.size
        assert outcome.status == Status.COMPLETE
        assert outcome.sentence() == ""
        for name, values in alone.readings.items():
            np.testing.assert_allclose(outcome.table[name], values, rtol=1e-12)


def test_run_that_reaches_its_cutoff_is_empty_after_it(case: Case) -> None:
    short = cut_short(case.runs[0], 15)  # it ends before the cut-off
    stopped = dataclasses.replace(case, cutoff={"soc": 0.9}, runs=(case.runs[2], short))
    first, second = simulate_case(stopped)
    alone = simulate(case_model(stopped, first.run), run_profile(first.run), Cutoff(soc=0.9))
    end = int(alone.end_row)
    assert first.status == Status.REACHED_CUTOFF
    assert first.table["soc"].notna().to_numpy().nonzero()[0][-1] == end
    assert first.table["soc"][end] < 0.9 <= first.table["soc"][end - 1]
    assert f"reached its cut-off at {first.run.measured.time_s[end]:g} s" in first.sentence()
    (remark,) = end_of(first)
    assert (remark.code, remark.subject, remark.numbers) == ("reached_cutoff", first.run.name, {"time_s": first.end_s})
    assert second.status == Status.COMPLETE
    assert second.table.notna().all(axis=None)


def test_run_outside_the_range_of_the_equations_says_so(case: Case) -> None:
    hot = dataclasses.replace(
        case.runs[0].measured, inputs=case.runs[0].measured.inputs | {"ambient_degC": np.full(61, 90.0)}
    )
    (outcome,) = simulate_case(dataclasses.replace(case, runs=(dataclasses.replace(case.runs[0], measured=hot),)))
    assert not outcome.table["valid"].all()
    assert "is outside the valid range of the cell's equations" in outcome.sentence()
    assert [one.code for one in end_of(outcome)] == ["outside_valid_range"]
