"""Derivatives of numbers in several directions at once, as what they are: linear in those of a few numbers before.

A `Tangent` is a sum of coefficients times nodes. A coefficient is one number of the lane, whatever the directions; only
a node has a number for each of them. A chain of operations multiplies coefficients, once for all directions; a new node
is made, with one product for each term and direction, only of a sum that is used more than once. So some directions
share nearly all of the work.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jaxmodel.lanes.emitter import Emitter, Value, constant
from jaxmodel.lanes.operands import Array, NotNative


class Node:
    """The derivatives of a number, one in each direction."""

    def part(self, e: Emitter, way: int) -> Value | None:
        """Return the derivative in a direction; None where it is zero in every lane."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True, eq=False)
class Unit(Node):
    """The derivatives of a number that is itself a direction: 1 in that, 0 in all others."""

    way: int
    one: Value

    def part(self, e: Emitter, way: int) -> Value | None:
        """Return 1 or nothing."""
        return self.one if way == self.way else None


@dataclasses.dataclass(frozen=True, eq=False)
class Parts(Node):
    """Derivatives in registers."""

    parts: tuple[Value | None, ...]

    def part(self, e: Emitter, way: int) -> Value | None:
        """Return the number."""
        return self.parts[way]


@dataclasses.dataclass(frozen=True, eq=False)
class Stored(Node):
    """Derivatives in memory.

    Attributes:
        load: the number in a direction, which is the text of an i64.
    """

    load: Callable[[str], Value]

    def part(self, e: Emitter, way: int) -> Value:
        """Return the number, loaded."""
        return self.at(e, str(way))

    def at(self, e: Emitter, way: str) -> Value:
        """Return the derivative in a direction."""
        return e.once((self, way), lambda: self.load(way))


@dataclasses.dataclass(frozen=True, eq=False)
class Sum(Node):
    """Derivatives that are computed where they are wanted."""

    terms: Mapping[Node, Value]

    def part(self, e: Emitter, way: int) -> Value | None:
        """Return the sum."""
        return e.once((self, way), lambda: summed(e, self.terms, lambda node: node.part(e, way)))


@dataclasses.dataclass(frozen=True, eq=False)
class Tangent:
    """The derivatives of a number: a factor times the sum of coefficients times nodes.

    Attributes:
        terms: the coefficient of each node.
        dtype: of the number.
        factor: of all terms; kept apart so that a further factor costs one product, however many terms there are.
    """

    terms: Mapping[Node, Value]
    dtype: np.dtype
    factor: Value

    def multiplied(self, e: Emitter) -> Mapping[Node, Value]:
        """Return the coefficients times the factor."""
        return {node: _product(e, coefficient, self.factor) for node, coefficient in self.terms.items()}


# Of an element of an array: in which directions it has a derivative; None for a number.
Form = tuple[bool, ...] | None


def seeds(count: int, dtype: Any) -> Array:
    """Return the derivatives of some numbers by themselves: each moves in a direction of its own."""
    one, result = constant(1, dtype), np.empty(count, dtype=object)
    for number in range(count):
        result[number] = of_node(Unit(number, one), one.dtype)
    return result


def of_node(node: Node, dtype: np.dtype) -> Tangent:
    """Return the derivatives of a node."""
    return Tangent({node: constant(1, dtype)}, dtype, constant(1, dtype))


def zero(dtype: np.dtype) -> Tangent:
    """Return the derivatives of a constant."""
    return Tangent({}, dtype, constant(1, dtype))


def summed(
    e: Emitter, terms: Mapping[Node, Value], part_of: Callable[[Node], Value | None], begin: Value | None = None
) -> Value | None:
    """Return the sum of coefficients times the nodes' derivatives in one direction, and a number."""
    total = begin
    for node, coefficient in terms.items():
        part = part_of(node)
        if part is not None:
            total = _product(e, coefficient, part) if total is None else _sum(e, coefficient, part, total)
    return total


def as_node(tangent: Tangent) -> Tangent:
    """Return the same derivatives as one node."""
    if len(tangent.terms) < 2:
        return tangent
    return dataclasses.replace(tangent, terms={Sum(tangent.terms): constant(1, tangent.dtype)})


def form_of(element: Value | Tangent, count: int) -> Form:
    """Return the form of an element, for so many directions."""
    return None if isinstance(element, Value) else tuple(_moves(element, way) for way in range(count))


def _moves(tangent: Tangent, way: int) -> bool:
    return any(node.way == way if isinstance(node, Unit) else True for node in tangent.terms)


def joined(one: Form, other: Form) -> Form:
    """Return the form that has room for both; a number among derivatives is their zero."""
    if one is None or other is None:
        return other if one is None else one
    return tuple(a or b for a, b in zip(one, other, strict=True))


