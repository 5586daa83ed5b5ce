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
    predicted = view.at(problem, [spec.lane(x) for x in places])
    worst = 1e3 * view.data.sd
    errors = view.data.value - predicted
    return np.where(np.isfinite(errors), np.clip(errors, -1e6, 1e6), worst).T


def linearised(view: View, problem: Problem, spec: ModelSpec, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (n,) at a point, and the derivatives of the predictions (n, k) by the free unknowns.

    One-sided finite differences between lanes. Unknowns of different runs share a lane: they move different readings.
    """
    together = _lanes_of(view, spec)
    places = np.repeat(x[None], len(together) + 1, axis=0)
    for number, moved in enumerate(together, start=1):
        places[number, moved] += DIFFERENCE_STEP
    errors = errors_at(view, problem, spec, places)
    jacobian = np.zeros((errors.shape[0], len(spec.free)))
    column = {place: number for number, place in enumerate(spec.free)}
    for number, moved in enumerate(together, start=1):
        slope = (errors[:, 0] - errors[:, number]) / DIFFERENCE_STEP
        for place in moved:
            run = view.space.layout.runs[place]
            jacobian[:, column[place]] = slope if run < 0 else np.where(view.data.run == run, slope, 0.0)
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

    def objectives(places: np.ndarray, errors: np.ndarray) -> np.ndarray:
        return np.sum((root[:, None] * errors) ** 2, axis=0) + np.sum(places[:, free] ** 2 * precision, axis=1)

    x = (start.x if isinstance(start, Point) else start).copy()
    known = (start.errors, start.jacobian) if isinstance(start, Point) else linearised(view, problem, spec, x)
    (errors, jacobian), left = known, steps
    since = int(isinstance(start, Point) and not start.exact)  # steps since the derivatives were computed
    while True:
        objective = float(objectives(x[None], errors[:, None])[0])
        white = root[:, None] * jacobian
        slope = white.T @ (root * errors) - precision * x[free]
        square = white.T @ white + np.diag(precision)
        moves = np.clip(_moves(square, slope), -LONGEST_STEP, LONGEST_STEP)
        least = flat * max(1.0, 0.01 * objective)
        promise = float(np.max(moves @ slope))  # Newton's; where its step is cut short, another's
        places = np.repeat(x[None], len(DAMPING), axis=0)
        places[:, free] += moves
        tried = errors_at(view, problem, spec, places) if promise >= least and left > 0 else None
        reached = np.array([objective]) if tried is None else objectives(places, tried)
        best = int(np.argmin(reached))
        gained = objective - float(reached[best])
        if tried is None or gained <= max(0.1 * least, 1e-12 * abs(objective)):
            if not since or (not exact and promise < least):
                return Point(x, errors, jacobian, objective, promise, exact=not since)
            errors, jacobian = linearised(view, problem, spec, x)
            since, left = 0, left - 1
            continue
        x, moved = places[best], moves[best]
        if since == LEARNT or gained < KEPT * float(2.0 * slope @ moved - moved @ square @ moved):
            errors, jacobian = linearised(view, problem, spec, x)
            since, left = 0, left - 1
        else:
            jacobian = jacobian + _learnt(tried[:, best] - errors + jacobian @ moved, moved, precision)
            errors, since = tried[:, best].copy(), since + 1


def _learnt(missed: np.ndarray, moved: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return what a step teaches of the derivatives of the predictions (n, k): Broyden's update.

    Args:
        missed: (n,) errors after the step, minus those that the derivatives predicted.
        moved: (k,) the step.
        precision: (k,) in whose metric the least change is sought.
    """
    along = precision * moved
    return -np.outer(missed, along / float(moved @ along))


def _moves(square: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return the step for each damping, (dampings, k)."""
    scale = 1.0 / np.sqrt(np.diag(square))
    alike = square * scale[:, None] * scale
    damped = alike + np.array(DAMPING)[:, None, None] * np.eye(slope.size)
    return scale * np.linalg.solve(damped, (scale * slope)[:, None])[..., 0]
