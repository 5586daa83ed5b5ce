"""Working memory of a kernel: arrays that are too long for registers, or whose elements need an index."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from jaxmodel.lanes.emitter import Emitter, Value
from jaxmodel.lanes.loop import Loop
from jaxmodel.lanes.operands import Array, Operand, Series
from jaxmodel.lanes.tangents import Form, Stored, Tangent, as_node, form_of, joined, numbers_of, of_node

Found = TypeVar("Found")


@dataclasses.dataclass(frozen=True)
class Room:
    """Working memory for the elements of an array.

    Attributes:
        place: pointer to its first element; the numbers of an element are as far apart as there are elements.
        form: of the elements.
        dtype: of the numbers.
        count: of elements, as the text of an i64.
    """

    place: str
    form: Form
    dtype: np.dtype
    count: str


class Rooms:
    """The part of a lowering that puts arrays into memory.

    Attributes:
        room: numbers of working memory by lane, each a length or a count.
        directions: of derivatives.
    """

    e: Emitter
    room: list[int]
    directions: int
    _workspace: str

    def reserve(self, count: int, form: Form, dtype: Any) -> Room:
        """Return room for so many elements of each lane; for derivatives in all directions, or none."""
        form = None if form is None else (True,) * self.directions
        e, index = self.e, np.dtype("i8")
        sizes = [e.count(size) for size in self.room]
        offset = str(sum(int(size) for size in sizes if not size.startswith("%")))
        for size in sizes:
            if size.startswith("%"):
                offset = e.emit(f"add i64 {offset}, {size}", index, False).text
        offset = e.emit(f"mul i64 {offset}, {8 * e.lanes}", index, False).text
        place = e.emit(f"getelementptr inbounds i8, ptr {self._workspace}, i64 {offset}", index, False).text
        room = Room(place, form, np.dtype(dtype), e.count(count))
        self.room += [count] * (1 if form is None else len(form))
        return room

    def put(self, room: Room, index: str, element: Value | Tangent) -> None:
        """Store an element."""
        address = self.numbers_at(room, index)
        for number, value in enumerate(numbers_of(self.e, element, room.form)):
            self.e.store(self.e.widen(value), address(str(number)))

    def taken(self, room: Room, index: str) -> Any:
        """Return an element."""
        load = self.loads(room, index)
        return load("0") if room.form is None else of_node(Stored(load), room.dtype)

    def loads(self, room: Room, index: str) -> Callable[[str], Value]:
        """Return the instructions of each number of an element."""
        address = self.numbers_at(room, index)
        return lambda number: self.e.load(address(number), room.dtype, True)

    def numbers_at(self, room: Room, index: str) -> Callable[[str], str]:
        """Return the address of each number of an element."""
        e, whole = self.e, np.dtype("i8")

        def address(number: str) -> str:
            if number == "0":
                return e.address(room.place, index, room.dtype, True)
            before = e.emit(f"mul i64 {number}, {room.count}", whole, False).text
            return e.address(room.place, e.emit(f"add i64 {before}, {index}", whole, False).text, room.dtype, True)

        return address

    def stored(self, room: Room, length: int) -> Series:
        """Return the elements in a room."""
        return Series(length, room.dtype, lambda index: self.taken(room, index), is_kept=True)

    def keep(self, series: Series, room: Room, start: int = 0) -> None:
        """Store all elements of a series from a place on."""
        with Loop(self.e, series.length) as loop:
            target = self.sum(loop.index, start) if start else loop.index
            self.put(room, target, series.at(loop.index))

    def kept(self, series: Series) -> Series:
        """Return a series whose elements are in memory."""
        if series.is_kept:
            return series
        room = self.reserve(series.length, self.form_at(series), series.dtype)
        self.keep(series, room)
        return self.stored(room, series.length)

    def spilled(self, x: Array) -> Series:
        """Return the elements of a small array, put into working memory so that they have an index."""
        flat = x.ravel()
        form = functools.reduce(joined, [form_of(element, self.directions) for element in flat])
        room = self.reserve(flat.size, form, flat[0].dtype)
        for number, element in enumerate(flat):
            self.put(room, str(number), element)
        return self.stored(room, x.shape[0])

    def sum(self, index: str, more: int) -> str:
        """Return index + more."""
        return self.e.emit(f"add i64 {index}, {self.e.count(more)}", np.dtype("i8"), False).text

    def form_at(self, *series: Series) -> Form:
        """Return the form that has room for the elements of some series."""
        if not self.directions:
            return None
        return functools.reduce(joined, [form_of(self.tried(lambda x=x: x.at("0")), self.directions) for x in series])

    def tried(self, compute: Callable[[], Found]) -> Found:
        """Return what a computation finds; its instructions are taken back."""
        lines, block, rooms = len(self.e.lines), self.e.block, len(self.room)
        self.e.begin_scope()
        with self.e.outside_loops():
            found = compute()
        self.e.end_scope()
        del self.e.lines[lines:], self.room[rooms:]
        self.e.block = block
        return found

    def settled(self, x: Operand) -> Operand:
        """Return an operand that is used more than once, so that a sum of derivatives in it is computed once."""
        if not self.directions:
            return x
        if isinstance(x, Series) and not x.is_kept:
            key = object()

            def at(index: str) -> Any:
                return self.e.once((key, index), lambda: _settled(x.at(index)))

            return dataclasses.replace(x, at=at)
        if isinstance(x, np.ndarray):
            result = np.empty(x.size, dtype=object)
            result[:] = [_settled(element) for element in x.ravel()]
            return result.reshape(x.shape)
        return x


def _settled(element: Value | Tangent) -> Value | Tangent:
    return as_node(element) if isinstance(element, Tangent) else element
