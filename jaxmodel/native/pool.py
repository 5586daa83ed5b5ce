"""A kernel over many lanes in several threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

import jax
import numpy as np

from jaxmodel.native.kernel import Kernel


class Pool:
    """Threads that share the packets of a call; no lane sees another, so that their number changes no bit."""

    def __init__(self, kernel: Kernel, threads: int, sizes: Sequence[int] = ()) -> None:
        """Start threads; `sizes` are the lengths that the kernel leaves open."""
        self._kernel, self._sizes = kernel, sizes
        self._executor = ThreadPoolExecutor(threads)
        self._free = [kernel.workspace(sizes) for _ in range(threads)]

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown(cancel_futures=True)

    def run(
        self, shared: Any, own: Any, count: int, packets: int, done: Callable[[int], None] = lambda lanes: None
    ) -> Any:
        """Return the results of lanes.

        Args:
            shared: by all lanes.
            own: arrays with the lanes along their first axis.
            count: of lanes.
            packets: that a thread runs at once.
            done: called with lanes as they are done.
        """
        width = self._kernel.lanes
        whole = -(-count // width) * width
        filled = jax.tree.map(lambda x: _filled(np.asarray(x), whole), own)
        results = self._kernel.buffers(whole, self._sizes)
        arguments = self._kernel.arguments(shared, filled, results)

        def part(first: int, last: int) -> int:
            workspace = self._free.pop()
            try:
                self._kernel.run(arguments, first, last, whole, workspace, self._sizes)
            finally:
                self._free.append(workspace)
            return min(last * width, count) - first * width

        ends = range(0, whole // width, packets)
        for future in as_completed(
            self._executor.submit(part, first, min(first + packets, whole // width)) for first in ends
        ):
            done(future.result())
        return self._kernel.tree(results, count)


def _filled(x: np.ndarray, count: int) -> np.ndarray:
    """Return lanes along the last axis, the last one repeated up to so many."""
    moved = np.moveaxis(x, 0, -1)
    return np.concatenate([moved, np.repeat(moved[..., -1:], count - x.shape[0], axis=-1)], axis=-1)
