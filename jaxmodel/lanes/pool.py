"""Kernels over many lanes in several threads."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from typing import Any

import numpy as np

from jaxmodel.lanes.kernel import Kernel, Own, Shared


class Job:
    """A call of a kernel whose packets are with the threads of a pool."""

    def __init__(self, kernel: Kernel, count: int, results: list[np.ndarray], parts: list[Future[int]]) -> None:
        self._kernel, self._count, self._results, self._parts = kernel, count, results, parts

    def raw(self, done: Callable[[int], None] = lambda lanes: None) -> list[np.ndarray]:
        """Return the results when they are there, the lanes along the last axis; `done` is called with lanes."""
        try:
            for part in as_completed(self._parts):
                done(part.result())
        finally:
            for part in self._parts:  # of a call that is broken off
                part.cancel()
        return [x[..., : self._count] for x in self._results]

    def tree(self, done: Callable[[int], None] = lambda lanes: None) -> Any:
        """Return the results as those of the function, the lanes along the first axis."""
        return self._kernel.tree(self.raw(done), self._count)


class Pool:
    """Threads that share the packets of calls; no lane sees another, so that their number changes no bit."""

    def __init__(self, threads: int) -> None:
        self._executor = ThreadPoolExecutor(threads)
        self._own = threading.local()

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown(cancel_futures=True)

    def start(self, kernel: Kernel, shared: Any, own: Any, count: int, packets: int, sizes: Sequence[int] = ()) -> Job:
        """Start a call.

        Args:
            kernel: of one lane.
            shared: by all lanes: values, or what `Kernel.shared` has made of them.
            own: arrays with the lanes along their first axis, or what `Kernel.own` has made of them.
            count: of lanes.
            packets: that a thread runs at once.
            sizes: the lengths that the kernel leaves open.
        """
        width, whole = kernel.lanes, kernel.filled(count)
        results = kernel.buffers(whole, sizes)
        of_all = shared if isinstance(shared, Shared) else kernel.shared(shared)
        of_each = own if isinstance(own, Own) else kernel.own(own, count)
        arguments = kernel.arguments(of_all, of_each, results)

        def part(first: int, last: int) -> int:
            kernel.run(arguments, first, last, whole, self._workspace(kernel.workspace_size(sizes)), sizes)
            return min(last * width, count) - first * width

        starts = range(0, whole // width, packets)
        ends = [min(first + packets, whole // width) for first in starts]
        parts = [self._executor.submit(part, first, last) for first, last in zip(starts, ends, strict=True)]
        return Job(kernel, count, results, parts)

    def _workspace(self, size: int) -> np.ndarray:
        """Return working memory of this thread."""
        if getattr(self._own, "memory", np.empty(0)).size < size:
            self._own.memory = np.empty(size)
        return self._own.memory
