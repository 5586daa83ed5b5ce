"""A model linearised at a point: all that is asked of it near there is algebra on a few small matrices.

For each time block and channel the Gram factors J'J, J'y and y'y of the predictions' derivatives J and of the target
y = e + J x are kept. Weights are one number for each channel, so that evidence, readings left out, bags and intervals
under any weights and prior sd need no simulation.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from jaxmodel.fit.data import PIECES, FitData
from jaxmodel.fit.likelihood import Likelihood

# Share of the diagonal of J'J that is added to it: of a channel that hardly scatters, what rounding leaves of the rest
# of J'J need not be positive.
ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True)
class Gram:
    """The Gram factors of one channel in one block: J'J (k, k), J'y (k,), y'y and the number of readings."""

    square: np.ndarray
    aim: np.ndarray
    power: float
    count: int

    def misfit(self, x: np.ndarray) -> float:
        """Return |y - J x|^2 at coordinates x (k,)."""
        return self.power - 2.0 * float(x @ self.aim) + float(x @ self.square @ x)


@dataclasses.dataclass(frozen=True, eq=False)
class Linearisation:
    """A model linearised at x.

    Attributes:
        x: (k,) free coordinates at which it is linearised.
        blocks: by number of the block, then by channel.
        runs: by number of the block, that of its run.
    """

    x: np.ndarray
    blocks: Mapping[int, Mapping[str, Gram]]
    runs: Mapping[int, int]

    @classmethod
    def of(cls, data: FitData, x: np.ndarray, errors: np.ndarray, jacobian: np.ndarray):
        """Linearise: errors (n,) and the derivatives of the predictions (n, k) at free coordinates x (k,)."""
        target = errors + jacobian @ x

        def gram(rows: slice) -> Gram:
            part, aim = jacobian[rows], target[rows]
            return Gram(part.T @ part, part.T @ aim, float(aim @ aim), aim.size)

        found = {number: {name: gram(rows) for name, rows in of.items()} for number, of in data.blocks.items()}
        return cls(x, found, {number: number // PIECES for number in found})

    @functools.cached_property
    def by_channel(self) -> dict[str, Gram]:
        """Return the factors of each channel, over all blocks."""
        return {name: self._sum(name) for name in self.names}

    @functools.cached_property
    def names(self) -> list[str]:
        """Return the channels."""
        return list(dict.fromkeys(name for block in self.blocks.values() for name in block))

    def _sum(self, name: str) -> Gram:
        parts = [block[name] for block in self.blocks.values() if name in block]
        return Gram(
            np.sum([one.square for one in parts], axis=0),
            np.sum([one.aim for one in parts], axis=0),
            float(sum(one.power for one in parts)),
            sum(one.count for one in parts),
        )

    def _stacked(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return the factors of each channel with the blocks along the first axis; zeros where one has no reading.

        They are not kept: of a hundred models they would be gigabytes.
        """
        size, found = self.x.size, {}
        for name in self.names:
            parts = [block.get(name) for block in self.blocks.values()]
            found[name] = (
                np.stack([np.zeros((size, size)) if one is None else one.square for one in parts]),
                np.stack([np.zeros(size) if one is None else one.aim for one in parts]),
                np.array([0.0 if one is None else one.power for one in parts]),
            )
        return found

    def resampled(self, likelihood: Likelihood, shares: np.ndarray) -> list[Gram]:
        """Return the factors of all readings under some weights, for each row of `shares`.

        Args:
            likelihood: the weight of each channel.
            shares: (resamplings, blocks) how often each block counts.
        """
        total: list[np.ndarray] = []
        stacked = self._stacked()
        for number in range(3):
            parts = [
                likelihood.channels[name].root ** 2 * np.tensordot(shares, arrays[number], axes=1)
                for name, arrays in stacked.items()
            ]
            total.append(np.sum(parts, axis=0))
        return [Gram(square, aim, float(power), 0) for square, aim, power in zip(*total, strict=True)]

    def under(self, likelihood: Likelihood) -> Gram:
        """Return the factors of all readings under some weights, the weight of each channel."""
        grams = self.by_channel
        squared = {name: likelihood.channels[name].root ** 2 for name in grams}
        return Gram(
            np.sum([squared[name] * one.square for name, one in grams.items()], axis=0),
            np.sum([squared[name] * one.aim for name, one in grams.items()], axis=0),
            float(sum(squared[name] * one.power for name, one in grams.items())),
            sum(one.count for one in grams.values()),
        )

    def block_grams(self, likelihood: Likelihood) -> dict[int, Gram]:
        """Return the factors of each block under some weights."""
        found = {}
        for number, block in self.blocks.items():
            squared = {name: likelihood.channels[name].root ** 2 for name in block}
            found[number] = Gram(
                np.sum([squared[name] * one.square for name, one in block.items()], axis=0),
                np.sum([squared[name] * one.aim for name, one in block.items()], axis=0),
                float(sum(squared[name] * one.power for name, one in block.items())),
                sum(one.count for one in block.values()),
            )
        return found

    def left_out(self, likelihood: Likelihood, precision: np.ndarray) -> dict[str, float]:
        """Return, by channel, the mean square error of blocks that were left out one by one."""
        whole = self.under(likelihood)
        squares, counts = dict.fromkeys(self.names, 0.0), dict.fromkeys(self.names, 0)
        for number, gram in self.block_grams(likelihood).items():
            x = solved(whole.square - gram.square, whole.aim - gram.aim, precision)
            for name, one in self.blocks[number].items():
                squares[name] += max(one.misfit(x), 0.0)
                counts[name] += one.count
        return {name: squares[name] / counts[name] for name in self.names}


def solved(square: np.ndarray, aim: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return the best coordinates (k,): (J'J + L)^-1 J'y, L the precision (k,) of the priors."""
    return np.asarray(cho_solve(_factor(square, precision), aim, check_finite=False))


def inverse(square: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return (J'J + L)^-1 (k, k), L the precision (k,) of the priors: the covariance of the coordinates."""
    found = np.asarray(cho_solve(_factor(square, precision), np.eye(len(square)), check_finite=False))
    return 0.5 * (found + found.T)


def _factor(square: np.ndarray, precision: np.ndarray):
    held = square.copy()
    held.flat[:: len(held) + 1] += precision + ROUNDING * np.diag(square)
    return cho_factor(held, lower=True, overwrite_a=True, check_finite=False)


def log_evidence(gram: Gram, precision: np.ndarray) -> float:
    """Return the log evidence of a linear model with priors N(0, 1 / precision), without what all models share.

    -(|y - J x|^2 + x'L x) / 2 - log det(J'J + L) / 2 + log det L / 2 at the best x.
    """
    factor = _factor(gram.square, precision)
    x = cho_solve(factor, gram.aim, check_finite=False)
    least = gram.power - float(x @ gram.aim)
    return -0.5 * least - float(np.sum(np.log(np.diag(factor[0])))) + 0.5 * float(np.sum(np.log(precision)))
