"""The linear part of a step: one loop over directions, whatever their number.

Written out for each direction, the instructions of a step would not fit into the processor's caches for them. In a loop
the coefficients, which all directions share, are read from memory, and so are the derivatives that a step begins with.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxmodel.native.emitter import Value, constant
from jaxmodel.native.long_arrays import LongArrays
from jaxmodel.native.loop import Loop
from jaxmodel.native.memory import Room
from jaxmodel.native.tangents import Node, Parts, Stored, Sum, Tangent, Unit, linear, numbers_of, of_node, summed


@dataclasses.dataclass(frozen=True)
class Target:
    """Where derivatives are to be put.

    Attributes:
        element: whose derivatives.
        place: pointer to those in the first direction.
        apart: how many packets the next direction is away, as the text of an i64.
        start: packets before the first, in the same way.
    """

    element: Value | Tangent
    place: str
    apart: str = "1"
    start: str = "0"


class Directions(LongArrays):
    """The part of a lowering that computes derivatives in a loop over directions."""

    def moved(self, element: Value | Tangent) -> Tangent:
        """Return an element's derivatives, put into memory."""
        room = self.reserve(self.directions, None, element.dtype)
        for way, number in enumerate(numbers_of(self.e, element, (True,) * self.directions)):
            self.put(room, str(way), number)
        return of_node(Stored(room.places[0], room.dtype), room.dtype)

    def cleared(self, dtype: Any) -> Room:
        """Return room for a number in each direction, all zero."""
        room, e = self.reserve(self.directions, None, dtype), self.e
        size = self.directions * e.lanes * np.dtype(dtype).itemsize
        e.declarations["llvm.memset"] = "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)"
        e.lines.append(f"  call void @llvm.memset.p0.i64(ptr align 8 {room.places[0]}, i8 0, i64 {size}, i1 false)")
        return room

    def carried_in(self, x: Any) -> Any:
        """Return what a loop uses and does not change: derivatives that its rounds would compute anew are in memory."""
        if not self.directions or not isinstance(x, np.ndarray):
            return x
        result = np.empty(x.size, dtype=object)
        result[:] = [self.moved(one) if isinstance(one, Tangent) and _has_to_move(one) else one for one in x.ravel()]
        return result.reshape(x.shape)

    def follow(self, targets: Sequence[Target], cleared: Sequence[Room]) -> list[np.dtype]:
        """Compute derivatives, put them where they belong, and return the types of the rooms that it took.

        Args:
            targets: what to compute.
            cleared: rooms with zeros, in which each round of a step's loop writes to the same places; in a trial none.
        """
        e, rooms, taken = self.e, iter(cleared), []
        wanted = [Tangent(x.multiplied(e), x.dtype, x.factor) for x in (linear(target.element) for target in targets)]
        sums = _in_order(wanted)
        begins: dict[int, Node] = {}
        held: dict[Node, Node] = {}
        for one in (*sums, *wanted):
            units = [(node, c) for node, c in one.terms.items() if isinstance(node, Unit)]
            if units:
                taken.append(units[0][1].dtype)
                room = next(rooms, None) or self.reserve(self.directions, None, taken[-1])
                for node, coefficient in units:
                    self.put(room, str(node.way), coefficient)
                begins[id(one)] = Stored(room.places[0], room.dtype)
            for node, coefficient in one.terms.items():
                if isinstance(node, Parts) and node not in held:
                    (held[node],) = self.moved(of_node(node, coefficient.dtype)).terms
        if not wanted:
            return taken
        with Loop(e, self.directions) as loop:
            values: dict[Node, Value] = {}

            def part(node: Node) -> Value:
                node = held.get(node, node)
                return node.at(e, loop.index) if isinstance(node, Stored) else values[node]

            def total(one: Sum | Tangent) -> Value | None:
                begin = part(begins[id(one)]) if id(one) in begins else None
                return summed(e, {n: c for n, c in one.terms.items() if not isinstance(n, Unit)}, part, begin)

            for node in sums:
                found = total(node)
                assert found is not None
                values[node] = found
            numbers = [total(one) or constant(0, one.dtype) for one in wanted]
            for target, number in zip(targets, numbers, strict=True):
                at = e.emit(f"mul i64 {loop.index}, {target.apart}", np.dtype("i8"), False).text
                at = e.emit(f"add i64 {at}, {target.start}", np.dtype("i8"), False).text
                e.store(e.widen(number), e.address(target.place, at, number.dtype, True))
        return taken


def _has_to_move(tangent: Tangent) -> bool:
    nodes = list(tangent.terms)
    return len(nodes) > 1 or any(not isinstance(node, Unit | Stored) for node in nodes)


def _in_order(wanted: Sequence[Tangent]) -> list[Sum]:
    """Return the sums that others need, each after those that it needs itself."""
    done: dict[Sum, None] = {}

    def visit(one: Sum | Tangent) -> None:
        for node in one.terms:
            if isinstance(node, Sum) and node not in done:
                visit(node)
                done[node] = None

    for one in wanted:
        visit(one)
    return list(done)
