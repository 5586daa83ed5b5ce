"""Stuck sensors are found in their run; quantities at rest are not mistaken for them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmodel.fit.preparation.stuck import stretches, stuck, without_stuck
from tests.diagnosis.made_cases import case_of, run_of

ROWS, STEP_S = 1500, 2.0


def load(seed: int) -> np.ndarray:
    """Pulses of one to four amperes, of a minute or so."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.choice([1.0, 2.0, 4.0], ROWS // 30), 30)


def warming(current: np.ndarray, seed: int, noise: float, quantum: float) -> np.ndarray:
    """A body of 600 s that its current warms by some kelvin, read by a thermometer."""
    rng = np.random.default_rng(seed)
    clean = 25.0 + lfilter([STEP_S / 600.0], [1.0, STEP_S / 600.0 - 1.0], 0.8 * current**2)
    return np.round(np.round((clean + noise * rng.standard_normal(ROWS)) / quantum) * quantum, 6)


def cell(number: int, noise: float = 0.1, quantum: float = 0.01, current: np.ndarray | None = None):
    current = load(number) if current is None else current
    inputs = {"current_A": current, "ambient_degC": np.full(ROWS, 25.0)}
    return run_of(number, inputs, {"cell_temperature_degC": warming(current, number, noise, quantum)}, step_s=STEP_S)


def with_readings(run, channel, values):
    return run_of(int(run.name[-2:]), run.measured.inputs, run.measured.outputs | {channel: values}, step_s=STEP_S)


def hanging(run, first: int, last: int = ROWS):
    values = run.measured.outputs["cell_temperature_degC"].copy()
    values[first:last] = values[first]
    return with_readings(run, "cell_temperature_degC", values)


@pytest.mark.parametrize(("noise", "quantum"), [(0.1, 0.01), (0.1, 0.1), (0.05, 1e-6)])
def test_a_thermometer_that_is_stuck_halfway_is_reported(noise: float, quantum: float) -> None:
    runs = [cell(1, noise, quantum), hanging(cell(2, noise, quantum), 600), cell(3, noise, quantum)]
    case = case_of("cell", {}, runs)
    cleaned, (remark,) = without_stuck(case)
    assert remark.startswith("cell_temperature_degC in run-02 repeats ")
    assert "degC from 1200 s to the end under load: the sensor is stuck" in remark
    assert (remark.code, remark.subject) == ("sensor_stuck", "cell_temperature_degC@run-02")
    assert (remark.numbers["from_s"], remark.numbers["to_s"]) == (1200.0, 2998.0)
    left = cleaned.runs[1].measured.outputs["cell_temperature_degC"]
    assert np.isnan(left[602:]).all()
    assert np.isfinite(left[:599]).all()
    assert np.isfinite(case.runs[1].measured.outputs["cell_temperature_degC"]).all(), "the case given is as it was"
    for one in (0, 2):
        assert np.isfinite(cleaned.runs[one].measured.outputs["cell_temperature_degC"]).all()


def test_a_sensor_that_recovers_is_reported_until_then() -> None:
    runs = [cell(1), hanging(cell(2), 400, 900)]
    _, (remark,) = without_stuck(case_of("cell", {}, runs))
    assert "from 800 s to 1798 s" in remark
    assert (remark.numbers["from_s"], remark.numbers["to_s"]) == (800.0, 1798.0)


def test_a_sensor_that_alternates_by_one_step_is_stuck_too() -> None:
    run = cell(2, noise=0.1, quantum=0.01)
    values = run.measured.outputs["cell_temperature_degC"].copy()
    values[700:] = np.round(values[700] + 0.01 * np.random.default_rng(0).integers(0, 2, ROWS - 700), 6)
    found = stuck(
        case_of("cell", {}, [cell(1), with_readings(run, "cell_temperature_degC", values)]), "cell_temperature_degC"
    )
    ((name, stretch),) = found
    assert name == "run-02"
    assert stretch.first == pytest.approx(700, abs=2)


