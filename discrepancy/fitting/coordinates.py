"""Unknown numbers as coordinates that a standard normal is the prior of."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from jaxmodel.declaration import ParameterInfo

# Over which share of its spread a number bends into its ceiling.
_BEND = 0.25
# A number at the end of its reach, or beyond it, has the coordinate of one at so much of it.
_ALL_BUT_ONE = 1.0 - 1e-12
# How many sd from what is stated a number can be at all (assumed): further off it hides an error. Of one run's numbers,
# and of those of all runs, which a data sheet may state with too small an sd.
REACH_OF_A_RUN, REACH_OF_ALL = 5.0, 10.0


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One unknown number as a standard normal: number = centre + spread x, or origin + sign exp(centre + spread x).

    The standard normal is the prior: what the case states of a parameter, or the usual range of an effect's (its ends
    at one standard deviation). Below a ceiling the straight line bends smoothly into it within a quarter of the spread:
    above the last point of its table a state of charge moves nothing, and a fit would stumble over that edge.

    What is stated has a reach, r: x stands for r tanh(x / r) sd. Within 2 sd that is all but x. A model far off
    would let its numbers run away to hide what it lacks, where so many readings outweigh any normal prior.
    """

    name: str
    centre: float
    spread: float
    logarithmic: bool = False
    origin: float = 0.0
    sign: float = 1.0
    ceiling: float = math.inf
    reach: float = math.inf

    @property
    def bend(self) -> float:
        """Return over how much of the number the line bends into the ceiling."""
        return _BEND * self.spread

    def off(self, x: float) -> float:
        """Return how many sd from the centre the number at the coordinate x is."""
        return x if self.reach == math.inf else self.reach * math.tanh(x / self.reach)

    def number(self, x: float) -> float:
        """Return the number at the coordinate x."""
        x = self.off(x)
        if self.logarithmic:
            return self.origin + self.sign * float(np.exp(self.centre + self.spread * x))
        straight = self.centre + self.spread * x
        if self.ceiling == math.inf:
            return straight
        return self.ceiling - self.bend * float(np.logaddexp(0.0, (self.ceiling - straight) / self.bend))

    def at(self, number: float) -> float:
        """Return the coordinate of a number, of one beyond its reach that of the end."""
        if self.logarithmic:
            return self._at_off((math.log((number - self.origin) / self.sign) - self.centre) / self.spread)
        if self.ceiling != math.inf:
            below = max((self.ceiling - number) / self.bend, 1e-3)
            number = self.ceiling - self.bend * (below + math.log(-math.expm1(-below)))
        return self._at_off((number - self.centre) / self.spread)

    def _at_off(self, off: float) -> float:
        if self.reach == math.inf:
            return off
        return self.reach * math.atanh(min(max(off / self.reach, -_ALL_BUT_ONE), _ALL_BUT_ONE))

    def slope(self, x: float) -> float:
        """Return d(number)/dx, to carry a standard deviation over."""
        off = self.off(x)
        bent = 1.0 if self.reach == math.inf else 1.0 - (off / self.reach) ** 2
        if self.logarithmic:
            return bent * abs(self.spread * float(np.exp(self.centre + self.spread * off)))
        if self.ceiling != math.inf:
            away = (self.ceiling - self.centre - self.spread * off) / self.bend
            return bent * self.spread / (1.0 + float(np.exp(-away)))
        return bent * self.spread


def known_coordinate(name: str, value: float, sd: float, info: ParameterInfo, run: int = -1) -> Coordinate:
    """Return the coordinate of a base parameter known to +- sd, on the logarithm where its table says so.

    Args:
        name: of the parameter.
        value: as stated.
        sd: as stated.
        info: its row of the table.
        run: the run whose number it is, -1 for all.
    """
    reach = REACH_OF_ALL if run < 0 else REACH_OF_A_RUN
    if info.transform == "log" and value > 0.0:
        return Coordinate(name, math.log(value), sd / value, logarithmic=True, reach=reach)
    return Coordinate(name, value, sd, reach=reach)


def effect_coordinate(name: str, info: ParameterInfo, usual: tuple[float, float] | None = None) -> Coordinate:
    """Return the coordinate of an effect's parameter, from its usual range, or that of the specimen where one is given.

    A range on one side of the null is taken on the logarithm of the distance from it, so that the sign is kept; a range
    that spans the null is taken as it is.
    """
    assert info.typical is not None, f"{name} declares no usual range"
    low, high = usual or info.typical
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
