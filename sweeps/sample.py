"""Values drawn from ranges; any part of a sample is drawn alone, and is the same each time."""

from __future__ import annotations

import functools
import threading
import warnings

import numpy as np

from jaxmodel.sweeps.axes_form import SampleForm


def draw(sample: SampleForm, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values of some lanes of a sample, by name, each of the shape of `numbers`."""
    if numbers.size == 0:
        return {name: np.empty(0) for name in sample.ranges}
    first, last = int(numbers.min()), int(numbers.max())
    shares = _points(sample, first, last + 1 - first)[numbers - first]
    values = {}
    for column, (name, span) in enumerate(sample.ranges.items()):
        low, high, share = span.low, span.high, shares[:, column]
        values[name] = low * (high / low) ** share if span.spacing == "log" else low + (high - low) * share
    return values


def _points(sample: SampleForm, first: int, count: int) -> np.ndarray:
    """Return points first, first + 1, ... of the unit cube, shape (count, ranges)."""
    size = len(sample.ranges)
    if sample.method == "sobol":
        return _sequence(size, sample.seed).points(first, count)
    if sample.method == "random":
        stream = np.random.PCG64(sample.seed).advance(first * size)  # one number of the stream for each value
        return np.random.Generator(stream).random((count, size))
    return _hypercube(size, sample.count, sample.seed)[first : first + count]


class _Sobol:
    """A scrambled Sobol sequence and how far it has been read; reading an earlier part restarts it."""

    def __init__(self, size: int, seed: int) -> None:
        self._size, self._seed = size, seed
        self._lock = threading.Lock()
        self._begin()

    def _begin(self) -> None:
        from scipy.stats import qmc  # half a second, which a grid does without

        self._sequence = qmc.Sobol(self._size, scramble=True, rng=self._seed)

    def points(self, first: int, count: int) -> np.ndarray:
        with self._lock, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a part is not a power of two, and need not be
            if self._sequence.num_generated > first:
                self._begin()
            if (ahead := first - self._sequence.num_generated) > 0:
                self._sequence.fast_forward(ahead)
            return self._sequence.random(count)


@functools.lru_cache(maxsize=4)
def _sequence(size: int, seed: int) -> _Sobol:
    return _Sobol(size, seed)


@functools.lru_cache(maxsize=1)
def _hypercube(size: int, count: int, seed: int) -> np.ndarray:
    """Return a whole Latin hypercube: no part of it can be drawn alone, so it is held in memory."""
    from scipy.stats import qmc

    return qmc.LatinHypercube(size, rng=seed).random(count)
