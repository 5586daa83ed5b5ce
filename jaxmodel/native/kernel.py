"""A function of one lane as a kernel over many: one loop over packets of lanes, the whole function in registers."""

from __future__ import annotations

import ctypes
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from jaxmodel.native import machine
from jaxmodel.native.emitter import Emitter, Value, scalar_type
from jaxmodel.native.lowering import MOST_IN_REGISTERS, Loop, Lowering, Memory, NotNative, Series

__all__ = ["Kernel", "NotNative"]

_NAME = "run"
_ARGUMENTS = [ctypes.c_int64, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p]


@dataclasses.dataclass(frozen=True)
class _Leaf:
    shape: tuple[int, ...]
    dtype: np.dtype

    @property
    def size(self) -> int:
        return math.prod(self.shape)


class Kernel:
    """A compiled function (shared, own) -> results of one lane, run for many.

    Attributes:
        lanes: in a packet.
    """

    def __init__(self, function: Callable, shared: Any, own: Any, lanes: int | None = None) -> None:
        """Compile a function.

        Args:
            function: of the arguments below, for one lane; pure.
            shared: a pytree of arrays that are the same for all lanes.
            own: a pytree of the arrays of one lane, or their shapes.
            lanes: in a packet, by default two registers of doubles.

        Raises:
            NotNative: it has an operation that has no vector instructions here.
        """
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(shared, own)
        self._out_tree = jax.tree.structure(shapes)
        jaxpr = traced.jaxpr
        count = len(jax.tree.leaves(shared))
        self._shared, self._own = (_leaves(v) for v in (jaxpr.invars[:count], jaxpr.invars[count:]))
        self._consts = [np.asarray(c) for c in traced.consts]
        self._results = _leaves(jaxpr.outvars)
        self.lanes = lanes or _packet(jaxpr)
        self.text = self._written(jaxpr)
        self._function = machine.load(self.text, _NAME, _ARGUMENTS)

    def _written(self, jaxpr: Any) -> str:
        """Return the module: a loop over packets."""
        e = Emitter(self.lanes)
        lowering = Lowering(e, "%work")
        pointers = [
            e.load(e.address("%arguments", str(k), np.dtype("i8"), False), np.dtype("i8"), False)
            for k in range(len(self._shared) + len(self._consts) + len(self._own) + len(self._results))
        ]
        pointers = iter([_pointer(e, value) for value in pointers])
        consts = [_shared(e, lowering, next(pointers), _Leaf(c.shape, c.dtype)) for c in self._consts]
        shared = [_shared(e, lowering, next(pointers), leaf) for leaf in self._shared]
        packet, head, done = "%packet", e.name("packets"), e.name("finished")
        before = e.block
        e.lines.append(f"  %any = icmp slt i64 %first, %last\n  br i1 %any, label %{head}, label %{done}")
        e.start_block(head)
        place = len(e.lines)
        own = [_own(e, next(pointers), leaf) for leaf in self._own]
        results = lowering.run(jaxpr, consts, [*shared, *own])
        _store(e, lowering, list(zip(results, self._results, pointers, strict=True)))
        e.lines.append(f"  %next = add nsw i64 {packet}, 1\n  %ends = icmp eq i64 %next, %last")
        last = e.block
        e.lines.append(f"  br i1 %ends, label %{done}, label %{head}")
        e.lines.insert(place, f"  {packet} = phi i64 [ %first, %{before} ], [ %next, %{last} ]")
        e.start_block(done)
        self._room = max(1, lowering.room)
        body = "\n".join(e.lines)
        declared = "\n".join(e.declarations.values())
        return (
            f"define void @{_NAME}(i64 %first, i64 %last, i64 %count, ptr noalias %arguments, ptr noalias %work) "
            f'nounwind "prefer-vector-width"="512" {{\nentry:\n{body}\n  ret void\n}}\n{declared}\n'
        )

    def workspace(self) -> np.ndarray:
        """Return working memory for one thread."""
        return np.empty(self._room * self.lanes)

    def buffers(self, count: int) -> list[np.ndarray]:
        """Return arrays for the results of so many lanes, a multiple of a packet."""
        return [np.empty((*leaf.shape, count), leaf.dtype) for leaf in self._results]

    def arguments(self, shared: Any, own: Any, results: list[np.ndarray]) -> Any:
        """Return what `run` reads and writes; `own` has the lanes along the last axis, a multiple of a packet."""
        given = [
            *self._consts,
            *(
                np.ascontiguousarray(x, leaf.dtype)
                for x, leaf in zip(jax.tree.leaves(shared), self._shared, strict=True)
            ),
            *(np.ascontiguousarray(x, leaf.dtype) for x, leaf in zip(jax.tree.leaves(own), self._own, strict=True)),
            *results,
        ]
        return given, (ctypes.c_void_p * len(given))(*(x.ctypes.data for x in given))

    def run(self, arguments: Any, first: int, last: int, count: int, workspace: np.ndarray) -> None:
        """Run some packets; releases the interpreter's lock."""
        self._function.call(first, last, count, ctypes.addressof(arguments[1]), workspace.ctypes.data)

    def tree(self, results: Sequence[np.ndarray], count: int) -> Any:
        """Return results as the function's, with an axis of lanes first."""
        return jax.tree.unflatten(self._out_tree, [np.moveaxis(x, -1, 0)[:count] for x in results])


