"""Unknowns as coordinates with a standard normal prior."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from jaxmodel.model.declaration import ParameterInfo

# Share of its spread over which a value approaches its ceiling.
_BEND = 0.25
# A value at or beyond its reach gets the coordinate of this share of the reach.
_ALL_BUT_ONE = 1.0 - 1e-12
# Largest distance from the stated value, in sd (assumed), for parameters of one run, and of all runs: a data sheet may
# state too small an sd.
REACH_OF_A_RUN, REACH_OF_ALL = 5.0, 10.0
# What is possible ends near a usual range if it ends within so many of its sd. Assumed.
_NEAR_SD = 3.0


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One unknown as a standard normal: value = centre + spread x, or origin + sign exp(centre + spread x).

    The prior comes from the stated value and sd of a parameter, or from the usual range of an effect's parameter (its
    ends are at one sd). Values approach a ceiling, or a floor, smoothly within a quarter of the spread: a state of
    charge beyond the last point of its table has no effect, and this edge would disturb a fit.

    A stated parameter has a reach r: x stands for r tanh(x / r) sd, which is close to x up to 2 sd. Without it, a poor
    model would move its parameters far away to compensate, because many readings outweigh a normal prior.
    """

    name: str
    centre: float
    spread: float
    logarithmic: bool = False
    origin: float = 0.0
    sign: float = 1.0
    ceiling: float = math.inf
    is_floor: bool = False
    reach: float = math.inf

    @property
    def bend(self) -> float:
        """Return the range of values over which the ceiling is approached; negative if it is a floor."""
        return (-_BEND if self.is_floor else _BEND) * self.spread

    def off(self, x: float) -> float:
        """Return the distance from the centre at the coordinate x, in sd."""
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
        """Return the coordinate of a value; beyond its reach, that of the end of the reach."""
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
        """Return d(value)/dx, to convert a standard deviation."""
        off = self.off(x)
        bent = 1.0 if self.reach == math.inf else 1.0 - (off / self.reach) ** 2
        if self.logarithmic:
            return bent * abs(self.spread * float(np.exp(self.centre + self.spread * off)))
        if self.ceiling != math.inf:
            away = (self.ceiling - self.centre - self.spread * off) / self.bend
            return bent * self.spread / (1.0 + float(np.exp(-away)))
        return bent * self.spread


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
        return Coordinate(name, math.log(value), sd / value, logarithmic=True, reach=reach)
    return Coordinate(name, value, sd, reach=reach)


def effect_coordinate(name: str, info: ParameterInfo, usual: tuple[float, float] | None = None) -> Coordinate:
    """Return the coordinate of an effect's parameter, from its usual range or that of the specimen.

    It is logarithmic in the distance from the null if the range is on one side of the null, so that the sign is kept;
    otherwise it is linear. It stays within what is possible where that ends near the usual range, on either side alike.
    """
    assert info.typical is not None, f"{name} declares no usual range"
    low, high = usual or info.typical
    origin = info.null if info.null is not None and math.isfinite(info.null) else 0.0
    near, far = sorted((abs(low - origin), abs(high - origin)))
    if (low - origin) * (high - origin) <= 0.0:
        sd, possible = max(abs(low), abs(high)), info.upper - origin
        near = possible == origin - info.lower and possible < _NEAR_SD * sd
        return Coordinate(name, origin, sd, reach=possible / sd if near else math.inf)
    return Coordinate(
        name,
        centre=0.5 * (math.log(near) + math.log(far)),
        spread=0.5 * (math.log(far) - math.log(near)),
        logarithmic=True,
        origin=origin,
        sign=math.copysign(1.0, high - origin),
    )
