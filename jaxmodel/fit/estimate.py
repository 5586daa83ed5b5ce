"""Calibration of a model: unknowns, the amplitudes of its curves, and the weights of its errors, in turn."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from jaxmodel.fit.coordinates import REACH_OF_ALL
from jaxmodel.fit.gauss_newton import FLAT, Point, descend
from jaxmodel.fit.likelihood import Likelihood, from_errors, from_tolerances
from jaxmodel.fit.linearisation import Linearisation, inverse, log_evidence, solved
from jaxmodel.fit.space import ModelSpec, View

# Amplitudes tried for a curve, in units of its usual size; the smallest is none: it moves no prediction by what a
# reading shows. Assumed.
NONE = 1e-4
AMPLITUDES = (NONE, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
# Prior sd tried for a stated charge, in units of its stated sd; the smallest holds it. Assumed.
SPREADS = (0.1, 0.2, 0.5, 1.0)
# Sd of the logarithm of an amplitude above its usual size; below it any is as likely. Assumed.
RARER = 1.0
# Log evidence that a change of an amplitude must gain, and rounds of the search over all curves. Assumed.
_GAIN, _PASSES = 0.1, 4
# Steps before the weights are known, of each round after it, and most rounds. Weights move with every step: more steps
# under one set of them would lead to what is not asked. Assumed.
FIRST_STEPS, STEPS, ROUNDS = 10, 2, 12
# Turns of an amplitude, up and down again, after which it stays: it and the weights chase each other. Assumed.
TURNS = 2
# What a Newton step may still gain of Q after the last round. Assumed: a third of an sd.
NEAR = 0.1
# Passes over weights and amplitudes between two linearisations. Assumed.
PASSES = 3
# A change of the logarithm of a weight that asks for another round. Assumed.
_MOVED = 0.02


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """A calibrated model.

    Attributes:
        spec: the model, with the amplitudes of its curves.
        added: its additions to the model of the case, without curves.
        x: (unknowns,) calibrated coordinates.
        errors: (n,) measured minus predicted.
        likelihood: the weights of its errors.
        linear: the model linearised there.
        objective: Q.
        promise: what a Newton step would still gain of it.
    """

    spec: ModelSpec
    added: tuple[str, ...]
    x: np.ndarray
    errors: np.ndarray
    likelihood: Likelihood
    linear: Linearisation
    objective: float
    promise: float

    @property
    def converged(self) -> bool:
        """Return True at a minimum."""
        return self.promise < 2.0 * max(1.0, 0.01 * self.objective)

    @property
    def free(self) -> np.ndarray:
        """Return the free coordinates, (k,)."""
        return self.x[list(self.spec.free)]

    @property
    def pulls(self) -> np.ndarray:
        """Return the distance of each free unknown from its prior mean in sd, of a charge in its stated sd, (k,)."""
        is_charge = np.isin(self.spec.free, self.spec.charges)
        return self.free * np.where(is_charge, 1.0, np.sqrt(self.spec.precision))

    @functools.cached_property
    def gram(self):
        """Return the Gram factors of all readings under the model's own weights."""
        return self.linear.under(self.likelihood)

    @functools.cached_property
    def covariance(self) -> np.ndarray:
        """Return the covariance of the free unknowns' coordinates, (k, k): the tempered posterior."""
        return inverse(self.gram.square, self.spec.precision)

    @functools.cached_property
    def sd(self) -> np.ndarray:
        """Return the sd of the free unknowns' coordinates, (k,): the larger of posterior and sandwich over runs.

        The sandwich C (sum g g') C uses how much the slopes g of single runs differ from one another.
        """
        slopes: dict[int, np.ndarray] = {}
        for number, gram in self.linear.block_grams(self.likelihood).items():
            run = self.linear.runs[number]
            slopes[run] = slopes.get(run, 0.0) + gram.aim - gram.square @ self.free
        posterior = np.diag(self.covariance)
        if len(slopes) < 2:
            return np.sqrt(posterior)
        of_runs = np.stack(list(slopes.values()))
        moved = (of_runs - of_runs.mean(axis=0)) @ self.covariance
        count = len(of_runs)
        sandwich = np.minimum(np.sum(moved**2, axis=0) * count / (count - 1.0), 1.0 / self.spec.precision)
        return np.sqrt(np.maximum(posterior, sandwich))

    def log_evidence(self, likelihood: Likelihood | None = None) -> float:
        """Return the log evidence under some weights, its own by default, with the amplitudes as they are."""
        return log_evidence(self.linear.under(likelihood or self.likelihood), self.spec.precision)

    def mean_squares(self, view: View) -> dict[str, float]:
        """Return the mean square error of each channel."""
        return mean_squares(view, self.errors)


