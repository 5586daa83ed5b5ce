"""A function of one lane as a kernel over many: one loop over packets of lanes, the whole function in registers."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxmodel.lanes import machine
from jaxmodel.lanes.module import NAME, Written
from jaxmodel.lanes.operands import NotNative

__all__ = ["Kernel", "NotNative"]

_ARGUMENTS = [ctypes.c_int64, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
# Lengths that stand for those that are known only when a kernel runs; primes, which no model has.
STEPS, ROWS = 1_000_003, 500_009


class Shared(NamedTuple):
    """What all lanes share: arrays, which are kept alive, and their addresses."""

    arrays: list[np.ndarray]
    addresses: list[int]


class Kernel(Written):
    """A compiled function (shared, own) -> results of one lane, run for many; with derivatives of the results.

    Derivatives are exact, in forward mode, and share what the function itself computes: see `jaxmodel.lanes.tangents`.
    """

    def _compile(self) -> None:
        self._function = machine.load(self.module.text, NAME, _ARGUMENTS)

    def shared(self, values: Any) -> Shared:
        """Return what all lanes share, ready to be read by any number of calls."""
        arrays = self.as_given(values)
        return Shared(arrays, [x.ctypes.data for x in arrays])

    def arguments(self, shared: Shared, own: Any, results: list[np.ndarray]) -> Any:
        """Return what `run` reads and writes; `own` has the lanes along the last axis, a multiple of a packet."""
        arrays = [*self.own_as_given(own), *results]
        addresses = [*shared.addresses, *(x.ctypes.data for x in arrays)]
        return (shared, arrays), (ctypes.c_void_p * len(addresses))(*addresses)

    def run(
        self, arguments: Any, first: int, last: int, count: int, workspace: np.ndarray, sizes: Sequence[int] = ()
    ) -> None:
        """Run some packets; releases the interpreter's lock."""
        lengths = (ctypes.c_int64 * max(1, len(sizes)))(*sizes)
        self._function.call(
            first, last, count, ctypes.addressof(lengths), ctypes.addressof(arguments[1]), workspace.ctypes.data
        )

    @property
    def address(self) -> int:
        """Where the compiled code is."""
        return ctypes.cast(self._function.call, ctypes.c_void_p).value or 0

    @property
    def arguments_of_call(self) -> list[np.ndarray | None]:
        """What `run` reads, in order: the constants, and None for each shared and own array."""
        return [*self.module.consts, *[None] * (len(self.module.shared) + len(self.module.own))]

    def results_of_call(self, count: int) -> list[jax.ShapeDtypeStruct]:
        """Return the shapes of what `run` writes for so many lanes, in order."""
        return [jax.ShapeDtypeStruct((*leaf.shape, count), leaf.dtype) for leaf in self.module.results]
