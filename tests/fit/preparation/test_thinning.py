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


def _pulses() -> Measured:
    """Return a pulse test at 1 s: rests and slow discharges of minutes, short pulses, and a dive at the end."""
    rng = np.random.default_rng(2)
    cycle = np.concatenate([np.full(30, 3.0), np.full(40, 0.0), np.full(10, -2.0), np.zeros(600), np.full(700, 1.0)])
    current = np.tile(np.append(cycle, np.zeros(1800)), 4)
    time = np.arange(float(current.size))
    dive = 1.5 * np.clip((time - time[-400]) / 400.0, 0.0, None) ** 2
    voltage = 3.7 - 0.03 * current - 1e-5 * np.cumsum(current) - dive + 5e-4 * rng.standard_normal(time.size)
    temperature = np.where(np.arange(time.size) % 10 == 0, 25.0 + 0.01 * rng.standard_normal(time.size), np.nan)
    inputs = {"current_A": current + 2e-3 * rng.standard_normal(time.size), "ambient_degC": np.full(time.size, 25.0)}
    return Measured(time, inputs, {"voltage_V": voltage, "cell_temperature_degC": temperature})


def test_steady_inputs_are_read_all_along():
    measured = _pulses()
    few = thinned_rows(measured, 1500)
    assert few.time_s.size < 1650
    read_s = few.time_s[np.isfinite(few.outputs["voltage_V"])]
    assert np.diff(read_s).max() < 200.0  # of 3.5 hours
    # Where the voltage falls steps are short, and readings no denser than elsewhere.
    voltage, span = measured.outputs["voltage_V"], np.ptp(measured.outputs["voltage_V"])
    fallen = voltage[np.searchsorted(measured.time_s, few.time_s[few.time_s > measured.time_s[-400]])]
    assert np.abs(np.diff(fallen)).max() < 0.05 * span
    assert 2 <= np.sum(read_s > measured.time_s[-400]) < 20
    # Each pulse is there from its first row, and the slower sensor is read too.
    steps = np.flatnonzero(np.diff(np.round(measured.inputs["current_A"]))) + 1
    assert np.isin(measured.time_s[steps], read_s).all()
    assert np.sum(np.isfinite(few.outputs["cell_temperature_degC"])) > 100


def test_steps_of_steady_inputs_keep_charge_and_what_is_read():
    measured = _pulses()
    few = thinned_rows(measured, 1500)
    assert _integrals(few, "current_A")[0] == pytest.approx(_integrals(measured, "current_A")[0], rel=1e-9)
    read = np.isfinite(few.outputs["voltage_V"])
    at = np.searchsorted(measured.time_s, few.time_s[read])
    np.testing.assert_array_equal(measured.outputs["voltage_V"][at], few.outputs["voltage_V"][read])
    off = np.abs(measured.inputs["current_A"][at] - few.inputs["current_A"][read])
    assert off.max() <= 1e-3 * np.ptp(measured.inputs["current_A"])


def test_the_model_reads_the_same_at_steady_inputs():
    measured = _pulses()
    frame = {"time_s": measured.time_s} | measured.inputs | measured.outputs
    case = Case.from_dataframes(
        {"pulses": pd.DataFrame(frame), "start": pd.DataFrame(frame)},
        kind="cell",
        check=["start"],
        parameters={"capacity_Ah": {"value": 3.0, "sd": 0.1}},
        effects={"self_heating": {"C_th": 60.0, "hA": 0.2}},
    )
    few = thinned(case, dataclasses.replace(SETTINGS, most_steps=1500))
    whole, part = (simulate(case_model(one, one.runs[0]), run_profile(one.runs[0])).readings for one in (case, few))
    for name, limit in (("voltage_V", 5e-4), ("cell_temperature_degC", 5e-3)):
        kept = np.isfinite(few.runs[0].measured.outputs[name])
        at = np.searchsorted(measured.time_s, few.runs[0].measured.time_s[kept])
        difference = np.asarray(part[name])[kept] - np.asarray(whole[name])[at]
        assert np.sqrt(np.mean(difference**2)) < limit


def test_rows_that_never_rest_are_in_windows():
    measured = drive(ROWS)
    restless = np.sin(measured.time_s / 97.0) > -0.3
    few = thinned_rows(measured, 3000)
    read_s = few.time_s[np.isfinite(few.outputs["voltage_V"])]
    share = np.mean(restless[read_s.astype(int)])
    assert 0.3 < share < 0.8  # by their share of the time, 0.6


def test_what_a_controller_follows_is_steady_only_where_it_stands_still():
    """A controller acts on how far the reference is from what is reached: its mean over a step is another input."""
    time = np.arange(12_000) * 1e-3
    reference = np.where(time < 6.0, 3.0 * np.sin(time), 3.0 * np.sin(6.0))
    measured = Measured(
        time,
        {"reference_position_rad": reference, "ambient_degC": np.full(time.size, 20.0)},
        {"position_rad": reference},
    )
    few = thinned_rows(measured, 3000)
    read = np.flatnonzero(np.isfinite(few.outputs["position_rad"]))[1:]
    step_s = np.diff(few.time_s)[read - 1]
    moving = few.time_s[read] < 6.0
    assert np.mean(step_s[moving] < 1.5e-3) > 0.9, "windows of all rows"
    assert np.mean(step_s[~moving] > 1.5e-3) > 0.5, "steps of several rows"
