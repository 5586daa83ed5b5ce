"""Lanes as vector instructions of the processor: packets of lanes, spread over threads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from jaxmodel.lanes import Kernel, Pool
from jaxmodel.sweeps.lane import Outcome
from jaxmodel.sweeps.lane_kernel import doubled
from jaxmodel.sweeps.plan import LANE_STEPS_PER_CALL

# Fewer are not worth another thread: 0.1 ms of a cell.
LEAST_LANE_STEPS = 8_000


class ByVectors:
    """A sweep's kernel in as many threads as there are devices."""

    def __init__(
        self,
        kernel: Kernel,
        shared: Any,
        lanes: Callable[[np.ndarray], dict[str, Any]],
        devices: Sequence[Any],
        steps: int,
    ) -> None:
        """Take a kernel of a lane; the other arguments are those of `ByXla`, and devices."""
        self._kernel, self._lanes_of, self._steps = kernel, lanes, steps
        self._shared = kernel.shared(shared)
        self._pool, self._threads = Pool(len(devices)), len(devices)

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
