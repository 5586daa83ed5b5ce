"""Where fits begin anew: within the priors, beside an effect too faint to matter, and over a bending law's ridges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discrepancy.calibrate import Fit, fit, objectives
from discrepancy.candidates import Candidate
from discrepancy.lanes import LANES
from discrepancy.problem import Problem

_FAINT = 3.0
# Of an amplitude with many local optima: places looked at about a fit, and how far, in prior sd, look after look.
_PLACES = 65
_REACHES = (0.4, 0.1, 0.1)


def likeliest_of_some(problem: Problem, unknowns: int) -> np.ndarray:
    """Return the best of one batch of places drawn from the priors.

    Where a case states a motor that stalls, nothing moves the readings, and no slope leads away from there.
    """
    places = np.random.default_rng(0).normal(size=(LANES, unknowns))
    return places[np.argmin(objectives(problem, places))]


def over_the_ridges(problem: Problem, amplitude: int, own: Sequence[int], found: Fit) -> Fit:
    """Look along an amplitude with many local optima for a place better than the fit's, and fit again from there."""
    for reach in _REACHES:
        places = np.repeat(found.x[None], _PLACES, axis=0)
        places[:, amplitude] += np.linspace(-reach, reach, _PLACES)
        values = objectives(problem, places)
        if np.min(values) < found.objective - 1.0:
            found = min(found, fit(problem, places[np.argmin(values)], own), key=lambda one: one.objective)
    return found


def faintest(candidate: Candidate) -> np.ndarray:
    """Return coordinates at which the effect is far below its usual size."""
    x = np.zeros(len(candidate.coordinates))
    if candidate.coordinates[0].logarithmic and candidate.has_amplitude:
        x[0] = _FAINT if candidate.null_at_infinity else -_FAINT
    return x
