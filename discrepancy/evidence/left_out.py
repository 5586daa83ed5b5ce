"""How well a model foretells what it was not fitted to: each block of readings given all others, to first order.

With B and g = J'e the information and score of a block at the fit, I the information of everything and C = I - B that
of the others, the fit without the block is C^-1 g away, leaves e + J C^-1 g there, and gives it the log probability

    -(e'e - (J'e)' (C + B)^-1 J'e + log det(C + B) - log det C) / 2      (e as the others leave it)

less a constant common to all models. What is a block's own (a run's initial charge) is known from its prior alone.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from discrepancy.fitting.fit import Fit


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """What a model says of each block when the others alone were fitted.

    Attributes:
        log_score: (blocks,) log probability of each block given the others.
        errors: (readings,) whitened errors there.
        moves: (blocks, k) how far the free unknowns move without the block.
        blocks: the numbers of the blocks, in order.
    """

    log_score: np.ndarray
    errors: np.ndarray
    moves: np.ndarray
    blocks: np.ndarray


@dataclasses.dataclass(frozen=True)
class Blocks:
    """The sums of squares and products of a fit's rows and Jacobian, block by block, unknowns in sd of their priors.

    Attributes:
        numbers: of the blocks, in order.
        gram: (blocks, k, k) J'J.
        slope: (blocks, k) J'e.
        square: (blocks,) e'e.
        pulls: (k,) unknowns.
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
        """Return the information of all other blocks and the priors, (blocks, k, k): sums alone, no difference."""
        first, last = np.cumsum(self.gram, axis=0), np.cumsum(self.gram[::-1], axis=0)[::-1]
        nothing = np.zeros((1, *self.gram.shape[1:]))
        return np.concatenate([nothing, first[:-1]]) + np.concatenate([last[1:], nothing]) + np.eye(self.pulls.size)

    @functools.cached_property
    def moves(self) -> np.ndarray:
        """Return how far the unknowns move without each block, to first order, (blocks, k)."""
        return np.linalg.solve(self.others, self.slope[..., None])[..., 0]

    def log_score(self, square: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the log probability of each block given the others, (blocks,), by e'e and J'e as they leave it."""
        whole = self.others + self.gram
        taken = np.sum(slope * np.linalg.solve(whole, slope[..., None])[..., 0], axis=1)
        return -0.5 * (square - taken + np.linalg.slogdet(whole)[1] - np.linalg.slogdet(self.others)[1])

    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the log probability of each block given the others and the squares that they leave, to first order."""
        along = np.einsum("bij,bj->bi", self.gram, self.moves)
        square = self.square + np.sum(self.moves * (2.0 * self.slope + along), axis=1)
        return self.log_score(square, self.slope + along), square


def left_out(
    fitted: Fit, block: np.ndarray, moves: np.ndarray | None = None, rows: np.ndarray | None = None
) -> LeftOut:
    """Return what a fitted model says of every block.

    Args:
        fitted: with its whitened rows and Jacobian.
        block: (readings,) number of each reading's block.
        moves: (blocks, k) how far the free unknowns move without the block; to first order where None.
        rows: (readings,) whitened errors of each block there; to first order where None.
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
    """Return what a richer model should gain of each block's log score if it is true, (blocks,).

    Half the square of the difference between what both foretell, in units of the noise and of what the richer model
    does not know of the block without having seen it.
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
