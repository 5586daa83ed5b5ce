"""Cross-validation: each time block of each run is predicted by the model fitted to all others."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.diagnosis.evidence.left_out import Blocks, LeftOut, left_out
from jaxmodel.diagnosis.evidence.trial import Trial
from jaxmodel.diagnosis.fitting.fit import errors_at

# Shares of a Newton step that are tried when a block is left out.
_SHARES = (1.0, 0.3)


@dataclasses.dataclass(frozen=True)
class CrossValidation:
    """Predictions of a model for time blocks that were left out.

    Attributes:
        trial: the model.
        block: (readings,) block of each.
        left_out: log probability of each block.
        errors: (readings,) measured minus predicted, in the channels' units.
    """

    trial: Trial
    block: np.ndarray
    left_out: LeftOut
    errors: np.ndarray


def cross_validate(trial: Trial, pieces: int) -> CrossValidation:
    """Return the prediction of each time block of each run when only the others are fitted.

    The unknowns move by a Newton step, or by a part of it if that fits the other blocks better: at the steep end of a
    discharge the linearisation fails. The errors are those of the nonlinear model.

    Args:
        trial: the model.
        pieces: number of time blocks per run.
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
