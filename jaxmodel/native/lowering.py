"""The primitives of JAX, written as vector instructions.

An array of a lane is its numbers, each in a register: an operation on arrays is one on each of their elements. What has
an element for each step of a long run is a `Series` instead: a function from an index to a number, evaluated in a loop
where its elements are used.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

from jaxmodel.native.elementary import Elementary
from jaxmodel.native.emitter import Emitter, Value, constant

# Arrays of more elements are not written out; arrays that many lanes share, or that one number fills, stay in memory
# from fewer on.
MOST_IN_REGISTERS = 512
MOST_SPREAD = 128

Array = np.ndarray  # of `Value`s


class NotNative(Exception):
    """A function has an operation that has no vector instructions here."""


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """One number for each index along the one axis of an array, which is too long for registers.

    Attributes:
        length: of the axis; others have one element.
        dtype: of the numbers.
        at: the instructions of the number at an index, which is the text of an i64.
        is_kept: whether they only load it.
    """

    length: int
    dtype: np.dtype
    at: Callable[[str], Value]
    is_kept: bool = False


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """A small array for each index along a first axis that is too long for registers; as `Series` else."""

    length: int
    at: Callable[[str], Array]


@dataclasses.dataclass(frozen=True)
class Memory:
    """An array in memory that is the same for all lanes, row after row.

    Attributes:
        pointer: to its first element.
        shape: of the array.
        dtype: of its elements.
        first: element at which it starts.
    """

    pointer: str
    shape: tuple[int, ...]
    dtype: np.dtype
    first: int = 0


Operand = Any  # an Array, a Series, Rows or a Memory


class Lowering:
    """Writes the equations of a jaxpr to an emitter.

    Attributes:
        room: numbers of working memory by lane, each a length or a count.
    """

    def __init__(self, emitter: Emitter, workspace: str) -> None:
        self.e = emitter
        self.room: list[int] = []
        self._workspace = workspace
        self._functions: dict[np.dtype, Elementary] = {}

    def run(self, jaxpr: Jaxpr, consts: Sequence[Operand], arguments: Sequence[Operand]) -> list[Operand]:
        """Write all equations and return the results.

        Raises:
            NotNative: an equation has no vector instructions.
        """
        known: dict[Any, Operand] = dict(zip(jaxpr.constvars, consts, strict=True))
        known |= zip(jaxpr.invars, arguments, strict=True)
        needed = _needed(jaxpr)

        def read(atom: Any) -> Operand:
            return self._literal(atom) if isinstance(atom, Literal) else known[atom]

        for equation, used in zip(jaxpr.eqns, needed, strict=True):
            if used:
                results = self._equation(equation, [read(atom) for atom in equation.invars])
                known |= zip(equation.outvars, results, strict=True)
        return [read(atom) for atom in jaxpr.outvars]

    def _literal(self, atom: Any) -> Array:
        """Return a constant of the jaxpr; one that stands for a length is that."""
        dtype = np.dtype(getattr(atom.aval, "dtype", np.asarray(atom.val).dtype))
        if dtype.kind in "iu" and np.ndim(atom.val) == 0:
            text = self.e.count(int(atom.val))
            if text.startswith("%"):
                value = Value(text, np.dtype(np.int64))
                return _array(_convert(self, [value], {}, dtype))
        return constants(atom.val, dtype)

    def functions(self, dtype: np.dtype) -> Elementary:
        """Return the elementary functions of a type."""
        if np.dtype(dtype) not in self._functions:
            self._functions[np.dtype(dtype)] = Elementary(self.e, dtype)
        return self._functions[np.dtype(dtype)]

    def _equation(self, equation: Any, given: list[Operand]) -> list[Operand]:
        name, params = equation.primitive.name, equation.params
        out: Any = equation.outvars[0].aval if equation.outvars else None
        if name in _INNER:
            inner = next(params[key] for key in _INNER[name] if key in params)
            if isinstance(inner, ClosedJaxpr):
                return self.run(inner.jaxpr, [constants(c) for c in inner.consts], given)
            return self.run(inner, [], given)
        if name in _UNCHANGED:
            return given
        if name in ("scan", "while"):
            return getattr(self, f"_{name}")(equation, given)
        if name == "cond":
            return self._cond(equation, given)
        if name == "split":
            return self._split(given[0], params)
        if any(isinstance(x, Rows) for x in given) or (
            any(isinstance(x, Series) for x in given) and math.prod(out.shape) > max(out.shape, default=1)
        ):
            return [self._of_rows(name, given, [v.aval.shape for v in equation.invars], params, out)]
        if any(isinstance(x, Series | Memory) for x in given):
            return [self._of_long(name, given, params, out)]
        if name in _ON_ARRAYS:
            return [_ON_ARRAYS[name](self, given, params, out)]
        return [self._by_element(name, given, params, out.dtype)]

    def _by_element(self, name: str, given: list[Array], params: dict, dtype: np.dtype) -> Array:
        operation = _element(name)
        shape = np.broadcast_shapes(*(x.shape for x in given))
        given = [np.broadcast_to(x, shape) for x in given]
        result = np.empty(shape, dtype=object)
        for index in np.ndindex(shape):
            result[index] = operation(self, [x[index] for x in given], params, np.dtype(dtype))
        return result

    # Long arrays

    def series(self, x: Operand) -> Series:
        """Return an array along its first axis as a series of numbers.

        Raises:
            NotNative: it has further axes.
        """
        if isinstance(x, Series):
            return x
        if isinstance(x, Memory) and math.prod(x.shape) == max(x.shape):
            return Series(max(x.shape), x.dtype, lambda index: self._element_of(x, index), is_kept=True)
        if isinstance(x, np.ndarray) and x.size == 1:
            value = x.ravel()[0]
            return Series(1, value.dtype, lambda index: value)  # the same at every index
        if isinstance(x, np.ndarray) and x.ndim == 1:
            return self._spilled(x)
        raise NotNative("an array over steps and something else")

    def _element_of(self, memory: Memory, index: str) -> Value:
        if memory.first:
            index = self._sum(index, memory.first)
        return self.e.load(self.e.address(memory.pointer, index, memory.dtype, False), memory.dtype, False)

    def _sum(self, index: str, more: int) -> str:
        """Return index + more."""
        return self.e.emit(f"add i64 {index}, {self.e.count(more)}", np.dtype("i8"), False).text

    def lazy(self, length: int, dtype: Any, compute: Callable[[str], Value]) -> Series:
        """Return a series whose number at an index is computed once where it is used several times."""
        key = object()
        return Series(length, np.dtype(dtype), lambda index: self.e.once((key, index), lambda: compute(index)))

    def _spilled(self, x: Array) -> Series:
        """Return the elements of a small array, put into working memory so that they have an index."""
        flat = x.ravel()
        place = self.reserve(flat.size)
        for number, value in enumerate(flat):
            self.e.store(self.e.widen(value), self.e.address(place, str(number), value.dtype, True))
        return self._stored(place, flat[0].dtype, x.shape[0])

    def kept(self, series: Series) -> Series:
        """Return a series whose numbers are in memory."""
        if series.is_kept:
            return series
        place = self.reserve(series.length)
        self._keep(series, place, 0)
        return self._stored(place, series.dtype, series.length)

    def _keep(self, series: Series, place: str, start: int) -> None:
        """Store all numbers of a series from a place on."""
        with Loop(self.e, series.length) as index:
            target = self._sum(index, start) if start else index
            self.e.store(self.e.widen(series.at(index)), self.e.address(place, target, series.dtype, True))

    def _stored(self, place: str, dtype: np.dtype, length: int) -> Series:
        e = self.e
        return Series(
            length,
            np.dtype(dtype),
            lambda index: e.load(e.address(place, index, dtype, True), dtype, True),
            is_kept=True,
        )

    def reserve(self, count: int) -> str:
        """Return a pointer to working memory for so many numbers of each lane."""
        e, index = self.e, np.dtype("i8")
        offset = "0"
        for size in self.room:
            offset = e.emit(f"add i64 {offset}, {e.count(size)}", index, False).text
        self.room.append(count)
        offset = e.emit(f"mul i64 {offset}, {8 * e.lanes}", index, False).text
        return e.emit(f"getelementptr inbounds i8, ptr {self._workspace}, i64 {offset}", index, False).text

    def _of_long(self, name: str, given: list[Operand], params: dict, out: Any) -> Operand:
        first = given[0]
        if isinstance(first, Memory) and name in _VIEWS:
            if name in ("reshape", "broadcast_in_dim") and math.prod(out.shape) != math.prod(first.shape):
                raise NotNative(f"{name} of an array in memory")
            return self._view(name, first, given[1:], params, out)
        if name == "gather":
            return self._gather(given, params, out)
        if name in ("broadcast_in_dim", "reshape", "squeeze", "expand_dims") and isinstance(first, Series):
            if math.prod(out.shape) == first.length:
                return first
            raise NotNative(f"{name} of an array over steps")
        if name == "concatenate":
            return self._joined([self.series(x) for x in given], out)
        if name == "scatter":
            return self._scattered(given, params)
        if name == "cumsum":
            return self._cumulated(self.series(first), params)
        if name == "slice" and isinstance(first, Series):
            (start, *_), strides = params["start_indices"], params["strides"]
            if strides is None or set(strides) == {1}:
                return self._moved(first, start, math.prod(out.shape))
        if name in ("reduce_and", "reduce_or", "reduce_sum", "reduce_max", "reduce_min", "reduce_prod"):
            return self._reduced(name, self.series(first))
        operation = _element(name)
        series = [self.series(x) for x in given]
        if math.prod(out.shape) != max(out.shape):
            raise NotNative(f"{name} of an array over steps")
        dtype = np.dtype(out.dtype)
        return self.lazy(
            max(out.shape), dtype, lambda index: operation(self, [one.at(index) for one in series], params, dtype)
        )

    def _of_rows(
        self, name: str, given: list[Operand], shapes: list[tuple[int, ...]], params: dict, out: Any
    ) -> Operand:
        """Return the result of an operation that acts on each row of arrays over steps."""
        whole = [x for x in given if isinstance(x, Series | Rows)]
        length = max(x.length for x in whole)
        row_out = jax.ShapeDtypeStruct(out.shape[1:], out.dtype)
        inner = _of_each_row(name, params, out)

        def row_of(x: Operand, shape: tuple[int, ...], index: str) -> Array:
            if isinstance(x, Rows):
                return x.at(index)
            if isinstance(x, Series | Memory):
                return _array(self.series(x).at(index)).reshape((1,) * max(len(shape) - 1, 0))
            return x if x.ndim == 0 else x[0]

        def compute(index: str) -> Array:
            rows = [row_of(x, shape, index) for x, shape in zip(given, shapes, strict=True)]
            if name in _ON_ARRAYS:
                return _ON_ARRAYS[name](self, rows, inner, row_out)
            return np.broadcast_to(self._by_element(name, rows, params, out.dtype), row_out.shape)

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
        return dataclasses.replace(series, length=length, at=lambda index: series.at(self._sum(index, start)))

    def _scattered(self, given: list[Operand], params: dict) -> Series:
        """Return a series with some of its numbers replaced."""
        source, places, updates = (self.series(x) for x in given)
        dims = params["dimension_numbers"]
        if dims.update_window_dims or dims.inserted_window_dims != (0,):
            raise NotNative("a scatter into an array of several axes")
        place = self.reserve(source.length)
        self._keep(source, place, 0)
        with Loop(self.e, updates.length) as index:
            target = self._as_i64(places.at(index))
            if target.wide:
                raise NotNative("a scatter to places that differ from lane to lane")
            self.e.store(self.e.widen(updates.at(index)), self.e.address(place, target.text, source.dtype, True))
        return self._stored(place, source.dtype, source.length)

    def _cumulated(self, series: Series, params: dict) -> Series:
        """Return the sums up to each number of a series."""
        if params["reverse"]:
            raise NotNative("a sum from the end")
        place = self.reserve(series.length)
        with Loop(self.e, series.length, [self.e.widen(constant(0, series.dtype))]) as loop:
            total = self.e.binary("fadd" if series.dtype.kind == "f" else "add", loop.carried[0], series.at(loop.index))
            self.e.store(total, self.e.address(place, loop.index, series.dtype, True))
            loop.next = [total]
        return self._stored(place, series.dtype, series.length)

    def _joined(self, parts: list[Series], out: Any) -> Series:
        """Return series one after the other, put into working memory."""
        start, place = 0, self.reserve(max(out.shape))
        for part in parts:
            self._keep(part, place, start)
            start += part.length
        return self._stored(place, np.dtype(out.dtype), max(out.shape))

    def _reduced(self, name: str, series: Series) -> Array:
        combine = _REDUCE[name]
        with Loop(self.e, series.length, [self.e.widen(_neutral(name, series.dtype))]) as loop:
            value = self.e.widen(series.at(loop.index))
            loop.next = [combine(self, [loop.carried[0], value], {}, series.dtype)]
        return _array(loop.carried[0])

    def _view(self, name: str, memory: Memory, rest: list[Operand], params: dict, out: Any) -> Operand:
        """Return a part of an array in memory, without moving it: rows of its first axis, or another shape."""
        if name == "slice":
            start, limit, strides = params["start_indices"], params["limit_indices"], params["strides"]
            whole = all(s == 0 and e == n for s, e, n in zip(start[1:], limit[1:], memory.shape[1:], strict=True))
            if not whole or strides not in (None, (1,) * len(memory.shape)):
                numbers = np.arange(math.prod(memory.shape)).reshape(memory.shape)
                return self._loaded(memory, numbers[tuple(map(slice, start, limit, strides or (None,) * len(start)))])
            memory = dataclasses.replace(memory, first=memory.first + start[0] * math.prod(memory.shape[1:]))
        if name == "dynamic_slice":
            starts = [x[()] for x in rest]
            if not all(start.is_constant for start in starts):
                flat = dataclasses.replace(memory, shape=(math.prod(memory.shape),))
                return self.rows_at(self.series(flat), memory.shape, starts, out)
            memory = dataclasses.replace(memory, first=memory.first + int(starts[0].text) * math.prod(memory.shape[1:]))
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
            result[index] = self._element_of(memory, str(numbers[index]))
        return result

    def _gather(self, given: list[Operand], params: dict, out: Any) -> Operand:
        """Return elements of a one-dimensional array at computed places, or rows of a series at those of another."""
        source, places = given
        dims = params["dimension_numbers"]
        shape = (source.length,) if isinstance(source, Series) else source.shape
        if math.prod(shape) != max(shape) or math.prod(params["slice_sizes"]) != 1 or dims.start_index_map != (0,):
            raise NotNative("a gather from an array of several axes")
        length, dtype = max(shape), np.dtype(out.dtype)
        clip = "CLIP" in str(params["mode"])

        def picked(place: Value) -> Value:
            place = self._as_i64(place)
            return self._picked(series, self._held(place, length) if clip else place, dtype)

        if isinstance(places, np.ndarray) and places.size <= MOST_IN_REGISTERS:
            # Of a lane's own places a series is best kept: each lane would compute its number anew.
            series = self._spilled(source.ravel()) if isinstance(source, np.ndarray) else self.kept(self.series(source))
            result = np.empty(out.shape, dtype=object)
            result.ravel()[:] = [picked(place) for place in places.ravel()]
            return result
        where, series = self.series(places), self.series(source)
        if not isinstance(places, Memory):
            series = self.kept(series)
        return self.lazy(max(out.shape), dtype, lambda index: picked(where.at(index)))

    def _as_i64(self, value: Value) -> Value:
        if value.dtype.itemsize == 8:
            return value
        return self.e.convert("sext" if value.dtype.kind == "i" else "zext", value, np.int64)

    def _held(self, place: Value, length: int) -> Value:
        zero, last = constant(0, np.int64), Value(self.e.count(length - 1), np.dtype(np.int64))
        return self.e.intrinsic("smin", self.e.intrinsic("smax", place, zero), last)

    def _picked(self, series: Series, place: Value, dtype: np.dtype) -> Value:
        """Return the element at a place that may differ from lane to lane."""
        if not place.wide:
            return series.at(place.text)
        lanes, kind = self.e.lanes, self.e.type_of(np.dtype(np.int64), True)
        result = "poison"
        for lane in range(lanes):
            index = self.e.emit(f"extractelement {kind} {place.text}, i64 {lane}", np.dtype(np.int64), False)
            one = series.at(index.text)
            if one.wide:
                one = self.e.emit(f"extractelement {self.e.typed(one)}, i64 {lane}", dtype, False)
            target = self.e.type_of(dtype, True)
            result = self.e.emit(f"insertelement {target} {result}, {self.e.typed(one)}, i64 {lane}", dtype, True).text
        return Value(result, dtype, True)

    def rows_at(self, flat: Series, shape: tuple[int, ...], starts: list[Value], out: Any) -> Array:
        """Return rows of an array from a place on that is computed, held within the array.

        Raises:
            NotNative: they are parts of rows.
        """
        if out.shape[1:] != shape[1:]:
            raise NotNative("a slice whose place is computed, of several axes")
        row = math.prod(shape[1:])
        first = self._held(self._as_i64(starts[0]), shape[0] - out.shape[0] + 1)
        first = self.e.binary("mul", first, constant(row, np.int64))
        result = np.empty(math.prod(out.shape), dtype=object)
        for number in range(result.size):
            place = self.e.binary("add", first, constant(number, np.int64))
            result[number] = self._picked(flat, place, np.dtype(out.dtype))
        return result.reshape(out.shape)

    # Loops

    def _scan(self, equation: Any, given: list[Operand]) -> list[Operand]:
        params = equation.params
        body, length = params["jaxpr"], params["length"]
        consts, carry = params["num_consts"], params["num_carry"]
        if params["reverse"]:
            raise NotNative("a scan from the end")
        fixed, begin, over = given[:consts], given[consts : consts + carry], given[consts + carry :]
        if any(isinstance(x, Series) for x in begin):
            return self._scan_of_each(equation, given)
        steps = [self._steps(x) for x in over]
        flat, shapes = _flattened(begin)
        room = []
        for variable in equation.outvars[carry:]:
            if type(variable).__name__ == "DropVar":
                room.append(None)
            elif len(variable.aval.shape) == 1:
                room.append((self.reserve(length), np.dtype(variable.aval.dtype)))
            else:
                raise NotNative("arrays kept at every step")
        with Loop(self.e, length, [self.e.widen(x) for x in flat]) as loop:
            rows = [step(loop.index) for step in steps]
            carried = _reshaped(loop.carried, shapes)
            results = self.run(body.jaxpr, [constants(c) for c in body.consts], [*fixed, *carried, *rows])
            for place, value in zip(room, results[carry:], strict=True):
                if place is not None:
                    address = self.e.address(place[0], loop.index, place[1], True)
                    self.e.store(self.e.widen(value[()]), address)
            loop.next = [self.e.widen(x) for x in _flattened(results[:carry])[0]]
        kept: list[Operand] = []
        for place in room:
            kept.append(None if place is None else self._stored(place[0], place[1], length))
        return [*_reshaped(loop.carried, shapes), *kept]

    def _scan_of_each(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write a scan that carries an array over steps: for each of its elements, where that is used, a loop."""
        params = equation.params
        body, consts, carry = params["jaxpr"], params["num_consts"], params["num_carry"]
        # Kept now: in the loop they would be computed whole for each element.
        fixed = [self.kept(x) if isinstance(x, Series) else x for x in given[:consts]]
        begin = [self.series(x) for x in given[consts : consts + carry]]
        if len(given) > consts + carry or len(equation.outvars) > carry:
            raise NotNative("a scan over arrays over steps")
        length = max(one.length for one in begin)
        key = object()

        def at(index: str) -> tuple[Value, ...]:
            starts = [self.e.widen(one.at(index)) for one in begin]
            with Loop(self.e, params["length"], starts) as loop:
                each = [self.lazy(length, x.dtype, lambda _, x=x: x) for x in loop.carried]
                results = self.run(body.jaxpr, [constants(c) for c in body.consts], [*fixed, *each])
                loop.next = [self.e.widen(self.series(x).at(index)) for x in results]
            return tuple(loop.carried)

        def of(number: int) -> Callable[[str], Value]:
            # All results of the loop are known once one of them is.
            return lambda index: self.e.once((key, index), lambda: at(index))[number]

        return [Series(length, one.dtype, of(number)) for number, one in enumerate(begin)]

    def _steps(self, x: Operand) -> Callable[[str], Operand]:
        """Return what a scan gives of an array at a step."""
        if isinstance(x, Memory) and len(x.shape) > 1:
            size = math.prod(x.shape[1:])

            def row(index: str) -> Array:
                start = self.e.emit(f"mul i64 {index}, {size}", np.dtype("i8"), False).text
                if x.first:
                    start = self.e.emit(f"add i64 {start}, {x.first}", np.dtype("i8"), False).text
                pointer = self.e.address(x.pointer, start, x.dtype, False)
                return self.loaded(Memory(pointer, x.shape[1:], x.dtype))

            return row
        if isinstance(x, np.ndarray) and x.ndim > 1:
            raise NotNative("a scan over an array of several axes")
        series = self.series(x)
        return lambda index: _array(series.at(index))

    def _while(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write a loop that runs as long as a lane goes on; a lane that does not keeps what it has."""
        params, e = equation.params, self.e
        first, second = params["cond_nconsts"], params["body_nconsts"]
        of_condition, of_body, begin = given[:first], given[first : first + second], given[first + second :]
        condition, body = params["cond_jaxpr"], params["body_jaxpr"]
        flat, shapes = _flattened(begin)
        flat = [e.widen(x) for x in flat]
        test, inside, end, before = e.name("test"), e.name("inside"), e.name("end"), e.block
        e.jump(test)
        e.start_block(test)
        place = len(e.lines)
        e.begin_scope()
        carried = [Value("%" + e.name(), x.dtype, True) for x in flat]
        now = _reshaped(carried, shapes)
        (goes_on,) = self.run(condition.jaxpr, [constants(c) for c in condition.consts], [*of_condition, *now])
        running = goes_on[()]
        e.branch(e.any_lane(running), inside, end)
        e.start_block(inside)
        results = self.run(body.jaxpr, [constants(c) for c in body.consts], [*of_body, *now])
        kept = [e.widen(e.select(running, new, old)) for new, old in zip(_flattened(results)[0], carried, strict=True)]
        last = e.block
        e.jump(test)
        e.end_scope()
        starts = []
        for register, start, new in zip(carried, flat, kept, strict=True):
            kind = e.type_of(register.dtype, True)
            starts.append(f"  {register.text} = phi {kind} [ {start.text}, %{before} ], [ {new.text}, %{last} ]")
        e.lines[place:place] = starts
        e.start_block(end)
        return now

    def _cond(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write the branches: all, and select, as they are pure; one is run alone where all lanes agree."""
        branches, index = equation.params["branches"], given[0][()]
        if index.dtype.kind == "b":
            index = self.e.select(index, constant(1, np.int32), constant(0, np.int32))
        if not index.wide:
            return self._branched(branches, index, given[1:], [v.aval for v in equation.outvars])
        results = [self.run(b.jaxpr, [constants(c) for c in b.consts], given[1:]) for b in branches]
        chosen = results[-1]
        for number in reversed(range(len(branches) - 1)):
            holds = self.e.compare("icmp sle", index, constant(number, index.dtype))
            chosen = [self._chosen(holds, new, old) for new, old in zip(results[number], chosen, strict=True)]
        return chosen

    def _branched(
        self, branches: Sequence[ClosedJaxpr], index: Value, given: list[Operand], avals: Sequence[Any]
    ) -> list[Operand]:
        """Run one branch; its results go through memory."""
        e = self.e
        places = [self.reserve(math.prod(aval.shape)) for aval in avals]
        end = e.name("joined")
        for number, branch in enumerate(branches):
            inside, other = e.name("branch"), e.name("other")
            last = number == len(branches) - 1
            holds = (
                Value("true", np.dtype(bool)) if last else e.compare("icmp sle", index, constant(number, index.dtype))
            )
            e.branch(holds, inside, other if not last else end)
            e.start_block(inside)
            e.begin_scope()
            results = self.run(branch.jaxpr, [constants(c) for c in branch.consts], given)
            for place, result, aval in zip(places, results, avals, strict=True):
                self._put(result, place, aval)
            e.end_scope()
            e.jump(end)
            if not last:
                e.start_block(other)
        e.start_block(end)
        return [self._taken(place, aval) for place, aval in zip(places, avals, strict=True)]

    def _put(self, result: Operand, place: str, aval: Any) -> None:
        dtype = np.dtype(aval.dtype)
        if math.prod(aval.shape) > MOST_IN_REGISTERS:
            self._keep(dataclasses.replace(self.series(result), length=max(aval.shape)), place, 0)
            return
        for number, value in enumerate(result.ravel()):
            self.e.store(self.e.widen(value), self.e.address(place, str(number), dtype, True))

    def _taken(self, place: str, aval: Any) -> Operand:
        series = self._stored(place, np.dtype(aval.dtype), math.prod(aval.shape))
        if series.length > MOST_IN_REGISTERS:
            return series
        result = np.empty(aval.shape, dtype=object)
        result.ravel()[:] = [series.at(str(number)) for number in range(series.length)]
        return result

    def _chosen(self, holds: Value, yes: Operand, no: Operand) -> Array:
        if isinstance(yes, Series) or isinstance(no, Series):
            raise NotNative("a branch with an array over steps")
        result = np.empty(yes.shape, dtype=object)
        for index in np.ndindex(yes.shape):
            result[index] = self.e.select(holds, yes[index], no[index])
        return result

    def _split(self, x: Operand, params: dict) -> list[Operand]:
        if not isinstance(x, np.ndarray):
            raise NotNative("a split of an array over steps")
        ends = np.cumsum(params["sizes"])[:-1]
        return list(np.split(x, ends, axis=params["axis"]))


class Loop:
    """A loop over indices from 0; carried values are phi nodes.

    Attributes:
        index: the text of the index.
        carried: values at the start of a round; after the loop those at its end.
        next: values at the end of a round, to be set in the body.
    """

    def __init__(self, emitter: Emitter, length: int, begin: Sequence[Value] = ()) -> None:
        self.e, self.length, self.begin = emitter, length, list(begin)
        self.next: list[Value] = []

    def __enter__(self) -> Any:
        e = self.e
        self._before, self._head, self._done = e.block, e.name("loop"), e.name("done")
        self.index = "%" + e.name()
        self.carried = [Value("%" + e.name(), x.dtype, True) for x in self.begin]
        # A loop of no rounds leaves the values at its start.
        count = e.count(self.length)
        if count.startswith("%"):
            some = e.emit(f"icmp sgt i64 {count}, 0", np.dtype(bool), False)
        else:
            some = Value("true" if self.length else "false", np.dtype(bool))
        e.branch(some, self._head, self._done)
        e.start_block(self._head)
        self._place = len(e.lines)
        e.begin_scope()
        return self if self.begin else self.index

    def __exit__(self, kind: Any, *rest: Any) -> None:
        if kind is not None:
            return
        e = self.e
        e.end_scope()
        count = e.count(self.length)
        following = e.emit(f"add nuw nsw i64 {self.index}, 1", np.dtype("i8"), False)
        ends = e.emit(f"icmp eq i64 {following.text}, {count}", np.dtype(bool), False)
        last = e.block
        e.branch(ends, self._done, self._head)
        lines = [f"  {self.index} = phi i64 [ 0, %{self._before} ], [ {following.text}, %{last} ]"]
        after = []
        results = []
        for register, start, new in zip(self.carried, self.begin, self.next, strict=True):
            kind_text = e.type_of(register.dtype, True)
            lines.append(
                f"  {register.text} = phi {kind_text} [ {start.text}, %{self._before} ], [ {new.text}, %{last} ]"
            )
            result = Value("%" + e.name(), register.dtype, True)
            after.append(
                f"  {result.text} = phi {kind_text} [ {start.text}, %{self._before} ], [ {new.text}, %{last} ]"
            )
            results.append(result)
        e.lines[self._place : self._place] = lines
        e.start_block(self._done)
        e.lines += after
        self.carried = results


def constants(value: Any, dtype: Any = None) -> Array:
    """Return numbers that are known when the kernel is compiled."""
    array = np.asarray(value, dtype)
    if array.size > MOST_IN_REGISTERS:
        raise NotNative(f"a constant of shape {array.shape}")
    result = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        result[index] = constant(array[index], array.dtype)
    return result


def _array(value: Value) -> Array:
    result = np.empty((), dtype=object)
    result[()] = value
    return result


def _flattened(arrays: Sequence[Operand]) -> tuple[list[Value], list[tuple[int, ...]]]:
    if any(not isinstance(x, np.ndarray) for x in arrays):
        raise NotNative("a long array carried from step to step")
    return [value for x in arrays for value in x.ravel()], [x.shape for x in arrays]


def _reshaped(values: Sequence[Value], shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    result, start = [], 0
    for shape in shapes:
        size = math.prod(shape)
        array = np.empty(size, dtype=object)
        array[:] = values[start : start + size]
        result.append(array.reshape(shape))
        start += size
    return result


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


def _needed(jaxpr: Jaxpr) -> list[bool]:
    """Return for each equation whether a result depends on it."""
    wanted = {v for v in jaxpr.outvars if not isinstance(v, Literal)}
    needed = []
    for equation in reversed(jaxpr.eqns):
        used = any(v in wanted for v in equation.outvars)
        needed.append(used)
        if used:
            wanted |= {v for v in equation.invars if not isinstance(v, Literal)}
    return needed[::-1]


# Primitives with a jaxpr inside, and the parameters that may hold it.
_INNER = {
    name: ("jaxpr", "call_jaxpr", "fun_jaxpr")
    for name in ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint")
}
_UNCHANGED = (
    "optimization_barrier", "stop_gradient", "copy", "copy_p", "device_put", "pvary", "reshard", "sharding_constraint",
    "reduce_precision",
)  # fmt: skip
_VIEWS = ("slice", "dynamic_slice", "squeeze", "reshape", "broadcast_in_dim", "expand_dims")


# Operations by element: (lowering, values, params, dtype of the result) -> value.


def _arithmetic(of_floats: str, of_integers: str) -> Callable:
    def operation(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        return lowering.e.binary(of_floats if dtype.kind == "f" else of_integers, *given)

    return operation


def _comparison(of_floats: str, of_integers: str) -> Callable:
    def operation(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        kind = given[0].dtype.kind
        if kind == "f":
            return lowering.e.compare(f"fcmp {of_floats}", *given)
        sign = "" if of_integers in ("eq", "ne") else ("s" if kind == "i" else "u")
        return lowering.e.compare(f"icmp {sign}{of_integers}", *given)

    return operation


def _before(or_equal: bool) -> Callable:
    """Return whether a number is before another where what is not a number comes last."""

    def operation(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        e, (x, y) = lowering.e, given
        if or_equal:
            return e.binary("or", e.compare("fcmp ole", x, y), e.compare("fcmp uno", y, y))
        last = e.binary("and", e.compare("fcmp uno", y, y), e.compare("fcmp ord", x, x))
        return e.binary("or", e.compare("fcmp olt", x, y), last)

    return operation


def _extreme(larger: bool) -> Callable:
    """Return the larger or smaller of two numbers; not a number if one is not."""

    def operation(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        e, (x, y) = lowering.e, given
        if dtype.kind == "b":
            return e.binary("or" if larger else "and", x, y)
        if dtype.kind in "iu":
            return e.intrinsic(("s" if dtype.kind == "i" else "u") + ("max" if larger else "min"), x, y)
        if y.is_constant:
            x, y = y, x
        if x.is_constant:  # one instruction, which returns the second number where the comparison fails
            return e.select(e.compare("fcmp ogt" if larger else "fcmp olt", x, y), x, y)
        # Half the instructions of `llvm.maximum`, which also puts -0 below 0.
        chosen = e.select(e.compare("fcmp ogt" if larger else "fcmp olt", x, y), x, y)
        return e.select(e.compare("fcmp uno", x, x), x, chosen)

    return operation


def _function(name: str) -> Callable:
    def operation(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        return getattr(lowering.functions(dtype), name)(*given)

    return operation


def _intrinsic(name: str) -> Callable:
    def operation(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        if dtype.kind != "f":
            raise NotNative(f"{name} of whole numbers")
        return lowering.e.intrinsic(name, *given)

    return operation


def _library(name: str) -> Callable:
    def operation(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        return lowering.e.by_lane(name, *given)

    return operation


def _neg(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    if dtype.kind == "f":
        return lowering.e.unary("fneg", given[0])
    return lowering.e.binary("sub", constant(0, dtype), given[0])


def _abs(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    if dtype.kind == "f":
        return lowering.e.intrinsic("fabs", given[0])
    return lowering.e.intrinsic("smax", given[0], _neg(lowering, given, params, dtype))


def _sign(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    e, x = lowering.e, given[0]
    kind = "f" if dtype.kind == "f" else "i"
    up, down = ("fcmp ogt", "fcmp olt") if kind == "f" else ("icmp sgt", "icmp slt")
    zero = constant(0, dtype)
    return e.select(
        e.compare(up, x, zero), constant(1, dtype), e.select(e.compare(down, x, zero), constant(-1, dtype), x)
    )


def _not(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.e.binary("xor", given[0], constant(dtype.kind == "b" or -1, dtype))


def _is_finite(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    x = given[0]
    return lowering.e.compare("fcmp olt", lowering.e.intrinsic("fabs", x), constant(np.inf, x.dtype))


def _select_n(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    which, *cases = given
    if which.dtype.kind == "b":
        return lowering.e.select(which, cases[1], cases[0])
    chosen = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        chosen = lowering.e.select(
            lowering.e.compare("icmp sle", which, constant(number, which.dtype)), cases[number], chosen
        )
    return chosen


def _integer_pow(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    """Return x^n by squaring."""
    times = _ELEMENTS["mul"]
    exponent, square, result = abs(params["y"]), given[0], None
    while exponent:
        if exponent & 1:
            result = square if result is None else times(lowering, [result, square], {}, dtype)
        exponent >>= 1
        if exponent:
            square = times(lowering, [square, square], {}, dtype)
    if result is None:
        return constant(1, dtype)
    return lowering.e.binary("fdiv", constant(1, dtype), result) if params["y"] < 0 else result


def _square(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return _ELEMENTS["mul"](lowering, [given[0], given[0]], {}, dtype)


def _pow(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    x, y = given
    if y.dtype.kind != "f":
        y = _convert(lowering, [y], {}, dtype)
    return lowering.functions(dtype).power(x, y)


def _rsqrt(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.e.binary("fdiv", constant(1, dtype), lowering.e.intrinsic("sqrt", given[0]))


def _sine(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.functions(dtype).sine_and_cosine(given[0])[0]


def _cosine(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.functions(dtype).sine_and_cosine(given[0])[1]


def _round(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    to_even = int(params["rounding_method"]) == 1
    return lowering.e.intrinsic("roundeven" if to_even else "round", given[0])


def _clamp(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    low, x, high = given
    x = _ELEMENTS["max"](lowering, [low, x], {}, dtype)
    return _ELEMENTS["min"](lowering, [x, high], {}, dtype)


def _convert(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    e, x = lowering.e, given[0]
    source, target = x.dtype, np.dtype(dtype)
    if source == target:
        return x
    pair = source.kind + target.kind
    if target.kind == "b":
        zero = constant(0, source)
        return e.compare("fcmp une" if source.kind == "f" else "icmp ne", x, zero)
    if pair == "ff":
        return e.convert("fpext" if target.itemsize > source.itemsize else "fptrunc", x, target)
    if source.kind == "b":
        return e.select(x, constant(1, target), constant(0, target))
    if source.kind in "iu" and target.kind == "f":
        return e.convert("sitofp" if source.kind == "i" else "uitofp", x, target)
    if source.kind == "f":
        return e.saturated("fptosi" if target.kind == "i" else "fptoui", x, target)
    if target.itemsize == source.itemsize:
        return dataclasses.replace(x, dtype=target)
    if target.itemsize < source.itemsize:
        return e.convert("trunc", x, target)
    return e.convert("sext" if source.kind == "i" else "zext", x, target)


def _remainder(lowering: Lowering, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    if dtype.kind != "f":
        return lowering.e.binary("srem" if dtype.kind == "i" else "urem", *given)
    return lowering.e.by_lane("fmod", *given)


_ELEMENTS: dict[str, Callable] = {
    "add": _arithmetic("fadd", "add"),
    "add_any": _arithmetic("fadd", "add"),
    "sub": _arithmetic("fsub", "sub"),
    "mul": _arithmetic("fmul", "mul"),
    "div": _arithmetic("fdiv", "sdiv"),
    "rem": _remainder,
    "neg": _neg,
    "abs": _abs,
    "sign": _sign,
    "max": _extreme(larger=True),
    "min": _extreme(larger=False),
    "gt": _comparison("ogt", "gt"),
    "ge": _comparison("oge", "ge"),
    "lt": _comparison("olt", "lt"),
    "le": _comparison("ole", "le"),
    "le_to": _before(or_equal=True),
    "lt_to": _before(or_equal=False),
    "eq": _comparison("oeq", "eq"),
    "ne": _comparison("une", "ne"),
    "and": _arithmetic("and", "and"),
    "or": _arithmetic("or", "or"),
    "xor": _arithmetic("xor", "xor"),
    "not": _not,
    "is_finite": _is_finite,
    "select_n": _select_n,
    "clamp": _clamp,
    "convert_element_type": _convert,
    "integer_pow": _integer_pow,
    "square": _square,
    "pow": _pow,
    "sqrt": _intrinsic("sqrt"),
    "rsqrt": _rsqrt,
    "floor": _intrinsic("floor"),
    "ceil": _intrinsic("ceil"),
    "round": _round,
    "exp": _function("exp"),
    "expm1": _function("expm1"),
    "log": _function("log"),
    "log1p": _function("log1p"),
    "tanh": _function("tanh"),
    "logistic": _function("logistic"),
    "asinh": _function("asinh"),
    "sin": _sine,
    "cos": _cosine,
    **{
        name: _library(name)
        for name in (
            "tan",
            "asin",
            "acos",
            "atan",
            "atan2",
            "sinh",
            "cosh",
            "acosh",
            "atanh",
            "cbrt",
            "erf",
            "erfc",
            "exp2",
        )
    },
}
_REDUCE = {
    "reduce_sum": _ELEMENTS["add"],
    "reduce_prod": _ELEMENTS["mul"],
    "reduce_max": _ELEMENTS["max"],
    "reduce_min": _ELEMENTS["min"],
    "reduce_and": _ELEMENTS["and"],
    "reduce_or": _ELEMENTS["or"],
}


def _neutral(name: str, dtype: np.dtype) -> Value:
    value = {
        "reduce_sum": 0, "reduce_prod": 1, "reduce_max": -np.inf, "reduce_min": np.inf, "reduce_and": True,
        "reduce_or": False,
    }[name]  # fmt: skip
    if dtype.kind in "iu" and not np.isfinite(value):
        value = np.iinfo(dtype).min if value < 0 else np.iinfo(dtype).max
    return constant(value, dtype)


def _element(name: str) -> Callable:
    if name not in _ELEMENTS:
        raise NotNative(f'the operation "{name}"')
    return _ELEMENTS[name]


# Operations on arrays: (lowering, arrays, params, abstract result) -> array.


def _reduce(name: str) -> Callable:
    def operation(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Array:
        axes = params["axes"]
        moved = np.moveaxis(given[0], axes, range(len(axes)))
        moved = moved.reshape(-1, *out.shape)
        result = np.empty(out.shape, dtype=object)
        for index in np.ndindex(*out.shape):
            values = [moved[(row, *index)] for row in range(moved.shape[0])]
            total = values[0] if values else _neutral(name, np.dtype(out.dtype))
            for value in values[1:]:
                total = _REDUCE[name](lowering, [total, value], {}, np.dtype(out.dtype))
            result[index] = total
        return result

    return operation


def _broadcast(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Operand:
    if math.prod(out.shape) > MOST_SPREAD and given[0].size == 1:
        if math.prod(out.shape) == max(out.shape):
            value = given[0].ravel()[0]
            return Series(max(out.shape), value.dtype, lambda index: value)
        if 0 not in params["broadcast_dimensions"]:
            value = given[0].ravel()[0]
            return Rows(out.shape[0], lambda index: np.broadcast_to(_array(value), out.shape[1:]))
    if math.prod(out.shape) > MOST_IN_REGISTERS:
        if 0 not in params["broadcast_dimensions"]:
            row_out = jax.ShapeDtypeStruct(out.shape[1:], out.dtype)
            inner = {"broadcast_dimensions": tuple(axis - 1 for axis in params["broadcast_dimensions"])}
            row = _broadcast(lowering, given, inner, row_out)
            return Rows(out.shape[0], lambda index: row)
        raise NotNative(f"an array of shape {out.shape}")
    shape = [1] * len(out.shape)
    for axis, size in zip(params["broadcast_dimensions"], given[0].shape, strict=True):
        shape[axis] = size
    return np.broadcast_to(given[0].reshape(shape), out.shape)


def _slice(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Array:
    strides = params["strides"] or (1,) * given[0].ndim
    return given[0][tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]


def _dynamic_slice(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Array:
    source, *starts = given
    places: list[Any] = [x[()] for x in starts]
    if not all(place.is_constant for place in places):
        return lowering.rows_at(lowering._spilled(source.ravel()), source.shape, places, out)
    at = [
        min(max(int(place.text), 0), size - width)
        for place, size, width in zip(places, source.shape, out.shape, strict=True)
    ]
    return source[tuple(slice(start, start + width) for start, width in zip(at, out.shape, strict=True))]


def _pad(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Array:
    source, value = given
    result = np.empty(out.shape, dtype=object)
    result.fill(value[()])
    places = []
    for (low, high, inner), size in zip(params["padding_config"], source.shape, strict=True):
        if low < 0 or high < 0:
            raise NotNative("a negative padding")
        places.append(slice(low, low + (size - 1) * (inner + 1) + 1, inner + 1))
    result[tuple(places)] = source
    return result


def _dot(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Array:
    (left, right), (batch_left, batch_right) = params["dimension_numbers"]
    if batch_left or batch_right:
        raise NotNative("a product of matrices over further axes")
    x = np.moveaxis(given[0], left, range(-len(left), 0)) if left else given[0]
    y = np.moveaxis(given[1], right, range(len(right))) if right else given[1]
    inner = math.prod(given[0].shape[axis] for axis in left)
    rows, columns = x.reshape(-1, inner), y.reshape(inner, -1)
    dtype = np.dtype(out.dtype)
    result = np.empty((rows.shape[0], columns.shape[1]), dtype=object)
    for i, j in np.ndindex(*result.shape):
        total = _ELEMENTS["mul"](lowering, [rows[i, 0], columns[0, j]], {}, dtype)
        for k in range(1, inner):
            product = _ELEMENTS["mul"](lowering, [rows[i, k], columns[k, j]], {}, dtype)
            total = _ELEMENTS["add"](lowering, [total, product], {}, dtype)
        result[i, j] = total
    return result.reshape(out.shape)


def _cumulative(name: str) -> Callable:
    def operation(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Array:
        source = np.moveaxis(given[0], params["axis"], 0)
        source = source[::-1] if params["reverse"] else source
        result = np.empty(source.shape, dtype=object)
        for index in np.ndindex(source.shape[1:]):
            total = None
            for row in range(source.shape[0]):
                value = source[(row, *index)]
                total = value if total is None else _REDUCE[name](lowering, [total, value], {}, np.dtype(out.dtype))
                result[(row, *index)] = total
        result = result[::-1] if params["reverse"] else result
        return np.moveaxis(result, 0, params["axis"])

    return operation


def _iota(lowering: Lowering, given: list[Array], params: dict, out: Any) -> Operand:
    if len(out.shape) == 1 and out.shape[0] > MOST_SPREAD:
        whole = np.dtype(np.int64)
        return Series(
            out.shape[0], np.dtype(out.dtype), lambda i: _convert(lowering, [Value(i, whole)], {}, np.dtype(out.dtype))
        )
    if math.prod(out.shape) > MOST_IN_REGISTERS:
        raise NotNative(f"an array of shape {out.shape}")
    shape = [1] * len(out.shape)
    shape[params["dimension"]] = -1
    count = np.arange(out.shape[params["dimension"]], dtype=out.dtype).reshape(shape)
    return constants(np.broadcast_to(count, out.shape))


_ON_ARRAYS: dict[str, Callable] = {
    **{name: _reduce(name) for name in _REDUCE},
    "broadcast_in_dim": _broadcast,
    "reshape": lambda lowering, given, params, out: given[0].reshape(out.shape),
    "squeeze": lambda lowering, given, params, out: given[0].reshape(out.shape),
    "expand_dims": lambda lowering, given, params, out: given[0].reshape(out.shape),
    "transpose": lambda lowering, given, params, out: given[0].transpose(params["permutation"]),
    "rev": lambda lowering, given, params, out: np.flip(given[0], params["dimensions"]),
    "concatenate": lambda lowering, given, params, out: np.concatenate(given, axis=params["dimension"]),
    "stack": lambda lowering, given, params, out: np.stack(given, axis=params.get("axis", params.get("dimension", 0))),
    "slice": _slice,
    "dynamic_slice": _dynamic_slice,
    "gather": lambda lowering, given, params, out: lowering._gather(given, params, out),
    "pad": _pad,
    "dot_general": _dot,
    "cumsum": _cumulative("reduce_sum"),
    "cumprod": _cumulative("reduce_prod"),
    "cummax": _cumulative("reduce_max"),
    "cummin": _cumulative("reduce_min"),
    "iota": _iota,
}  # fmt: skip
