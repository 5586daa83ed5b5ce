"""What readings say of parameters, from Fisher information alone: Cramer-Rao bounds, shares, poorly known directions.

All is in coordinates x in which the prior is standard normal, so that its information is the unit matrix: an
information of 1 is that of the prior.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]

# Eigenvalues below this share of the largest are rounding, or the error of difference quotients.
_NOTHING = 1e-10
# A parameter is determined by the data where less than this of its axis lies in directions without information.
_OUTSIDE = 1e-4


@dataclasses.dataclass(frozen=True)
class Information:
    """Fisher information of independent parts of the data, in prior sd.

    Attributes:
        names: of the unknowns.
        parts: (parts, unknowns, unknowns), J'J of the whitened sensitivities of each part: a run's sensor, say.
    """

    names: tuple[str, ...]
    parts: Floats

    @property
    def total(self) -> Floats:
        """Return the information of all data, without the prior."""
        return self.parts.sum(axis=0)

    @property
    def covariance(self) -> Floats:
        """Return (F + I)^-1: the covariance that remains once the data are in."""
        return np.linalg.inv(self.total + np.eye(len(self.names)))

    def sd(self) -> Floats:
        """Return the Cramer-Rao bounds with the prior, in prior sd: 1 where the data say nothing of it."""
        return np.sqrt(np.diag(self.covariance))

    def sd_of_data(self) -> Floats:
        """Return the Cramer-Rao bounds of the data alone; inf where they leave a parameter open."""
        values, vectors = _eigen(self.total)
        informed = values > _NOTHING * max(float(values[-1]), 1.0)
        outside = np.sum(vectors[:, ~informed] ** 2, axis=1)
        variance = np.sum(vectors[:, informed] ** 2 / values[informed], axis=1)
        return np.where(outside > _OUTSIDE, np.inf, np.sqrt(variance))

    def correlation(self) -> Floats:
        """Return the correlations of the estimates, with the prior."""
        sd = self.sd()
        return self.covariance / np.outer(sd, sd)

    def shares(self) -> Floats:
        """Return the share of each part of the data in the final information on each parameter.

        The information on parameter i, all others being estimated too, is 1/C_ii = v'(F + I)v with v = C e_i / C_ii:
        that along the direction of i which the others cannot compensate. It is a sum over the parts.

        Returns:
            Shape (parts + 2, unknowns): the parts, the prior of the parameter itself, and the priors of the others;
            columns add up to 1.
        """
        covariance = self.covariance
        known = 1.0 / np.diag(covariance)
        ways = covariance * known  # columns v
        of_parts = np.einsum("ji,pjk,ki->pi", ways, self.parts, ways)
        of_others = np.sum(ways**2, axis=0) - 1.0
        return np.concatenate([of_parts, np.ones((1, known.size)), of_others[None]]) / known

    def without(self, parts: Sequence[int]) -> Information:
        """Return the information that is left without some parts."""
        return Information(self.names, np.delete(self.parts, list(parts), axis=0))

    def directions(self) -> tuple[Floats, Floats]:
        """Return the information along its own axes, least first, and the axes as columns, in prior sd."""
        return _eigen(self.total)


def _eigen(matrix: Floats) -> tuple[Floats, Floats]:
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.maximum(values, 0.0), vectors


# A component of a direction smaller than this share of its largest is not named.
_NAMED = 0.25
# How near an exponent must be to 1 to be called a plain product or ratio.
_PLAIN = 0.15


def direction_in_words(names: tuple[str, ...], way: Floats, proportional: Mapping[str, bool] | None = None) -> str:
    """Say what the data leave open along a direction: "R_TL and C_TL only as a product".

    Args:
        names: of the unknowns.
        way: the direction, in relative changes for what is proportional, else in prior sd.
        proportional: whether a relative change means something, by name; True where it is not said.
    """
    large = [i for i in np.argsort(-np.abs(way)) if abs(way[i]) >= _NAMED * np.max(np.abs(way))]
    chosen = [str(names[i]) for i in large]
    relative = all((proportional or {}).get(name, True) for name in chosen)
    if len(large) == 1:
        return f"{chosen[0]} alone"
    if len(large) == 2 and relative:
        first, second = way[large]
        # p^a q^b stays where a dp/p + b dq/q = 0.
        power = -first / second
        kind = "product" if power > 0.0 else "ratio"
        if abs(abs(power) - 1.0) < _PLAIN:
            return f"{chosen[0]} and {chosen[1]} only as a {kind}"
        between = "*" if power > 0.0 else "/"
        return f"{chosen[0]} and {chosen[1]} only as {chosen[0]} {between} {chosen[1]}^{abs(power):.2g}"
    sign = np.sign(way[large[0]])
    up = [str(names[i]) for i in large if way[i] * sign > 0.0]
    down = [str(names[i]) for i in large if way[i] * sign < 0.0]
    return f"{', '.join(up)} up together" + (f" with {', '.join(down)} down" if down else "")
