"""What the noise of measured inputs does to the readings: each input moved by its sd, row by row, and simulated.

A row's noise moves the reading of that row, and by what it does to the state all later ones. The first is noise of each
reading like its sensor's own; the second is slow, shared by many readings, and counts as what one unknown more would
do: left out, numbers that follow from slow changes seem up to twice as sure as they are.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from discrepancy.preparation.held_inputs import LONG, rows_held, stretches
from jaxmodel.profile import Track

# Slow noise is that of the means of so many stretches of a run, or more where an input was held for less.
_STRETCHES = 64
# Never more: neighbours are one then, whose charge is what matters. All answers to them are held at once.
_MOST_STRETCHES = 512
# A direction of the readings in which slow noise raises the sd by less than this share is left as it is.
_FAINT = 0.05
# Rows of one simulation that are moved are so many apart: what a row's noise does to later readings has faded by then.
_APART = 8
# So many moves are simulated at once: two batches of lanes.
_AT_ONCE = 32

# Readings (moves, runs, rows, ...) where something is added to inputs, (runs, 1 + steps) each, in each of some moves.
Predict = Callable[[Sequence[Mapping[str, np.ndarray]]], np.ndarray]


@dataclasses.dataclass(frozen=True)
class InputNoise:
    """What noise of measured inputs does to the readings of a case under one model.

    Attributes:
        variance: (runs, rows, channels) of each reading by itself.
        shared: (stretches, runs, rows, channels) answers to independent noises of unit variance that readings share.
    """

    variance: np.ndarray
    shared: np.ndarray


class MovedInputs:
    """The readings of a model, and how they answer where its noisy inputs are moved."""

    def __init__(self, predict: Predict, tracks: Track, input_sd: Mapping[str, float]) -> None:
        """Predict the readings at the inputs as they were read.

        Args:
            predict: the readings under the steps with something added to their inputs, for each of several moves.
            tracks: the steps of all runs, leaves with a leading axis of runs.
            input_sd: by input, the sd of one reading's noise.
        """
        self._predict, self._input_sd = predict, input_sd
        self._inputs = {name: np.asarray(tracks.inputs[name]) for name in input_sd}
        self._row = row_of_step(tracks)
        self._nothing = {name: np.zeros(self._row.shape) for name in input_sd}
        self._still = predict([self._nothing])[0]

    def _answers(self, moves: Iterable[tuple[str, np.ndarray]]) -> Iterator[np.ndarray]:
        """Give what each move does to the readings: of an input's steps (runs, 1 + steps) by so many of its sd."""
        left = iter(moves)
        while some := list(itertools.islice(left, _AT_ONCE)):
            moved = self._predict([self._nothing | {name: self._input_sd[name] * sds} for name, sds in some])
            for answer in moved - self._still:
                yield np.where(np.isfinite(answer), answer, 0.0)

    def variance(self) -> np.ndarray:
        """Return the variance that noise of measured inputs adds to each reading, shaped as the predictions.

        Row by row the noise moves a reading at once (a resistance), by what its step does to the state (a relaxation),
        and by the tail of earlier rows; the squares of all are summed, var_k = sum_j (dy_k/du_j)^2 sd^2. Neighbours
        among the rows moved go up and down in turn, so that nothing drifts. Noise of a mean over rows in which the
        input was held is slow.
        """
        turn = np.where((self._row // _APART) % 2 == 0, 1.0, -1.0)
        free = {name: np.where(self._of_each_run(rows_held, name) < LONG, turn, 0.0) for name in self._input_sd}
        each = itertools.product(free.items(), range(_APART))
        moves = ((name, np.where(self._row % _APART == first, sds, 0.0)) for (name, sds), first in each)
        return sum((answer**2 for answer in self._answers(moves)), np.zeros_like(self._still))

    def to_slow_noise(self) -> np.ndarray:
        """Return the answers to an sd of the mean of each stretch of a run, shape (stretches, *predictions)."""
        most = [max(1, int(rows + 1) // _STRETCHES) for rows in self._row.max(axis=1)]

        def moves() -> Iterator[tuple[str, np.ndarray]]:
            for name in self._input_sd:
                stretch = at_most(_MOST_STRETCHES, self._of_each_run(stretches, name, most))
                for number in range(stretch.max() + 1):
                    mine = stretch == number
                    rows = np.array([np.unique(row[own]).size for row, own in zip(self._row, mine, strict=True)])
                    yield name, mine / np.sqrt(np.maximum(rows, 1))[:, None]

        return np.stack(list(self._answers(moves())))

    def _of_each_run(self, function: Callable[..., np.ndarray], name: str, *more: Sequence[int]) -> np.ndarray:
        return np.stack([function(*each) for each in zip(self._inputs[name], self._row, *more, strict=True)])


def at_most(most: int, number: np.ndarray) -> np.ndarray:
    """Return numbers of stretches with neighbours put together, as many as it takes to leave no more than `most`."""
    return number // -(-(int(number.max()) + 1) // most)


def slow_directions(answers: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return what takes slow noise out of whitened residuals e: e - slow (slow' e), shape (readings, directions).

    With A the answers, residuals have the covariance I + A'A = I + Q s^2 Q', and so I - Q (1 - 1/sqrt(1 + s^2)) Q'
    makes them white.

    Args:
        answers: (n, readings) of the whitened readings to independent noises of unit variance.
        run: (readings,) number of each reading's run; runs have no noise in common.
    """
    found = [np.zeros((run.size, 0))]
    for one in np.unique(run):
        mine = np.flatnonzero(run == one)
        own = answers[:, mine]
        squares, vectors = np.linalg.eigh(own @ own.T)  # far fewer noises than readings
        larger = np.sqrt(1.0 + np.maximum(squares, 0.0))
        kept = larger > 1.0 + _FAINT
        directions = np.zeros((run.size, int(kept.sum())))
        q = own.T @ vectors[:, kept] / np.sqrt(squares[kept])
        directions[mine] = q * np.sqrt(1.0 - 1.0 / larger[kept])
        found.append(directions)
    return np.concatenate(found, axis=1)


def row_of_step(tracks: Track) -> np.ndarray:
    """Return the row at whose end each step lies, and the first row for the start, shape (runs, 1 + steps)."""
    last_step = np.asarray(tracks.last_step)
    steps = np.arange(tracks.duration_s.shape[1])
    rows = np.stack([np.append(0, 1 + np.searchsorted(one, steps)) for one in last_step])
    return np.minimum(rows, last_step.shape[1])
