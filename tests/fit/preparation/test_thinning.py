"""Thinned runs keep charge, heat, and the readings of their windows."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.measurements import Measured
from jaxmodel.fit.preparation.thinning import WINDOW, start_rows, thinned, thinned_rows
from jaxmodel.fit.settings import SETTINGS
from jaxmodel.model.simulation import simulate
from tests.fit.preparation.made import drive

ROWS = 12_000


def _integrals(measured: Measured, name: str) -> tuple[float, float]:
    values, durations = measured.inputs[name][1:], np.diff(measured.time_s)
    return float(values @ durations), float(values**2 @ durations)


def test_charge_is_exact_and_ohmic_heat_nearly():
    measured = drive(ROWS)
    few = thinned_rows(measured, 3000)
    charge, heat = _integrals(measured, "current_A")
    assert few.time_s.size < 3300
    assert _integrals(few, "current_A")[0] == pytest.approx(charge, rel=1e-12)
    assert _integrals(few, "current_A")[1] == pytest.approx(heat, rel=2e-3)


def test_every_reading_that_is_kept_was_measured_at_that_time():
    measured = drive(ROWS)
    few = thinned_rows(measured, 3000)
    kept = np.isfinite(few.outputs["voltage_V"])
    assert np.sum(kept) > 0.6 * 3000
    at = np.searchsorted(measured.time_s, few.time_s[kept])
    np.testing.assert_array_equal(measured.time_s[at], few.time_s[kept])
    np.testing.assert_array_equal(measured.outputs["voltage_V"][at], few.outputs["voltage_V"][kept])
    np.testing.assert_array_equal(measured.inputs["current_A"][at], few.inputs["current_A"][kept])


def test_a_rare_pulse_is_in_a_window():
    measured = drive(ROWS)
    current = np.full(ROWS, 0.5)
    current[7310:7320] = 20.0
    few = thinned_rows(dataclasses.replace(measured, inputs=measured.inputs | {"current_A": current}), 1500)
    readings = np.isfinite(few.outputs["voltage_V"])
    assert np.sum(few.inputs["current_A"][readings] == 20.0) == 10


def test_a_duty_stays_within_its_limits():
    rng = np.random.default_rng(3)
    duty = np.where(rng.random(ROWS) < 0.1, 1.0, 0.05)
    measured = dataclasses.replace(drive(ROWS), inputs={"duty": duty, "ambient_degC": np.full(ROWS, 20.0)})
    few = thinned_rows(measured, 2000)
    assert few.inputs["duty"].max() <= 1.0
    assert few.inputs["duty"].min() >= 0.05 - 1e-12
    assert _integrals(few, "duty")[0] == pytest.approx(_integrals(measured, "duty")[0], rel=1e-12)


def test_the_model_reads_the_same_in_the_windows():
    measured = drive(ROWS)
    frame = {"time_s": measured.time_s} | measured.inputs | measured.outputs
    case = Case.from_dataframes(
        {"drive": pd.DataFrame(frame), "start": pd.DataFrame(frame)},
        kind="cell",
        check=["start"],
        parameters={"capacity_Ah": {"value": 10.0, "sd": 0.1}},
        effects={"self_heating": {"C_th": 60.0, "hA": 0.2}},
    )
    few = thinned(case, dataclasses.replace(SETTINGS, most_steps=3000))
    whole, part = (
        simulate(case_model(one, one.runs[0]), run_profile(one.runs[0])).readings["voltage_V"] for one in (case, few)
    )
    kept = np.isfinite(few.runs[0].measured.outputs["voltage_V"])
    at = np.searchsorted(measured.time_s, few.runs[0].measured.time_s[kept])
    difference = np.asarray(part)[kept] - np.asarray(whole)[at]
    # The current is noise of 3 A from second to second, the worst that there is for averages: it moves the voltage by
    # 150 mV. In drive cycles the difference is a tenth of this.
    assert np.sqrt(np.mean(difference**2)) < 1e-3
    assert np.max(np.abs(difference)) < 5e-3
    assert few.runs[1].measured.time_s.size == start_rows(case.runs[1], SETTINGS).stop


def test_short_cases_are_not_touched():
    measured = drive(5 * WINDOW)
    assert thinned_rows(measured, 5 * WINDOW) is measured


def test_a_run_whose_windows_are_all_of_it_stays():
    measured = drive(250)
    assert thinned_rows(measured, 200) is measured
