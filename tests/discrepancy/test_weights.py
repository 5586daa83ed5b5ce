"""Weights by what a wrong model leaves: its memory is found, and a run counts by its time, not by its readings."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.best_model import BestModel, find_best_model
from discrepancy.noise import NoiseModel
from discrepancy.weights import memory
from jaxmodel.cases import Known
from tests.discrepancy.made_cases import case_of, run_of, with_candidates

MEMORY_S = 200.0


def errors(seed: int, step_s: float, rows: int = 20000) -> tuple[np.ndarray, np.ndarray]:
    """An Ornstein-Uhlenbeck process of unit variance: its times and values."""
    rng = np.random.default_rng(seed)
    kept = np.exp(-step_s / MEMORY_S)
    values = np.empty(rows)
    values[0] = rng.standard_normal()
    for row in range(1, rows):
        values[row] = kept * values[row - 1] + np.sqrt(1.0 - kept**2) * rng.standard_normal()
    return step_s * np.arange(rows), values


@pytest.mark.parametrize("step_s", [2.0, 20.0])
def test_memory_is_found_at_any_spacing(step_s: float) -> None:
    assert memory([errors(0, step_s), errors(1, step_s)]) == pytest.approx(MEMORY_S, rel=0.2)


def test_missing_readings_and_runs_of_other_spacing_do_no_harm() -> None:
    time, values = errors(2, 5.0)
    values[::7] = np.nan
    assert memory([(time, values), errors(3, 50.0, 2000)]) == pytest.approx(MEMORY_S, rel=0.2)
    assert memory([]) == 0.0
    assert memory([(time, np.full(time.size, np.nan))]) == 0.0


def test_crowded_readings_tell_of_a_mean_what_the_process_does() -> None:
    """The variance of the mean of correlated errors, by weights alone, is within a tenth of the true one."""
    model = NoiseModel(sd=1.0, rho=0.0, source="", memory_s=MEMORY_S)
    for step_s, rows in ((1.0, 20000), (20.0, 1000), (5.0, 4000)):
        time = step_s * np.arange(rows)
        told = 1.0 / np.sum(1.0 / model.crowding(time) ** 2)
        lag = np.arange(rows)
        true = np.sum((1.0 - lag / rows) * np.exp(-lag * step_s / MEMORY_S) * np.where(lag > 0, 2.0, 1.0)) / rows
        assert told == pytest.approx(true, rel=0.1)
    assert np.all(NoiseModel(1.0, 0.0, "").crowding(np.arange(5.0)) == 1.0)


@pytest.fixture(scope="module")
def far() -> BestModel:
    """A cell read every second while it works and every minute while it is slow, with errors no effect explains.

    The slow run lies 30 mV off, and the fast one waves by 60 mV: sensors of 1 mV.
    """
    fast, slow = np.arange(0.0, 1200.0), np.arange(0.0, 12000.0, 60.0)
    current = np.where((fast // 120) % 2 == 0, 2.0, 0.0)
    level = np.full(fast.size, 3.7) - 0.06 * np.sin(fast / 40.0) - 0.05 * current
    runs = [
        run_of(1, {"current_A": current, "ambient_degC": np.full(fast.size, 25.0)}, {"voltage_V": level}, step_s=1.0),
        run_of(
            2,
            {"current_A": np.full(slow.size, 0.1), "ambient_degC": np.full(slow.size, 25.0)},
            {"voltage_V": 3.75 - 0.03 * np.sign(np.sin(slow / 3000.0))},
            step_s=60.0,
        ),
    ]
    parameters = {"capacity_Ah": Known(2.0, 0.1), "series_resistance_scale": Known(1.0, 0.1)}
    case = case_of("cell", parameters, runs, {"voltage_V": 1e-3})
    session = with_candidates(case, "ocv_hysteresis", "slow_diffusion", "rate_capacity", "voltage_offset")
    return find_best_model(session, None, ())


def test_no_model_near_the_noise_is_said_and_evidence_is_that_of_time(far: BestModel) -> None:
    assert far.far == ("voltage_V",)
    weights = far.judge.weights["voltage_V"]
    assert weights.memory_s > 10.0
    assert weights.sd > 3e-3
    assert far.session.weights["voltage_V"].memory_s == 0.0  # the numbers are fitted to all readings
    readings = far.judge.hypothesis(far.best.labels).problem.readings
    problem = far.best.problem
    sd, run = np.asarray(readings.sd), np.asarray(readings.index) // (problem.times.shape[1] * len(problem.channels))
    counted = np.asarray(readings.fit) > 0.0
    by_run = [np.median(sd[counted & (run == number)]) for number in (0, 1)]
    assert by_run[0] / by_run[1] == pytest.approx(
        np.sqrt(2.0 * weights.memory_s) / np.sqrt(max(1.0, weights.memory_s / 30.0)), rel=0.02
    )


def test_scores_are_no_surer_than_so_few_errors_allow(far: BestModel) -> None:
    """A thousand readings of one wave are no thousand pieces of evidence."""
    judge = far.judge
    by_time = max(effect.z_equivalent for effect in judge.screen(judge.hypothesis()).table.effects)
    by_reading = max(effect.z_equivalent for effect in far.session.screen(far.session.hypothesis()).table.effects)
    assert by_time < 0.8 * by_reading