def mean_squares(view: View, errors: np.ndarray) -> dict[str, float]:
    """Return the mean square of errors (readings,) by channel."""
    return {
        name: float(np.mean(np.concatenate([errors[rows] for rows in slices]) ** 2))
        for name, slices in view.data.by_channel.items()
    }


def calibrate(
    view: View,
    spec: ModelSpec,
    start: np.ndarray,
    tolerances: Mapping[str, float],
    likelihood: Likelihood | None = None,
    *,
    rounds: int = ROUNDS,
    held: Collection[str] = (),
) -> Fit:
    """Calibrate a model from one start.

    Args:
        view: the readings.
        spec: the model; its amplitudes are where the search for them begins.
        start: (unknowns,) initial coordinates.
        tolerances: by channel, in its unit: errors of this size are the first weights.
        likelihood: the first weights, in place of those.
        rounds: at most so many times weights and amplitudes are estimated again.
        held: channels whose weights stay as given.
    """
    weights = likelihood or from_tolerances(view.data, tolerances)
    point = descend(view, spec, weights, start, steps=FIRST_STEPS if likelihood is None else STEPS, flat=1.0)
    passed: list[tuple[Likelihood, ModelSpec]] = [(weights, spec)]
    for number in range(rounds):
        linear = Linearisation.of(view.data, point.x[list(spec.free)], point.errors, point.jacobian)
        weights, spec = _settled(view, spec, weights, linear, point, held, _turning(passed))
        if _turns_back(passed, weights):
            weights = weights.towards(passed[-1][0])  # weights and errors chase each other
        passed.append((weights, spec))
        flat = FLAT if number else 0.1
        point = descend(view, spec, weights, point, steps=STEPS, flat=flat, exact=False)
        if number and _is_near(point) and _alike(*passed[-2:]):
            point = descend(view, spec, weights, point, steps=STEPS, flat=flat)
            if _is_near(point):
                break
    else:
        point = descend(view, spec, weights, point, steps=STEPS, flat=FLAT)
    linear = Linearisation.of(view.data, point.x[list(spec.free)], point.errors, point.jacobian)
    added = tuple(label for label in spec.labels if view.space.candidates[label].group != "curve")
    return Fit(spec, added, point.x, point.errors, weights, linear, point.objective, point.promise)


def _is_near(point: Point) -> bool:
    return point.promise < NEAR * max(1.0, 0.01 * point.objective)


def _turning(passed: Sequence[tuple[Likelihood, ModelSpec]]) -> set[str]:
    """Return the curves and charges whose amplitude went up and down too often in the rounds that passed."""
    sizes = [spec.amplitudes | spec.spreads for _, spec in passed]
    found = set()
    for name in sizes[0]:
        moves = np.sign(np.diff(np.log([one[name] for one in sizes])))
        moves = moves[moves != 0.0]
        if np.sum(moves[1:] != moves[:-1]) >= TURNS:
            found.add(name)
    return found


def _turns_back(passed: Sequence[tuple[Likelihood, ModelSpec]], weights: Likelihood) -> bool:
    """Return True if the weight of a channel would turn back from where it went in the round before."""
    if len(passed) < 3:  # the first weights are those of tolerances, or of another model
        return False
    (older, _), (old, _) = passed[-2:]
    return any(
        (one.root - old.channels[name].root) * (old.channels[name].root - older.channels[name].root) < 0.0
        for name, one in weights.channels.items()
    )


