"""Log score of each block of readings given all others, to first order.

B and g = J'e are the information and score of a block at the fit, I the total information, and C = I - B that of the
others. The fit without the block is C^-1 g away, has the errors e + J C^-1 g in the block, and the log probability

    -(e'e - (J'e)' (C + B)^-1 J'e + log det(C + B) - log det C) / 2      (e as the others leave it)

minus a constant common to all models. For an unknown of a single block (a run's initial charge) only the prior counts.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from jaxmodel.diagnosis.fitting.fit import Fit


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Predictions of each block when only the others are fitted.

    Attributes:
        log_score: (blocks,) log probability of each block given the others.
        errors: (readings,) whitened errors there.
        moves: (blocks, k) change of the free unknowns without the block.
        blocks: the numbers of the blocks, in order.
    """

    log_score: np.ndarray
    errors: np.ndarray
    moves: np.ndarray
    blocks: np.ndarray


@dataclasses.dataclass(frozen=True)
class Blocks:
    """Sums of squares and products of a fit's residuals and Jacobian by block, with unknowns in prior sd.

    Attributes:
        numbers: of the blocks, in order.
        gram: (blocks, k, k) J'J.
        slope: (blocks, k) J'e.
        square: (blocks,) e'e.
        pulls: (k,) distances from the prior means, in prior sd.
        scale: (k,) sd of the priors.
    """

    numbers: np.ndarray
    gram: np.ndarray
    slope: np.ndarray
    square: np.ndarray
    pulls: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, fitted: Fit, block: np.ndarray) -> Blocks:
        """Return the sums of a fit."""
        numbers = np.unique(block)
        parts = [(fitted.jacobian[block == one] * fitted.prior_sd, fitted.rows[block == one]) for one in numbers]
        gram = np.stack([jacobian.T @ jacobian for jacobian, _ in parts])
        slope = np.stack([jacobian.T @ rows for jacobian, rows in parts])
        square = np.array([rows @ rows for _, rows in parts])
        return cls(numbers, gram, slope, square, fitted.pulls, fitted.prior_sd)

    def under(self, prior_sd: np.ndarray) -> Blocks:
        """Return the sums at the fit under other priors, to first order."""
        ratio = prior_sd / self.scale
        gram, slope = self.gram * ratio[:, None] * ratio, self.slope * ratio
        pulls = self.pulls / ratio
        move = -np.linalg.solve(gram.sum(axis=0) + np.eye(ratio.size), slope.sum(axis=0) + pulls)
        along = gram @ move
        square = self.square + 2.0 * slope @ move + along @ move
        return Blocks(self.numbers, gram, slope + along, square, pulls + move, prior_sd)

    @functools.cached_property
    def others(self) -> np.ndarray:
        """Return the information of all other blocks and the priors, (blocks, k, k), without subtraction."""
        first, last = np.cumsum(self.gram, axis=0), np.cumsum(self.gram[::-1], axis=0)[::-1]
        nothing = np.zeros((1, *self.gram.shape[1:]))
        return np.concatenate([nothing, first[:-1]]) + np.concatenate([last[1:], nothing]) + np.eye(self.pulls.size)

    @functools.cached_property
    def moves(self) -> np.ndarray:
        """Return the change of the unknowns without each block, to first order, (blocks, k)."""
        return np.linalg.solve(self.others, self.slope[..., None])[..., 0]

    def log_score(self, square: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the log probability of each block given the others, (blocks,), from e'e and J'e of its prediction."""
        whole = self.others + self.gram
        taken = np.sum(slope * np.linalg.solve(whole, slope[..., None])[..., 0], axis=1)
        return -0.5 * (square - taken + np.linalg.slogdet(whole)[1] - np.linalg.slogdet(self.others)[1])

    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the log probability of each block given the others, and its sum of squares, to first order."""
        along = np.einsum("bij,bj->bi", self.gram, self.moves)
        square = self.square + np.sum(self.moves * (2.0 * self.slope + along), axis=1)
        return self.log_score(square, self.slope + along), square


def left_out(
    fitted: Fit, block: np.ndarray, moves: np.ndarray | None = None, rows: np.ndarray | None = None
) -> LeftOut:
    """Return the predictions of a fitted model for every block.

    Args:
        fitted: with its whitened rows and Jacobian.
        block: (readings,) number of each reading's block.
        moves: (blocks, k) change of the free unknowns without the block; to first order if None.
        rows: (readings,) whitened errors of each block after that change; to first order if None.
    """
    blocks = Blocks.of(fitted, block)
    moves = blocks.moves * blocks.scale if moves is None else moves
    errors = fitted.rows.copy() if rows is None else rows
    if rows is None:
        for place, number in enumerate(blocks.numbers):
            mine = block == number
            errors[mine] += fitted.jacobian[mine] @ moves[place]
    square, slope = [], []
    for number in blocks.numbers:
        mine = block == number
        square.append(errors[mine] @ errors[mine])
        slope.append(fitted.prior_sd * (fitted.jacobian[mine].T @ errors[mine]))
    return LeftOut(blocks.log_score(np.array(square), np.array(slope)), errors, moves, blocks.numbers)


def expected_gain(richer: Fit, other: LeftOut, own: LeftOut, block: np.ndarray) -> np.ndarray:
    """Return the expected gain in each block's log score if the richer model is true, (blocks,).

    Half the squared difference of the two predictions, in units of the noise and of the prediction uncertainty of the
    richer model.
    """
    found = []
    for place, number in enumerate(own.blocks):
        mine = block == number
        difference = own.errors[mine] - other.errors[mine]
        jacobian = richer.jacobian[mine]
        along = jacobian.T @ difference
        found.append(0.5 * (difference @ difference - along @ np.linalg.solve(richer.information, along)))
        assert place < own.log_score.size
    return np.maximum(np.array(found), 0.0)
