"""Predictions for many settings of the unknowns: vector instructions on processors, else one program of XLA."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array
from threadpoolctl import threadpool_limits

from jaxmodel.fit import kernels
from jaxmodel.fit.problem import Lane, Problem
from jaxmodel.lanes import NotNative, Pool

# A kernel of 16 lanes takes half as long as one of 32; one of 8 more than half as long as one of 16.
LANES = 16
# Batches and fits run on one thread per core. Additional BLAS threads would compete with them: a product of 1 ms then
# takes 200 ms.
one_thread_of_blas = threadpool_limits.wrap(limits=1, user_api="blas")

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def predictions(problem: Problem, lanes: Sequence[Lane]) -> np.ndarray:
    """Return the predicted readings of any number of lanes, shape (lanes, runs, rows, channels).

    Args:
        problem: a case.
        lanes: arrays on the host.
    """
    if (found := _by_vectors(problem, lanes)) is not None:
        return _padded(problem, found, len(lanes))
    blocks = problem.blocks

    def together(predicted: Sequence[Array]) -> np.ndarray:
        found = np.empty((LANES, *problem.times.shape, len(problem.channels)))
        for (runs, _), part in zip(blocks, predicted, strict=True):
            rows = part.shape[2]
            found[:, runs, :rows] = part[:, : len(runs)]
            found[:, runs, rows:] = found[:, runs, rows - 1 : rows]  # the last row of a run is repeated
        return found

    return _of_batches(blocks, lanes, together)


def _by_vectors(problem: Problem, lanes: Sequence[Lane]) -> list[list[np.ndarray]] | None:
    """Return the readings of each run by channel, each (rows, lanes); None if XLA is to compute them."""
    if jax.default_backend() != "cpu":
        return None
    try:
        return kernels.predicted(problem, lanes, _pool())
    except NotNative:  # an effect of the user's, most likely
        return None


@functools.cache
def _pool() -> Pool:
    return Pool(os.cpu_count() or 1)


def _padded(problem: Problem, of_runs: Sequence[Sequence[np.ndarray]], count: int) -> np.ndarray:
    """Return the readings of runs in one array, the last row of a run repeated."""
    found = np.empty((count, *problem.times.shape, len(problem.channels)))
    for number, readings in enumerate(of_runs):
        rows = readings[0].shape[0]
        for place, of_channel in enumerate(readings):
            found[:, number, :rows, place] = of_channel.T
        found[:, number, rows:] = found[:, number, rows - 1 : rows]
    return found


def at_places(problem: Problem, places: tuple[np.ndarray, np.ndarray, np.ndarray], lanes: Sequence[Lane]) -> np.ndarray:
    """Return the predictions of lanes for some readings, shape (lanes, readings).

    In memory the lanes of a reading lie together, as the kernels write them.

    Args:
        problem: a case.
        places: run, row and channel of each reading.
        lanes: arrays on the host.
    """
    run, row, channel = places
    if (of_runs := _by_vectors(problem, lanes)) is not None:
        found = np.empty((run.size, len(lanes)))
        for number, readings in enumerate(of_runs):
            for place, of_channel in enumerate(readings):
                mine = np.flatnonzero((run == number) & (channel == place))
                if mine.size and mine[-1] - mine[0] == mine.size - 1:
                    np.take(of_channel, row[mine], axis=0, out=found[mine[0] : mine[-1] + 1], mode="clip")
                else:
                    found[mine] = of_channel[row[mine]]
        return found.T
    picked = []  # of each block: its readings, and where they are in its predictions
    for runs, part in problem.blocks:
        of_block = np.full(problem.times.shape[0], -1)
        of_block[runs] = np.arange(len(runs))
        mine = np.flatnonzero(of_block[run] >= 0)
        shape = (*part.times.shape, len(part.channels))
        picked.append((mine, np.ravel_multi_index((of_block[run[mine]], row[mine], channel[mine]), shape)))

    def at_readings(predicted: Sequence[Array]) -> np.ndarray:
        found = np.empty((LANES, run.size))
        for (mine, there), part in zip(picked, predicted, strict=True):
            found[:, mine] = np.asarray(part).reshape(LANES, -1)[:, there]
        return found

    return _of_batches(problem.blocks, lanes, at_readings)


def _of_batches(
    blocks: Sequence[tuple[np.ndarray, Problem]], lanes: Sequence[Lane], use: Callable[[Sequence[Array]], np.ndarray]
) -> np.ndarray:
    """Apply a function to the predictions (lanes, runs, rows, channels) of all blocks, batch after batch.

    A batch of a block is one kernel on one core.
    """

    def of_batch(first: int) -> np.ndarray:
        batch = list(lanes[first : first + LANES])
        filled = batch + [batch[-1]] * (LANES - len(batch))
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *filled)
        return use([_predictions(part, jax.device_put(stacked)) for _, part in blocks])[: len(batch)]

    return np.concatenate(at_once(of_batch, range(0, len(lanes), LANES)))


def at_once(use: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """Apply a function to each item, on one thread per core."""
    if len(items) == 1:
        return [use(items[0])]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(use, items))


@eqx.filter_jit
def _predictions(problem: Problem, lanes: Lane) -> Array:
    """Return the predictions of one batch."""
    return problem.predictions(lanes)
