"""LLVM instructions as text: typed values, one instruction a call."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jaxmodel.lanes.outline import OUTLINED, outlined

# `contract` lets a product and a sum become one operation; `arcp` lets a division by a number that is the same in every
# step become a product with its reciprocal. Neither assumes that numbers are finite.
FLAGS = "contract arcp"
# How far from a length that is known only when the kernel runs a number may be and still mean one.
NEAR = 8
_TYPES = {"f8": "double", "f4": "float", "i8": "i64", "i4": "i32", "u8": "i64", "u4": "i32", "b1": "i1"}


class NotNative(Exception):
    """A function has an operation that has no vector instructions here."""


@dataclasses.dataclass(frozen=True)
class Value:
    """A number in a kernel.

    Attributes:
        text: the name of its register, or the constant itself.
        dtype: as in NumPy.
        wide: whether it differs from lane to lane; else it is one number for the packet.
    """

    text: str
    dtype: np.dtype
    wide: bool = False

    @property
    def scalar_type(self) -> str:
        """The LLVM type of one lane."""
        return scalar_type(self.dtype)

    @property
    def is_constant(self) -> bool:
        """Whether it is known when the kernel is compiled."""
        return not self.text.startswith("%")


def scalar_type(dtype: np.dtype) -> str:
    """Return the LLVM type of a NumPy dtype.

    Raises:
        KeyError: there is none.
    """
    return _TYPES[np.dtype(dtype).str[1:]]


def constant(value, dtype=None) -> Value:
    """Return a number that is known when the kernel is compiled."""
    dtype = np.asarray(value).dtype if dtype is None else np.dtype(dtype)
    if dtype.kind == "f":
        # Written in bits; also a float is written in those of a double.
        with np.errstate(over="ignore"):
            bits = struct.unpack("<Q", struct.pack("<d", float(dtype.type(value))))[0]
        return Value(f"0x{bits:016X}", dtype)
    if dtype.kind == "b":
        return Value("true" if value else "false", dtype)
    return Value(str(int(value)), dtype)


class _Loop:
    """A loop that is being written.

    Attributes:
        number: of names before it; later names belong to its rounds.
        mark: the line that stands for what is computed before it.
        lines: that.
        found: what was computed there, by the numbers that it was computed of.
    """

    def __init__(self, number: int) -> None:
        self.number, self.mark = number, f"  ; before {number}"
        self.lines: list[str] = []
        self.found: dict[tuple[str, ...], Any] = {}


def _number_of(value: Value) -> float:
    """Return when a number was named: 0 if it is known when the kernel is compiled, inf if nothing tells."""
    if value.is_constant:
        return 0.0
    digits = value.text.removeprefix("%v")
    return float(digits) if digits.isdigit() else float("inf")


class Emitter:
    """The instructions of one function, in order; `lanes` numbers are in a vector.

    A division, say, is `emitter.binary("fdiv", a, b)`. An operation on numbers that are the same for all lanes is done
    once, not for each lane.
    """

    def __init__(self, lanes: int, sizes: Mapping[int, str] | None = None, has_library: bool = True) -> None:
        """Begin a function.

        Args:
            lanes: in a vector.
            sizes: lengths that are known only when the kernel runs: the number that stands for each, and its register.
            has_library: whether the function may call those of the C library.
        """
        self.lanes, self.has_library = lanes, has_library
        self._sizes = dict(sizes or {})
        self.lines: list[str] = []
        self.declarations: dict[str, str] = {}
        self.block = "entry"
        self._types = {"%count": "i64", "%packet": "i64", "%work": "ptr"} | dict.fromkeys(self._sizes.values(), "i64")
        self._functions: dict[str, str] = {}
        self._number = itertools.count()
        self._known: list[dict[Any, Any]] = [{}]
        self._loops: list[_Loop] = []
        self._aside = False
        self._before: dict[str, _Loop] = {}

    def name(self, stem: str = "v") -> str:
        """Return a fresh name."""
        return f"{stem}{next(self._number)}"

    def type_of(self, dtype: np.dtype, wide: bool) -> str:
        """Return the LLVM type."""
        scalar = scalar_type(dtype)
        return f"<{self.lanes} x {scalar}>" if wide else scalar

    def typed(self, value: Value) -> str:
        """Return 'type value'."""
        return f"{self.type_of(value.dtype, value.wide)} {value.text}"

    def emit(self, instruction: str, dtype: np.dtype, wide: bool) -> Value:
        """Append an instruction and return its result."""
        value = self.register(dtype, wide)
        if instruction.startswith(("getelementptr", "inttoptr")):
            self._types[value.text] = "ptr"
        self.lines.append(f"  {value.text} = {instruction}")
        return value

    def register(self, dtype: np.dtype, wide: bool) -> Value:
        """Return a fresh register, to be filled."""
        value = Value("%" + self.name(), np.dtype(dtype), wide)
        self._types[value.text] = self.type_of(value.dtype, wide)
        return value

    def start_block(self, name: str) -> None:
        """Begin a block; what was made wide in a block that need not be run before is not used in it."""
        self.lines.append(f"{name}:")
        self.block = name

    def begin_scope(self) -> None:
        """Begin instructions that may be run without those before having been run in the same round."""
        self._known.append({})

    def end_scope(self) -> None:
        """End them."""
        self._known.pop()

    def begin_loop(self) -> None:
        """Begin a loop, with a place before it for what its rounds share."""
        if not self._aside:
            loop = _Loop(next(self._number))
            self._loops.append(loop)
            self._before[loop.mark] = loop
            self.lines.append(loop.mark)

    def end_loop(self) -> None:
        """End it."""
        if not self._aside:
            self._loops.pop()

    def before_loop(self, values: Sequence[Value], compute: Callable[[], Any]) -> Any:
        """Return what is computed of some numbers, once before the outermost loop whose rounds share them.

        Returns:
            None where no loop does.
        """
        numbers = [_number_of(value) for value in values]
        loop = next((one for one in self._loops if all(number < one.number for number in numbers)), None)
        if loop is None:
            return None
        key = tuple(value.text for value in values)
        if key not in loop.found:
            rest = self.lines, self._known, self._loops
            self.lines, self._known, self._loops = loop.lines, [{}], []
            loop.found[key] = compute()
            self.lines, self._known, self._loops = rest
        return loop.found[key]

    @contextlib.contextmanager
    def outside_loops(self) -> Iterator[None]:
        """Write instructions that are taken back: they put nothing before a loop."""
        loops, self._loops = self._loops, []
        yield
        self._loops = loops

    def text(self) -> str:
        """Return all instructions, one a line."""
        return "\n".join("\n".join(self._before[line].lines) if line in self._before else line for line in self.lines)

    def jump(self, block: str) -> None:
        """Go to a block."""
        self.lines.append(f"  br label %{block}")

    def branch(self, condition: Value, yes: str, no: str) -> None:
        """Go to one of two blocks."""
        self.lines.append(f"  br i1 {condition.text}, label %{yes}, label %{no}")

    def widen(self, value: Value) -> Value:
        """Return the number in every lane."""
        if value.wide:
            return value
        if value.is_constant:
            scalar = value.scalar_type
            return Value(f"splat ({scalar} {value.text})", value.dtype, wide=True)
        return self.once(value, lambda: self._splat(value))

    def once(self, key: Any, compute: Callable[[], Any]) -> Any:
        """Return what was computed before in this scope, or one around it, under a key; else compute it."""
        for known in reversed(self._known):
            if key in known:
                return known[key]
        found = compute()
        self._known[-1][key] = found
        return found

    def count(self, number: int) -> str:
        """Return a length or an index as the text of an i64; also one near a length known only when the kernel runs."""
        for size, register in self._sizes.items():
            if number == size:
                return register
            if abs(number - size) <= NEAR:
                key = (register, number - size)
                add = f"add i64 {register}, {number - size}"
                return self.once(key, lambda add=add: self.emit(add, np.dtype(np.int64), False)).text
        return str(number)

    def _splat(self, value: Value) -> Value:
        kind = self.type_of(value.dtype, True)
        one = self.emit(f"insertelement {kind} poison, {self.typed(value)}, i64 0", value.dtype, True)
        wide = self.emit(
            f"shufflevector {kind} {one.text}, {kind} poison, <{self.lanes} x i32> zeroinitializer", value.dtype, True
        )
        return wide

    def alike(self, *values: Value) -> tuple[Value, ...]:
        """Return the numbers, all wide if one of them is."""
        return tuple(map(self.widen, values)) if any(value.wide for value in values) else values

    def unary(self, operation: str, x: Value) -> Value:
        """Return the result of an operation on one number."""
        return self.emit(f"{operation} {self.typed(x)}", x.dtype, x.wide)

    def binary(self, operation: str, x: Value, y: Value) -> Value:
        """Return the result of an operation on two numbers of one type."""
        x, y = self.alike(x, y)
        flags = f" {FLAGS}" if operation in ("fadd", "fsub", "fmul", "fdiv") else ""
        return self.emit(f"{operation}{flags} {self.typed(x)}, {y.text}", x.dtype, x.wide)

    def reciprocal(self, x: Value) -> Value:
        """Return 1 / x, once for all that is divided by x."""
        return self.once(("reciprocal", x), lambda: self.binary("fdiv", constant(1, x.dtype), x))

    def compare(self, operation: str, x: Value, y: Value) -> Value:
        """Return whether a comparison holds: 'fcmp olt', 'icmp eq' and the like."""
        x, y = self.alike(x, y)
        return self.emit(f"{operation} {self.typed(x)}, {y.text}", np.dtype(bool), x.wide)

    def select(self, condition: Value, yes: Value, no: Value) -> Value:
        """Return `yes` where the condition holds, `no` elsewhere."""
        yes, no = self.alike(yes, no)
        if condition.wide:
            yes, no = self.widen(yes), self.widen(no)
        return self.emit(f"select {self.typed(condition)}, {self.typed(yes)}, {self.typed(no)}", yes.dtype, yes.wide)

    def convert(self, operation: str, x: Value, dtype) -> Value:
        """Return a number in another type: 'sitofp', 'zext', 'bitcast' and the like."""
        target = self.type_of(np.dtype(dtype), x.wide)
        return self.emit(f"{operation} {self.typed(x)} to {target}", np.dtype(dtype), x.wide)

    def intrinsic(self, name: str, *arguments: Value) -> Value:
        """Return the result of an intrinsic of LLVM, such as 'fmuladd', on numbers of one type."""
        arguments = self.alike(*arguments)
        first = arguments[0]
        scalar = {"double": "f64", "float": "f32"}.get(first.scalar_type, first.scalar_type)
        suffix = f"v{self.lanes}{scalar}" if first.wide else scalar
        kind = self.type_of(first.dtype, first.wide)
        full = f"llvm.{name}.{suffix}"
        self.declarations[full] = f"declare {kind} @{full}({', '.join([kind] * len(arguments))})"
        flags = f" {FLAGS}" if name == "fmuladd" else ""
        return self.emit(
            f"call{flags} {kind} @{full}({', '.join(map(self.typed, arguments))})", first.dtype, first.wide
        )

    def saturated(self, operation: str, x: Value, dtype) -> Value:
        """Return a float as a whole number; beyond the range its end, and 0 for what is not a number."""
        dtype = np.dtype(dtype)
        source, target = self.type_of(x.dtype, x.wide), self.type_of(dtype, x.wide)
        lanes = f"v{self.lanes}" if x.wide else ""
        ends = [lanes + {"double": "f64", "float": "f32"}.get(scalar_type(t), scalar_type(t)) for t in (dtype, x.dtype)]
        full = f"llvm.{operation}.sat.{'.'.join(ends)}"
        self.declarations[full] = f"declare {target} @{full}({source})"
        return self.emit(f"call {target} @{full}({source} {x.text})", dtype, x.wide)

    def any_lane(self, condition: Value) -> Value:
        """Return whether a condition holds in some lane."""
        if not condition.wide:
            return condition
        full = f"llvm.vector.reduce.or.v{self.lanes}i1"
        kind = self.type_of(condition.dtype, True)
        self.declarations[full] = f"declare i1 @{full}({kind})"
        return self.emit(f"call i1 @{full}({kind} {condition.text})", condition.dtype, False)

    def rarely(
        self, condition: Value, usual: tuple[Value, ...], rare: Callable[[], tuple[Value, ...]]
    ) -> tuple[Value, ...]:
        """Return numbers, others where a condition holds; the instructions of those are run only if it does."""

        def chosen() -> tuple[Value, ...]:
            return tuple(self.select(condition, new, old) for new, old in zip(rare(), usual, strict=True))

        return self.instead(condition, usual, chosen)

    def instead(
        self, condition: Value, usual: tuple[Value, ...], compute: Callable[[], tuple[Value, ...]]
    ) -> tuple[Value, ...]:
        """Return numbers, in all lanes those that are computed in their place if a condition holds in some lane."""
        before, unusual, after = self.block, self.name("rare"), self.name("after")
        self.branch(self.any_lane(condition), unusual, after)
        self.start_block(unusual)
        self.begin_scope()
        found = compute()
        self.end_scope()
        last = self.block
        self.jump(after)
        self.start_block(after)
        return tuple(self.either(old, before, new, last) for old, new in zip(usual, found, strict=True))

    def seldom(self, condition: Value, usual: Value, compute: Callable[[], Value]) -> Value:
        """Return a number, another where a condition holds; what computes that one is a function of its own.

        It is called only if the condition holds in some lane, and functions that are alike are written once: LLVM takes
        longer for a function of all their instructions.
        """

        def called() -> tuple[Value, ...]:
            place, block, aside = len(self.lines), self.block, self._aside
            self._aside = True
            found = self.widen(compute())
            self._aside = aside
            body, self.lines[place:], self.block = self.lines[place:], [], block
            kind = self.type_of(found.dtype, True)
            text, given = outlined(body, block, found.text, kind, self._types)
            name = self._functions.setdefault(text, f"aside{len(self._functions)}")
            self.declarations[name] = text.replace(OUTLINED, f"@{name}")
            arguments = ", ".join(f"{self._types[x]} {x}" for x in given)
            return (self.emit(f"call {kind} @{name}({arguments})", found.dtype, True),)

        return self.rarely(condition, (self.widen(usual),), called)[0]

    def either(self, one: Value, block: str, other: Value, other_block: str) -> Value:
        """Return the one of two numbers that belongs to the block from which this one was reached."""
        kind = self.type_of(other.dtype, other.wide)
        phi = f"phi {kind} [ {one.text}, %{block} ], [ {other.text}, %{other_block} ]"
        return self.emit(phi, other.dtype, other.wide)

    def by_lane(self, function: str, *arguments: Value) -> Value:
        """Return the result of a function of the C library, called for lane after lane.

        Raises:
            NotNative: there is no such library where the function runs.
        """
        if not self.has_library:
            raise NotNative(f'the function "{function}" on a GPU')
        arguments = self.alike(*arguments)
        first = arguments[0]
        scalar = first.scalar_type
        symbol = function if scalar == "double" else f"{function}f"
        self.declarations[symbol] = f"declare {scalar} @{symbol}({', '.join([scalar] * len(arguments))}) nounwind"
        if not first.wide:
            given = ", ".join(map(self.typed, arguments))
            return self.emit(f"call {scalar} @{symbol}({given})", first.dtype, False)
        kind, result = self.type_of(first.dtype, True), "poison"
        for lane in range(self.lanes):
            parts = [self.emit(f"extractelement {kind} {x.text}, i64 {lane}", x.dtype, False) for x in arguments]
            given = ", ".join(map(self.typed, parts))
            one = self.emit(f"call {scalar} @{symbol}({given})", first.dtype, False)
            result = self.emit(f"insertelement {kind} {result}, {self.typed(one)}, i64 {lane}", first.dtype, True).text
        return Value(result, first.dtype, True)

    def assembled(self, each: Sequence[Value], dtype: np.dtype) -> Value:
        """Return a vector of each lane's own number of as many vectors or numbers."""
        target, result = self.type_of(dtype, True), "poison"
        for lane, one in enumerate(each):
            if one.wide:
                one = self.emit(f"extractelement {self.typed(one)}, i64 {lane}", dtype, False)
            result = self.emit(f"insertelement {target} {result}, {self.typed(one)}, i64 {lane}", dtype, True).text
        return Value(result, dtype, True)

    # Memory. An address is the text of a pointer; an index counts numbers, or packets where `wide`.

    def address(self, base: str, index: str, dtype: np.dtype, wide: bool) -> str:
        """Return the address of a number in an array."""
        kind = self.memory_type(dtype, wide)
        return self.emit(f"getelementptr inbounds {kind}, ptr {base}, i64 {index}", np.dtype("i8"), False).text

    def memory_type(self, dtype: np.dtype, wide: bool) -> str:
        """Return the type in memory, where a truth value takes a byte."""
        dtype = np.dtype(dtype)
        scalar = "i8" if dtype.kind == "b" else scalar_type(dtype)
        return f"<{self.lanes} x {scalar}>" if wide else scalar

    def load(self, address: str, dtype: np.dtype, wide: bool) -> Value:
        """Return the number at an address."""
        dtype = np.dtype(dtype)
        found = self.emit(f"load {self.memory_type(dtype, wide)}, ptr {address}, align {dtype.itemsize}", dtype, wide)
        if dtype.kind != "b":
            return found
        kind = self.memory_type(dtype, wide)
        return self.emit(f"trunc {kind} {found.text} to {self.type_of(dtype, wide)}", dtype, wide)

    def store(self, value: Value, address: str) -> None:
        """Put a number to an address."""
        kind = self.memory_type(value.dtype, value.wide)
        if value.dtype.kind == "b":
            value = dataclasses.replace(
                self.emit(f"zext {self.typed(value)} to {kind}", value.dtype, value.wide), dtype=value.dtype
            )
        self.lines.append(f"  store {kind} {value.text}, ptr {address}, align {value.dtype.itemsize}")
