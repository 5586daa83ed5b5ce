"""Pulses and steps are found where a load is held, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.case.known import Known
from jaxmodel.case.measurements import Measured
from jaxmodel.case.records import Run
from jaxmodel.diagnosis.residuals.blocks import block_sentence, worst_block
from jaxmodel.diagnosis.residuals.pulses import pulses

RNG = np.random.default_rng(3)


def run_of(values: np.ndarray, drive: str = "current_A", step_s: float = 1.0, name: str = "run-01") -> Run:
    time_s = step_s * np.arange(values.size)
    inputs = {drive: values, "ambient_degC": np.full(values.size, 20.0)}
    return Run(name, f"{name}.csv", "fit", "", Known(0.9), {}, Measured(time_s, inputs, {}), None)


def train(levels: list[float], rows: int = 10, rest: int = 40) -> np.ndarray:
    """Return pulses with rests before, between and after."""
    parts = [np.zeros(rest)]
    for level in levels:
        parts += [np.full(rows, level), np.zeros(rest)]
    return np.concatenate(parts)


def test_every_pulse_is_seen_from_before_its_edge_through_three_times_its_rest() -> None:
    found = pulses(run_of(train([3.0, -2.0, 5.0])))
    assert [one.level for one in found] == [3.0, -2.0, 5.0]
    first = found[0]
    assert (first.before, first.off) == (39, 50)
    assert first.last == 49 + 30
    assert first.rows == slice(39, 80)


def test_noise_of_the_current_makes_no_pulse() -> None:
    noisy = train([3.0, 3.0]) + 0.02 * RNG.standard_normal(140)
    assert [round(one.level, 1) for one in pulses(run_of(noisy))] == [3.0, 3.0]


def test_steps_without_rests_end_with_their_load() -> None:
    found = pulses(run_of(np.repeat([6.0, 12.0, 9.0], 20), drive="voltage_V"))
    assert [(one.before, one.last) for one in found] == [(19, 39), (39, 59)]


@pytest.mark.parametrize(
    "values",
    [
        np.full(200, 3.0),
        np.linspace(0.0, 10.0, 200),
        10.0 * RNG.standard_normal(500),
        np.concatenate([np.zeros(20), np.full(100, 3.0), np.zeros(20)]),
    ],
    ids=["constant", "ramp", "drive cycle", "one discharge"],
)
def test_other_loads_have_no_pulses(values: np.ndarray) -> None:
    assert pulses(run_of(values)) == ()


def test_mean_of_a_block_is_told_whatever_the_rest_of_the_runs_does() -> None:
    """One block of 200 mV in a run with a mean of 17 mV is named, with its place."""
    run, other = run_of(np.full(1200, 3.0)), run_of(np.full(1200, 3.0), name="run-02")
    error = np.zeros(1200)
    error[1100:] = -0.2
    soc = {"soc": np.linspace(0.9, 0.0, 1200)}
    conditions = {"run-01": soc, "run-02": soc}
    worst = worst_block([other, run], {"run-01": error, "run-02": np.zeros(1200)}, conditions)
    assert worst is not None
    assert worst.run == "run-01"
    assert worst.mean == pytest.approx(-0.2, rel=0.02)
    said = block_sentence(worst, "V")
    assert said.startswith("run-01 (fit run), minute 18.3 to 20, state of charge 0.00 to 0.07: ")
    assert "mV below the model on average" in said


def test_readings_that_are_missing_are_in_no_block() -> None:
    assert worst_block([run_of(np.ones(30))], {"run-01": np.full(30, np.nan)}, {"run-01": {}}) is None
