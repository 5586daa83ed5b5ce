"""Predictions of left-out readings are exact for linear models."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.diagnosis.evidence.left_out import LeftOut, expected_gain, left_out
from jaxmodel.diagnosis.fitting.fit import Fit

ROWS, BLOCKS = 40, 4


def linear_fit(matrix: np.ndarray, data: np.ndarray, prior_sd: np.ndarray) -> Fit:
    """Return the fit of data = matrix x + white noise with a prior of x."""
    information = matrix.T @ matrix + np.diag(prior_sd**-2.0)
    x = np.linalg.solve(information, matrix.T @ data)
    return Fit(x, tuple(range(x.size)), prior_sd, data - matrix @ x, -matrix, 0.0, 1)


def log_marginal(matrix: np.ndarray, data: np.ndarray, prior_sd: np.ndarray) -> float:
    """Return the log probability of data, minus the constant that all models share."""
    covariance = np.eye(data.size) + (matrix * prior_sd**2) @ matrix.T
    return float(-0.5 * data @ np.linalg.solve(covariance, data) - 0.5 * np.linalg.slogdet(covariance)[1])


@pytest.fixture(scope="module")
def made() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Matrix, data, prior and block; the last unknown but one is of the second block alone, the last of no reading."""
    rng = np.random.default_rng(0)
    block = np.repeat(np.arange(BLOCKS), ROWS // BLOCKS)
    matrix = rng.standard_normal((ROWS, 6)) * np.array([3.0, 1.0, 0.3, 0.1, 2.0, 0.0])
    matrix[block != 1, 4] = 0.0
    prior_sd = np.array([1.0, 0.5, 2.0, 1.0, 1.0, 1.0])
    return matrix, matrix @ (prior_sd * rng.standard_normal(6)) + rng.standard_normal(ROWS), prior_sd, block


def test_score_of_a_block_is_its_probability_given_the_others(made):
    matrix, data, prior_sd, block = made
    found = left_out(linear_fit(matrix, data, prior_sd), block)
    whole = log_marginal(matrix, data, prior_sd)
    for place, number in enumerate(found.blocks):
        kept = block != number
        expected = whole - log_marginal(matrix[kept], data[kept], prior_sd)
        assert found.log_score[place] == pytest.approx(expected, abs=1e-8)


def test_errors_and_moves_are_those_of_a_fit_to_the_others(made):
    matrix, data, prior_sd, block = made
    fitted = linear_fit(matrix, data, prior_sd)
    found = left_out(fitted, block)
    for place, number in enumerate(found.blocks):
        kept = block != number
        others = linear_fit(matrix[kept], data[kept], prior_sd)
        np.testing.assert_allclose(fitted.x + found.moves[place], others.x, atol=1e-9)
        np.testing.assert_allclose(found.errors[~kept], data[~kept] - matrix[~kept] @ others.x, atol=1e-9)


def test_evidence_is_the_probability_of_all(made):
    matrix, data, prior_sd, _ = made
    assert linear_fit(matrix, data, prior_sd).log_evidence == pytest.approx(log_marginal(matrix, data, prior_sd))


def test_expected_gain_is_at_most_the_average_gain_if_the_richer_model_is_true():
    rng = np.random.default_rng(1)
    block = np.repeat(np.arange(BLOCKS), ROWS // BLOCKS)
    richer, prior_sd = 0.7 * rng.standard_normal((ROWS, 3)), np.ones(3)
    poorer = richer[:, :2]
    gained, expected, sizes = [], [], []
    for _ in range(200):
        data = richer @ np.array([0.5, -0.5, 1.5]) + rng.standard_normal(ROWS)
        rich, poor = linear_fit(richer, data, prior_sd), linear_fit(poorer, data, prior_sd[:2])
        own, other = left_out(rich, block), left_out(poor, block)
        found = expected_gain(rich, other, own, block)
        sizes.append(found.min())
        gained.append(np.sum(own.log_score - other.log_score))
        expected.append(np.sum(found))
    assert min(sizes) >= 0.0
    assert 0.4 < np.mean(expected) / np.mean(gained) < 1.1


def test_a_model_with_equal_predictions_has_no_expected_gain(made):
    matrix, data, prior_sd, block = made
    fitted = linear_fit(matrix, data, prior_sd)
    same = left_out(fitted, block)
    assert isinstance(same, LeftOut)
    np.testing.assert_array_equal(expected_gain(fitted, same, same, block), np.zeros(BLOCKS))
