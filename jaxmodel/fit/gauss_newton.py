"""Joint least squares over all unknowns of a model: Gauss-Newton, damped, several damping values in one batch."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.fit.likelihood import Likelihood
from jaxmodel.fit.problem import Problem
from jaxmodel.fit.space import ModelSpec, View

# Step of finite differences, in prior sd. For five cells, motors and robots, derivatives are within 2e-5 of exact
# tangents; a longer step adds curvature, a shorter one rounding errors at kinks.
DIFFERENCE_STEP = 1e-4
# Marquardt's damping, in units of the diagonal of the normal equations; all are tried in one batch of lanes, of which
# a packet has 16. The first gives Newton's step, but for directions that nothing determines. Knots of a curve are so
# alike that a damping of 1e-3 already leaves nine tenths of a step untaken. Assumed.
DAMPING = (1e-12, 1e-8, 1e-7, 1e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 1.0, 10.0, 1e3)
# No unknown moves further in one step, in prior sd. Assumed.
LONGEST_STEP = 30.0
# Derivatives are kept, with what a step taught of them, while steps gain at least this share of what they predict,
# for so many steps: to compute them takes ten times as long as a step. Assumed.
KEPT, LEARNT = 0.5, 2
# No error counts for more, in the unit of its channel: squares stay finite.
LARGEST = 1e6
# A fit has converged if a Newton step would gain less than this of Q: a tenth of an sd.
FLAT = 0.01


@dataclasses.dataclass(frozen=True)
class Point:
    """A model at one point.

    Attributes:
        x: (unknowns,) coordinates.
        errors: (n,) measured minus predicted.
        jacobian: (n, k) derivatives of the predictions by the free unknowns.
        objective: Q.
        promise: what a Newton step would gain of Q.
        exact: False if the derivatives are those of a point near by, with what steps taught of them.
    """

    x: np.ndarray
    errors: np.ndarray
    jacobian: np.ndarray
    objective: float
    promise: float
    exact: bool = True

    @property
    def converged(self) -> bool:
        """Return True at a minimum; near it in the units of a model with a large error."""
        return self.promise < FLAT * max(1.0, 0.01 * self.objective)


def errors_at(view: View, problem: Problem, spec: ModelSpec, places: np.ndarray) -> np.ndarray:
    """Return measured minus predicted at some points (places, unknowns), shape (readings, places).

    Predictions that are not finite count as a large error, so that a fit can go on.
    """
    errors = (view.data.value - view.at(problem, [spec.lane(x) for x in places])).T
    if not np.max(np.abs(errors)) <= LARGEST:  # or one is not finite
        worst = 1e3 * view.data.sd
        errors = np.where(np.isfinite(errors), np.clip(errors, -LARGEST, LARGEST), worst[:, None])
    return errors


def linearised(view: View, problem: Problem, spec: ModelSpec, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (n,) at a point, and the derivatives of the predictions (n, k) by the free unknowns.

    One-sided finite differences between lanes. Unknowns of different runs share a lane: they move different readings.
    """
    together = _lanes_of(view, spec)
    places = np.repeat(x[None], len(together) + 1, axis=0)
    for number, moved in enumerate(together, start=1):
        places[number, moved] += DIFFERENCE_STEP
    errors = errors_at(view, problem, spec, places)
    slopes = (errors[:, :1] - errors[:, 1:]) / DIFFERENCE_STEP
    lane = {place: number for number, moved in enumerate(together) for place in moved}
    jacobian = slopes[:, [lane[place] for place in spec.free]]
    for number, place in enumerate(spec.free):
        if (run := view.space.layout.runs[place]) >= 0:
            jacobian[view.data.run != run, number] = 0.0
    return errors[:, 0].copy(), jacobian  # a column of a matrix would keep all of it


def _lanes_of(view: View, spec: ModelSpec) -> list[list[int]]:
    """Return the unknowns that each lane moves."""
    runs = view.space.layout.runs
    alone = [[place] for place in spec.free if runs[place] < 0]
    of_runs: dict[int, list[int]] = {}
    for place in spec.free:
        if runs[place] >= 0:
            of_runs.setdefault(runs[place], []).append(place)
    most = max(map(len, of_runs.values()), default=0)
    return alone + [[places[number] for places in of_runs.values() if number < len(places)] for number in range(most)]


