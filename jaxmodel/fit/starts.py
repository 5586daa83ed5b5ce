"""Search along an amplitude with many local optima, such as the shift of a clock."""

from __future__ import annotations

import itertools

import numpy as np

from jaxmodel.fit.candidates import Candidate
from jaxmodel.fit.gauss_newton import Point, descend, errors_at
from jaxmodel.fit.likelihood import Likelihood
from jaxmodel.fit.space import ModelSpec, View

# Points around a fit, and their range, in prior sd, in the searches after the first. Assumed.
_PLACES = 65
_CLOSER = (0.1,)
# Gain of Q from which another optimum counts as better. Assumed.
_BETTER = 1.0
_STEPS = 6


def best_along(view: View, spec: ModelSpec, likelihood: Likelihood, candidate: Candidate, found: Point) -> Point:
    """Search along an amplitude with many local optima for a better point, and descend again from there.

    The other parameters of the effect are held at their fitted values, and at the ends of their usual ranges: at a
    wrong local optimum they are wrong too.

    Args:
        view: the readings.
        spec: a model with the effect.
        likelihood: the weights.
        candidate: the effect, its amplitude first.
        found: where the model is.
    """
    amplitude, *shapes = view.space.layout.of[candidate.label]
    ends = [np.array(each) for each in itertools.product(*candidate.shape_ends) if each]
    problem, root, free = view.space.problem(spec), likelihood.roots(view.data), list(spec.free)
    for reach in (candidate.reach, *_CLOSER):
        others = [found.x[shapes], *ends]
        points = np.repeat(found.x[None], _PLACES * len(others), axis=0)
        points[:, amplitude] += np.tile(np.linspace(-reach, reach, _PLACES), len(others))
        points[:, shapes] = np.repeat(others, _PLACES, axis=0)
        errors = errors_at(view, problem, spec, points)
        values = np.sum((root[:, None] * errors) ** 2, axis=0) + np.sum(points[:, free] ** 2 * spec.precision, axis=1)
        best = int(np.argmin(values))
        if values[best] < found.objective - _BETTER:
            led = descend(view, spec, likelihood, points[best], steps=_STEPS)
            found = min(found, led, key=lambda one: one.objective)
        ends = []
    return found
