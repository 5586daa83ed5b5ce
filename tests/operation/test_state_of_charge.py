"""The filter and the polynomial estimator, on cells whose truth is known: simulated by the filter's own model."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.build import preset_model
from jaxmodel.case.records import Run
from jaxmodel.model.cell import cycle_resistance, storage_factor
from jaxmodel.model.names import with_values
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate
from jaxmodel.operation.evaluation import NEARER, Trial, draw_tunings, filters, polynomials, rms, trials, tune_filter
from jaxmodel.operation.kalman import FilterOutput, Measured, Tuning
from jaxmodel.operation.polynomial import polynomial_estimator
from tests.diagnosis.made_cases import run_of

CELL = preset_model("lg_mj1", "cell")
ROWS = 1801
TIME_S = np.arange(0.0, 2.0 * ROWS, 2.0)


def made(degC: float, seed: int = 0) -> tuple[Measured, np.ndarray]:
    """A drive of an hour from a full cell, and its true charge."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(0.0, 4.0, ROWS // 10 + 1), 10)[:ROWS]
    current[:5] = 0.0
    ambient = np.full(ROWS, degC)
    ran = simulate(CELL, Profile(TIME_S, {"current_A": current, "ambient_degC": ambient}))
    columns = (TIME_S, current, ambient, ran.readings["voltage_V"])
    return Measured(*(jnp.asarray(column, dtype=float) for column in columns)), np.asarray(ran.readings["soc"])


COLD, COLD_SOC = made(0.0)
# What is left of the filter where its model is right: charge and RC pairs.
RIGHT = Tuning(charge_sd=1e-4, voltage_sd_V=5e-3, drop_share=0.0, scale_sd=1e-4, offset_sd_V=1e-4)


def run(tuning: Tuning, measured: Measured, starts: list[float]) -> FilterOutput:
    """Filters of one shape: each compiles once."""
    one = jax.tree.map(lambda leaf: leaf[None], tuning)
    track = filters(CELL, one, measured, jnp.asarray(starts), jnp.zeros(()))
    return jax.tree.map(lambda values: np.asarray(values)[0], track)


def with_voltage(measured: Measured, volts: np.ndarray) -> Measured:
    return Measured(measured.time_s, measured.current_A, measured.degC, jnp.asarray(volts))


@pytest.mark.slow
def test_filter_that_knows_everything_says_the_truth() -> None:
    track = run(RIGHT, COLD, [1.0, 1.0])
    np.testing.assert_allclose(track.soc[0], COLD_SOC, atol=2e-5)
    assert track.nis[0].max() < 1e-3


@pytest.mark.slow
def test_wrong_start_is_forgotten() -> None:
    track = run(Tuning(voltage_sd_V=5e-3), COLD, [0.8, 0.6])
    late = TIME_S > 900.0
    assert rms(track.soc[0][late] - COLD_SOC[late]) < 0.01
    assert rms(track.soc[1][late] - COLD_SOC[late]) < 0.01


@pytest.mark.slow
def test_innovations_are_as_large_as_the_filter_assumes() -> None:
    """White noise of the sd that it assumes: NIS is chi-square of one degree of freedom, mean 1, sd sqrt(2 / rows)."""
    noise = np.random.default_rng(5).normal(0.0, 5e-3, ROWS)
    track = run(RIGHT, with_voltage(COLD, np.asarray(COLD.voltage_V) + noise), [1.0, 1.0])
    assert np.mean(track.nis[0]) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / ROWS))


@pytest.mark.slow
def test_charge_is_as_uncertain_as_the_filter_assumes() -> None:
    """Over many noises, the error at the end by its own sd has an RMS of 1."""
    tuning = Tuning(start_sd=0.05, charge_sd=1e-6, voltage_sd_V=0.05, drop_share=0.0, scale_sd=1e-4, offset_sd_V=1e-4)
    rng = np.random.default_rng(7)
    pulls = []
    for _ in range(24):
        volts = np.asarray(COLD.voltage_V) + rng.normal(0.0, 0.05, ROWS)
        track = run(tuning, with_voltage(COLD, volts), [1.0 - abs(rng.normal(0.0, 0.05)), 0.95])
        pulls.append((track.soc[0, 600] - COLD_SOC[600]) / track.sd[0, 600])
    assert 0.6 < rms(np.array(pulls)) < 1.5


@pytest.mark.slow
def test_without_readings_it_counts() -> None:
    track = run(Tuning(), with_voltage(COLD, np.full(ROWS, np.nan)), [0.9, 0.9])
    np.testing.assert_allclose(track.soc[0], COLD_SOC - 0.1, atol=1e-6)
    assert np.isnan(track.nis).all()
    assert np.all(np.diff(track.sd[0]) > 0.0)


@pytest.mark.slow
def test_batch_is_its_members() -> None:
    both = run(Tuning(), COLD, [0.9, 0.7])
    swapped = run(Tuning(), COLD, [0.7, 0.9])
    np.testing.assert_allclose(both.soc, swapped.soc[::-1], atol=1e-12)


