"""Where fits begin anew: within the priors, beside an effect too faint to matter, along an amplitude of many optima."""

from __future__ import annotations

import itertools

import numpy as np

from discrepancy.fitting.candidates import Candidate
from discrepancy.fitting.fit import Fit, fit, objectives
from discrepancy.fitting.lanes import LANES
from discrepancy.fitting.model import Setting, View
from discrepancy.fitting.readings import Weights

# Of all random numbers: the same case is told the same.
SEED = 0
_FAINT = 3.0
# Of an amplitude with many local optima: places looked at about a fit, and how far, in prior sd, in looks after the
# first.
_PLACES = 65
_CLOSER = (0.1, 0.1)
# Steps along the amplitude alone from the best place of a look: within a row a delay is felt in straight lines.
_ALONG = 5


def likeliest_of_some(view: View, setting: Setting, weights: Weights) -> np.ndarray:
    """Return the best of one batch of places drawn from the priors of the model's own unknowns.

    Where a case states a motor that stalls, nothing moves the readings, and no slope leads away from there.
    """
    places = np.zeros((LANES, setting.prior_sd.size))
    free = list(setting.free)
    places[:, free] = np.random.default_rng(SEED).normal(size=(LANES, len(free))) * setting.prior_sd[free]
    return places[np.argmin(objectives(view, setting, weights, places))]


def over_the_ridges(
    view: View, setting: Setting, weights: Weights, candidate: Candidate, found: Fit, rival: float = np.inf
) -> Fit:
    """Look along an amplitude with many local optima for a place better than the fit's, and fit again from there.

    Far along it the other numbers are looked at where the fit has them, within their range, and at its ends: a fit that
    settled between the wrong ridges has settled them wrongly too. At the ends the valley may be narrower than from
    place to place: where no place is better, the best is followed down along the amplitude.

    Args:
        view: the readings.
        setting: a model with the effect.
        weights: what makes its errors white.
        candidate: the effect, its amplitude first.
        found: the fit.
        rival: objective of a model that this one must come near.
    """
    amplitude, *shapes = view.space.layout.of[candidate.label]
    ends = [np.array(each) for each in itertools.product(*candidate.shape_ends) if each]

    def within(x: np.ndarray) -> np.ndarray:
        return np.clip(x[shapes], np.min(ends, axis=0), np.max(ends, axis=0)) if ends else x[shapes]

    others = [within(found.x), *ends]
    for reach in (candidate.reach, *_CLOSER):
        along = np.linspace(-reach, reach, _PLACES)
        points = np.repeat(found.x[None], _PLACES * len(others), axis=0)
        points[:, amplitude] += np.tile(along, len(others))
        points[:, shapes] = np.repeat(others, _PLACES, axis=0)
        values = objectives(view, setting, weights, points)
        best, least = points[np.argmin(values)], float(np.min(values))
        if least >= found.objective - 1.0 and len(others) > 1:
            best, least = _down_the_valleys(
                view, setting, weights, points[_PLACES:], values[_PLACES:], amplitude, rival
            )
        if least < found.objective - 1.0:
            if shapes:  # held at first: from ridge to ridge they make up for an amplitude a little off
                free = [place for place in setting.free if place not in shapes]
                best = fit(view, setting, weights, best, rival=rival, free=free).x
            led = fit(view, setting, weights, best, rival=rival)
            found = min(found, led, key=lambda one: one.objective)
        others = [within(found.x)]
    return found


def _down_the_valleys(
    view: View,
    setting: Setting,
    weights: Weights,
    points: np.ndarray,
    values: np.ndarray,
    amplitude: int,
    rival: float,
) -> tuple[np.ndarray, float]:
    """Return the best place, and its objective, of fits of the amplitude alone from the best of each row of looks."""
    begins = [first + np.argmin(values[first : first + _PLACES]) for first in range(0, values.size, _PLACES)]
    ends = np.stack(
        [fit(view, setting, weights, points[begin], rival=rival, steps=_ALONG, free=[amplitude]).x for begin in begins]
    )
    reached = objectives(view, setting, weights, ends)
    return ends[np.argmin(reached)], float(np.min(reached))


def faintest(candidate: Candidate) -> np.ndarray:
    """Return coordinates at which the effect is far below its usual size."""
    x = np.zeros(len(candidate.coordinates))
    if candidate.coordinates[0].logarithmic and candidate.has_amplitude:
        x[0] = _FAINT if candidate.null_at_infinity else -_FAINT
    return x
