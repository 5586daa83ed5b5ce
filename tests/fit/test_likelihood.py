"""Weights of errors: independent readings are counted by the autocorrelation, and no weight is above the noise's."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmodel.fit.data import FitData
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood, autocorrelation_time, from_errors, from_tolerances

ROWS, RUNS, NOISE = 2000, 4, 0.002


def ar1(rho: float, rng: np.random.Generator, rows: int = ROWS) -> np.ndarray:
    """Return AR(1) noise of unit sd."""
    shocks = rng.standard_normal(rows) * np.sqrt(1.0 - rho**2)
    shocks[0] /= np.sqrt(1.0 - rho**2)
    return lfilter([1.0], [1.0, -rho], shocks)


def data_of(**noise: float) -> FitData:
    """Return readings of some channels in a few runs of one length."""
    size = ROWS * RUNS * len(noise)
    names = np.repeat(np.arange(len(noise)), ROWS * RUNS)
    rows = np.tile(np.arange(ROWS), RUNS * len(noise))
    runs = np.tile(np.repeat(np.arange(RUNS), ROWS), len(noise))
    chains = tuple(
        ((name, run), slice((number * RUNS + run) * ROWS, (number * RUNS + run + 1) * ROWS))
        for number, name in enumerate(noise)
        for run in range(RUNS)
    )
    return FitData(np.zeros(size), runs, rows, names, 1.0 * rows, np.array([*noise.values()])[names], chains)


@pytest.mark.parametrize("seed", range(5))
def test_every_white_reading_counts(seed: int):
    rng = np.random.default_rng(seed)
    assert autocorrelation_time([ar1(0.0, rng) for _ in range(RUNS)]) == 1.0
    assert autocorrelation_time([ar1(0.0, rng, 50) for _ in range(2)]) < 1.6


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.9, 0.97])
def test_readings_for_each_independent_one_are_those_of_theory(rho: float):
    """Of AR(1) errors (1 + rho) / (1 - rho), with a sampling error by Bartlett's formula for a sum of lags."""
    rng = np.random.default_rng(1)
    found = np.array([autocorrelation_time([ar1(rho, rng) for _ in range(RUNS)]) for _ in range(20)])
    expected = (1.0 + rho) / (1.0 - rho)
    # About four correlation times are summed; cut there, the sum lacks little.
    sampling = expected * np.sqrt(2.0 * (2.0 * 4.0 * expected + 1.0) / (ROWS * RUNS))
    assert np.mean(found) == pytest.approx(expected, rel=0.1, abs=3.0 * sampling / np.sqrt(20))
    assert np.std(found) < 2.0 * sampling


def test_an_error_that_lasts_a_run_is_one_of_its_few_readings():
    level = [np.full(ROWS, value) for value in (1.0, -1.0, 0.5, -0.5)]
    # Lags up to a third of a run are summed, over which the autocorrelation falls to two thirds.
    assert autocorrelation_time(level) > 0.5 * ROWS


def test_series_of_a_few_readings_or_without_error_have_no_autocorrelation():
    assert autocorrelation_time([np.ones(3)]) == 1.0
    assert autocorrelation_time([np.zeros(ROWS)]) == 1.0


def test_noise_alone_has_the_weight_of_the_noise():
    data, rng = data_of(voltage_V=NOISE), np.random.default_rng(2)
    channel = from_errors(data, NOISE * rng.standard_normal(data.count)).channels["voltage_V"]
    assert channel.sd == pytest.approx(NOISE, rel=0.02)
    assert channel.inflation == 1.0
    assert channel.root == pytest.approx(1.0 / NOISE, rel=0.02)
    assert channel.independent == channel.count == data.count


