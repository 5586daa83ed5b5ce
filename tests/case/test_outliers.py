"""Outliers are excluded if no input explains them; changes of the hardware are kept."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.case.outliers import outliers, without_outliers
from tests.diagnosis.made_cases import case_of, run_of

ROWS = 2000
SD = 0.002


def cell(seed: int = 0, current: np.ndarray | None = None, noise: float = SD, digits: int = 6):
    """A run of pulses of twenty rows; the voltage follows the current, and recovers slowly."""
    rng = np.random.default_rng(seed)
    current = np.where(np.arange(ROWS) % 100 < 20, 5.0, 0.0) if current is None else current
    slow = np.convolve(current, np.exp(-np.arange(200) / 30.0) / 30.0)[:ROWS]
    voltage = 3.9 - 0.03 * current - 0.02 * slow - 1e-4 * np.arange(ROWS) + noise * rng.standard_normal(ROWS)
    inputs = {"current_A": current, "ambient_degC": np.full(ROWS, 25.0)}
    return run_of(1, inputs, {"voltage_V": np.round(voltage, digits)})


def spoilt(run, rows, value):
    voltage = run.measured.outputs["voltage_V"].copy()
    voltage[rows] = value
    return run_of(1, run.measured.inputs, {"voltage_V": voltage})


@pytest.mark.parametrize("stated", [0.0, SD])
@pytest.mark.parametrize(("rows", "value"), [([50], 0.0), ([50, 51, 52], 0.0), ([777], 3.95), ([340, 1290], np.inf)])
def test_what_is_far_off_and_back_while_nothing_changes_is_an_outlier(stated, rows, value):
    value = 9.99 if value == np.inf else value
    found = outliers(spoilt(cell(), rows, value), "voltage_V", stated)
    assert list(np.flatnonzero(found)) == rows


@pytest.mark.parametrize("stated", [0.0, SD])
@pytest.mark.parametrize("digits", [6, 3, 2])
def test_what_the_hardware_does_is_none(stated, digits):
    drive = np.random.default_rng(1).normal(0.0, 3.0, ROWS)
    alternating = np.where(np.arange(ROWS) % 50 == 7, 8.0, 0.0)  # a pulse of one row
    for current in (None, drive, alternating):
        assert not outliers(cell(2, current, digits=digits), "voltage_V", stated).any()


def test_a_step_a_gap_and_a_pause_are_none():
    run = cell()
    assert not outliers(spoilt(run, slice(1000, ROWS), 3.0), "voltage_V").any(), "it stays there"
    assert not outliers(spoilt(run, [50], np.nan), "voltage_V").any()
    assert not outliers(spoilt(run, slice(0, ROWS), np.nan), "voltage_V").any()
    assert not outliers(spoilt(run, [0], 0.0), "voltage_V").any(), "there is nothing before it"
    one = spoilt(run, [50], 0.0)
    late = run.measured.time_s + np.where(np.arange(ROWS) >= 50, 3600.0, 0.0)
    paused = dataclasses.replace(one, measured=dataclasses.replace(one.measured, time_s=late))
    assert not outliers(paused, "voltage_V").any(), "an hour before it nothing was read"


def test_a_pulse_of_the_input_beside_noise_of_its_sensor_explains_a_reading():
    current = 0.01 * np.random.default_rng(5).standard_normal(ROWS)
    current[600] += 5.0
    run = cell(3, current)
    assert abs(run.measured.outputs["voltage_V"][600] - 3.84) > 0.1, "the pulse is to show"
    assert not outliers(run, "voltage_V").any()


def test_exclusions_are_reported_and_frequent_events_are_kept():
    clean = cell()
    case = case_of("cell", {}, [spoilt(clean, [250, 777], 0.0)], {"voltage_V": SD})
    cleaned, (remark,) = without_outliers(case)
    assert remark.startswith("2 readings of voltage_V excluded as outliers")
    assert (remark.code, remark.subject) == ("outliers_excluded", "voltage_V")
    assert remark.numbers == {"readings": 2.0, "share": 2.0 / ROWS, "value": 0.0, "time_s": 750.0}
    assert "0 at" in remark
    assert list(np.flatnonzero(np.isnan(cleaned.runs[0].measured.outputs["voltage_V"]))) == [250, 777]
    assert np.isfinite(case.runs[0].measured.outputs["voltage_V"]).all(), "the case given is as it was"

    often = case_of("cell", {}, [spoilt(clean, np.arange(60, ROWS, 100), 0.0)], {"voltage_V": SD})
    cleaned, (remark,) = without_outliers(often)
    assert "20 readings of voltage_V excluded" in remark
    assert "1.0% of its readings, so look at the sensor" in remark
    assert np.isnan(cleaned.runs[0].measured.outputs["voltage_V"]).sum() == 20

    rows = np.flatnonzero(np.isin(np.arange(ROWS) % 100, [30, 40, 50, 60, 70, 80]))
    most = case_of("cell", {}, [spoilt(clean, rows, 0.0)], {"voltage_V": SD})
    kept, (remark,) = without_outliers(most)
    assert "6.0% of its rows, too many for outliers, so they are kept" in remark
    assert (remark.code, remark.numbers["share"]) == ("outliers_kept", pytest.approx(0.06))
    assert np.isfinite(kept.runs[0].measured.outputs["voltage_V"]).all()