@pytest.mark.parametrize("quantum", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_a_coarse_thermometer_is_not_stuck_at_rest_nor_when_it_has_come_to_its_temperature(
    quantum: float, noise: float
) -> None:
    rest = np.where(np.arange(ROWS) < 500, 2.0, 0.0)
    settled = np.full(ROWS, 2.0)
    runs = [cell(k, noise, quantum, current) for k, current in enumerate([rest, settled, load(3), 0.0 * rest], start=1)]
    assert without_stuck(case_of("cell", {}, runs))[1] == ()


def test_a_run_long_enough_to_settle_beside_short_ones_is_not_stuck() -> None:
    """The others end while they still warm, and a reading every 20 s never repeats there."""
    runs = []
    for number, rows in ((1, 60), (2, 60), (3, 700)):
        current = np.full(rows, 3.0)
        warm = np.round(25.0 + 7.0 * (1.0 - np.exp(-20.0 * np.arange(rows) / 900.0)), 1)
        inputs = {"current_A": current, "ambient_degC": np.full(rows, 25.0)}
        runs.append(run_of(number, inputs, {"cell_temperature_degC": warm}, step_s=20.0))
    assert without_stuck(case_of("cell", {}, runs))[1] == ()


def test_a_coarse_sensor_that_stops_during_a_rise_is_stuck() -> None:
    warm = np.round(25.0 + 0.02 * np.arange(900), 1)
    inputs = {"current_A": np.full(900, 3.0), "ambient_degC": np.full(900, 25.0)}
    hung = np.where(np.arange(900) < 400, warm, warm[400])
    runs = [run_of(k, inputs, {"cell_temperature_degC": one}) for k, one in ((1, warm), (2, hung))]
    _, (remark,) = without_stuck(case_of("cell", {}, runs))
    assert remark.startswith("cell_temperature_degC in run-02 repeats 33 degC from ")


def test_a_sensor_of_which_noise_is_seen_in_no_run_but_its_own_is_stuck_where_a_trend_ends() -> None:
    """As at NASA, of six logs: 10 s between rows, so that warmth moves readings by more than they scatter."""
    rng, steady = np.random.default_rng(5), np.full(ROWS, 2.0)

    def run(number: int, scatter: float, first: int = ROWS):
        read = 24.0 + 6e-3 * STEP_S * np.arange(ROWS) + 1e-3 * np.arange(ROWS) ** 0.5 + scatter * rng.normal(size=ROWS)
        read[first:] = read[min(first, ROWS - 1)]
        return with_readings(cell(number, current=steady), "cell_temperature_degC", np.round(read, 2))

    others = [run(number, 1e-3) for number in (1, 3, 4)]
    _, (remark,) = without_stuck(case_of("cell", {}, [*others, run(2, 0.03, 700)]))
    assert remark.subject == "cell_temperature_degC@run-02"
    assert remark.numbers["from_s"] == pytest.approx(1400.0, abs=2.0 * STEP_S)


@pytest.mark.parametrize(("times", "is_stuck"), [(2.0, False), (5.0, True)])
def test_a_settled_sensor_whose_noise_repeats_readings_is_stuck_if_no_chance_makes_it(
    times: float, is_stuck: bool
) -> None:
    """As in a discharge at 1C, logged every 10 s: 185 equal readings, where noise repeats one up to 34 times."""
    others = [cell(number, 0.03, 0.1, np.full(ROWS, 2.0)) for number in (1, 2)]
    longest = max(one.rows for run in others for one in stretches(run, "cell_temperature_degC"))
    third = cell(3, 0.03, 0.1, np.full(ROWS, 2.0))
    last = next(one for one in stretches(third, "cell_temperature_degC") if one.first > 800 and one.rows > 2)
    hung = hanging(third, last.first, last.first + int(times * longest))
    remarks = without_stuck(case_of("cell", {}, [*others, hung]))[1]
    assert [one.subject for one in remarks] == (["cell_temperature_degC@run-03"] if is_stuck else [])


def test_a_motor_that_stands_still_and_a_chamber_that_is_constant_are_not_stuck() -> None:
    rng = np.random.default_rng(4)
    runs = []
    for number in (1, 2):
        voltage = np.where(np.arange(ROWS) < 700, 12.0, 1.0)
        speed = np.where(voltage > 5.0, 300.0 + rng.normal(0.0, 1.0, ROWS), 0.0)
        inputs = {"voltage_V": voltage, "load_torque_Nm": np.full(ROWS, 0.1), "ambient_degC": np.full(ROWS, 20.0)}
        outputs = {"speed_rad_s": speed, "case_temperature_degC": np.full(ROWS, 20.0)}
        runs.append(run_of(number, inputs, outputs, step_s=STEP_S))
    assert without_stuck(case_of("motor", {}, runs))[1] == ()


def test_a_voltage_that_a_charger_holds_is_not_stuck() -> None:
    fall = np.exp(-np.arange(ROWS) / 300.0)
    rising = 3.6 + 0.6 * np.minimum(np.arange(ROWS) / 500.0, 1.0)
    inputs = {"current_A": -2.0 * np.where(np.arange(ROWS) < 500, 1.0, fall), "ambient_degC": np.full(ROWS, 25.0)}
    noisy = rising + np.where(rising < 4.2, 1e-3 * np.random.default_rng(1).standard_normal(ROWS), 0.0)
    runs = [run_of(k, inputs, {"voltage_V": np.round(noisy, 4)}, step_s=STEP_S) for k in (1, 2)]
    assert without_stuck(case_of("cell", {}, runs))[1] == ()


def test_stretches_cover_all_readings_once() -> None:
    run = cell(1, 0.05, 0.1)
    found = stretches(run, "cell_temperature_degC")
    assert sum(one.rows for one in found) == ROWS
    wide = stretches(run, "cell_temperature_degC", within=0.1)
    assert sum(one.rows for one in wide) == ROWS
    assert len(wide) < len(found)


def test_a_stretch_that_is_loaded_for_long_in_few_rows_is_stuck() -> None:
    """Slow rows under load and quick ones in the rest after it: what counts is time."""
    run = hanging(cell(2), 600)
    current = run.measured.inputs["current_A"].copy()
    current[640:] = 0.0
    time_s = np.cumsum(np.where(np.arange(ROWS) < 640, 20.0 * STEP_S, STEP_S))
    measured = dataclasses.replace(run.measured, time_s=time_s, inputs=run.measured.inputs | {"current_A": current})
    case = case_of("cell", {}, [cell(1), dataclasses.replace(run, measured=measured), cell(3)])
    assert [(name, stretch.first) for name, stretch in stuck(case, "cell_temperature_degC")] == [("run-02", 600)]
