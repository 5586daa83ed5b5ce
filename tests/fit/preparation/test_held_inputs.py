"""Held inputs are averaged; changing inputs stay as measured, however small the change."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.fit.preparation.held_inputs import held

SD = 0.02
LEVELS = np.repeat([0.0, 3.0, 0.0, 1.2, 5.0], [30, 8, 200, 62, 100])


def read(values: np.ndarray, seed: int = 0) -> np.ndarray:
    return values + SD * np.random.default_rng(seed).standard_normal(values.size)


def test_the_mean_of_a_hold_is_nearer_to_what_was_held():
    readings = read(LEVELS)
    found = held(readings, SD)
    rows = np.repeat([30, 8, 200, 62, 100], [30, 8, 200, 62, 100])
    assert np.flatnonzero(np.diff(found)).tolist() == np.flatnonzero(np.diff(LEVELS)).tolist()
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
