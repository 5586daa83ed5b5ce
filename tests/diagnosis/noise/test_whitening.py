"""Whitening: exactly the inverse square root of the AR(1) covariance, whatever is missing."""

import numpy as np
import pytest

from jaxmodel.diagnosis.noise.whitening import chain_starts, chain_weights, whiten


def covariance(starts: np.ndarray, clock: np.ndarray, rho: float, sd: np.ndarray) -> np.ndarray:
    chain = np.cumsum(starts)
    correlation = np.where(chain[:, None] == chain, rho ** np.abs(clock[:, None] - clock), 0.0)
    return sd[:, None] * correlation * sd


@pytest.mark.parametrize("rho", [0.0, 0.4, 0.95, -0.6])
def test_whitened_covariance_is_the_identity(rho):
    starts = chain_starts([range(7), range(5)])
    sd = np.linspace(0.5, 2.0, 12)
    w = whiten(np.eye(12), starts, rho, sd)
    assert w @ covariance(starts, np.arange(12), rho, sd) @ w.T == pytest.approx(np.eye(12), abs=1e-12)


def test_missing_readings_are_bridged_exactly_and_weigh_nothing():
    starts = chain_starts([range(9)])
    present = np.array([1, 1, 0, 1, 0, 0, 1, 1, 0], dtype=bool)
    w = whiten(np.eye(9), starts, 0.8, 1.0, present)
    whitened_covariance = w @ covariance(starts, np.arange(9), 0.8, np.ones(9)) @ w.T
    assert whitened_covariance == pytest.approx(np.diag(present.astype(float)), abs=1e-12)


def test_what_stands_in_a_missing_row_does_not_matter():
    present = np.array([True, False, True, True])
    values = np.array([1.0, np.nan, 2.0, 4.0])
    filled = np.nan_to_num(values, nan=1e9)
    starts = chain_starts([range(4)])
    assert np.array_equal(whiten(values, starts, 0.5, 1.0, present), whiten(filled, starts, 0.5, 1.0, present))


def test_chain_restarts_at_every_run():
    starts = chain_starts([range(3), range(2), range(2)])
    assert starts.tolist() == [True, False, False, True, False, True, False]
    values = np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0])
    whitened = whiten(values, starts, 0.9, 2.0)
    assert whitened[starts] == pytest.approx(values[starts] / 2.0)
    assert whitened[1] == pytest.approx((1.0 - 0.9 * 3.0) / (2.0 * np.sqrt(1.0 - 0.81)))
    assert chain_weights(starts, 0.9, np.ones(7, dtype=bool))[1].tolist() == [0.0, 0.9, 0.9, 0.0, 0.9, 0.0, 0.9]


def test_columns_are_whitened_as_each_alone():
    values = np.random.default_rng(0).normal(size=(20, 3))
    starts = chain_starts([range(8), range(12)])
    together = whiten(values, starts, 0.6, 0.3)
    alone = np.stack([whiten(column, starts, 0.6, 0.3) for column in values.T], axis=1)
    assert together == pytest.approx(alone)


def test_runs_without_rows_start_nothing():
    assert chain_starts([range(2), range(0), range(3)]).tolist() == [True, False, True, False, False]


def test_chain_restarts_after_a_pause_and_not_where_the_logger_slows_down():
    gap = np.array([0.0, 1.0, 2.0, 3.0, 3600.0, 3601.0, 3602.0])
    assert np.flatnonzero(chain_starts([gap])).tolist() == [0, 4]
    slower = np.cumsum([0.0, 1.0, 1.0, 60.0, 60.0, 60.0, 1.0, 1.0])
    assert np.flatnonzero(chain_starts([slower, [0.0], [0.0, 50.0]])).tolist() == [0, 8, 9]


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"rho": 1.0, "sd": 1.0}, "rho"),
        ({"rho": 0.5, "sd": 0.0}, "positive"),
    ],
)
def test_impossible_noise_is_refused(arguments, why):
    with pytest.raises(ValueError, match=why):
        whiten(np.zeros(3), chain_starts([range(3)]), **arguments)