def numbers_of(e: Emitter, element: Value | Tangent, form: Form) -> list[Value]:
    """Return an element as the numbers that its form has."""
    if form is None:
        assert isinstance(element, Value)
        return [element]
    nothing, terms = constant(0, element.dtype), linear(element).multiplied(e)
    ways = [way for way, there in enumerate(form) if there]
    return [summed(e, terms, lambda node, way=way: node.part(e, way)) or nothing for way in ways]


def from_numbers(values: Iterator[Value], form: Form, dtype: np.dtype) -> Value | Tangent:
    """Return the element that takes its numbers from some."""
    if form is None:
        return next(values)
    parts = tuple(next(values) if there else None for there in form)
    return of_node(Parts(parts), dtype) if any(form) else zero(dtype)


def _is(value: Value, number: float) -> bool:
    return value.is_constant and value.text == constant(number, value.dtype).text


def linear(element: Value | Tangent) -> Tangent:
    """Return what stands where derivatives do: they, or zero, as a number there depends on no direction."""
    return element if isinstance(element, Tangent) else zero(element.dtype)


def _product(e: Emitter, x: Value, y: Value) -> Value:
    for one, other in ((x, y), (y, x)):
        if _is(one, 1.0):
            return other
        if _is(one, -1.0):
            return e.unary("fneg", other)
    return e.binary("fmul", x, y)


def _sum(e: Emitter, coefficient: Value, part: Value, total: Value) -> Value:
    for one, other in ((coefficient, part), (part, coefficient)):
        if _is(one, 1.0) or _is(one, -1.0):
            return e.binary("fadd" if _is(one, 1.0) else "fsub", total, other)
    return e.intrinsic("fmuladd", coefficient, part, total)


def _scaled(e: Emitter, tangent: Tangent, factor: Value) -> Tangent:
    return dataclasses.replace(tangent, factor=_product(e, tangent.factor, factor))


def _mul(e: Emitter, given: Sequence[Any], params: Mapping[str, Any]) -> Tangent:
    x, y = given if isinstance(given[0], Tangent) else given[::-1]
    if isinstance(y, Tangent):
        raise NotNative("a product of derivatives")
    return _scaled(e, x, y)


def _div(e: Emitter, given: Sequence[Any], params: Mapping[str, Any]) -> Tangent:
    x, y = given
    if isinstance(y, Tangent):
        raise NotNative("a quotient by a derivative")
    return _scaled(e, x, e.reciprocal(y))


def _neg(e: Emitter, given: Sequence[Any], params: Mapping[str, Any]) -> Tangent:
    return _scaled(e, given[0], constant(-1, given[0].dtype))


def _add(e: Emitter, given: Sequence[Any], params: Mapping[str, Any]) -> Tangent:
    x, y = map(linear, given)
    if not x.terms or not y.terms:
        return x if x.terms else y
    terms = dict(x.multiplied(e))
    for node, coefficient in y.multiplied(e).items():
        terms[node] = e.binary("fadd", terms[node], coefficient) if node in terms else coefficient
    return Tangent(terms, x.dtype, constant(1, x.dtype))


def _sub(e: Emitter, given: Sequence[Any], params: Mapping[str, Any]) -> Tangent:
    return _add(e, [given[0], _neg(e, [linear(given[1])], params)], params)


def _select_n(e: Emitter, given: Sequence[Any], params: Mapping[str, Any]) -> Tangent:
    which, cases = given[0], [linear(case) for case in given[1:]]
    nothing = constant(0, cases[0].dtype)
    first = next((case for case in cases if case.terms), cases[0])
    if all(case.terms is first.terms or not case.terms for case in cases):
        return dataclasses.replace(first, factor=_chosen(e, which, [c.factor if c.terms else nothing for c in cases]))
    numbers = [case.multiplied(e) for case in cases]
    nodes = dict.fromkeys(node for case in cases for node in case.terms)
    terms = {node: _chosen(e, which, [of_case.get(node, nothing) for of_case in numbers]) for node in nodes}
    return Tangent(terms, cases[0].dtype, constant(1, cases[0].dtype))


def _chosen(e: Emitter, which: Value, cases: Sequence[Value]) -> Value:
    if which.dtype.kind == "b":
        return e.select(which, cases[1], cases[0])
    chosen = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        chosen = e.select(e.compare("icmp sle", which, constant(number, which.dtype)), cases[number], chosen)
    return chosen


def _convert(e: Emitter, given: Sequence[Any], params: Mapping[str, Any]) -> Tangent:
    if np.dtype(params["new_dtype"]) != given[0].dtype:
        raise NotNative("a derivative in another precision")
    return given[0]


# Operations that are linear in derivatives, by the names of JAX's primitives: (emitter, elements, params) -> tangent.
LINEAR: dict[str, Callable[[Emitter, Sequence[Any], Mapping[str, Any]], Tangent]] = {
    "add": _add,
    "add_any": _add,
    "sub": _sub,
    "neg": _neg,
    "mul": _mul,
    "div": _div,
    "select_n": _select_n,
    "convert_element_type": _convert,
}
