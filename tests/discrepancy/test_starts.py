"""Starts of fits: over the ridges of an amplitude with many local optima."""

from __future__ import annotations

import numpy as np

from discrepancy.calibrate import fit
from discrepancy.problem import BASE
from discrepancy.starts import over_the_ridges
from tests.discrepancy.made_cases import made_cell, with_candidates

DELAY_S = -7.7


def test_a_fit_between_the_wrong_ridges_is_led_over_them(tmp_path):
    session = with_candidates(made_cell(tmp_path, {"clock_shift": {"d": DELAY_S}}).case, "clock_shift")
    candidate = session.candidates["clock_shift"]
    problem, layout = session.problem_of(("clock_shift",))
    delay, resampled = candidate.coordinates
    # As if the logger had sampled the true course, which it did not: it draws straight lines between rows.
    begin = {BASE: np.zeros(layout.base), "clock_shift": np.array([delay.at(DELAY_S - 4.0), resampled.at(0.0)])}
    stuck = fit(problem, layout.at(begin))
    places = layout.of_effect["clock_shift"]
    readings = float(np.sum(np.asarray(problem.readings.fit)))
    assert stuck.chi2 > 10.0 * readings, "the fit is to be led out of a poor place, and is in none"

    led = over_the_ridges(problem, candidate, places, layout.own(("clock_shift",)), stuck)
    assert led.chi2 < 1.1 * readings
    assert abs(delay.number(led.x[places[0]]) - DELAY_S) < 3.0 * delay.slope(0.0) * led.sd[places[0]]