def descend(
    view: View,
    spec: ModelSpec,
    likelihood: Likelihood,
    start: np.ndarray | Point,
    *,
    steps: int,
    flat: float = FLAT,
    exact: bool = True,
) -> Point:
    """Return the model where Q is least, from one start.

    Args:
        view: the readings.
        spec: the model.
        likelihood: the weights.
        start: (unknowns,) coordinates, of which those that are not free stay; or a point that was linearised already.
        steps: at most so many.
        flat: gain of Q below which the fit has converged.
        exact: False if derivatives that were learnt are good enough for a point that has converged.
    """
    problem, free, precision = view.space.problem(spec), list(spec.free), spec.precision
    root = likelihood.roots(view.data)
    weight = root**2

    def objectives(places: np.ndarray, errors: np.ndarray) -> np.ndarray:
        return weight @ errors**2 + places[:, free] ** 2 @ precision

    x = (start.x if isinstance(start, Point) else start).copy()
    known = (start.errors, start.jacobian) if isinstance(start, Point) else linearised(view, problem, spec, x)
    (errors, jacobian), left = known, steps
    inner = _inner(jacobian, root)
    since = int(isinstance(start, Point) and not start.exact)  # steps since the derivatives were computed
    while True:
        objective = float(objectives(x[None], errors[:, None])[0])
        slope = (weight * errors) @ jacobian - precision * x[free]
        square = inner + np.diag(precision)
        moves = np.clip(_moves(square, slope), -LONGEST_STEP, LONGEST_STEP)
        least = flat * max(1.0, 0.01 * objective)
        promise = float(np.max(moves @ slope))  # Newton's; where its step is cut short, another's
        places = np.repeat(x[None], len(DAMPING), axis=0)
        places[:, free] += moves
        tried = errors_at(view, problem, spec, places) if promise >= least and left > 0 else None
        reached = np.array([objective]) if tried is None else objectives(places, tried)
        best = int(np.argmin(reached))
        gained = objective - float(reached[best])
        stays = tried is None or gained <= max(0.1 * least, 1e-12 * abs(objective))
        if stays and (not since or (not exact and promise < least)):
            return Point(x, errors, jacobian, objective, promise, exact=not since)
        moved = moves[best]
        if not stays:
            x = places[best]
        if stays or since == LEARNT or gained < KEPT * float(2.0 * slope @ moved - moved @ square @ moved):
            errors, jacobian = linearised(view, problem, spec, x)
            inner = _inner(jacobian, root)
            since, left = 0, left - 1
        else:
            assert tried is not None
            along = _learnt(moved, precision)
            missed = tried[:, best] - errors + jacobian @ moved
            inner = inner + _of_change((weight * missed) @ jacobian, float(weight @ missed**2), along)
            jacobian = jacobian - np.outer(missed, along)
            errors, since = tried[:, best].copy(), since + 1


def _inner(jacobian: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return J'WJ (k, k) of derivatives J (n, k) under the roots (n,) of the weights."""
    white = root[:, None] * jacobian
    return white.T @ white


def _learnt(moved: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return the direction a (k,) of Broyden's update, J - m a', of the derivatives J of the predictions (n, k).

    m are the errors (n,) after a step, minus those that the derivatives predicted. It is the least change, in the
    metric of the priors, with which they would have predicted them.

    Args:
        moved: (k,) the step.
        precision: (k,) of the priors.
    """
    along = precision * moved
    return along / float(moved @ along)


def _of_change(crossed: np.ndarray, power: float, along: np.ndarray) -> np.ndarray:
    """Return by how much J'WJ (k, k) changes where J becomes J - m a': in the time of one product of J.

    Args:
        crossed: (k,) J'Wm.
        power: m'Wm.
        along: (k,) a.
    """
    once = np.outer(crossed, along)
    return power * np.outer(along, along) - once - once.T


def _moves(square: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return the step for each damping, (dampings, k)."""
    scale = 1.0 / np.sqrt(np.diag(square))
    alike = square * scale[:, None] * scale
    damped = alike + np.array(DAMPING)[:, None, None] * np.eye(slope.size)
    return scale * np.linalg.solve(damped, (scale * slope)[:, None])[..., 0]
