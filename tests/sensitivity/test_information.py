"""Bounds, shares and directions of Fisher information, against least squares done by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.sensitivity.information import Information, direction_in_words


def made(seed: int, parts: int = 3, unknowns: int = 4) -> tuple[Information, np.ndarray]:
    """Some parts' information, and the sensitivities behind it, five readings each."""
    slopes = np.random.default_rng(seed).standard_normal((parts, 5, unknowns))
    return Information(tuple("abcd"[:unknowns]), np.einsum("pni,pnj->pij", slopes, slopes)), slopes


def test_bounds_are_those_of_least_squares_with_and_without_prior_rows():
    information, slopes = made(1)
    rows = slopes.reshape(-1, 4)
    np.testing.assert_allclose(information.sd_of_data() ** 2, np.diag(np.linalg.inv(rows.T @ rows)), rtol=1e-9)
    with_prior = np.vstack([rows, np.eye(4)])
    covariance = np.linalg.inv(with_prior.T @ with_prior)
    np.testing.assert_allclose(information.covariance, covariance, rtol=1e-9)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(information.correlation(), covariance / np.outer(sd, sd), rtol=1e-9)


@given(st.integers(0, 10**6))
def test_shares_are_of_the_part_of_a_sensitivity_that_the_others_cannot_make_up_for(seed: int):
    """By regression of one column of [J; I] on the others: the squares left over, row by row, are the shares."""
    information, slopes = made(seed)
    rows = np.vstack([slopes.reshape(-1, 4), np.eye(4)])
    shares = information.shares()
    np.testing.assert_allclose(shares.sum(axis=0), 1.0, rtol=1e-9)
    for i in range(4):
        others = np.delete(rows, i, axis=1)
        left = rows[:, i] - others @ np.linalg.lstsq(others, rows[:, i], rcond=None)[0]
        squares = left**2 / np.sum(left**2)
        expected = [*squares[:15].reshape(3, 5).sum(axis=1), squares[15 + i], squares[15:].sum() - squares[15 + i]]
        np.testing.assert_allclose(shares[:, i], expected, atol=1e-9)


def test_without_data_all_stays_as_it_was_known():
    nothing = Information(("a", "b"), np.zeros((2, 2, 2)))
    np.testing.assert_array_equal(nothing.sd(), [1.0, 1.0])
    np.testing.assert_array_equal(nothing.sd_of_data(), [np.inf, np.inf])
    np.testing.assert_array_equal(nothing.shares(), [[0, 0], [0, 0], [1, 1], [0, 0]])


def test_what_is_told_only_together_is_open_alone():
    """Readings of ln R + ln C and of b: both are open by the data alone; one run less leaves b open too."""
    both = np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0]) * 100.0
    information = Information(("R", "C", "b"), np.array([both, np.diag([0.0, 0.0, 4.0])]))
    np.testing.assert_array_equal(information.sd_of_data(), [np.inf, np.inf, 0.5])
    np.testing.assert_array_equal(information.without([1]).sd_of_data(), np.full(3, np.inf))
    strength, axes = information.directions()
    assert strength[0] == pytest.approx(0.0, abs=1e-9)
    assert set(direction_in_words(information.names, axes[:, 0]).split(" only as a ")[0].split(" and ")) == {"R", "C"}
    assert direction_in_words(information.names, axes[:, 0]).endswith("only as a product")


@pytest.mark.parametrize(
    ("way", "words"),
    [
        ([1.0, -1.0, 0.1], "R and C only as a product"),
        ([1.0, 1.0, 0.0], "R and C only as a ratio"),
        ([0.5, -1.0, 0.0], "C and R only as C * R^2"),
        ([0.0, 0.1, -1.0], "b alone"),
        ([1.0, 0.8, -0.6], "R, C up together with b down"),
    ],
)
def test_direction_in_words(way: list[float], words: str):
    assert direction_in_words(("R", "C", "b"), np.array(way)) == words


def test_no_product_is_named_of_what_has_no_proportion():
    words = direction_in_words(("soc", "R"), np.array([1.0, -1.0]), {"soc": False})
    assert words == "soc up together with R down"
