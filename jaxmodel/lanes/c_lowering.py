"""The equations of a jaxpr as statements of C: no memory is asked for, no function calls itself, every loop is bounded.

A jaxpr is the one that the kernels come from (`lowering`); here loops and branches are those of C, and a formula that
is linear between knots becomes the look-up of a table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr

from jaxmodel.lanes.c_emitter import CEmitter, OfLibrary
from jaxmodel.lanes.elementary import Elementary
from jaxmodel.lanes.emitter import NotNative, Value, constant
from jaxmodel.lanes.jaxprs import opened, parts_of_scan
from jaxmodel.lanes.layout import flattened, reshaped
from jaxmodel.lanes.lowering import Lowering
from jaxmodel.lanes.operands import Array, Operand, array_of

_INDEX = np.dtype(np.int64)
# Rounds of a loop of known length that are written out one by one; assumed.
MOST_ROUNDS = 64
LOOK_UP = "look_up"  # the function of every file that looks up a table


class CLowering(Lowering):
    """Writes the equations of a jaxpr to an emitter of C."""

    def __init__(self, emitter: CEmitter) -> None:
        """Begin a lowering."""
        super().__init__(emitter, "", alike=True)
        self.c = emitter

    def functions(self, dtype: np.dtype) -> Elementary:
        """Return the elementary functions of a type: those of the C library."""
        return OfLibrary(self.c, dtype)

    def inside(self, program: ClosedJaxpr | Jaxpr, given: list[Operand]) -> list[Operand]:
        """Write the equations of a program inside an operation, and return its results."""
        jaxpr, consts = opened(program)
        return self.run(jaxpr, [numbers(c) for c in consts], given)

    def _equation(self, equation: Any, given: list[Operand]) -> list[Operand]:
        name, params = equation.primitive.name, equation.params
        if name == "broadcast_in_dim":
            out, shape = equation.outvars[0].aval, [1] * len(equation.outvars[0].aval.shape)
            for axis, size in zip(params["broadcast_dimensions"], given[0].shape, strict=True):
                shape[axis] = size
            return [np.broadcast_to(given[0].reshape(shape), out.shape)]
        if name == "dynamic_slice":
            return [self._part(given[0], [x[()] for x in given[1:]], equation.outvars[0].aval.shape)]
        if name == "convert_element_type" and given[0].size and given[0].flat[0].dtype.kind in "iu":
            to = np.dtype(params["new_dtype"])
            if to.kind in "iu":  # the bits may be the same; in C the type is another
                return [_each(given[0], lambda x: x if x.dtype == to else self.c.convert("", x, to))]
        return super()._equation(equation, given)

    def on_segments(self, x: Operand, knots: Operand, values: Operand) -> Operand | None:
        """Return what a table of constants has at x; None where it is not constant."""
        if knots.shape != values.shape or not all(one.is_constant for one in (*knots.ravel(), *values.ravel())):
            return None
        at, of = self.c.array(list(knots)), self.c.array(list(values))
        text = self.c.text_of
        return _each(x, lambda one: self.c.known(f"{LOOK_UP}({text(one)}, {at}, {of}, {knots.size})", one.dtype))

    def gather(self, given: list[Operand], params: dict, out: Any) -> Operand:
        """Return elements of a one-dimensional array at computed places."""
        source, places = given
        if source.ndim != 1 or math.prod(params["slice_sizes"]) != 1:
            raise NotNative("a gather from an array of several axes in C")
        result = np.empty(out.shape, dtype=object)
        flat = [self._part(source, [place], (1,))[0] for place in places.ravel()]
        result.ravel()[:] = flat
        return result

    def _part(self, source: Array, starts: Sequence[Value], shape: tuple[int, ...]) -> Array:
        """Return a part of an array that begins at computed places, moved so that it lies within the array."""
        e, flat = self.c, constant(0, _INDEX)
        for start, size, width in zip(starts, source.shape, shape, strict=True):
            held = e.intrinsic("smin", self.as_i64(start), constant(size - width, _INDEX))
            held = e.intrinsic("smax", held, constant(0, _INDEX))
            flat = e.binary("add", e.binary("mul", flat, constant(size, _INDEX)), held)
        numbered = np.arange(source.size).reshape(source.shape)
        offsets = numbered[tuple(map(slice, shape))]
        result = np.empty(shape, dtype=object)
        elements = list(source.ravel())
        if flat.is_constant:
            for index in np.ndindex(shape):
                result[index] = elements[int(flat.text) + offsets[index]]
            return result
        array = e.array(elements)
        for index in np.ndindex(shape):
            place = e.binary("add", flat, constant(offsets[index], _INDEX))
            result[index] = e.known(f"{array}[{e.text_of(place)}]", elements[0].dtype)
        return result

    def scan(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write the rounds of a short loop one by one."""
        params = equation.params
        if params["length"] > MOST_ROUNDS:
            raise NotNative(f"a loop of {params['length']} rounds in C")
        consts, carry = parts_of_scan(params, len(given))
        fixed, carried, over = given[:consts], given[consts : consts + carry], given[consts + carry :]
        kept: dict[int, list[Operand]] = {}
        rounds = range(params["length"])
        for number in reversed(rounds) if params["reverse"] else rounds:
            results = self.inside(params["jaxpr"], [*fixed, *carried, *(_row(x, number) for x in over)])
            carried, kept[number] = results[:carry], results[carry:]
        stacked = [np.stack([kept[number][k] for number in rounds]) for k in range(len(equation.outvars) - carry)]
        return [*carried, *stacked]

    def while_loop(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write a loop that runs as long as its condition holds."""
        params, e = equation.params, self.c
        first, second = params["cond_nconsts"], params["body_nconsts"]
        of_condition, of_body, begin = given[:first], given[first : first + second], given[first + second :]
        flat, shapes = flattened(begin)
        carried = [e.variable(x, x.dtype) for x in flat]
        now = reshaped(carried, shapes)
        e.open("for (;;)")
        (goes_on,) = self.inside(params["cond_jaxpr"], [*of_condition, *now])
        e.line(f"if (!({e.text_of(goes_on[()])})) {{ break; }}")
        e.assign(carried, flattened(self.inside(params["body_jaxpr"], [*of_body, *now]))[0])
        e.close()
        return now

    def cond(self, equation: Any, given: list[Operand]) -> list[Operand]:
        """Write the branches, of which one is run."""
        branches, index, e = equation.params["branches"], given[0][()], self.c
        if index.dtype.kind == "b":
            index = e.select(index, constant(1, np.int32), constant(0, np.int32))
        avals = [v.aval for v in equation.outvars]
        chosen = [e.variable(None, aval.dtype) for aval in avals for _ in range(math.prod(aval.shape))]
        last = len(branches) - 1
        for number, branch in enumerate(branches):
            test = f"if ({e.text_of(index)} <= {number})" if number < last else ""
            e.open(test if number == 0 else f"else {test}".strip())
            e.assign(chosen, flattened(self.inside(branch, given[1:]))[0])
            e.close()
        return reshaped(chosen, [aval.shape for aval in avals])


def numbers(value: Any) -> Array:
    """Return an array of numbers that are known when the text is written, of any size."""
    array = np.asarray(value)
    result = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        result[index] = constant(array[index], array.dtype)
    return result


def _each(x: Array, function: Callable[[Value], Value]) -> Array:
    result = np.empty(x.shape, dtype=object)
    for index in np.ndindex(x.shape):
        result[index] = function(x[index])
    return result


def _row(x: Array, number: int) -> Array:
    row = x[number]
    return row if isinstance(row, np.ndarray) else array_of(row)
