"""What a model says of pieces of runs that were left out, by its own predictions there."""

from __future__ import annotations

import dataclasses

import numpy as np

from discrepancy.evidence.left_out import Blocks, LeftOut, left_out
from discrepancy.evidence.trial import Trial
from discrepancy.fitting.fit import errors_at

# Shares of a step that are tried where a piece of a run is left out.
_SHARES = (1.0, 0.3)


@dataclasses.dataclass(frozen=True)
class CrossValidation:
    """What a model says of pieces of runs that were left out.

    Attributes:
        trial: the model.
        block: (readings,) the piece of each.
        left_out: log probability of each piece.
        errors: (readings,) measured less predicted, in the channels' units.
    """

    trial: Trial
    block: np.ndarray
    left_out: LeftOut
    errors: np.ndarray


def cross_validate(trial: Trial, pieces: int) -> CrossValidation:
    """Return what a model says of each piece of each run when the others alone are fitted.

    The unknowns move by a step of Newton's, or a shorter one where the others are fitted better there: at the steep end
    of a discharge no straight line holds. The errors are those of the model itself.

    Args:
        trial: the model.
        pieces: into how many pieces of time each run is cut.
    """
    block, view, free = trial.scale.pieces(pieces), trial.scale.view, list(trial.setting.free)
    blocks = Blocks.of(trial.fitted, block)
    numbers, moves = blocks.numbers, blocks.moves * blocks.scale
    steps = np.concatenate([share * moves for share in _SHARES])
    places = np.repeat(trial.fitted.x[None], len(steps), axis=0)
    places[:, free] += steps
    errors = errors_at(view, view.space.problem(trial.setting), trial.setting, places)
    white = trial.scale.weights.whiten(errors)
    pulls = np.sum((places[:, free] / trial.fitted.prior_sd) ** 2, axis=1)
    raw, rows = np.zeros(block.size), np.zeros(block.size)
    for place, number in enumerate(numbers):
        mine = block == number
        mine_of = range(place, len(steps), numbers.size)
        best = min(mine_of, key=lambda one: float(np.sum(white[~mine, one] ** 2)) + pulls[one])
        moves[place], raw[mine], rows[mine] = steps[best], errors[mine, best], white[mine, best]
    return CrossValidation(trial, block, left_out(trial.fitted, block, moves, rows), raw)