def test_filter_finds_a_scale_of_resistance() -> None:
    """Current through 1.3 times the resistances: what a table over charge and temperature does not know."""
    worn = with_values(
        CELL, {"series_resistance_scale": 1.3, "rc_resistance_scale": 1.3, "rc_capacitance_scale": 1.0 / 1.3}
    )
    inputs = {"current_A": np.asarray(COLD.current_A), "ambient_degC": np.asarray(COLD.degC)}
    volts = np.asarray(simulate(worn, Profile(TIME_S, inputs)).readings["voltage_V"])
    track = run(Tuning(voltage_sd_V=5e-3, offset_sd_V=1e-3, drop_share=0.01), with_voltage(COLD, volts), [1.0, 0.8])
    np.testing.assert_allclose(np.median(track.scale[:, 300:], axis=1), 1.3, rtol=0.03)


@pytest.mark.slow
def test_polynomial_estimator_needs_the_temperature_in_the_cold() -> None:
    measured = polynomial_estimator(CELL, np.array([-20.0, 0.0, 10.0, 25.0]), 600.0)
    fixed = polynomial_estimator(CELL, np.array([25.0]), 600.0)
    wrong = jnp.asarray([0.8])
    late = TIME_S > 1800.0
    errors = [rms(np.asarray(polynomials(one, COLD, wrong))[0][late] - COLD_SOC[late]) for one in (measured, fixed)]
    assert errors[0] < 0.07
    assert errors[1] > 1.5 * errors[0]
    assert measured.worst_fit < 0.05


def test_error_is_counted_after_the_time_to_converge() -> None:
    time_s = np.arange(0.0, 2000.0, 100.0)
    soc = np.linspace(1.0, 0.8, time_s.size)
    trial = Trial("made", COLD, soc, time_s, (0.0, -0.2), rested=True)
    off = np.where(time_s <= 900.0, 0.5, 0.03)
    estimate = np.concatenate([soc + off, [9.0, 9.0]])  # padding
    assert trial.errors(estimate) == pytest.approx(0.03)
    assert trial.convergence_s(estimate) == 1000.0
    assert trial.convergence_s(estimate, within=0.01) == np.inf


@pytest.mark.slow
def test_tuning_is_the_best_of_those_drawn() -> None:
    trial = Trial("made", COLD, COLD_SOC, TIME_S, (0.0, -0.2), rested=True)
    tuning, score = tune_filter([CELL], [trial], 2, lambda run: None)
    drawn = draw_tunings(2)
    tracks = filters(CELL, drawn, COLD, trial.starts, trial.pairs_sd_V)
    scores = np.mean(trial.log_scores(np.asarray(tracks.soc), np.asarray(tracks.sd)), axis=1)
    best = int(scores.argmin())
    assert score <= scores[best] + 1e-9
    # A second round looks near the best of the first.
    assert 1.0 / NEARER <= float(tuning.scale_s / drawn.scale_s[best]) <= NEARER


def test_score_is_least_for_the_band_that_is_right() -> None:
    """Of bands of errors of sd 0.03, the logarithmic score is least for 0.03: a narrow band does not win."""
    soc = np.linspace(1.0, 0.2, ROWS)
    trial = Trial("made", COLD, soc, TIME_S, (0.0,), rested=True)
    estimate = soc + np.random.default_rng(3).normal(0.0, 0.03, ROWS)
    bands = np.array([0.003, 0.01, 0.03, 0.09, 0.3])
    scores = trial.log_scores(np.tile(estimate, (5, 1)), np.tile(bands[:, None], ROWS))
    assert int(scores.argmin()) == 2


def _run_of(soc: np.ndarray, **outputs: np.ndarray) -> Run:
    inputs = {"current_A": np.ones(soc.size), "ambient_degC": np.full(soc.size, 20.0)}
    run = run_of(1, inputs, {"voltage_V": np.full(soc.size, 3.7), "soc": soc} | outputs)
    time_s = np.arange(0.0, 10.0 * soc.size, 10.0)
    return dataclasses.replace(run, measured=dataclasses.replace(run.measured, time_s=time_s))


def test_readings_that_are_missing_are_no_reason_to_lose_a_run() -> None:
    soc, degC = np.linspace(0.9, 0.5, 300), np.full(300, 20.0)
    soc[150], degC[[0, 40]] = np.nan, np.nan
    (trial, *_) = trials([_run_of(soc, cell_temperature_degC=degC)], with_temperature=True)
    assert np.all(np.isfinite(trial.measured.degC))
    assert trial.errors(np.nan_to_num(soc, nan=0.7) + 0.01) == pytest.approx(0.01)


@pytest.mark.parametrize("rows", [slice(0, 1), slice(80, 300)], ids=["at the start", "after converging"])
def test_run_without_a_reference_is_a_mistake(rows: slice) -> None:
    soc = np.linspace(0.9, 0.5, 300)
    soc[rows] = np.nan
    with pytest.raises(MeasurementError, match="needs soc in its first row, and after the 900 s"):
        trials([_run_of(soc)], with_temperature=True)


def test_polynomial_estimator_knows_age_and_storage() -> None:
    aged = with_values(CELL, {"storage_months": jnp.asarray(18.0), "cycles": jnp.asarray(100.0)})
    new, old = (polynomial_estimator(model, np.array([25.0]), 600.0) for model in (CELL, aged))
    assert old.capacity_Ah == pytest.approx(
        new.capacity_Ah * float(storage_factor(jnp.asarray(18.0), jnp.asarray(20.0)))
    )
    more = cycle_resistance(jnp.asarray(100.0)) - cycle_resistance(CELL.parameters.cycles)
    assert old.series_ohm[0] - new.series_ohm[0] == pytest.approx(float(more * CELL.parameters.series_resistance_scale))
