"""The primitives of JAX, written as vector instructions.

An array of a lane is its numbers, each in a register: an operation on arrays is one on each of their elements. What has
an element for each step of a long run is a `Series` instead: a function from an index to a number, evaluated in a loop
where its elements are used.
"""

from __future__ import annotations

import collections
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

from jaxmodel.lanes.absent import behind_switches
from jaxmodel.lanes.arrays import ON_ARRAYS
from jaxmodel.lanes.control import Control
from jaxmodel.lanes.elementary import Elementary
from jaxmodel.lanes.elements import convert, element
from jaxmodel.lanes.emitter import Emitter, Value, constant
from jaxmodel.lanes.jaxprs import opened
from jaxmodel.lanes.operands import Array, Memory, NotNative, Operand, Rows, Series, array_of, constants
from jaxmodel.lanes.piecewise import PIECEWISE

# More take LLVM longer than XLA needs for the same function: short arrays of which each element is written out. A robot
# with all effects has 80,000, for which LLVM takes 15 s and XLA 46 s.
MOST_INSTRUCTIONS = 200_000


class Lowering(Control):
    """Writes the equations of a jaxpr to an emitter."""

    def __init__(self, emitter: Emitter, workspace: str, directions: int = 0, alike: bool = False) -> None:
        """Begin a lowering into working memory, with derivatives in so many directions.

        `alike` where lanes mostly lie in the same segments of tables.
        """
        self.e, self._alike = emitter, alike
        self.directions = directions
        self.room: list[int] = []
        self._workspace = workspace
        self._functions: dict[np.dtype, Elementary] = {}

    def run(self, jaxpr: Jaxpr, consts: Sequence[Operand], arguments: Sequence[Operand]) -> list[Operand]:
        """Write all equations and return the results.

        Raises:
            NotNative: an equation has no vector instructions.
        """
        known: dict[Any, Operand] = dict(zip(jaxpr.constvars, consts, strict=True))
        needed = _needed(jaxpr)
        often = _used_often(jaxpr, needed) if self.directions else frozenset()

        def learn(variables: Sequence[Any], operands: Sequence[Operand]) -> None:
            for variable, x in zip(variables, operands, strict=True):
                known[variable] = self.settled(x) if variable in often else x

        learn(jaxpr.invars, arguments)

        def read(atom: Any) -> Operand:
            return self._literal(atom) if isinstance(atom, Literal) else known[atom]

        behind = {} if self.directions else behind_switches(jaxpr, needed)
        put_off = {number for numbers in behind.values() for number in numbers}

        def write(number: int) -> None:
            if len(self.e.lines) > MOST_INSTRUCTIONS:
                raise NotNative(f"a function of more than {MOST_INSTRUCTIONS} instructions")
            equation = jaxpr.eqns[number]
            if number not in behind:
                learn(equation.outvars, self._equation(equation, [read(atom) for atom in equation.invars]))
                return
            switch, value = (read(atom)[()] for atom in equation.invars[:2])

            def switched_on() -> Value:
                for earlier in behind[number]:
                    write(earlier)
                (found,) = self._equation(equation, [read(atom) for atom in equation.invars])
                return found[()]

            on = self.e.compare("fcmp une", switch, constant(0.0, switch.dtype))
            learn(equation.outvars, [array_of(self.e.seldom(on, value, switched_on))])

        for number, used in enumerate(needed):
            if used and number not in put_off:
                write(number)
        return [read(atom) for atom in jaxpr.outvars]

    def inside(self, program: ClosedJaxpr | Jaxpr, given: list[Operand]) -> list[Operand]:
        """Write the equations of a program inside an operation, and return its results."""
        jaxpr, consts = opened(program)
        return self.run(jaxpr, [constants(c) for c in consts], given)

    def _literal(self, atom: Any) -> Array:
        """Return a constant of the jaxpr; one that stands for a length is that."""
        dtype = np.dtype(getattr(atom.aval, "dtype", np.asarray(atom.val).dtype))
        if dtype.kind in "iu" and np.ndim(atom.val) == 0:
            text = self.e.count(int(atom.val))
            if text.startswith("%"):
                value = Value(text, np.dtype(np.int64))
                return array_of(convert(self, [value], {}, dtype))
        return constants(atom.val, dtype)

    def functions(self, dtype: np.dtype) -> Elementary:
        """Return the elementary functions of a type."""
        if np.dtype(dtype) not in self._functions:
            self._functions[np.dtype(dtype)] = Elementary(self.e, dtype)
        return self._functions[np.dtype(dtype)]

    def _equation(self, equation: Any, given: list[Operand]) -> list[Operand]:
        name, params = equation.primitive.name, equation.params
        out: Any = equation.outvars[0].aval if equation.outvars else None
        if self._alike and not self.directions and params.get("name") == PIECEWISE and len(equation.outvars) == 1:
            found = self.on_segments(*given[:3])
            if found is not None:
                return [found]
        if name in _INNER:
            inner = next(params[key] for key in _INNER[name] if key in params)
            return self.inside(inner, given)
        if name in _UNCHANGED:
            return given
        if name == "scan":
            return self.scan(equation, given)
        if name == "while":
            return self.while_loop(equation, given)
        if name == "cond":
            return self.cond(equation, given)
        if name == "split":
            return self.split(given[0], params)
        if name == "unstack":  # from JAX 0.11 on
            return self.unstacked(given[0], params)
        if math.prod(out.shape) == 0:  # a table of two points has no inner segment
            return [np.empty(out.shape, dtype=object)]
        if self.directions:
            given = [
                self.settled(x) if math.prod(v.aval.shape) < math.prod(out.shape) else x
                for x, v in zip(given, equation.invars, strict=True)
            ]  # it is used for several elements
        if any(isinstance(x, Rows) for x in given) or (
            any(isinstance(x, Series) for x in given) and math.prod(out.shape) > max(out.shape, default=1)
        ):
            return [self.of_rows(name, given, [v.aval.shape for v in equation.invars], params, out)]
        if any(isinstance(x, Series | Memory) for x in given):
            return [self.of_long(name, given, params, out)]
        if name in ON_ARRAYS:
            return [ON_ARRAYS[name](self, given, params, out)]
        return [self.by_element(name, given, params, out.dtype)]

    def by_element(self, name: str, given: list[Array], params: dict, dtype: np.dtype) -> Array:
        """Return the result of an operation on each element of small arrays."""
        operation = element(name)
        shape = np.broadcast_shapes(*(x.shape for x in given))
        given = [np.broadcast_to(x, shape) for x in given]
        result = np.empty(shape, dtype=object)
        for index in np.ndindex(shape):
            result[index] = operation(self, [x[index] for x in given], params, np.dtype(dtype))
        return result

    def split(self, x: Operand, params: dict) -> list[Operand]:
        """Return the parts of a small array."""
        if not isinstance(x, np.ndarray):
            raise NotNative("a split of an array over steps")
        ends = np.cumsum(params["sizes"])[:-1]
        return list(np.split(x, ends, axis=params["axis"]))

    def unstacked(self, x: Operand, params: dict) -> list[Operand]:
        """Return the parts of a small array along an axis, which they do not have."""
        x = self.loaded(x) if isinstance(x, Memory) else x
        if not isinstance(x, np.ndarray):
            raise NotNative("an array over steps taken apart")
        return [np.array(part, dtype=object) for part in np.moveaxis(x, params["axis"], 0)]


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


def _used_often(jaxpr: Jaxpr, needed: list[bool]) -> frozenset[Any]:
    """Return the variables that are used more than once."""
    used = [v for equation, wanted in zip(jaxpr.eqns, needed, strict=True) if wanted for v in equation.invars]
    counted = collections.Counter(v for v in (*used, *jaxpr.outvars) if not isinstance(v, Literal))
    return frozenset(v for v, count in counted.items() if count > 1)


# Primitives with a jaxpr inside, and the parameters that may hold it.
_INNER = {
    name: ("jaxpr", "call_jaxpr", "fun_jaxpr")
    for name in ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint")
}
_UNCHANGED = (
    "optimization_barrier", "stop_gradient", "copy", "copy_p", "device_put", "pvary", "reshard", "sharding_constraint",
    "reduce_precision",
)  # fmt: skip
