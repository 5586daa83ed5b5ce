"""Loops and branches of a lane: `scan`, `while_loop`, `cond` and `switch`."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr

from jaxmodel.lanes.directions import Target
from jaxmodel.lanes.elements import ELEMENTS
from jaxmodel.lanes.emitter import Value, constant
from jaxmodel.lanes.jaxprs import length, opened, parts_of_scan
from jaxmodel.lanes.layout import Layout, flattened, reshaped
from jaxmodel.lanes.loop import Loop
from jaxmodel.lanes.memory import Room
from jaxmodel.lanes.operands import MOST_IN_REGISTERS, Array, Memory, NotNative, Operand, Series, array_of
from jaxmodel.lanes.segments import OnSegments
from jaxmodel.lanes.tangents import Form, Stored, Tangent, form_of, joined, of_node

# Operations of a branch that are worth a jump: a packet whose lanes all take another branch then skips them.
LONG_BRANCH = 16


class Control(OnSegments):
    """The part of a lowering that handles loops and branches."""

    def inside(self, program: ClosedJaxpr | Jaxpr, given: list[Operand]) -> list[Operand]:
        """Write the equations of a program inside an operation, and return its results."""
        raise NotImplementedError

    def scan(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write a loop over steps, with what is carried from step to step and what is kept of each."""
        params = equation.params
        body, length = params["jaxpr"], params["length"]
        consts, carry = parts_of_scan(params, len(given))
        if params["reverse"]:
            raise NotNative("a scan from the end")
        fixed, begin, over = given[:consts], given[consts : consts + carry], given[consts + carry :]
        if any(isinstance(x, Series) for x in begin):
            return self._scan_of_each(equation, given)
        fixed = self.unchanged(fixed)
        steps = [self._steps(x) for x in over]
        flat, shapes = flattened(begin)
        kept = {k: v.aval for k, v in enumerate(equation.outvars[carry:]) if type(v).__name__ != "DropVar"}
        if any(len(aval.shape) != 1 for aval in kept.values()):
            raise NotNative("arrays kept at every step")

        def at(index: str, elements: list[Any]) -> list[Any]:
            """Return the elements after a step, and what is kept of it."""
            given = [*fixed, *reshaped(elements, shapes), *(step(index) for step in steps)]
            results = self.inside(body, given)
            return flattened([*results[:carry], *(results[carry + k] for k in kept)])[0]

        alive, types = self._alive(flat, at)
        cleared = [self.cleared(dtype) for dtype in types]
        living = [number for number, lives in enumerate(alive[: len(flat)]) if lives]
        moved = dict(zip(living, self.moved([flat[number] for number in living]), strict=True))
        state = [self.taken(moved[number], "0") if number in moved else x for number, x in enumerate(flat)]
        rooms = [
            self.reserve(length, () if lives else None, aval.dtype)
            for lives, aval in zip(alive[len(flat) :], kept.values(), strict=True)
        ]
        with Loop(self.e, length, [self.e.widen(x) for x in state if isinstance(x, Value)]) as loop:
            found = at(loop.index, _merged(state, loop.carried))
            targets = [Target(found[number], self.numbers_at(room, "0")) for number, room in moved.items()]
            for x, room in zip(found[len(flat) :], rooms, strict=True):
                if room.form is None:
                    self.put(room, loop.index, x)
                else:
                    targets.append(Target(x, self.numbers_at(room, loop.index)))
            self.follow(targets, cleared)
            loop.next = [self.e.widen(x) for x, was in zip(found, state, strict=False) if isinstance(was, Value)]
        stored = {k: self.stored(room, length) for k, room in zip(kept, rooms, strict=True)}
        after = reshaped(_merged(state, loop.carried), shapes)
        return [*after, *(stored.get(k) for k in range(len(equation.outvars) - carry))]

    def _alive(self, begin: list[Any], at: Callable[[str, list[Any]], list[Any]]) -> tuple[list[bool], list[np.dtype]]:
        """Return which elements after a step have derivatives, and what `follow` takes for them.

        A derivative that is zero at first need not stay so: a step is tried until nothing more comes alive.
        """
        alive, e = [isinstance(x, Tangent) for x in begin], self.e

        def round_of() -> tuple[list[bool], list[np.dtype]]:
            state = [
                of_node(Stored(lambda _, x=x: Value("%tried", x.dtype, True)), x.dtype)
                if lives
                else e.register(x.dtype, True)
                for x, lives in zip(begin, alive, strict=False)
            ]
            found = at("0", state)
            now = [isinstance(x, Tangent) for x in found]
            now[: len(begin)] = [a or b for a, b in zip(alive, now, strict=False)]
            targets = [Target(x, lambda _: "%work") for x, lives in zip(found, now, strict=True) if lives]
            return now, self.follow(targets)

        while True:
            now, types = self.tried(round_of)
            if now[: len(begin)] == alive:
                return now, types
            alive = now[: len(begin)]

    def _layout(self, begin: list[Operand], advance: Callable[[list[Array]], list[Operand]]) -> Layout:
        """Return the layout of what a loop carries in registers, found as in `_alive`."""
        layout = Layout.of(begin, self.directions)

        def round_of() -> Layout:
            numbers = [self.e.register(x.dtype, True) for x in layout.numbers(self.e, begin)]
            return layout.joined(Layout.of(advance(layout.arrays(numbers)), self.directions))

        while self.directions and (found := self.tried(round_of)) != layout:
            layout = found
        return layout

    def _scan_of_each(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write a scan that carries an array over steps: for each of its elements, where that is used, a loop."""
        params = equation.params
        body, (consts, carry) = params["jaxpr"], parts_of_scan(params, len(given))
        # Kept now: in the loop they would be computed whole for each element.
        fixed = [self.kept(x) if isinstance(x, Series) else self.settled(x) for x in given[:consts]]
        begin = [self.series(x) for x in given[consts : consts + carry]]
        if len(given) > consts + carry or len(equation.outvars) > carry:
            raise NotNative("a scan over arrays over steps")
        length = max(one.length for one in begin)
        key = object()

        def at(index: str) -> list[Any]:
            starts = [array_of(one.at(index)) for one in begin]

            def advance(carried: list[Array]) -> list[Operand]:
                elements: list[Any] = [x[()] for x in carried]
                each = [self.lazy(length, x.dtype, lambda _, x=x: x) for x in elements]
                results = self.inside(body, [*fixed, *each])
                return [array_of(self.series(x).at(index)) for x in results]

            layout = self._layout(starts, advance)
            with Loop(self.e, params["length"], [self.e.widen(x) for x in layout.numbers(self.e, starts)]) as loop:
                after = advance(layout.arrays(loop.carried))
                loop.next = [self.e.widen(x) for x in layout.numbers(self.e, after)]
            return [x[()] for x in layout.arrays(loop.carried)]

        def of(number: int) -> Callable[[str], Any]:
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
        fixed = [self.settled(x) for x in of_body]

        def advance(carried: list[Array]) -> list[Operand]:
            return self.inside(body, [*fixed, *carried])

        layout = self._layout(begin, advance)
        flat = [e.widen(x) for x in layout.numbers(e, begin)]
        test, inside, end, before = e.name("test"), e.name("inside"), e.name("end"), e.block
        e.jump(test)
        e.start_block(test)
        place = len(e.lines)
        e.begin_scope()
        carried = [e.register(x.dtype, True) for x in flat]
        now = layout.arrays(carried)
        (goes_on,) = self.inside(condition, [*of_condition, *now])
        running = goes_on[()]
        e.branch(e.any_lane(running), inside, end)
        e.start_block(inside)
        found = layout.numbers(e, advance(now))
        kept = [e.widen(e.select(running, new, old)) for new, old in zip(found, carried, strict=True)]
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
        """Write the branches; as they are pure, one may be run for lanes that do not take it, and is for short ones."""
        branches, index = equation.params["branches"], given[0][()]
        if index.dtype.kind == "b":
            index = self.e.select(index, constant(1, np.int32), constant(0, np.int32))
        if not index.wide:
            return self._branched(branches, index, given[1:], [v.aval for v in equation.outvars])
        avals = [v.aval for v in equation.outvars]
        of_numbers = all(math.prod(aval.shape) <= MOST_IN_REGISTERS for aval in avals)
        if of_numbers and not self.directions and max(length(opened(b)[0]) for b in branches) > LONG_BRANCH:
            return self._where_taken(branches, index, given[1:], avals)
        results = [self.inside(b, given[1:]) for b in branches]
        chosen = results[-1]
        for number in reversed(range(len(branches) - 1)):
            holds = self.e.compare("icmp sle", index, constant(number, index.dtype))
            chosen = [self._chosen(holds, new, old) for new, old in zip(results[number], chosen, strict=True)]
        return chosen

    def _where_taken(
        self, branches: Sequence[ClosedJaxpr | Jaxpr], index: Value, given: list[Operand], avals: Sequence[Any]
    ) -> list[Operand]:
        """Run each branch if some lane of the packet takes it; a lane gets the results of its own."""
        e = self.e
        given = [self.settled(x) for x in given]
        chosen = [e.widen(constant(0, aval.dtype)) for aval in avals for _ in range(math.prod(aval.shape))]
        for number, branch in enumerate(branches):
            relation = "icmp sle" if number == 0 else "icmp sge" if number == len(branches) - 1 else "icmp eq"
            holds = e.compare(relation, index, constant(number, index.dtype))
            before, inside, after = e.block, e.name("branch"), e.name("other")
            e.branch(e.any_lane(holds), inside, after)
            e.start_block(inside)
            e.begin_scope()
            found = self.inside(branch, given)
            mixed = [e.select(holds, new, old) for new, old in zip(flattened(found)[0], chosen, strict=True)]
            e.end_scope()
            last = e.block
            e.jump(after)
            e.start_block(after)
            chosen = [e.either(old, before, new, last) for old, new in zip(chosen, mixed, strict=True)]
        return reshaped(chosen, [aval.shape for aval in avals])

    def _branched(
        self, branches: Sequence[ClosedJaxpr | Jaxpr], index: Value, given: list[Operand], avals: Sequence[Any]
    ) -> list[Operand]:
        """Run one branch; its results go through memory."""
        e = self.e
        given = [self.settled(x) for x in given]
        ways = [functools.partial(self.inside, b, given) for b in branches]
        tried = [self.tried(lambda way=way: [self._form(x) for x in way()]) for way in ways if self.directions]
        forms = [functools.reduce(joined, some) for some in zip(*tried, strict=True)] or [None] * len(avals)
        rooms = [self.reserve(math.prod(aval.shape), form, aval.dtype) for form, aval in zip(forms, avals, strict=True)]
        end = e.name("joined")
        for number, way in enumerate(ways):
            inside, other = e.name("branch"), e.name("other")
            last = number == len(branches) - 1
            holds = (
                Value("true", np.dtype(bool)) if last else e.compare("icmp sle", index, constant(number, index.dtype))
            )
            e.branch(holds, inside, other if not last else end)
            e.start_block(inside)
            e.begin_scope()
            for room, result, aval in zip(rooms, way(), avals, strict=True):
                self._put_all(result, room, aval)
            e.end_scope()
            e.jump(end)
            if not last:
                e.start_block(other)
        e.start_block(end)
        return [self._take_all(room, aval) for room, aval in zip(rooms, avals, strict=True)]

    def _form(self, x: Operand) -> Form:
        """Return the form that has room for the elements of an operand."""
        if isinstance(x, np.ndarray):
            return functools.reduce(joined, [form_of(element, self.directions) for element in x.ravel()], None)
        return self.form_at(self.series(x))

    def _put_all(self, result: Operand, room: Room, aval: Any) -> None:
        if math.prod(aval.shape) > MOST_IN_REGISTERS:
            self.keep(dataclasses.replace(self.series(result), length=max(aval.shape)), room)
            return
        for number, element in enumerate(result.ravel()):
            self.put(room, str(number), element)

    def _take_all(self, room: Room, aval: Any) -> Operand:
        size = math.prod(aval.shape)
        if size > MOST_IN_REGISTERS:
            return self.stored(room, size)
        result = np.empty(size, dtype=object)
        for number in range(size):
            result[number] = self.taken(room, str(number))
        return result.reshape(aval.shape)

    def _chosen(self, holds: Value, yes: Operand, no: Operand) -> Operand:
        if not (isinstance(yes, np.ndarray) and isinstance(no, np.ndarray)):
            ways = self.series(yes), self.series(no)

            def at(index: str) -> Any:
                taken, left = (way.at(index) for way in ways)
                return ELEMENTS["select_n"](self, [holds, left, taken], {}, taken.dtype)

            return self.lazy(ways[0].length, ways[0].dtype, at)
        result = np.empty(yes.shape, dtype=object)
        for index in np.ndindex(yes.shape):
            result[index] = ELEMENTS["select_n"](self, [holds, no[index], yes[index]], {}, yes[index].dtype)
        return result


def _merged(state: list[Any], numbers: list[Value]) -> list[Any]:
    """Return the elements of a state whose numbers are now others; derivatives are where they were."""
    rest = iter(numbers)
    return [next(rest) if isinstance(x, Value) else x for x in state]
