"""Effect of the noise of measured inputs on the readings, by simulation with inputs changed by one sd.

The noise of a row affects the reading of that row and, through the state, all later ones. The first part is independent
for each reading, like sensor noise. The second is slow and shared by many readings; it is treated like additional
unknowns. Without it, the sd of parameters determined from slow changes would be up to a factor of two too small.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from jaxmodel.diagnosis.preparation.held_inputs import LONG, rows_held, stretches
from jaxmodel.model.profile import Track

# Slow noise is that of the means of so many stretches of a run, or more if an input was held constant for less.
_STRETCHES = 64
# Largest number; beyond it neighbouring stretches are merged. All responses are in memory at once.
_MOST_STRETCHES = 512
# Directions of the readings in which slow noise raises the sd by less than this share are ignored.
_FAINT = 0.05
# Distance between changed rows of one simulation, after which the effect of a row on later readings has decayed.
_APART = 8
# Changes that are simulated together: two batches of lanes.
_AT_ONCE = 32

# From additions to inputs, (runs, 1 + steps) each, for several changes, to readings (changes, runs, rows, ...).
Predict = Callable[[Sequence[Mapping[str, np.ndarray]]], np.ndarray]


@dataclasses.dataclass(frozen=True)
class InputNoise:
    """Effect of the noise of measured inputs on the readings of a case, for one model.

    Attributes:
        variance: (runs, rows, channels) independent part for each reading.
        shared: (stretches, runs, rows, channels) responses to independent slow noises of unit variance.
    """

    variance: np.ndarray
    shared: np.ndarray


class MovedInputs:
    """Responses of the readings of a model to changes of its noisy inputs."""

    def __init__(self, predict: Predict, tracks: Track, input_sd: Mapping[str, float]) -> None:
        """Predict the readings with the inputs as measured.

        Args:
            predict: the readings with additions to the inputs, for each of several changes.
            tracks: the steps of all runs, leaves with a leading axis of runs.
            input_sd: by input, the sd of one reading's noise.
        """
        self._predict, self._input_sd = predict, input_sd
        self._inputs = {name: np.asarray(tracks.inputs[name]) for name in input_sd}
        self._row = row_of_step(tracks)
        self._nothing = {name: np.zeros(self._row.shape) for name in input_sd}
        self._still = predict([self._nothing])[0]

    def _answers(self, moves: Iterable[tuple[str, np.ndarray]]) -> Iterator[np.ndarray]:
        """Give the response to each change: of an input's steps (runs, 1 + steps), in its sd."""
        left = iter(moves)
        while some := list(itertools.islice(left, _AT_ONCE)):
            moved = self._predict([self._nothing | {name: self._input_sd[name] * sds} for name, sds in some])
            for answer in moved - self._still:
                yield np.where(np.isfinite(answer), answer, 0.0)

    def variance(self) -> np.ndarray:
        """Return the variance that noise of measured inputs adds to each reading, shaped as the predictions.

        The noise of a row affects a reading directly (a resistance), through the state (a relaxation), and through the
        tail of earlier rows; var_k = sum_j (dy_k/du_j)^2 sd^2. Neighbouring changed rows have alternating sign, so that
        the state does not drift. Noise of the mean of a held input is slow.
        """
        turn = np.where((self._row // _APART) % 2 == 0, 1.0, -1.0)
        free = {name: np.where(self._of_each_run(rows_held, name) < LONG, turn, 0.0) for name in self._input_sd}
        each = itertools.product(free.items(), range(_APART))
        moves = ((name, np.where(self._row % _APART == first, sds, 0.0)) for (name, sds), first in each)
        return sum((answer**2 for answer in self._answers(moves)), np.zeros_like(self._still))

    def to_slow_noise(self) -> np.ndarray:
        """Return the responses to one sd of the mean of each stretch of a run, shape (stretches, *predictions)."""
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
    """Return numbers of stretches with neighbours merged, so that there are at most `most`."""
    return number // -(-(int(number.max()) + 1) // most)


def slow_directions(answers: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return directions D that whiten residuals e with slow noise: e - D (D' e), shape (readings, directions).

    With the responses A, the residuals have the covariance I + A'A = I + Q s^2 Q'; I - Q (1 - 1/sqrt(1 + s^2)) Q'
    whitens them.

    Args:
        answers: (n, readings) responses of the whitened readings to independent noises of unit variance.
        run: (readings,) index of each reading's run; runs share no noise.
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
    """Return the row of each step, and row 0 for the start, shape (runs, 1 + steps)."""
    last_step = np.asarray(tracks.last_step)
    steps = np.arange(tracks.duration_s.shape[1])
    rows = np.stack([np.append(0, 1 + np.searchsorted(one, steps)) for one in last_step])
    return np.minimum(rows, last_step.shape[1])
