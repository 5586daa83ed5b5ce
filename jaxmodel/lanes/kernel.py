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


class Own(NamedTuple):
    """Arrays with the lanes along the last axis, so many as fill the packets."""

    arrays: list[np.ndarray]


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

    def filled(self, count: int) -> int:
        """Return the lanes of the packets that so many lanes fill."""
        return -(-count // self.lanes) * self.lanes

    def own(self, values: Any, count: int) -> Own:
        """Return values with the lanes along their first axis, ready to be read by any number of calls."""
        moved = jax.tree.map(lambda x: _filled(np.asarray(x), self.filled(count)), values)
        return Own(self.own_as_given(moved))

    def arguments(self, shared: Shared, own: Own, results: list[np.ndarray]) -> Any:
        """Return what `run` reads and writes."""
        arrays = [*own.arrays, *results]
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


def _filled(x: np.ndarray, count: int) -> np.ndarray:
    """Return lanes along the last axis, the last one repeated up to so many."""
    moved = np.moveaxis(x, 0, -1)
    return np.concatenate([moved, np.repeat(moved[..., -1:], count - x.shape[0], axis=-1)], axis=-1)
