"""The linear part of a step: one loop over directions, whatever their number.

Written out for each direction, the instructions of a step would not fit into the processor's caches for them. In a loop
the coefficients, which all directions share, are read from memory, and so are the derivatives that a step begins with.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxmodel.lanes.emitter import Value, constant
from jaxmodel.lanes.long_arrays import LongArrays
from jaxmodel.lanes.loop import Loop
from jaxmodel.lanes.memory import Room
from jaxmodel.lanes.tangents import Node, Parts, Stored, Sum, Tangent, Unit, linear, of_node, summed


@dataclasses.dataclass(frozen=True)
class Target:
    """Where derivatives are to be put.

    Attributes:
        element: whose derivatives.
        address: of a packet of numbers, from the direction as the text of an i64.
    """

    element: Value | Tangent
    address: Callable[[str], str]


class Directions(LongArrays):
    """The part of a lowering that computes derivatives in a loop over directions."""

    def moved(self, elements: Sequence[Value | Tangent]) -> list[Room]:
        """Return memory with the derivatives of elements."""
        rooms = [self.reserve(1, (), element.dtype) for element in elements]
        self.follow([Target(x, self.numbers_at(room, "0")) for x, room in zip(elements, rooms, strict=True)])
        return rooms

    def unchanged(self, arrays: Sequence[Any]) -> list[Any]:
        """Return what a loop uses as it is: derivatives that its rounds would compute anew are put into memory."""
        small = [x.ravel() if isinstance(x, np.ndarray) else () for x in arrays]
        moving = dict.fromkeys(x for some in small for x in some if isinstance(x, Tangent) and _has_to_move(x))
        rooms = self.moved(list(moving))
        held = {x: self.taken(room, "0") for x, room in zip(moving, rooms, strict=True)}
        result = []
        for x, some in zip(arrays, small, strict=True):
            if isinstance(x, np.ndarray):
                flat = np.empty(x.size, dtype=object)
                flat[:] = [held[one] if one in moving else one for one in some]
                x = flat.reshape(x.shape)
            result.append(x)
        return result

    def cleared(self, dtype: Any) -> Room:
        """Return room for a number in each direction, all zero."""
        room, e = self.reserve(1, (), dtype), self.e
        size = self.directions * e.lanes * 8
        e.declarations["llvm.memset"] = "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)"
        e.lines.append(f"  call void @llvm.memset.p0.i64(ptr align 8 {room.place}, i8 0, i64 {size}, i1 false)")
        return room

    def follow(self, targets: Sequence[Target], cleared: Sequence[Room] = ()) -> list[np.dtype]:
        """Compute derivatives, put them where they belong, and return the types of the rooms that it took.

        Args:
            targets: what to compute.
            cleared: rooms with zeros, in which the rounds of a loop write to the same places; by default own ones.
        """
        if not targets:
            return []
        e, rooms, taken = self.e, iter(cleared), []
        wanted = [Tangent(x.multiplied(e), x.dtype, x.factor) for x in (linear(target.element) for target in targets)]
        sums = _in_order(wanted)
        begins: dict[int, Node] = {}
        held: dict[Node, Node] = {}
        for one in (*sums, *wanted):
            units = [(node, c) for node, c in one.terms.items() if isinstance(node, Unit)]
            if units:
                taken.append(units[0][1].dtype)
                room = next(rooms, None) or self.cleared(taken[-1])
                address = self.numbers_at(room, "0")
                begins[id(one)] = Stored(self.loads(room, "0"))
                for node, coefficient in units:
                    e.store(e.widen(coefficient), address(str(node.way)))
            held |= {node: self._in_memory(node, c.dtype) for node, c in one.terms.items() if isinstance(node, Parts)}
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
                e.store(e.widen(number), target.address(loop.index))
        return taken

    def _in_memory(self, node: Node, dtype: np.dtype) -> Node:
        """Return derivatives from registers."""
        room = self.reserve(1, (), dtype)
        self.put(room, "0", of_node(node, dtype))
        return Stored(self.loads(room, "0"))


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
