"""How well a model foretells what it was not fitted to: each block of readings given all others, to first order.

With B and g = J'e the information and score of a block at the fit, I the information of everything and C = I - B that
of the others, the fit without the block is C^-1 g away, leaves e + J C^-1 g there, and gives it the log probability

    -(e'e - (J'e)' (C + B)^-1 J'e + log det(C + B) - log det C) / 2      (e as the others leave it)

less a constant common to all models. What is a block's own (a run's initial charge) is known from its prior alone.
"""

from __future__ import annotations

import dataclasses

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


def left_out(fitted: Fit, block: np.ndarray) -> LeftOut:
    """Return what a fitted model says of every block.

    Args:
        fitted: with its whitened rows and Jacobian.
        block: (readings,) number of each reading's block.
    """
    total = fitted.information
    numbers = np.unique(block)
    errors, scores, moves = fitted.rows.copy(), [], []
    for number in numbers:
        mine = block == number
        jacobian, rows = fitted.jacobian[mine], fitted.rows[mine]
        own = jacobian.T @ jacobian
        others = _positive(total - own, fitted.prior_sd)
        move = np.linalg.solve(others, jacobian.T @ rows)
        left = rows + jacobian @ move
        errors[mine] = left
        along = jacobian.T @ left
        _, with_it = np.linalg.slogdet(others + own)
        _, without = np.linalg.slogdet(others)
        marginal = left @ left - along @ np.linalg.solve(others + own, along)
        scores.append(-0.5 * (marginal + with_it - without))
        moves.append(move)
    return LeftOut(np.array(scores), errors, np.array(moves), numbers)


def _positive(information: np.ndarray, prior_sd: np.ndarray) -> np.ndarray:
    """Return information of the others; rounding may leave less than the priors, which are among the others."""
    scaled = prior_sd[:, None] * information * prior_sd
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    restored = (vectors * np.maximum(values, 1.0)) @ vectors.T
    return restored / prior_sd[:, None] / prior_sd


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
