"""Held inputs are averaged; changing inputs stay as measured, however small the change."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.diagnosis.preparation.held_inputs import LONG, held, rows_held, stretches

SD = 0.02
LEVELS = np.repeat([0.0, 3.0, 0.0, 1.2, 5.0], [30, 8, 200, 62, 100])


def read(values: np.ndarray, seed: int = 0) -> np.ndarray:
    return values + SD * np.random.default_rng(seed).standard_normal(values.size)


def test_the_mean_of_a_hold_is_nearer_to_what_was_held():
    readings = read(LEVELS)
    found = held(readings, SD)
    rows = rows_held(found, np.arange(found.size))
    np.testing.assert_array_equal(rows, np.repeat([30, 8, 200, 62, 100], [30, 8, 200, 62, 100]))
    assert np.all(np.abs(found - LEVELS) < 4.0 * SD / np.sqrt(rows))
    assert found.sum() == pytest.approx(readings.sum())  # no charge is made


@pytest.mark.parametrize(
    "values",
    [
        np.linspace(0.0, 0.3, 400),  # a drift of 15 sd over the run
        3.0 * np.sin(np.arange(400) / 15.0),
        5.0 * np.random.default_rng(1).standard_normal(400),  # a drive cycle
        np.repeat(np.random.default_rng(2).uniform(0.0, 5.0, 80), 5),  # shorter than a hold
    ],
)
def test_what_moves_is_left_as_it_was_read(values: np.ndarray):
    readings = read(values)
    np.testing.assert_array_equal(held(readings, SD), readings)


def test_one_hold_that_drifts_is_left_among_others_that_do_not():
    values = LEVELS.copy()
    values[238:300] = 1.2 + np.linspace(0.0, 0.3, 62)
    readings = read(values)
    found = held(readings, SD)
    np.testing.assert_array_equal(found[238:300], readings[238:300])
    assert np.ptp(found[38:238]) == 0.0


def test_stretches_are_of_one_hold_or_of_none_and_of_so_many_rows_at_most():
    values = np.concatenate([np.full(20, 1.0), np.arange(13.0), np.full(LONG, 2.0), np.full(3, 5.0), np.full(3, 6.0)])
    numbers = stretches(values, np.arange(values.size), 7)
    sizes = [7, 7, 6, 7, 6, 7, 1, 6]
    np.testing.assert_array_equal(numbers, np.repeat(np.arange(len(sizes)), sizes))


def test_several_steps_of_a_row_are_one_row():
    row = np.repeat(np.arange(20), 3)
    values = np.where(row < 10, 1.0, 2.0)
    np.testing.assert_array_equal(rows_held(values, row), 10)
    np.testing.assert_array_equal(stretches(values, row, 5), row // 5)
