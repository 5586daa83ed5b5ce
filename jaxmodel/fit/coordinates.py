"""Unknowns as coordinates with a standard normal prior."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from jaxmodel.model.declaration import ParameterInfo

# Share of its spread over which a value approaches its ceiling.
_BEND = 0.25
# A value at or beyond a reach gets the coordinate of this share of the reach.
_ALL_BUT_ONE = 1.0 - 1e-12
# A number may be stated at the end of what is possible. At the upper end its centre is so many sd below it, as slopes
# are taken upwards; below a lower end the reach is this, in sd.
_INSIDE, _LEAST_REACH = 1e-3, 1e-9
# Largest distance from the stated value, in sd (assumed), for parameters of one run, and of all runs: a data sheet may
# state too small an sd.
REACH_OF_A_RUN, REACH_OF_ALL = 5.0, 10.0


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One unknown as a standard normal: value = centre + spread x, or origin + sign exp(centre + spread x).

    The prior comes from the stated value and sd of a parameter, or from the usual range of an effect's parameter (its
    ends are at one sd). Values approach a ceiling, or a floor, smoothly within a quarter of the spread: a state of
    charge beyond the last point of its table has no effect, and this edge would disturb a fit.

    On either side values have a reach r: beyond half of it x stands for r/2 (1 + tanh(2 x / r - 1)) sd.
    No number leaves what its table allows, so that every model that is fitted can be written. A stated number does not
    go further than some sd either: a poor model would move it far away to compensate, because many readings outweigh
    a normal prior.
    """

    name: str
    centre: float
    spread: float
    logarithmic: bool = False
    origin: float = 0.0
    sign: float = 1.0
    ceiling: float = math.inf
    is_floor: bool = False
    above: float = math.inf
    below: float = math.inf

    @property
    def bend(self) -> float:
        """Return the range of values over which the ceiling is approached; negative if it is a floor."""
        return (-_BEND if self.is_floor else _BEND) * self.spread

    def off(self, x: float) -> float:
        """Return the distance from the centre at the coordinate x, in sd."""
        reach = self._reach(x)
        return math.copysign(_bent(abs(x), reach), x)

    def number(self, x: float) -> float:
        """Return the number at the coordinate x."""
        straight = self.centre + self.spread * self.off(x)
        if self.ceiling != math.inf:
            straight = self.ceiling - self.bend * float(np.logaddexp(0.0, (self.ceiling - straight) / self.bend))
        return self.origin + self.sign * float(np.exp(straight)) if self.logarithmic else straight

    def at(self, number: float) -> float:
        """Return the coordinate of a value; beyond its reach, that of the end of the reach."""
        straight = math.log((number - self.origin) / self.sign) if self.logarithmic else number
        if self.ceiling != math.inf:
            under = max((self.ceiling - straight) / self.bend, 1e-3)
            straight = self.ceiling - self.bend * (under + math.log(-math.expm1(-under)))
        off = (straight - self.centre) / self.spread
        half = 0.5 * self._reach(off)
        if abs(off) <= half:
            return off
        return math.copysign(half * (1.0 + math.atanh(min(abs(off) / half - 1.0, _ALL_BUT_ONE))), off)

    def slope(self, x: float) -> float:
        """Return d(value)/dx, to convert a standard deviation."""
        off, half = self.off(x), 0.5 * self._reach(x)
        straight = self.centre + self.spread * off
        slope = self.spread * (1.0 if abs(x) <= half else 1.0 - (abs(off) / half - 1.0) ** 2)
        if self.ceiling != math.inf:
            slope /= 1.0 + float(np.exp(-(self.ceiling - straight) / self.bend))
        return slope * float(np.exp(self.centre + self.spread * off)) if self.logarithmic else slope

    def _reach(self, x: float) -> float:
        """Return the reach on the side of the centre where x is."""
        return self.above if x > 0.0 else self.below


def _bent(size: float, reach: float) -> float:
    """Return a distance from the centre that approaches its reach."""
    half = 0.5 * reach
    return size if size <= half else half * (1.0 + math.tanh(size / half - 1.0))


def known_coordinate(name: str, value: float, sd: float, info: ParameterInfo, run: int = -1) -> Coordinate:
    """Return the coordinate of a base parameter with a stated sd, logarithmic if its table says so.

    Args:
        name: of the parameter.
        value: as stated.
        sd: as stated.
        info: its row of the table.
        run: index of its run, -1 for all.
    """
    reach = REACH_OF_ALL if run < 0 else REACH_OF_A_RUN
    if info.transform == "log" and value > 0.0:
        return _possible(Coordinate(name, math.log(value), sd / value, logarithmic=True), info, reach)
    return _possible(Coordinate(name, value, sd), info, reach)


def effect_coordinate(name: str, info: ParameterInfo, usual: tuple[float, float] | None = None) -> Coordinate:
    """Return the coordinate of an effect's parameter, from its usual range or that of the specimen.

    It is logarithmic in the distance from the null if the range is on one side of the null, so that the sign is kept;
    otherwise it is linear.
    """
    assert info.typical is not None, f"{name} declares no usual range"
    low, high = usual or info.typical
    origin = info.null if info.null is not None and math.isfinite(info.null) else 0.0
    near, far = sorted((abs(low - origin), abs(high - origin)))
    if (low - origin) * (high - origin) <= 0.0:
        return _possible(Coordinate(name, origin, max(abs(low), abs(high))), info)
    coordinate = Coordinate(
        name,
        centre=0.5 * (math.log(near) + math.log(far)),
        spread=0.5 * (math.log(far) - math.log(near)),
        logarithmic=True,
        origin=origin,
        sign=math.copysign(1.0, high - origin),
    )
    return _possible(coordinate, info)


def _possible(coordinate: Coordinate, info: ParameterInfo, reach: float = math.inf) -> Coordinate:
    """Return a coordinate within what is possible, and within a reach in sd.

    Args:
        coordinate: without a reach.
        info: row of its table, with the bounds.
        reach: on either side.
    """
    ends = sorted((info.lower, info.upper), key=lambda end: coordinate.sign * end)
    if coordinate.logarithmic:
        distances = [coordinate.sign * (end - coordinate.origin) for end in ends]
        ends = [math.log(one) if 0.0 < one < math.inf else math.copysign(math.inf, one - 1.0) for one in distances]
    coordinate = dataclasses.replace(coordinate, centre=min(coordinate.centre, ends[1] - _INSIDE * coordinate.spread))
    below, above = (_ALL_BUT_ONE * abs(end - coordinate.centre) / coordinate.spread for end in ends)
    return dataclasses.replace(coordinate, above=min(reach, above), below=max(min(reach, below), _LEAST_REACH))
