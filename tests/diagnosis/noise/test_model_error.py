"""The model error beside the noise: whitened exactly as its dense covariance says, and found where it is."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.diagnosis.noise.model_error import NONE, Chain, ModelError, Whitener, estimate

# Of some series: channel, number of the run, readings, s, tau, correlation of the noise from reading to reading.
NOISE = 0.5


def times(rows: int, seed: int) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).uniform(0.5, 12.0, rows))


def chain(name: str, run: int, first: int, time_s: np.ndarray, rho: float = 0.0) -> Chain:
    rows = np.arange(first, first + time_s.size)
    gain = np.full(time_s.size, np.sqrt((1.0 - rho) / (1.0 + rho)))
    gain[0] = 1.0  # nothing before it was taken off
    return Chain((name, run), rows, time_s, np.full(time_s.size, NOISE), gain)


def covariance(time_s: np.ndarray, s: float, tau: float) -> np.ndarray:
    """Return the covariance of model error alone."""
    return s**2 * np.exp(-np.abs(time_s[:, None] - time_s) / tau)


def drawn(time_s: np.ndarray, s: float, tau: float, rng: np.random.Generator) -> np.ndarray:
    """Return noise and model error of a series."""
    own = np.linalg.cholesky(covariance(time_s, s, tau) + 1e-12 * np.eye(time_s.size))
    return own @ rng.standard_normal(time_s.size) + NOISE * rng.standard_normal(time_s.size)


def test_chi_square_and_determinant_are_those_of_the_dense_covariance():
    """Of two series with a model error and one without, at uneven times."""
    chains = [
        chain("voltage_V", 0, 0, times(40, 0)),
        chain("voltage_V", 1, 40, times(30, 1)),
        chain("temperature", 0, 70, times(20, 2)),
    ]
    error = ModelError({("voltage_V", 0): 2.0, ("voltage_V", 1): 0.3}, {"voltage_V": 25.0})
    dense = NOISE**2 * np.eye(90)
    for one in chains[:2]:
        dense[np.ix_(one.rows, one.rows)] += covariance(one.time_s, error.sd[one.series], 25.0)
    white = Whitener(chains, error, 90)(np.eye(90))
    np.testing.assert_allclose(white @ dense @ white.T, np.eye(90), atol=1e-10)
    assert np.linalg.slogdet(white)[1] == pytest.approx(-0.5 * np.linalg.slogdet(dense)[1])
    values = np.random.default_rng(3).standard_normal((90, 4))
    found = Whitener(chains, error, 90)(values)
    np.testing.assert_allclose(np.sum(found**2, axis=0), np.sum(values * np.linalg.solve(dense, values), axis=0))
    # Columns are whitened as each alone.
    np.testing.assert_allclose(Whitener(chains, error, 90)(values[:, :1]), found[:, :1])


def test_without_model_error_readings_are_divided_by_their_noise():
    one = chain("voltage_V", 0, 0, times(20, 0))
    values = np.random.default_rng(0).standard_normal((20, 2))
    np.testing.assert_array_equal(Whitener([one], NONE, 20)(values), values / NOISE)


@pytest.mark.parametrize(("rho", "tau"), [(0.0, 120.0), (0.6, 3000.0)])
def test_simulated_errors_become_white(rho: float, tau: float):
    """Where the noise is AR(1), approximately, and only if the error moves little from one reading to the next."""
    rng, rows, s = np.random.default_rng(1), 60, 2.0
    time_s = 4.0 * np.arange(rows)
    coloured = NOISE**2 * rho ** np.abs(np.subtract.outer(np.arange(rows), np.arange(rows)))
    dense = coloured + covariance(time_s, s, tau)
    errors = np.linalg.cholesky(dense) @ rng.standard_normal((rows, 4000))
    differenced = errors.copy()
    differenced[1:] = (errors[1:] - rho * errors[:-1]) / np.sqrt(1.0 - rho**2)
    white = Whitener(
        [chain("voltage_V", 0, 0, time_s, rho)], ModelError({("voltage_V", 0): s}, {"voltage_V": tau}), rows
    )
    found = white(differenced)
    seen = found @ found.T / errors.shape[1]
    np.testing.assert_allclose(np.diag(seen)[1:], 1.0, atol=0.1)
    off = seen - np.diag(np.diag(seen))
    assert np.max(np.abs(off[2:, 2:])) < (0.1 if rho == 0.0 else 0.15)
    if rho == 0.0:
        return
    exact = np.sum(errors * np.linalg.solve(dense, errors), axis=0)
    assert np.mean(np.sum(found**2, axis=0)) == pytest.approx(np.mean(exact), rel=0.05)


@pytest.mark.parametrize(("s", "tau"), [(0.5, 100.0), (5.0, 30.0), (5.0, 300.0), (50.0, 100.0)])
def test_size_and_correlation_time_of_simulated_errors_are_found(s: float, tau: float):
    rng = np.random.default_rng(4)
    chains = [chain("voltage_V", run, 300 * run, 5.0 * np.arange(300)) for run in range(3)]
    errors = np.concatenate([drawn(one.time_s, s, tau, rng) for one in chains])
    found = estimate(chains, errors)
    assert found.of_channel("voltage_V") == pytest.approx(s, rel=0.6)
    assert 1.0 / 4.0 < found.tau_s["voltage_V"] / tau < 4.0


def test_runs_have_sizes_of_their_own_about_that_of_all():
    rng = np.random.default_rng(5)
    chains = [chain("voltage_V", run, 300 * run, 5.0 * np.arange(300)) for run in range(3)]
    errors = np.concatenate([drawn(one.time_s, s, 100.0, rng) for one, s in zip(chains, (1.0, 1.0, 6.0), strict=True)])
    found = estimate(chains, errors)
    sizes = [found.sd["voltage_V", run] for run in range(3)]
    assert sizes[2] > 2.0 * max(sizes[:2])
    assert max(sizes[:2]) < 2.0


def test_white_noise_has_no_model_error():
    """At most one draw of twenty."""
    chains = [chain("voltage_V", run, 120 * run, 5.0 * np.arange(120)) for run in range(2)]
    alarms = 0
    for seed in range(40):
        errors = NOISE * np.random.default_rng(seed).standard_normal(240)
        alarms += bool(estimate(chains, errors).sd)
    assert alarms <= 2


def test_channels_are_separate_and_a_tolerance_limits_the_size():
    rng = np.random.default_rng(6)
    time_s = 5.0 * np.arange(200)
    chains = [chain("voltage_V", 0, 0, time_s), chain("temperature", 0, 200, time_s)]
    errors = np.concatenate([drawn(time_s, 3.0, 100.0, rng), NOISE * rng.standard_normal(200)])
    free = estimate(chains, errors)
    assert free.sd.keys() == {("voltage_V", 0)}
    assert free.tau_s.keys() == {"voltage_V"}
    assert free.of_channel("temperature") == 0.0
    held = estimate(chains, errors, {"voltage_V": 0.5})
    assert 0.0 < held.of_channel("voltage_V") < free.of_channel("voltage_V")
