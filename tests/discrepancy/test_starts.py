"""Starts of fits: over the ridges of an amplitude with many local optima."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np

from discrepancy.calibrate import fit
from discrepancy.problem import BASE, Start
from discrepancy.session import Hypothesis
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


class _BesideAnother(Hypothesis):
    """A model with an effect that the one fitted again does not have."""

    @property
    def start(self) -> Start:
        return {**super().start, "an effect of the other": np.ones(1)}


def test_a_model_is_fitted_again_from_where_another_ended(plain_session):
    """What settled in a poor place is replaced, and all that was read off it; what is no better is not."""
    session = copy.copy(plain_session)
    found = session.hypothesis()
    poor = dataclasses.replace(found, fitted=fit(found.problem, found.fitted.x + 1.0, steps=1))
    session.__dict__.update(_hypotheses={(): poor}, _rungs={}, _screens={})
    left = session.rung("", session.hypothesis()).errors["voltage_V"].fit
    better = session.again((), _BesideAnother(**vars(found)))
    assert better.fitted.objective < poor.fitted.objective
    assert session.hypothesis() is better
    assert session.rung("", better).errors["voltage_V"].fit < left
    assert session.again((), poor) is better
