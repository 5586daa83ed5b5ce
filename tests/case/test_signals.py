"""Pauses of a logger."""

import numpy as np

from jaxmodel.case.signals import after_pauses, represented_s


def test_a_pause_is_not_where_the_logger_slows_down():
    gap = np.array([0.0, 1.0, 2.0, 3.0, 3600.0, 3601.0, 3602.0])
    assert np.flatnonzero(after_pauses(gap)).tolist() == [0, 4]
    slower = np.cumsum([0.0, 1.0, 1.0, 60.0, 60.0, 60.0, 1.0, 1.0])
    assert np.flatnonzero(after_pauses(slower)).tolist() == [0]


def test_one_or_two_rows_have_no_pause():
    assert after_pauses(np.array([0.0])).tolist() == [True]
    assert after_pauses(np.array([0.0, 50.0])).tolist() == [True, False]
    assert after_pauses(np.zeros(0)).tolist() == []


def test_a_reading_represents_half_of_the_time_to_its_neighbours_and_nothing_of_a_pause():
    assert represented_s(np.array([0.0, 1.0, 2.0, 4.0, 6.0])).tolist() == [1.0, 1.0, 1.5, 2.0, 2.0]
    assert represented_s(np.array([0.0, 1.0, 2.0, 3.0, 9000.0, 9001.0])).tolist() == [1.0] * 6
    assert represented_s(np.array([0.0, 60.0, 120.0, 9000.0])).tolist() == [60.0] * 4
    assert represented_s(np.array([0.0, 5.0])).tolist() == [5.0, 5.0]
