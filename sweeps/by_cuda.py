"""Lanes as a CUDA kernel: a thread per lane, calls spread over GPUs."""

from __future__ import annotations

import collections
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import numpy as np

from jaxmodel.lanes import CudaCall, CudaKernel
from jaxmodel.sweeps.lane import Outcome
from jaxmodel.sweeps.lane_kernel import doubled
from jaxmodel.sweeps.plan import ACCELERATOR, LANE_STEPS_PER_CALL

_Item = TypeVar("_Item")

# Of what is free of a GPU's memory, for the lanes of one call; two calls are in flight.
_SHARE = 0.25


def is_cuda(device: Any) -> bool:
    """Return whether a device of JAX is a GPU of NVIDIA."""
    return device.platform != "cpu" and "cuda" in device.client.platform_version.lower()


class ByCuda:
    """A sweep's kernel on as many GPUs as there are devices."""

    def __init__(
        self,
        kernel: CudaKernel,
        shared: Any,
        lanes: Callable[[np.ndarray], dict[str, Any]],
        devices: Sequence[Any],
        steps: int,
    ) -> None:
        """Load a kernel of a lane; the other arguments are those of `ByVectors`.

        Raises:
            CudaError: the driver of the GPU is too old, or refuses.
        """
        self._lanes_of, self._steps = lanes, steps
        self._gpus = [kernel.on(device.local_hardware_id, shared) for device in devices]

    def outcomes(
        self, spans: Iterable[tuple[int, int, int]], done: Callable[[int], None]
    ) -> Iterator[tuple[int, Outcome]]:
        """Run spans (number, first lane, lanes) and yield the outcome of each with its number."""
        parts: list[Outcome] = []
        for number, count, ends, started in _ahead(self._started(spans), len(self._gpus)):
            parts.append(doubled(started.tree()))
            done(count)
            if ends:
                yield number, jax.tree.map(lambda *each: np.concatenate(each), *parts)
                parts = []

    def call(self, first: int, count: int) -> int:
        """Run the first call of a span, keep nothing of it, and return its number of lanes."""
        _, lanes, _, started = next(call for call in self._started([(0, first, count)]) if call is not None)
        started.wait()
        return lanes

    def _started(self, spans: Iterable[tuple[int, int, int]]) -> Iterator[tuple[int, int, bool, CudaCall] | None]:
        """Start the calls of spans one by one, on one GPU after the other; a call returns before its lanes are done.

        None stands for a call that found too little memory: what is in flight must be fetched first.
        """
        calls, most = 0, ACCELERATOR * LANE_STEPS_PER_CALL // self._steps
        for number, first, count in spans:
            start, end = first, first + count
            while start < end:
                gpu = self._gpus[calls % len(self._gpus)]
                fitting = int(_SHARE * gpu.free_bytes / gpu.bytes_per_lane)
                lanes = max(1, min(end - start, most, fitting))
                try:
                    started = gpu.start(self._lanes_of(np.arange(start, start + lanes)), lanes)
                except MemoryError:  # another program took it meanwhile
                    if lanes == 1:
                        raise
                    most = lanes // 2
                    yield None
                    continue
                calls, start = calls + 1, start + lanes
                yield number, lanes, start == end, started


def _ahead(items: Iterator[_Item | None], count: int) -> Iterator[_Item]:
    """Yield items, each after so many more have been fetched, so that GPUs run meanwhile; at None none wait."""
    waiting: collections.deque[_Item] = collections.deque()
    for item in items:
        if item is not None:
            waiting.append(item)
        while len(waiting) > (0 if item is None else count):
            yield waiting.popleft()
    yield from waiting
