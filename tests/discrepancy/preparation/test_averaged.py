"""Fewer rows: the mean voltage belongs to the mean current, and nothing is lost of what was counted."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from discrepancy.noise.instrument import NoiseModel
from discrepancy.preparation.averaged import averaged, rows_of_a_block
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Case
from jaxmodel.simulate import simulate
from tests.discrepancy.made_cases import small_cell

ROWS = 3


@pytest.fixture(scope="module")
def case() -> Case:
    return small_cell({}, seed=1)


def test_only_long_cases_are_averaged(case: Case) -> None:
    rows = sum(run.measured.time_s.size for run in case.runs if run.split == "fit")
    assert rows_of_a_block(case, rows) == 1
    assert rows_of_a_block(case, rows - 1) == 2
    assert averaged(case, 1) is case
    assert rows_of_a_block(dataclasses.replace(case, kind="motor"), 10) == 1


def test_charge_and_means_are_kept(case: Case) -> None:
    case = dataclasses.replace(case, sensors=case.sensors | {"current_A": 0.03})
    assert averaged(case, ROWS).sensors["current_A"] == pytest.approx(0.03 / np.sqrt(ROWS))
    for before, after in zip(case.runs, averaged(case, ROWS).runs, strict=True):
        one, other = before.measured, after.measured
        assert other.time_s[0] == one.time_s[0]
        assert other.time_s[-1] == one.time_s[-1]
        assert other.time_s.size < 0.4 * one.time_s.size
        for name, values in one.inputs.items():
            charge = np.sum(np.diff(one.time_s) * values[1:])
            assert np.sum(np.diff(other.time_s) * other.inputs[name][1:]) == pytest.approx(charge, rel=1e-12)
        np.testing.assert_allclose(other.outputs["voltage_V"][1], one.outputs["voltage_V"][1 : 1 + ROWS].mean())
        assert other.outputs["voltage_V"][0] == one.outputs["voltage_V"][0]


def test_rows_that_are_not_evenly_apart_stay(case: Case) -> None:
    run = case.runs[0]
    time_s = np.cumsum(np.where(np.arange(run.measured.time_s.size) % 2, 0.1, 10.0))
    uneven = dataclasses.replace(run, measured=dataclasses.replace(run.measured, time_s=time_s))
    kept = averaged(dataclasses.replace(case, runs=(uneven,)), ROWS).runs[0].measured
    np.testing.assert_array_equal(kept.time_s, time_s)
    np.testing.assert_allclose(kept.inputs["current_A"], run.measured.inputs["current_A"])


def test_missing_readings_leave_no_false_mean(case: Case) -> None:
    run = case.runs[0]
    few, many = (np.array(run.measured.outputs["voltage_V"]) for _ in range(2))
    few[5] = np.nan
    many[np.arange(many.size) % 2 != 0] = np.nan
    for values, expected in ((few, True), (many, False)):
        outputs = run.measured.outputs | {"voltage_V": values}
        holed = dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs))
        found = averaged(dataclasses.replace(case, runs=(holed,)), ROWS).runs[0].measured.outputs["voltage_V"]
        assert np.isnan(found[2]) == expected
        assert np.isnan(found).sum() <= 1


def test_the_model_of_the_means_is_the_mean_of_the_model(case: Case) -> None:
    """Of three rows three seconds apart, under pulses of 6 A: to what the RC pair moves in half of nine seconds."""
    for before, after in zip(case.runs, averaged(case, ROWS).runs, strict=True):
        whole = simulate(case_model(case, before), run_profile(before))
        means = simulate(case_model(case, after), run_profile(after))
        of_whole = np.asarray(whole.readings["voltage_V"])[1:]
        count = (of_whole.size // ROWS) * ROWS
        expected = of_whole[:count].reshape(-1, ROWS).mean(axis=1)
        found = np.asarray(means.readings["voltage_V"])[1 : 1 + expected.size]
        assert np.sqrt(np.mean((found - expected) ** 2)) < 0.02
        assert abs(np.mean(found - expected)) < 5e-3


def test_noise_of_means() -> None:
    white = NoiseModel(0.003, 0.0, "stated (0.003)", stated=0.003)
    assert white.of_means(1) is white
    assert white.of_means(9).sd == pytest.approx(0.001)
    assert white.of_means(9).stated == pytest.approx(0.001)
    rounded = NoiseModel(0.003, 0.0, "", quantum=0.009)
    assert rounded.of_means(9).sd == pytest.approx(0.009 / np.sqrt(12.0))
    drawn = np.random.default_rng(0).standard_normal((20_000, 8))
    coloured = np.empty_like(drawn)
    coloured[:, 0] = drawn[:, 0]
    for step in range(1, 8):
        coloured[:, step] = 0.6 * coloured[:, step - 1] + 0.8 * drawn[:, step]
    slow = NoiseModel(1.0, 0.6, "")
    assert slow.of_means(8).sd == pytest.approx(coloured.mean(axis=1).std(), rel=0.2)
