"""Loops and branches of a lane: `scan`, `while_loop`, `cond` and `switch`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jax.extend.core import ClosedJaxpr

from jaxmodel.native.emitter import Value, constant
from jaxmodel.native.long_arrays import LongArrays
from jaxmodel.native.loop import Loop
from jaxmodel.native.operands import (
    MOST_IN_REGISTERS,
    Array,
    Memory,
    NotNative,
    Operand,
    Series,
    array_of,
    constants,
    flattened,
    reshaped,
)


class Control(LongArrays):
    """The part of a lowering that handles loops and branches."""

    run: Callable[..., list[Operand]]

    def scan(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write a loop over steps, with what is carried from step to step and what is kept of each."""
        params = equation.params
        body, length = params["jaxpr"], params["length"]
        consts, carry = params["num_consts"], params["num_carry"]
        if params["reverse"]:
            raise NotNative("a scan from the end")
        fixed, begin, over = given[:consts], given[consts : consts + carry], given[consts + carry :]
        if any(isinstance(x, Series) for x in begin):
            return self._scan_of_each(equation, given)
        steps = [self._steps(x) for x in over]
        flat, shapes = flattened(begin)
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
            carried = reshaped(loop.carried, shapes)
            results = self.run(body.jaxpr, [constants(c) for c in body.consts], [*fixed, *carried, *rows])
            for place, value in zip(room, results[carry:], strict=True):
                if place is not None:
                    address = self.e.address(place[0], loop.index, place[1], True)
                    self.e.store(self.e.widen(value[()]), address)
            loop.next = [self.e.widen(x) for x in flattened(results[:carry])[0]]
        kept: list[Operand] = []
        for place in room:
            kept.append(None if place is None else self.stored(place[0], place[1], length))
        return [*reshaped(loop.carried, shapes), *kept]

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
        return lambda index: array_of(series.at(index))

    def while_loop(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write a loop that runs as long as a lane goes on; a lane that does not keeps what it has."""
        params, e = equation.params, self.e
        first, second = params["cond_nconsts"], params["body_nconsts"]
        of_condition, of_body, begin = given[:first], given[first : first + second], given[first + second :]
        condition, body = params["cond_jaxpr"], params["body_jaxpr"]
        flat, shapes = flattened(begin)
        flat = [e.widen(x) for x in flat]
        test, inside, end, before = e.name("test"), e.name("inside"), e.name("end"), e.block
        e.jump(test)
        e.start_block(test)
        place = len(e.lines)
        e.begin_scope()
        carried = [Value("%" + e.name(), x.dtype, True) for x in flat]
        now = reshaped(carried, shapes)
        (goes_on,) = self.run(condition.jaxpr, [constants(c) for c in condition.consts], [*of_condition, *now])
        running = goes_on[()]
        e.branch(e.any_lane(running), inside, end)
        e.start_block(inside)
        results = self.run(body.jaxpr, [constants(c) for c in body.consts], [*of_body, *now])
        kept = [e.widen(e.select(running, new, old)) for new, old in zip(flattened(results)[0], carried, strict=True)]
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

    def cond(self, equation: Any, given: list[Operand]) -> list[Operand]:
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
            self.keep(dataclasses.replace(self.series(result), length=max(aval.shape)), place, 0)
            return
        for number, value in enumerate(result.ravel()):
            self.e.store(self.e.widen(value), self.e.address(place, str(number), dtype, True))

    def _taken(self, place: str, aval: Any) -> Operand:
        series = self.stored(place, np.dtype(aval.dtype), math.prod(aval.shape))
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
