"""Statements on residuals: a planted error is stated with sign, size, range and cause; noise gives no statement."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxmodel.diagnosis.residuals.statements import account, statements
from jaxmodel.diagnosis.residuals.table import ChannelResiduals
from tests.diagnosis.residuals.made_residuals import between, constant_currents, noise, pulses, stacked


def numbers_before(word: str, text: str) -> list[float]:
    found = re.search(rf"((?:-?[\d.]+, )*-?[\d.]+) {word}", text)
    assert found, text
    return [float(number) for number in found.group(1).split(", ")]


@pytest.mark.parametrize("made", [constant_currents, pulses])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_open_circuit_voltage_that_is_off_in_a_part_of_the_charge(made, sign: float) -> None:
    residuals = made(lambda run, number: sign * 0.012 * between(run["soc"], 0.6, 0.7))
    (first, *rest) = statements(residuals)
    assert rest == []
    assert (first.condition, first.cause, first.unit) == ("soc", "open_circuit_voltage", "V")
    assert (first.lower, first.upper) == (0.6, 0.7)
    assert first.value == pytest.approx(sign * 0.012, rel=0.1)
    assert f"{'above' if sign > 0 else 'below'} the model at" in first.text
    assert "almost independent of the current" in first.text
    assert f"mV too {'low' if sign > 0 else 'high'} there" in first.text
    assert numbers_before("mV (above|below)", first.text) == pytest.approx([12.0] * 4, abs=1.5)
    explained = 0.012**2 * np.mean(between(residuals.conditions["soc"], 0.6, 0.7))
    assert first.share == pytest.approx(explained / residuals.mean_square, rel=0.2)


def test_a_resistance_that_is_off_at_full_charge_grows_with_the_current() -> None:
    residuals = constant_currents(lambda run, number: -0.002 * run["current_A"] * (run["soc"] > 0.9), sd=2e-4)
    (first,) = statements(residuals, capacity_Ah=3.0)
    assert first.text.startswith("SOC above 0.9: the measurement is 6, 12, 18, 2")
    assert "mV below the model at 1, 2, 3, 4C, " in first.text
    assert "proportional to the current: resistance 2.0 mohm too low there (in all 4 runs)" in first.text
    assert (first.cause, first.unit, first.runs_seen) == ("resistance", "ohm", 4)
    assert first.value == pytest.approx(0.002, rel=0.1), "what would have to be added to the model's resistance"


def test_ocv_and_resistance_errors_in_one_case_are_separated() -> None:
    def off(run, number):
        return 0.015 * between(run["soc"], 0.7, 0.8) - 0.004 * run["current_A"] * between(run["soc"], 0.5, 0.6)

    found = {one.cause: one for one in statements(pulses(off))}
    assert (found["open_circuit_voltage"].lower, found["open_circuit_voltage"].upper) == (0.7, 0.8)
    assert (found["resistance"].lower, found["resistance"].upper) == (0.5, 0.6)
    assert found["resistance"].value == pytest.approx(0.004, rel=0.1)


def test_adjacent_ranges_with_one_error_give_one_statement() -> None:
    (first,) = statements(pulses(lambda run, number: 0.01 * between(run["soc"], 0.5, 0.8)))
    assert (first.lower, first.upper) == (0.5, 0.8)


def test_missing_heat_is_stated_with_the_rise_of_each_run() -> None:
    residuals = constant_currents(
        lambda run, number: run["cell_temperature_degC"] - 22.5, sd=0.1, channel="cell_temperature_degC", unit="K"
    )
    flat = dict(residuals.conditions) | {"cell_temperature_degC": residuals.conditions["ambient_degC"]}
    (first, *_) = statements(dataclasses.replace(residuals, conditions=flat))
    assert first.cause == "heat"
    assert first.share > 0.95
    rises = [residuals.error[residuals.run == number][-20:].mean() for number in range(4)]
    assert numbers_before("K above", first.text) == pytest.approx(rises, rel=0.05, abs=0.8)
    assert "At the end of run-01, run-02, run-03 and run-04" in first.text
    assert "the model lacks heat" in first.text


def test_one_run_that_differs_is_stated_as_that_run() -> None:
    (first, *rest) = statements(
        pulses(lambda run, number: -0.011 * run["current_A"] * (number == 2), ambients=(20.0, 20.0, 20.0, 20.0, 20.0))
    )
    assert rest == []
    assert first.text.startswith("run-03: the measurement is 11 mohm x current below the model")
    assert "in this run only" in first.text
    assert (first.cause, first.condition, first.runs_seen) == ("run", "run", 1)
    assert first.value == pytest.approx(0.011, rel=0.1)


def test_a_run_that_is_alone_in_its_condition_is_stated_with_it() -> None:
    (first, *_) = statements(pulses(lambda run, number: 0.02 * (number == 0), ambients=(-20.0, 20.0, 25.0, 25.0, 20.0)))
    assert first.text.startswith("run-01: the measurement is 20 mV above the model")
    assert "it is the only one at -" in first.text


def test_runs_in_the_order_of_their_temperature() -> None:
    (first, *_) = statements(pulses(lambda run, number: -0.0006 * run["current_A"] * (20.0 - run["ambient_degC"])))
    assert first.cause == "temperature_dependence"
    assert first.condition in ("ambient_degC", "cell_temperature_degC")
    assert (first.unit, first.runs_seen) == ("ohm/K", 5)
    assert first.value == pytest.approx(-0.0006, rel=0.2)
    assert first.text.startswith("The resistance is 1")
    assert first.share > 0.8


def test_one_noisy_run_does_not_hide_what_the_others_share() -> None:
    rng = np.random.default_rng(5)

    def off(run, number):
        wild = 0.08 * noise(rng, run["soc"].size, 0.99) if number == 4 else 0.0
        return wild + 0.012 * between(run["soc"], 0.6, 0.8)

    found = statements(pulses(off, ambients=(20.0, 20.0, 20.0, 20.0, 20.0)))
    assert [one.condition for one in found] == ["run", "soc"]
    assert found[0].text.startswith("run-05: the RMS error is ")
    assert found[1].value == pytest.approx(0.012, rel=0.1)


def test_a_motor_s_speed_over_its_speed() -> None:
    rng = np.random.default_rng(7)
    runs = []
    for _ in range(4):
        voltage = np.repeat(rng.uniform(2.0, 12.0, 30), 50)
        speed = 40.0 * voltage
        runs.append({"speed_rad_s": speed, "load_torque_Nm": np.repeat(rng.choice([0.0, 0.1, 0.2], 75), 20)})
    residuals = stacked(
        runs,
        lambda run, number: 0.05 * between(run["speed_rad_s"], 350.0, 999.0),
        0.01,
        0.5,
        rng,
        channel="current_A",
        unit="A",
    )
    (first,) = statements(residuals)
    assert first.condition == "speed_rad_s"
    assert first.lower >= 300.0
    assert "mA above the model at" in first.text
    assert "N m" in first.text


def test_an_ambient_temperature_that_hardly_varies_gives_no_statement() -> None:
    """An error that follows a tenth of a kelvin of the ambient temperature is no dependence on it."""
    residuals = constant_currents(lambda run, number: 0.02 * (run["ambient_degC"] - run["ambient_degC"].mean()))
    assert all("ambient" not in one.text for one in statements(residuals))


def test_an_error_below_a_tenth_of_the_tolerance_is_not_stated() -> None:
    def off(run, number):
        return 0.0009 * between(run["soc"], 0.5, 0.8)

    assert statements(pulses(off, sd=2e-4)) != ()
    assert statements(pulses(off, sd=2e-4, tolerance=0.010)) == ()
    assert statements(pulses(off, sd=2e-4, tolerance=0.005)) != ()


def test_the_explained_part_is_removed_from_the_residuals() -> None:
    residuals = pulses(lambda run, number: 0.012 * between(run["soc"], 0.6, 0.7))
    found = account(residuals)
    assert found.left.mean_square == pytest.approx(
        (1.0 - sum(one.share for one in found.statements)) * residuals.mean_square
    )
    assert np.sqrt(found.left.mean_square) == pytest.approx(1e-3, rel=0.15)


def test_readings_are_weighted_by_time() -> None:
    """A higher sampling rate in one part changes no share."""
    residuals = pulses(lambda run, number: 0.012 * between(run["soc"], 0.6, 0.7), rho=0.0)
    kept = (np.arange(residuals.error.size) % 5 == 0) | (residuals.conditions["soc"] < 0.6)
    weight = np.where(residuals.conditions["soc"] < 0.6, residuals.weight_s, 5.0 * residuals.weight_s)
    sparse = dataclasses.replace(residuals, weight_s=weight).rows(kept)
    (one,), (other,) = statements(residuals), statements(sparse)
    assert one.share == pytest.approx(other.share, rel=0.1)


def test_at_most_four_statements_and_each_material() -> None:
    rng = np.random.default_rng(3)
    curve = rng.normal(0.0, 0.01, 10)
    found = statements(constant_currents(lambda run, number: curve[(10 * run["soc"].clip(0.0, 0.999)).astype(int)]))
    assert 1 <= len(found) <= 4
    assert all(one.share >= 0.03 for one in found)
    assert [one.share for one in found] == sorted((one.share for one in found), reverse=True)


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), runs=st.integers(1, 4), rows=st.integers(1, 12))
def test_a_few_readings_raise_no_error(seed: int, runs: int, rows: int) -> None:
    residuals = pulses(
        lambda run, number: 0.01 * number, seed=seed, ambients=tuple(10.0 * k for k in range(runs)), rows=rows
    )
    rng = np.random.default_rng(seed)
    kept = rng.random(residuals.error.size) < 0.8
    assert len(statements(residuals.rows(kept))) <= 4


def test_no_error_gives_no_statement() -> None:
    residuals = constant_currents(lambda run, number: 0.0)
    assert statements(dataclasses.replace(residuals, error=np.zeros(residuals.error.size))) == ()
    alone = residuals.rows(residuals.run == 1)
    assert statements(alone) == ()
    assert statements(residuals.rows(np.zeros(residuals.error.size, dtype=bool))) == ()


@pytest.mark.slow
@pytest.mark.parametrize("made", [constant_currents, pulses])
@pytest.mark.parametrize("rho", [0.0, 0.9, 0.98])
def test_noise_alone_hardly_ever_gives_a_statement(made, rho: float) -> None:
    """White noise, and noise of correlation times up to 100 s: in at most one of twenty channels."""
    false = sum(bool(statements(made(lambda run, number: 0.0, rho=rho, seed=seed))) for seed in range(20))
    assert false <= 2  # of 20: more would be improbable (8 %) at a rate of one in twenty


@pytest.mark.slow
@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), scale=st.floats(1e-6, 1e3), understated=st.floats(0.1, 1.0))
def test_the_unit_and_a_noise_stated_too_small_change_no_statement(seed: int, scale: float, understated: float) -> None:
    """Statements rest on the scatter of the runs, not on the stated sensor noise."""
    residuals = pulses(lambda run, number: 0.006 * between(run["soc"], 0.6, 0.7), seed=seed, rows=700)
    scaled = dataclasses.replace(
        residuals, error=scale * residuals.error, noise_sd=understated * scale * residuals.noise_sd
    )
    one, other = statements(residuals), statements(scaled)
    assert [(s.condition, s.lower, s.upper, s.cause) for s in one] == [
        (s.condition, s.lower, s.upper, s.cause) for s in other
    ]
    assert [s.value * scale for s in one] == pytest.approx([s.value for s in other])


def test_a_reversed_error_reverses_every_value() -> None:
    residuals = constant_currents(
        lambda run, number: 0.012 * between(run["soc"], 0.3, 0.5) - 0.002 * run["current_A"] * (run["soc"] > 0.8)
    )
    turned: ChannelResiduals = dataclasses.replace(residuals, error=-residuals.error)
    assert [one.value for one in statements(turned)] == pytest.approx([-one.value for one in statements(residuals)])


def test_an_error_without_a_mean_is_located_by_its_size() -> None:
    def off(run, number):
        return 0.06 * np.sin(run["soc"] * 900.0) * (run["soc"] < 0.1)

    (first, *_) = statements(constant_currents(off, rates=(1.0, 1.01, 1.02, 1.03)))
    assert (first.condition, first.upper, first.cause, first.runs_seen) == ("soc", 0.1, "", 4)
    assert first.text == "SOC below 0.1: the RMS error is 42 mV (in all 4 runs); elsewhere it is 1 mV."
    assert first.share > 0.9


def test_an_error_that_is_explained_is_located_once() -> None:
    found = statements(constant_currents(lambda run, number: 0.06 * (run["soc"] < 0.1)))
    assert [one.cause for one in found] == ["open_circuit_voltage"]


def test_an_error_in_one_run_is_not_that_of_a_range() -> None:
    found = statements(constant_currents(lambda run, number: 0.06 * np.sin(run["soc"] * 900.0) * (number == 2)))
    assert all("elsewhere" not in one.text for one in found)
