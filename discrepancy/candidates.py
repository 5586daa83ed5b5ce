"""The candidate effects of a case, and the coordinates in which they are tried and fitted."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jaxmodel.cases import Case
from jaxmodel.declaration import ParameterInfo, describe
from jaxmodel.effects import CATALOGUE
from jaxmodel.ports import Effect

Floats = NDArray[np.float64]

# How far, in prior sd, better optima of an amplitude may be: between the ridges that jumps of an input make, and on the
# other side of a standstill.
_ACROSS_RIDGES = 0.4
_ACROSS_STANDSTILL = 1.0
# No fit begins further from the middle of an amplitude's usual range, in prior sd.
_FURTHEST_START = 2.5


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One unknown number as a standard normal: number = centre + spread x, or origin + sign exp(centre + spread x).

    The standard normal is the prior: what the case states of a parameter, or the usual range of an effect's (its ends
    at one standard deviation).
    """

    name: str
    centre: float
    spread: float
    logarithmic: bool = False
    origin: float = 0.0
    sign: float = 1.0

    def number(self, x: float) -> float:
        """Return the number at the coordinate x."""
        if self.logarithmic:
            return self.origin + self.sign * float(np.exp(self.centre + self.spread * x))
        return self.centre + self.spread * x

    def at(self, number: float) -> float:
        """Return the coordinate of a number."""
        if self.logarithmic:
            return (math.log((number - self.origin) / self.sign) - self.centre) / self.spread
        return (number - self.centre) / self.spread

    def slope(self, x: float) -> float:
        """Return d(number)/dx, to carry a standard deviation over."""
        if self.logarithmic:
            return abs(self.spread * float(np.exp(self.centre + self.spread * x)))
        return self.spread


def known_coordinate(name: str, value: float, sd: float, info: ParameterInfo) -> Coordinate:
    """Return the coordinate of a base parameter known to +- sd, on the logarithm where its table says so."""
    if info.transform == "log" and value > 0.0:
        return Coordinate(name, math.log(value), sd / value, logarithmic=True)
    return Coordinate(name, value, sd)


def effect_coordinate(name: str, info: ParameterInfo) -> Coordinate:
    """Return the coordinate of an effect's parameter, from its usual range.

    A range on one side of the null is taken on the logarithm of the distance from it, so that the sign is kept; a range
    that spans the null is taken as it is.
    """
    assert info.typical is not None, f"{name} declares no usual range"
    low, high = info.typical
    origin = info.null if info.null is not None and math.isfinite(info.null) else 0.0
    near, far = sorted((abs(low - origin), abs(high - origin)))
    if (low - origin) * (high - origin) <= 0.0:
        return Coordinate(name, origin, max(abs(low), abs(high)))
    return Coordinate(
        name,
        centre=0.5 * (math.log(near) + math.log(far)),
        spread=0.5 * (math.log(far) - math.log(near)),
        logarithmic=True,
        origin=origin,
        sign=math.copysign(1.0, high - origin),
    )


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One effect that could be missing: an effect of the catalogue, on one column where it is a sensor's.

    Attributes:
        effect: the effect at the middle of its usual range.
        coordinates: of its parameters; the first is its amplitude.
        probes: for each variant of its shape, the coordinates x at which its direction is taken.
        one_sided: physics allows one sign of the amplitude only.
        amplitude_on_grid: the amplitude has probes on either side; the readings depend on it with many local optima.
        reach: how far about a fit, in prior sd, its amplitude may have a better optimum; 0 where it has but one.
        has_amplitude: False where no value of the first parameter makes the effect vanish.
        null_at_infinity: the amplitude fades as its parameter grows (an exchange current, a leakage resistance).
    """

    effect: Effect
    coordinates: tuple[Coordinate, ...]
    probes: tuple[tuple[float, ...], ...]
    one_sided: bool
    null_at_infinity: bool
    amplitude_on_grid: bool = False
    reach: float = 0.0
    has_amplitude: bool = True

    @property
    def label(self) -> str:
        """Return the effect's name, with its column where it has one."""
        return self.effect.label

    @property
    def shape_ends(self) -> list[tuple[float, ...]]:
        """Return the coordinates of the ends of the usual range of each parameter but the amplitude."""
        shapes = list(zip(self.coordinates, describe(self.effect).values(), strict=True))[1:]
        return [tuple(coordinate.at(end) for end in info.typical or ()) for coordinate, info in shapes]

    def times_as_strong(self, x: Floats, probe: float) -> Floats:
        """Return how many times as strong as at a probe an effect is at x of its amplitude; 1 where it has none."""
        first = self.coordinates[0]
        if not self.has_amplitude:
            return np.ones(np.shape(x))
        if not first.logarithmic:
            return np.asarray(x) / (probe or 1.0)
        away = first.spread * (np.asarray(x) - probe)
        return np.exp(-away if self.null_at_infinity else away)

    def at(self, probe: np.ndarray, amplitude: float) -> np.ndarray:
        """Return the coordinates of an effect so many times as strong as at a probe, within its usual range."""
        suggested, first = probe.copy(), self.coordinates[0]
        if first.logarithmic:
            stronger = math.log(max(amplitude, 1e-3)) / first.spread
            suggested[0] = probe[0] + (-stronger if self.null_at_infinity else stronger)
        else:
            suggested[0] = probe[0] * amplitude
        suggested[0] = np.clip(suggested[0], -_FURTHEST_START, _FURTHEST_START)
        return suggested

    @property
    def is_sensor(self) -> bool:
        """Return True for a fault of a sensor."""
        return self.effect.is_sensor


