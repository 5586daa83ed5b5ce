"""Lanes as vector instructions of the processor: packets of lanes, spread over threads."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import numpy as np

from jaxmodel.model import Model
from jaxmodel.native import Kernel, Pool, Written
from sweeps.lane import Keep, Outcome, SteppedProfile, run_lane
from sweeps.plan import LANE_STEPS_PER_CALL

_Kind = TypeVar("_Kind", bound=Written)

# Fewer are not worth another thread: 0.1 ms of a cell.
LEAST_LANE_STEPS = 8_000


class ByVectors:
    """A sweep's kernel in as many threads as there are devices."""

    def __init__(
        self,
        keep: Keep,
        shared: tuple[Model, SteppedProfile, Any],
        lanes: Callable[[np.ndarray], dict[str, Any]],
        devices: Sequence[Any],
        steps: int,
        single: bool = False,
    ) -> None:
        """Compile it; the arguments are those of `ByXla`, devices, and whether to compute in float32.

        Raises:
            NotNative: an operation of a lane has no vector instructions.
        """
        self._lanes_of = lanes
        values = jax.tree.map(np.asarray, shared)
        self._kernel = kernel_of_a_lane(Kernel, keep, values, lanes, single)
        self._shared = self._kernel.shared(values)
        self._pool, self._threads = Pool(len(devices)), len(devices)
        self._steps = steps

    def outcomes(
        self, spans: Iterable[tuple[int, int, int]], done: Callable[[int], None]
    ) -> Iterator[tuple[int, Outcome]]:
        """Run spans (number, first lane, lanes) and yield the outcome of each with its number."""
        for number, first, count in spans:
            yield number, self._run(first, count, done)

    def call(self, first: int, count: int) -> int:
        """Run as many lanes of a span as a call has, keep nothing of them, and return their number."""
        lanes = min(count, self._threads * self._packets(count) * self._kernel.lanes)
        self._run(first, lanes, lambda lanes: None)
        return lanes

    def _packets(self, count: int) -> int:
        """Return how many packets a thread runs at once: short calls to be counted, and work for all threads."""
        per_packet = self._steps * self._kernel.lanes
        most = max(1, LANE_STEPS_PER_CALL // per_packet)
        all_threads = -(-count // (self._kernel.lanes * self._threads))
        return min(most, max(all_threads, -(-LEAST_LANE_STEPS // per_packet)))

    def _run(self, first: int, count: int, done: Callable[[int], None]) -> Outcome:
        own = self._lanes_of(np.arange(first, first + count))
        job = self._pool.start(self._kernel, self._shared, own, count, self._packets(count))
        return doubled(job.tree(done))


def kernel_of_a_lane(
    kind: type[_Kind], keep: Keep, shared: Any, lanes: Callable[[np.ndarray], dict[str, Any]], single: bool
) -> _Kind:
    """Return the kernel of a lane, in float64 or float32, cached for like sweeps.

    Raises:
        NotNative: an operation of a lane has no instructions.
    """
    own = {name: np.asarray(value)[0] for name, value in lanes(np.zeros(1, dtype=int)).items()}
    leaves, structure = jax.tree.flatten((shared, own))
    return _kernel(kind, keep, structure, tuple((x.shape, x.dtype) for x in leaves), single)


@functools.lru_cache(maxsize=32)
def _kernel(
    kind: type[_Kind], keep: Keep, structure: Any, leaves: tuple[tuple[tuple[int, ...], np.dtype], ...], single: bool
) -> _Kind:
    halves = {"float64": "float32", "int64": "int32", "uint64": "uint32"} if single else {}
    types = [(shape, np.dtype(halves.get(dtype.name, dtype))) for shape, dtype in leaves]
    shared, own = jax.tree.unflatten(structure, [jax.ShapeDtypeStruct(*leaf) for leaf in types])

    def one_lane(shared: tuple[Model, SteppedProfile, Any], own: dict[str, jax.Array]) -> Outcome:
        return run_lane(keep, *shared, own)

    with jax.enable_x64(not single):
        return kind(one_lane, shared, own)


def doubled(outcome: Outcome) -> Outcome:
    """Return results as they are kept, floats in float64."""
    return jax.tree.map(lambda x: x.astype(np.float64, copy=False) if x.dtype.kind == "f" else x, outcome)