def _leaves(variables: Sequence[Any]) -> list[_Leaf]:
    return [_Leaf(tuple(v.aval.shape), np.dtype(v.aval.dtype)) for v in variables]


def _packet(jaxpr: Any) -> int:
    floats = {np.dtype(v.aval.dtype).itemsize for v in jaxpr.invars if np.dtype(v.aval.dtype).kind == "f"}
    return 2 * machine.vector_bits() // (8 * max(floats, default=8))


def _pointer(e: Emitter, value: Value) -> str:
    return e.emit(f"inttoptr i64 {value.text} to ptr", np.dtype("i8"), False).text


def _shared(e: Emitter, lowering: Lowering, pointer: str, leaf: _Leaf) -> Any:
    memory = Memory(pointer, leaf.shape, leaf.dtype)
    return lowering.loaded(memory) if leaf.size <= MOST_IN_REGISTERS // 4 else memory


def _own(e: Emitter, pointer: str, leaf: _Leaf) -> Any:
    if leaf.size > MOST_IN_REGISTERS:
        if len(leaf.shape) > 1:
            raise NotNative(f"an array of shape {leaf.shape} in each lane")
        return Series(leaf.size, leaf.dtype, lambda index: e.load(_row(e, pointer, index, leaf), leaf.dtype, True))
    result = np.empty(leaf.size, dtype=object)
    for number in range(leaf.size):
        result[number] = e.load(_row(e, pointer, str(number), leaf), leaf.dtype, True)
    return result.reshape(leaf.shape)


def _row(e: Emitter, pointer: str, row: str, leaf: _Leaf) -> str:
    """Return the address of this packet's numbers in a row."""
    index = np.dtype("i8")
    start = e.emit(f"mul i64 {row}, %count", index, False).text
    here = e.emit(f"mul i64 %packet, {e.lanes}", index, False).text
    at = e.emit(f"add i64 {start}, {here}", index, False).text
    return e.address(pointer, at, leaf.dtype, False)


def _store(e: Emitter, lowering: Lowering, results: list[tuple[Any, _Leaf, str]]) -> None:
    """Store results; those over steps in one loop for each length, so that what they share is computed once."""
    long: dict[int, list[tuple[Any, _Leaf, str]]] = {}
    for value, leaf, pointer in results:
        if isinstance(value, np.ndarray):
            for number, one in enumerate(value.ravel()):
                e.store(e.widen(one), _row(e, pointer, str(number), leaf))
        else:
            long.setdefault(leaf.shape[0], []).append((lowering.series(value), leaf, pointer))
    for length, group in long.items():
        with Loop(e, length) as index:
            for series, leaf, pointer in group:
                e.store(e.widen(series.at(index)), _row(e, pointer, index, leaf))


assert scalar_type