def make_candidate(effect: Effect) -> Candidate:
    """Return the candidate that an effect of any origin makes, from its own table."""
    table = describe(effect)
    coordinates = tuple(effect_coordinate(f"{effect.label}.{name}", info) for name, info in table.items())
    choices = []
    for coordinate, info in zip(coordinates, table.values(), strict=True):
        if info.shape_grid:
            choices.append([coordinate.at(number) for number in info.shape_grid])
        else:
            choices.append([0.0 if coordinate.logarithmic else 0.5])
    amplitude = coordinates[0]
    first = next(iter(table.values()))
    on_grid = bool(first.shape_grid) and not amplitude.logarithmic
    return Candidate(
        effect,
        coordinates,
        tuple(itertools.product(*choices)),
        one_sided=amplitude.logarithmic,
        null_at_infinity=first.null == math.inf,
        amplitude_on_grid=on_grid,
        reach=_ACROSS_RIDGES if on_grid else 0.0,
        has_amplitude=first.null is not None,
    )


def candidates(case: Case, catalogue: Mapping[str, type[Effect]] = CATALOGUE) -> list[Candidate]:
    """Return every effect of the catalogue that could act in a case and is not in its model already."""
    present = set(case.effects)
    columns = _columns(case)
    found = []
    for name, cls in catalogue.items():
        if case.kind not in cls.kinds or name in present:
            continue
        if not cls.is_sensor:
            found.append(make_candidate(cls()))
            continue
        for column in [column for column in columns if column.endswith(cls.reads)] if cls.reads else [""]:
            fault = make_candidate(cls(column=column))
            # With a drive's input a little off, a rotor that stands still turns in the model, or does not start.
            sticks = case.kind != "cell" and column in case.runs[0].measured.inputs
            found.append(dataclasses.replace(fault, reach=_ACROSS_STANDSTILL) if sticks else fault)
    return found


def _columns(case: Case) -> list[str]:
    measured: dict[str, None] = {}
    for run in case.runs:
        for name, values in (run.measured.outputs | run.measured.inputs).items():
            if np.any(np.isfinite(values)):
                measured[name] = None
    return list(measured)
