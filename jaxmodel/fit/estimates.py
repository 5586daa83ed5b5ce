"""A calibrated model in numbers: its parameters, and its curves at their knots, each with its sd."""

from __future__ import annotations

import dataclasses
from typing import Protocol, runtime_checkable

import numpy as np

from jaxmodel.effects.curves import Curve
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import NONE, Fit
from jaxmodel.model.declaration import describe
from jaxmodel.model.names import parameter_table

# Initial states that may affect no reading of a run.
_FAINT_STARTS = ("initial_temperature_rise_K", "initial_hysteresis")


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted number with its standard deviation (of the fit, priors included) and unit."""

    value: float
    sd: float
    unit: str


@runtime_checkable
class CurveAtKnots(Protocol):
    """The values of a curve at its knots, as `CurveValues` and what is told of one in a diagnosis have them."""

    @property
    def label(self) -> str:
        """Return its candidate."""
        ...

    @property
    def at(self) -> np.ndarray:
        """Return its knots."""
        ...

    @property
    def value(self) -> np.ndarray:
        """Return the correction at the knots; the logarithm if it is a factor."""
        ...

    @property
    def sd(self) -> np.ndarray:
        """Return the sd of the correction."""
        ...


@dataclasses.dataclass(frozen=True, eq=False)
class CurveValues:
    """A curve at its knots.

    Attributes:
        label: of the candidate.
        at: knots, in the unit of its variable.
        value: correction at the knots; the logarithm if it is a factor.
        sd: of the correction.
    """

    label: str
    at: np.ndarray
    value: np.ndarray
    sd: np.ndarray


def estimates_of(cache: FitCache, fit: Fit) -> tuple[dict[str, Estimate], tuple[str, ...]]:
    """Return a model's calibrated parameters by name, and the names of those far from their stated values."""
    units = {name: info.unit for name, info in parameter_table(cache.space.coarse.models).items()}
    for candidate in cache.space.candidates.values():
        label = candidate.effect.label
        units |= {f"{label}.{name}": info.unit for name, info in describe(candidate.effect).items()}
    layout = cache.space.layout
    estimates, far = {}, []
    knots = {place for _, first, last, _ in layout.vectors for place in range(first, last)}
    for place, sd, pull in zip(fit.spec.free, fit.sd, fit.pulls, strict=True):
        coordinate = layout.coordinates[place]
        if place in knots:
            continue
        is_undetermined = coordinate.name in _FAINT_STARTS and sd > 0.98 and abs(pull) < 0.05
        if is_undetermined:  # an initial state that affects no reading
            continue
        name = layout.name_of(place)
        x = fit.x[place]
        estimates[name] = Estimate(coordinate.number(x), coordinate.slope(x) * sd, units.get(coordinate.name, ""))
        if abs(pull) > cache.settings.strained:
            far.append(name)
    return estimates, tuple(far)


def values_of(cache: FitCache, fit: Fit, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of a curve or law at its knots, and their sd."""
    layout, candidate = cache.space.layout, cache.space.candidates[label]
    places = list(layout.of[label])
    columns = slice(candidate.offset, candidate.offset + len(candidate.coordinates))
    mix = candidate.mix[:, columns]
    if candidate.law is not None:
        knots = cache.settings.law_knots
        mix = mix[candidate.law[0] * knots : (candidate.law[0] + 1) * knots]
    free = list(fit.spec.free)
    mine = [free.index(place) for place in places]
    covariance = fit.covariance[np.ix_(mine, mine)]
    return mix @ fit.x[places], np.sqrt(np.maximum(np.diag(mix @ covariance @ mix.T), 0.0))


def free_curves(cache: FitCache, fit: Fit) -> list[str]:
    """Return every curve of a model that is not held at nothing, in the order in which the model has them."""
    candidates = cache.space.candidates
    held = fit.spec.amplitudes
    return [one for one in fit.spec.labels if candidates[one].group == "curve" and held[one] > NONE]


def curves_of(cache: FitCache, fit: Fit) -> list[CurveValues]:
    """Return the curves of a model that are not held at nothing, at their knots."""
    found = []
    for label in free_curves(cache, fit):
        effect = cache.space.candidates[label].effect
        assert isinstance(effect, Curve)
        found.append(CurveValues(label, effect.knots, *values_of(cache, fit, label)))
    return found