@pytest.mark.parametrize("share", [0.0, 1e-3, 0.3, 0.99])
def test_s_is_never_below_the_noise(share: float):
    data, rng = data_of(voltage_V=NOISE), np.random.default_rng(3)
    slow = np.concatenate([ar1(0.98, rng) for _ in range(RUNS)])
    channel = from_errors(data, share * NOISE * slow, {"voltage_V": 30.0}).channels["voltage_V"]
    assert channel.sd >= NOISE
    assert 1.0 <= channel.inflation <= 120.0


def test_errors_below_the_noise_lose_their_correlation():
    """They are hidden in noise that is white."""
    data, rng = data_of(voltage_V=NOISE), np.random.default_rng(3)
    slow = np.concatenate([ar1(0.98, rng) for _ in range(RUNS)])
    slow /= np.sqrt(np.mean(slow**2))
    whole, half, faint = (
        from_errors(data, share * NOISE * slow).channels["voltage_V"].inflation for share in (1.01, 0.5, 0.01)
    )
    assert half == pytest.approx(0.25 * whole)
    assert faint == 1.0


def test_a_weight_counts_independent_readings():
    channel = ChannelWeight(2.0, 9.0, 90)
    assert channel.root == pytest.approx(1.0 / 6.0)
    assert channel.independent == pytest.approx(10.0)


def test_more_degrees_of_freedom_raise_s():
    data, rng = data_of(voltage_V=NOISE), np.random.default_rng(4)
    errors = 0.02 * np.concatenate([ar1(0.98, rng) for _ in range(RUNS)])
    found = [from_errors(data, errors, {"voltage_V": used}).channels["voltage_V"] for used in (0.0, 5.0, 20.0, 1e9)]
    sds = [one.sd for one in found]
    assert sds == sorted(sds)
    assert sds[0] < sds[1] < sds[2] < sds[3]
    assert sds[0] == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert sds[1] == pytest.approx(sds[0] * np.sqrt(found[0].independent / (found[0].independent - 5.0)))
    assert np.isfinite(sds[3]), "however many unknowns there are, some readings are left"


def test_each_channel_has_its_own_weight_pooled_over_runs():
    data, rng = data_of(voltage_V=NOISE, soc=0.01), np.random.default_rng(5)
    errors = np.zeros(data.count)
    for (name, run), rows in data.chains:
        errors[rows] = (0.05 if name == "voltage_V" and run == 2 else 0.001) * rng.standard_normal(ROWS)
    weights = from_errors(data, errors)
    expected = np.sqrt((3.0 * 0.001**2 + 0.05**2) / 4.0)
    assert weights.channels["voltage_V"].sd == pytest.approx(expected, rel=0.05)
    assert weights.channels["soc"].sd == pytest.approx(0.01)
    root = weights.roots(data)
    assert len(set(root[data.channel == 0])) == len(set(root[data.channel == 1])) == 1
    np.testing.assert_allclose(root[data.channel == 1], weights.channels["soc"].root)


def test_a_fit_begins_with_errors_of_a_tolerance():
    data = data_of(voltage_V=NOISE, soc=0.01)
    weights = from_tolerances(data, {"voltage_V": 0.02, "soc": 0.05}, inflation=1.0)
    assert weights.channels["voltage_V"].root == pytest.approx(50.0)
    assert weights.distance(weights) == 0.0
    channels = dict(weights.channels)
    channels["soc"] = dataclasses.replace(channels["soc"], sd=0.1)
    assert weights.distance(dataclasses.replace(weights, channels=channels)) == pytest.approx(np.log(2.0))


def test_weights_half_way_are_half_way_in_their_logarithms():
    one = Likelihood({"voltage_V": ChannelWeight(0.001, 1.0, 100)})
    other = Likelihood({"voltage_V": ChannelWeight(0.004, 9.0, 100)})
    between = one.towards(other)
    channel = between.channels["voltage_V"]
    assert (channel.sd, channel.inflation, channel.count) == (pytest.approx(0.002), pytest.approx(3.0), 100)
    assert between.distance(one) == pytest.approx(between.distance(other)) == pytest.approx(one.distance(other) / 2.0)
