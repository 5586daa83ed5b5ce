"""Operations on arrays with an element for each step of a run, which are too long for registers."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxmodel.lanes.arrays import ON_ARRAYS, places_held
from jaxmodel.lanes.elements import ELEMENTS, REDUCE, element, neutral
from jaxmodel.lanes.emitter import Value, constant
from jaxmodel.lanes.loop import Loop
from jaxmodel.lanes.memory import Room, Rooms
from jaxmodel.lanes.operands import (
    MOST_IN_REGISTERS,
    MOST_SPREAD,
    Array,
    Memory,
    NotNative,
    Operand,
    Rows,
    Series,
    array_of,
)
from jaxmodel.lanes.tangents import Stored, Tangent, from_numbers, numbers_of, of_node

_VIEWS = ("slice", "dynamic_slice", "squeeze", "reshape", "broadcast_in_dim", "expand_dims")


class LongArrays(Rooms):
    """The part of a lowering that handles long arrays."""

    by_element: Callable[..., Array]

    def series(self, x: Operand) -> Series:
        """Return an array along its first axis as a series of numbers.

        Raises:
            NotNative: it has further axes.
        """
        if isinstance(x, Series):
            return x
        if isinstance(x, Memory) and math.prod(x.shape) == max(x.shape):
            return Series(max(x.shape), x.dtype, lambda index: self.element_of(x, index), is_kept=True)
        if isinstance(x, np.ndarray) and x.size == 1:
            value = x.ravel()[0]
            return Series(1, value.dtype, lambda index: value)  # the same at every index
        if isinstance(x, np.ndarray) and x.size == max(x.shape):
            return self.spilled(x.ravel())
        raise NotNative("an array over steps and something else")

    def element_of(self, memory: Memory, index: str) -> Value:
        """Return an element of an array in memory."""
        if memory.first:
            index = self.sum(index, memory.first)
        return self.e.load(self.e.address(memory.pointer, index, memory.dtype, False), memory.dtype, False)

    def lazy(self, length: int, dtype: Any, compute: Callable[[str], Value]) -> Series:
        """Return a series whose number at an index is computed once where it is used several times."""
        key = object()
        return Series(length, np.dtype(dtype), lambda index: self.e.once((key, index), lambda: compute(index)))

    def of_long(self, name: str, given: list[Operand], params: dict, out: Any) -> Operand:
        """Return the result of an operation on long arrays of one axis."""
        first = given[0]
        if isinstance(first, Memory) and name in _VIEWS:
            if name in ("reshape", "broadcast_in_dim") and math.prod(out.shape) != math.prod(first.shape):
                raise NotNative(f"{name} of an array in memory")
            return self._view(name, first, given[1:], params, out)
        if name == "gather":
            return self.gather(given, params, out)
        if name in ON_ARRAYS and all(_is_small(x) for x in given):
            return ON_ARRAYS[name](self, [self.loaded(x) if isinstance(x, Memory) else x for x in given], params, out)
        if name in ("broadcast_in_dim", "reshape", "squeeze", "expand_dims") and isinstance(first, Series):
            if math.prod(out.shape) == first.length:
                return first
            raise NotNative(f"{name} of an array over steps")
        if name == "concatenate":
            return self._joined([self.series(x) for x in given if not _is_empty(x)], out)
        if name == "scatter":
            return self._scattered(given, params)
        if name == "cumsum" and out.shape[params["axis"]] == math.prod(out.shape):
            return self._cumulated(self.series(first), params)
        if name == "slice" and isinstance(first, Series):
            (start, *_), strides = params["start_indices"], params["strides"]
            if strides is None or set(strides) == {1}:
                return self._moved(first, start, math.prod(out.shape))
        if name in ("reduce_and", "reduce_or", "reduce_sum", "reduce_max", "reduce_min", "reduce_prod"):
            if out.shape and math.prod(out.shape) == max(first.shape if isinstance(first, Memory) else (first.length,)):
                return self.series(first)  # over axes of length 1
            if out.shape:
                raise NotNative(f"{name} over some axes of an array over steps")
            return self._reduced(name, self.series(first))
        operation = element(name)
        series = [self.series(x) for x in given]
        if math.prod(out.shape) != max(out.shape):
            raise NotNative(f"{name} of an array over steps")
        dtype = np.dtype(out.dtype)
        return self.lazy(
            max(out.shape), dtype, lambda index: operation(self, [one.at(index) for one in series], params, dtype)
        )

    def of_rows(
        self, name: str, given: list[Operand], shapes: list[tuple[int, ...]], params: dict, out: Any
    ) -> Operand:
        """Return the result of an operation that acts on each row of arrays over steps."""
        whole = [x for x in given if isinstance(x, Series | Rows)]
        length = max(x.length for x in whole)
        if out.shape[0] != length:
            raise NotNative(f"{name} of an array whose steps are not its first axis")
        row_out = jax.ShapeDtypeStruct(out.shape[1:], out.dtype)
        inner = _of_each_row(name, params, out)

        def row_of(x: Operand, shape: tuple[int, ...], index: str) -> Array:
            if isinstance(x, Rows):
                return x.at(index)
            if isinstance(x, Memory) and x.shape[0] == 1:  # the same for each row
                return self.loaded(dataclasses.replace(x, shape=x.shape[1:]))
            if isinstance(x, Series | Memory):
                return array_of(self.series(x).at(index)).reshape((1,) * max(len(shape) - 1, 0))
            return x if x.ndim == 0 else x[0]

        def compute(index: str) -> Array:
            rows = [row_of(x, shape, index) for x, shape in zip(given, shapes, strict=True)]
            if name in ON_ARRAYS:
                return ON_ARRAYS[name](self, rows, inner, row_out)
            return np.broadcast_to(self.by_element(name, rows, params, out.dtype), row_out.shape)

        key = object()
        if math.prod(row_out.shape) == 1:
            return self.lazy(length, out.dtype, lambda index: compute(index).ravel()[0])
        return Rows(length, lambda index: self.e.once((key, index), lambda: compute(index)))

    def _moved(self, series: Series, start: int, length: int) -> Operand:
        """Return a part of a series."""
        if length == 1:
            return np.array([series.at(self.e.count(start))], dtype=object)
        if not start:
            return dataclasses.replace(series, length=length)
        return dataclasses.replace(series, length=length, at=lambda index: series.at(self.sum(index, start)))

    def _scattered(self, given: list[Operand], params: dict) -> Series:
        """Return a series with some of its numbers replaced."""
        source, updates, where = self.series(given[0]), self.series(given[2]), given[1]
        dims = params["dimension_numbers"]
        if dims.update_window_dims or dims.inserted_window_dims != (0,):
            raise NotNative("a scatter into an array of several axes")
        room = self.reserve(source.length, self.form_at(source, updates), source.dtype)
        self.keep(source, room)

        def replace(place: Value, new: Any) -> None:
            target = self.as_i64(place)
            if target.wide:
                raise NotNative("a scatter to places that differ from lane to lane")
            held = self.held(target, source.length)
            inside = self.e.compare("icmp eq", held, target)  # what is outside is dropped
            now = ELEMENTS["select_n"](self, [inside, self.taken(room, held.text), new], {}, source.dtype)
            self.put(room, held.text, now)

        if isinstance(where, np.ndarray):
            for number, place in enumerate(where.ravel()):
                replace(place, updates.at(str(number)))
        else:
            places = self.series(where)
            with Loop(self.e, updates.length) as loop:
                replace(places.at(loop.index), updates.at(loop.index))
        return self.stored(room, source.length)

    def _cumulated(self, series: Series, params: dict) -> Series:
        """Return the sums up to each number of a series."""
        if params["reverse"]:
            raise NotNative("a sum from the end")
        room = self.reserve(series.length, self.form_at(series), series.dtype)
        self._added_up("reduce_sum", series, room)
        return self.stored(room, series.length)

    def _reduced(self, name: str, series: Series) -> Array:
        return array_of(self._added_up(name, series, None))

    def _added_up(self, name: str, series: Series, room: Room | None) -> Any:
        """Return a reduction of a series; what it is up to each element is put into a room."""
        e, form = self.e, self.form_at(series)
        begin = numbers_of(e, neutral(name, series.dtype), form)
        with Loop(e, series.length, [e.widen(x) for x in begin]) as loop:
            so_far = from_numbers(iter(loop.carried), form, series.dtype)
            total = REDUCE[name](self, [so_far, series.at(loop.index)], {}, series.dtype)
            if room is not None:
                self.put(room, loop.index, total)
            loop.next = [e.widen(x) for x in numbers_of(e, total, form)]
        return from_numbers(iter(loop.carried), form, series.dtype)

    def _joined(self, parts: list[Series], out: Any) -> Series:
        """Return series one after the other, put into working memory unless they can be read where they are."""
        if len(parts) == 2 and not self.directions and all(part.is_kept or part.length == 1 for part in parts):
            return self._read_in_turn(parts[0], parts[1], out)
        start, room = 0, self.reserve(max(out.shape), self.form_at(*parts), out.dtype)
        for part in parts:
            self.keep(part, room, start)
            start += part.length
        return self.stored(room, max(out.shape))

    def _read_in_turn(self, first: Series, second: Series, out: Any) -> Series:
        """Return two series as one, without moving them: a lane then needs no room for what all lanes share."""

        def at(index: str) -> Any:
            place = Value(index, np.dtype(np.int64))
            later = self.e.emit(f"sub i64 {index}, {self.e.count(first.length)}", np.dtype(np.int64), False)
            in_second = self.e.compare("icmp sge", later, constant(0, np.int64))
            parts = [
                first.at(self.held(place, first.length).text),
                second.at(self.held(later, second.length).text),
            ]
            return ELEMENTS["select_n"](self, [in_second, *parts], {}, np.dtype(out.dtype))

        return self.lazy(max(out.shape), out.dtype, at)

    def _view(self, name: str, memory: Memory, rest: list[Operand], params: dict, out: Any) -> Operand:
        """Return a part of an array in memory, without moving it: rows of its first axis, or another shape."""
        if name == "dynamic_slice":
            starts = [x[()] for x in rest]
            if not all(start.is_constant for start in starts):
                flat = dataclasses.replace(memory, shape=(math.prod(memory.shape),))
                return self.rows_at(self.series(flat), memory.shape, starts, out)
            params = {"start_indices": places_held(starts, memory.shape, out.shape), "strides": None}
            params["limit_indices"] = tuple(map(operator.add, params["start_indices"], out.shape))
        if name in ("slice", "dynamic_slice"):
            start, limit, strides = params["start_indices"], params["limit_indices"], params["strides"]
            whole = all(s == 0 and e == n for s, e, n in zip(start[1:], limit[1:], memory.shape[1:], strict=True))
            if not whole or strides not in (None, (1,) * len(memory.shape)):
                numbers = np.arange(math.prod(memory.shape)).reshape(memory.shape)
                return self._loaded(memory, numbers[tuple(map(slice, start, limit, strides or (None,) * len(start)))])
            memory = dataclasses.replace(memory, first=memory.first + start[0] * math.prod(memory.shape[1:]))
        view = dataclasses.replace(memory, shape=tuple(out.shape))
        return self.loaded(view) if math.prod(out.shape) <= MOST_SPREAD else view

    def loaded(self, memory: Memory) -> Array:
        """Return an array in memory in registers."""
        return self._loaded(memory, np.arange(math.prod(memory.shape)).reshape(memory.shape))

    def _loaded(self, memory: Memory, numbers: np.ndarray) -> Array:
        """Return the elements of these numbers."""
        if numbers.size > MOST_IN_REGISTERS:
            raise NotNative(f"an array of shape {numbers.shape} as a whole")
        result = np.empty(numbers.shape, dtype=object)
        for index in np.ndindex(numbers.shape):
            result[index] = self.element_of(memory, str(numbers[index]))
        return result

    def gather(self, given: list[Operand], params: dict, out: Any) -> Operand:
        """Return elements of a one-dimensional array at computed places, or rows of a series at those of another."""
        source, places = given
        dims = params["dimension_numbers"]
        shape = (source.length,) if isinstance(source, Series) else source.shape
        if math.prod(shape) != max(shape) or math.prod(params["slice_sizes"]) != 1 or dims.start_index_map != (0,):
            raise NotNative("a gather from an array of several axes")
        if "FILL" in str(params["mode"]):
            raise NotNative("a gather that fills what is outside of an array")
        length, dtype = max(shape), np.dtype(out.dtype)

        def picked(place: Value) -> Value:
            return self.picked(series, self.held(self.as_i64(place), length), dtype)

        if isinstance(places, np.ndarray) and places.size <= MOST_IN_REGISTERS:
            # Of a lane's own places a series is best kept: each lane would compute its number anew.
            series = self.spilled(source.ravel()) if isinstance(source, np.ndarray) else self.kept(self.series(source))
            result = np.empty(out.shape, dtype=object)
            result.ravel()[:] = [picked(place) for place in places.ravel()]
            return result
        where, series = self.series(places), self.series(source)
        if not isinstance(places, Memory):
            series = self.kept(series)
        return self.lazy(max(out.shape), dtype, lambda index: picked(where.at(index)))

    def as_i64(self, value: Value) -> Value:
        """Return a whole number in 64 bits."""
        if value.dtype.itemsize == 8:
            return value
        return self.e.convert("sext" if value.dtype.kind == "i" else "zext", value, np.int64)

    def held(self, place: Value, length: int) -> Value:
        """Return a place within an array of some length."""
        zero, last = constant(0, np.int64), Value(self.e.count(length - 1), np.dtype(np.int64))
        return self.e.intrinsic("smin", self.e.intrinsic("smax", place, zero), last)

    def picked(self, series: Series, place: Value, dtype: np.dtype) -> Any:
        """Return the element at a place that may differ from lane to lane."""
        if not place.wide:
            return series.at(place.text)
        e, kind = self.e, self.e.type_of(np.dtype(np.int64), True)
        extracts = [f"extractelement {kind} {place.text}, i64 {lane}" for lane in range(e.lanes)]
        each = [series.at(e.emit(extract, np.dtype(np.int64), False).text) for extract in extracts]
        if not any(isinstance(one, Tangent) for one in each):
            return e.assembled(each, dtype)
        nodes = [node for one in each if isinstance(one, Tangent) for node in one.terms if isinstance(node, Stored)]
        if not series.is_kept or len(nodes) != len(each):
            raise NotNative("derivatives at places that differ from lane to lane")

        def load(way: str) -> Value:
            return e.assembled([node.at(e, way) for node in nodes], dtype)

        return of_node(Stored(load), dtype)

    def rows_at(self, flat: Series, shape: tuple[int, ...], starts: list[Value], out: Any) -> Array:
        """Return rows of an array from a place on that is computed, held within the array.

        Raises:
            NotNative: they are parts of rows.
        """
        if out.shape[1:] != shape[1:]:
            raise NotNative("a slice whose place is computed, of several axes")
        row = math.prod(shape[1:])
        first = self.held(self.as_i64(starts[0]), shape[0] - out.shape[0] + 1)
        first = self.e.binary("mul", first, constant(row, np.int64))
        result = np.empty(math.prod(out.shape), dtype=object)
        for number in range(result.size):
            place = self.e.binary("add", first, constant(number, np.int64))
            result[number] = self.picked(flat, place, np.dtype(out.dtype))
        return result.reshape(out.shape)


def _is_small(x: Operand) -> bool:
    """Return whether an array may be in registers."""
    return isinstance(x, np.ndarray) or (isinstance(x, Memory) and math.prod(x.shape) <= MOST_IN_REGISTERS)


def _is_empty(x: Operand) -> bool:
    return isinstance(x, np.ndarray) and x.size == 0


def _of_each_row(name: str, params: dict, out: Any) -> dict:
    """Return the parameters of an operation on the rows of an array, along whose first axis it does nothing.

    Raises:
        NotNative: it does something there.
    """
    changed = dict(params)
    for key in ("axes", "broadcast_dimensions", "dimensions"):
        if key in params:
            if name.startswith("reduce") and 0 in params[key]:
                raise NotNative(f"{name} over the steps of an array of several axes")
            changed[key] = tuple(axis - 1 for axis in params[key] if axis != 0)
    for key in ("axis", "dimension"):
        if key in params and not isinstance(params[key], bool):
            if params[key] == 0:
                raise NotNative(f"{name} along the steps of an array of several axes")
            changed[key] = params[key] - 1
    for key in ("start_indices", "limit_indices", "strides"):
        if params.get(key) is not None:
            changed[key] = tuple(params[key][1:])
    if name == "slice" and params["limit_indices"][0] - params["start_indices"][0] != out.shape[0]:
        raise NotNative("a slice of an array of several axes")
    if name in ("gather", "pad", "dot_general", "dynamic_slice", "transpose", "iota"):
        raise NotNative(f"{name} of an array over steps")
    return changed