def _settled(
    view: View,
    spec: ModelSpec,
    weights: Likelihood,
    linear: Linearisation,
    point: Point,
    held: Collection[str],
    still: Collection[str],
) -> tuple[Likelihood, ModelSpec]:
    """Return weights and amplitudes for a model that is linear from a point on, each under the other.

    They ask for one another, and for the errors that they leave. Where the model is linear all of it is algebra: no
    simulation need follow each change. The weights of the channels `held` and the amplitudes `still` stay.
    """
    errors = point.errors
    free = set(weights.channels) - set(held)
    for _ in range(PASSES if free else 1):
        before = (weights, spec)
        if free:
            asked = from_errors(view.data, errors, degrees_of_freedom(linear, weights, spec))
            weights = Likelihood({**asked.channels, **{name: weights.channels[name] for name in held}})
        spec = best_amplitudes(view, spec, linear, weights, still)
        if _alike(before, (weights, spec)):
            break
        gram = linear.under(weights)
        errors = point.errors - point.jacobian @ (solved(gram.square, gram.aim, spec.precision) - linear.x)
    return weights, spec


def _alike(before: tuple[Likelihood, ModelSpec], after: tuple[Likelihood, ModelSpec]) -> bool:
    (old, one), (new, other) = before, after
    moved = bool(new.distance(old) >= _MOVED)
    return not moved and (one.amplitudes, one.spreads) == (other.amplitudes, other.spreads)


def degrees_of_freedom(linear: Linearisation, likelihood: Likelihood, spec: ModelSpec) -> dict[str, float]:
    """Return how many of each channel's independent readings the unknowns used: the trace of its hat matrix."""
    whole = linear.under(likelihood)
    covariance = inverse(whole.square, spec.precision)
    return {
        name: float(np.sum(covariance * gram.square)) * likelihood.channels[name].root ** 2
        for name, gram in linear.by_channel.items()
    }


def rarer(spec: ModelSpec) -> float:
    """Return the log odds against amplitudes and spreads above their usual size."""
    sizes = (*spec.amplitudes.values(), *spec.spreads.values())
    return 0.5 * sum((max(0.0, float(np.log(a))) / RARER) ** 2 for a in sizes)


def evidence(view: View, fit: Fit, likelihood: Likelihood, loose: Collection[int] = ()) -> float:
    """Return the log evidence of a model under some weights, the amplitudes of its curves the best under them.

    Args:
        view: the readings.
        fit: the model.
        likelihood: the weights.
        loose: unknowns whose stated values are not held to.
    """
    spec = best_amplitudes(view, fit.spec, fit.linear, likelihood)
    precision = np.where(np.isin(spec.free, list(loose)), spec.precision / REACH_OF_ALL**2, spec.precision)
    return log_evidence(fit.linear.under(likelihood), precision) - rarer(spec)


def best_amplitudes(
    view: View, spec: ModelSpec, linear: Linearisation, likelihood: Likelihood, still: Collection[str] = ()
) -> ModelSpec:
    """Return the model with the amplitudes of its curves that have the most evidence, one after the other.

    Those of `still` stay.
    """
    space = view.space
    grids = {label: [a for a in AMPLITUDES if a <= space.candidates[label].largest] for label in spec.amplitudes}
    if not grids:
        return spec
    # Without curves nothing else could take the part of a charge: what is stated of it holds.
    grids |= {name: list(SPREADS) for name in spec.spreads}
    grids = {name: grid for name, grid in grids.items() if name not in still}
    gram = linear.under(likelihood)

    def score(one: ModelSpec) -> float:
        return log_evidence(gram, one.precision) - rarer(one)

    def changed(one: ModelSpec, name: str, size: float) -> ModelSpec:
        if name in one.spreads:
            return space.spec(one.labels, one.amplitudes, {**one.spreads, name: size})
        return space.spec(one.labels, {**one.amplitudes, name: size}, one.spreads)

    best = score(spec)
    for _ in range(_PASSES):
        begin = best
        for name, grid in grids.items():
            place = int(np.argmin(np.abs(np.log(grid) - np.log((spec.amplitudes | spec.spreads)[name]))))
            for step in (1, -1):
                at = place + step
                while 0 <= at < len(grid):
                    other = changed(spec, name, grid[at])
                    reached = score(other)
                    if reached <= best + _GAIN:
                        break
                    best, spec, place = reached, other, at
                    at += step
        if best - begin < 10.0 * _GAIN:
            break
    return spec
