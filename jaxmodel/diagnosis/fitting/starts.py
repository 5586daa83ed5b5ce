"""Starts of fits: random ones within the priors, negligible effects, and search along amplitudes with many optima."""

from __future__ import annotations

import itertools

import numpy as np

from jaxmodel.diagnosis.fitting.candidates import Candidate
from jaxmodel.diagnosis.fitting.fit import Fit, fit, objectives
from jaxmodel.diagnosis.fitting.lanes import LANES
from jaxmodel.diagnosis.fitting.model import Setting, View
from jaxmodel.diagnosis.fitting.readings import Weights

# Seed of all random numbers: a case always gives the same result.
SEED = 0
_FAINT = 3.0
# Search along an amplitude with many local optima: points around a fit, and their range, in prior sd, in the searches
# after the first.
_PLACES = 65
_CLOSER = (0.1, 0.1)
# Steps along the amplitude alone from the best point: within one row the readings are linear in a delay.
_ALONG = 5


def best_random_start(view: View, setting: Setting, weights: Weights) -> np.ndarray:
    """Return the best of one batch of points drawn from the priors of the model's free unknowns.

    If the stated motor stalls, no unknown affects the readings, and a gradient gives no direction.
    """
    places = np.zeros((LANES, setting.prior_sd.size))
    free = list(setting.free)
    places[:, free] = np.random.default_rng(SEED).normal(size=(LANES, len(free))) * setting.prior_sd[free]
    return places[np.argmin(objectives(view, setting, weights, places))]


def best_local_optimum(
    view: View, setting: Setting, weights: Weights, candidate: Candidate, found: Fit, rival: float = np.inf
) -> Fit:
    """Search along an amplitude with many local optima for a better point, and fit again from there.

    The other parameters of the effect are held at their fitted values, and at the ends of their usual ranges: at a
    wrong local optimum they are wrong too. At these ends an optimum may be narrower than the grid: if no point is
    better, the best ones are first optimised along the amplitude.

    Args:
        view: the readings.
        setting: a model with the effect.
        weights: that whiten its errors.
        candidate: the effect, its amplitude first.
        found: the fit.
        rival: objective of a competing model.
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
            best, least = _optimised_along(view, setting, weights, points[_PLACES:], values[_PLACES:], amplitude, rival)
        if least < found.objective - 1.0:
            if shapes:  # held first: they could compensate for a slightly wrong amplitude
                free = [place for place in setting.free if place not in shapes]
                best = fit(view, setting, weights, best, rival=rival, free=free).x
            led = fit(view, setting, weights, best, rival=rival)
            found = min(found, led, key=lambda one: one.objective)
        others = [within(found.x)]
    return found


def _optimised_along(
    view: View,
    setting: Setting,
    weights: Weights,
    points: np.ndarray,
    values: np.ndarray,
    amplitude: int,
    rival: float,
) -> tuple[np.ndarray, float]:
    """Return the best point, and its objective, after optimising the amplitude from the best point of each row."""
    begins = [first + np.argmin(values[first : first + _PLACES]) for first in range(0, values.size, _PLACES)]
    ends = np.stack(
        [fit(view, setting, weights, points[begin], rival=rival, steps=_ALONG, free=[amplitude]).x for begin in begins]
    )
    reached = objectives(view, setting, weights, ends)
    return ends[np.argmin(reached)], float(np.min(reached))


def negligible(candidate: Candidate) -> np.ndarray:
    """Return coordinates at which the effect is negligible."""
    x = np.zeros(len(candidate.coordinates))
    if candidate.coordinates[0].logarithmic and candidate.has_amplitude:
        x[0] = _FAINT if candidate.null_at_infinity else -_FAINT
    return x
