"""Where fits begin anew: within the priors, beside an effect too faint to matter, along an amplitude of many optima."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from discrepancy.calibrate import Fit, fit, objectives
from discrepancy.candidates import Candidate
from discrepancy.lanes import LANES
from discrepancy.masking import Pair
from discrepancy.problem import Problem, Start
from discrepancy.score import SEED
from discrepancy.screen import Screen

_FAINT = 3.0
# Of an amplitude with many local optima: places looked at about a fit, and how far, in prior sd, in looks after the
# first.
_PLACES = 65
_CLOSER = (0.1, 0.1)
# Steps along the amplitude alone from the best place of a look: within a row a delay is felt in straight lines.
_ALONG = 5


def likeliest_of_some(problem: Problem, unknowns: int) -> np.ndarray:
    """Return the best of one batch of places drawn from the priors.

    Where a case states a motor that stalls, nothing moves the readings, and no slope leads away from there.
    """
    places = np.random.default_rng(SEED).normal(size=(LANES, unknowns))
    return places[np.argmin(objectives(problem, places))]


def scored_starts(candidate: Candidate, screened: Screen) -> list[Start]:
    """Return where to begin fitting a candidate: at its best-scoring shape and the amplitude it suggests."""
    label = candidate.label
    if label not in screened.probes:
        return [{label: np.array(candidate.probes[0])}]
    scored = screened.table[label]
    probe = np.array(screened.probes[label][scored.shape], dtype=float)
    if not candidate.has_amplitude:
        return [{label: probe}, {label: np.zeros(probe.size)}]
    return [{label: candidate.at(probe, float(scored.amplitude[0]))}, {label: probe}]


def pair_start(pair: Pair, screened: Screen, candidates: Mapping[str, Candidate]) -> Start:
    """Return where to begin fitting two candidates together: at the shapes and amplitudes that both suggest."""
    start: dict[str, np.ndarray] = {}
    for label, shape, amplitude in zip(pair.labels, pair.shapes, pair.amplitudes, strict=True):
        probe = np.array(screened.probes[label][shape], dtype=float)
        known = candidates[label]
        start[label] = known.at(probe, amplitude) if known.has_amplitude else probe
    return start


def over_the_ridges(
    problem: Problem, candidate: Candidate, places: Sequence[int], own: Sequence[int], found: Fit, rival: float = np.inf
) -> Fit:
    """Look along an amplitude with many local optima for a place better than the fit's, and fit again from there.

    Far along it the other numbers are looked at where the fit has them, within their range, and at its ends: a fit that
    settled between the wrong ridges has settled them wrongly too. At the ends the valley may be narrower than from
    place to place: where no place is better, the best is followed down along the amplitude.

    Args:
        problem: the case under a model with the effect.
        candidate: the effect, its amplitude first.
        places: numbers of its unknowns.
        own: numbers of the model's own unknowns.
        found: the fit.
        rival: objective of a model that this one must come near.
    """
    amplitude, *shapes = places
    ends = [np.array(each) for each in itertools.product(*candidate.shape_ends) if each]

    def within(x: np.ndarray) -> np.ndarray:
        return np.clip(x[shapes], np.min(ends, axis=0), np.max(ends, axis=0)) if ends else x[shapes]

    others = [within(found.x), *ends]
    for reach in (candidate.reach, *_CLOSER):
        along = np.linspace(-reach, reach, _PLACES)
        looks = np.repeat(found.x[None], _PLACES * len(others), axis=0)
        looks[:, amplitude] += np.tile(along, len(others))
        looks[:, shapes] = np.repeat(others, _PLACES, axis=0)
        values = objectives(problem, looks)
        best, least = looks[np.argmin(values)], float(np.min(values))
        if least >= found.objective - 1.0 and len(others) > 1:
            led = _down_the_valleys(problem, looks[_PLACES:], values[_PLACES:], amplitude, rival)
            best, least = led.x, led.objective
        if least < found.objective - 1.0:
            if shapes:  # held at first: from ridge to ridge they make up for an amplitude a little off
                best = fit(problem, best, [number for number in own if number not in shapes], rival=rival).x
            led = fit(problem, best, own, rival=rival)
            found = min(found, led, key=lambda one: one.objective)
        others = [within(found.x)]
    return found


def _down_the_valleys(problem: Problem, looks: np.ndarray, values: np.ndarray, amplitude: int, rival: float) -> Fit:
    """Return the best of the fits of the amplitude alone, one from the best place of each row of looks."""
    begins = [first + np.argmin(values[first : first + _PLACES]) for first in range(0, values.size, _PLACES)]
    fits = [fit(problem, looks[begin], [amplitude], rival=rival, steps=_ALONG) for begin in begins]
    return min(fits, key=lambda one: one.objective)


def faintest(candidate: Candidate) -> np.ndarray:
    """Return coordinates at which the effect is far below its usual size."""
    x = np.zeros(len(candidate.coordinates))
    if candidate.coordinates[0].logarithmic and candidate.has_amplitude:
        x[0] = _FAINT if candidate.null_at_infinity else -_FAINT
    return x
