"""Statements of C as text, one a call, in the place of LLVM instructions: what `lowering` writes, for any compiler.

One lane, so that every number is a scalar. A number that is known when the text is written is computed at once; what
was computed before is named again. Zero times a number is taken as zero: the numbers of a model are finite.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxmodel.lanes.elementary import Elementary
from jaxmodel.lanes.emitter import Emitter, NotNative, Value, constant

_TYPES = {"f8": "double", "f4": "float", "i8": "int64_t", "i4": "int32_t", "u8": "uint64_t", "u4": "uint32_t"}
_TYPES |= {"b1": "bool"}
_SIGNS = {
    "fadd": "+", "fsub": "-", "fmul": "*", "fdiv": "/", "add": "+", "sub": "-", "mul": "*", "sdiv": "/", "udiv": "/",
    "srem": "%", "urem": "%", "and": "&", "or": "|", "xor": "^", "eq": "==", "ne": "!=", "lt": "<", "le": "<=",
    "gt": ">", "ge": ">=",
}  # fmt: skip
_OF_TRUTHS = {"and": "&&", "or": "||", "xor": "!="}
_NUMPY: dict[str, Callable] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "&": np.bitwise_and, "|": np.bitwise_or,
    "^": np.bitwise_xor, "==": np.equal, "!=": np.not_equal, "<": np.less, "<=": np.less_equal, ">": np.greater,
    ">=": np.greater_equal, "&&": np.logical_and, "||": np.logical_or, "fabs": np.abs, "sqrt": np.sqrt, "exp": np.exp,
    "expm1": np.expm1, "log": np.log, "log1p": np.log1p, "tanh": np.tanh, "asinh": np.arcsinh, "floor": np.floor,
    "ceil": np.ceil, "trunc": np.trunc, "rint": np.rint, "sin": np.sin, "cos": np.cos, "pow": np.power,
}  # fmt: skip
# Names of LLVM's intrinsics in the C library, where they differ; of whole numbers there is none.
_LIBRARY = {"roundeven": "rint"}
_MOST_OF_A_LINE = 116


def type_name(dtype: Any) -> str:
    """Return the type in C of a NumPy dtype."""
    return _TYPES[np.dtype(dtype).str[1:]]


def number_of(value: Value) -> Any:
    """Return a number that is known when the text is written."""
    if value.dtype.kind == "f":
        return value.dtype.type(struct.unpack("<d", struct.pack("<Q", int(value.text, 16)))[0])
    return np.bool_(value.text == "true") if value.dtype.kind == "b" else value.dtype.type(int(value.text))


def literal(number: Any, dtype: Any) -> str:
    """Return a number as C writes it: with all its digits, and of its type."""
    dtype = np.dtype(dtype)
    if dtype.kind == "b":
        return "true" if number else "false"
    if dtype.kind in "iu":
        return f"INT64_C({int(number)})" if dtype.itemsize == 8 else str(int(number))
    number = dtype.type(number)
    if not np.isfinite(number):
        return "NAN" if np.isnan(number) else "-INFINITY" if number < 0 else "INFINITY"
    text = str(number)
    return text + ("" if "." in text or "e" in text else ".0") + ("f" if dtype.itemsize == 4 else "")


class CEmitter(Emitter):
    """The statements of one function; `lines` has them, with a % before every name, which `finished` takes away."""

    def __init__(self, tables: dict[bytes, tuple[str, np.ndarray]] | None = None) -> None:
        """Begin a function that shares the constant arrays of a file: by their bytes, name and numbers."""
        super().__init__(lanes=1)
        self.tables = {} if tables is None else tables
        self.indent = 1

    # What is left of LLVM would be no C.

    def emit(self, instruction: str, dtype: np.dtype, wide: bool) -> Value:
        """Refuse an instruction of LLVM."""
        raise NotNative(f'the instruction "{instruction.split(" ", 1)[0]}" in C')

    def widen(self, value: Value) -> Value:
        """Return the number: there is one lane."""
        return value

    def line(self, text: str) -> None:
        """Append a line."""
        self.lines.append("    " * self.indent + text)

    def open(self, text: str) -> None:
        """Begin a block."""
        self.line(text + " {")
        self.indent += 1
        self.begin_scope()

    def close(self, text: str = "}") -> None:
        """End a block."""
        self.end_scope()
        self.indent -= 1
        self.line(text)

    def known(self, expression: str, dtype: Any) -> Value:
        """Return the number of an expression, computed once in a scope."""
        return self.once(expression, lambda: self._named(expression, np.dtype(dtype)))

    def _named(self, expression: str, dtype: np.dtype) -> Value:
        value = Value("%" + self.name(), dtype)
        self.line(f"const {type_name(dtype)} {value.text} = {expression};")
        return value

    def variable(self, start: Value | None, dtype: Any) -> Value:
        """Return a new variable, which `assign` changes."""
        value = Value("%" + self.name("w"), np.dtype(dtype))
        self.line(f"{type_name(dtype)} {value.text}{'' if start is None else f' = {self.text_of(start)}'};")
        return value

    def assign(self, variables: Sequence[Value], values: Sequence[Value]) -> None:
        """Give variables their next numbers, all at once."""
        changed = {variable.text for variable in variables}
        copied = [
            self._named(new.text, new.dtype) if new.text in changed and new.text != old.text else new
            for old, new in zip(variables, values, strict=True)
        ]
        for old, new in zip(variables, copied, strict=True):
            if new.text != old.text:
                self.line(f"{old.text} = {self.text_of(new)};")

    def text_of(self, value: Value) -> str:
        """Return a number as it stands in an expression."""
        return literal(number_of(value), value.dtype) if value.is_constant else value.text

    def _operation(self, sign: str, x: Value, y: Value, dtype: Any) -> Value:
        if x.is_constant and y.is_constant and sign in _NUMPY:
            return _computed(sign, dtype, x, y)
        return self.known(f"{_within(self.text_of(x))} {sign} {_within(self.text_of(y))}", dtype)

    def unary(self, operation: str, x: Value) -> Value:
        """Return -x."""
        if x.is_constant:
            return constant(-number_of(x), x.dtype)
        return self.known(f"-{x.text}", x.dtype)

    def binary(self, operation: str, x: Value, y: Value) -> Value:
        """Return the result of an operation on two numbers; without one where a number is known to be 0 or 1."""
        left, right = (number_of(one) if one.is_constant else None for one in (x, y))
        if x.dtype.kind == "b":
            return self._of_truths(_OF_TRUTHS[operation], x, y)
        if operation in ("fadd", "add") and (left == 0 or right == 0):
            return y if left == 0 else x
        if operation in ("fmul", "mul"):
            if left == 0 or right == 0:
                return constant(0, x.dtype)
            if left == 1 or right == 1:
                return y if left == 1 else x
        if operation in ("fsub", "sub") and right == 0:
            return x
        if operation == "fsub" and left == 0:
            return self.unary("fneg", y)
        if operation == "fdiv" and (right == 1 or (left == 0 and right is None)):
            return x
        return self._operation(_SIGNS[operation], x, y, x.dtype)

    def _of_truths(self, sign: str, x: Value, y: Value) -> Value:
        if x.is_constant or y.is_constant:
            one, other = (x, y) if x.is_constant else (y, x)
            if sign == "!=":
                return self._not(other) if number_of(one) else other
            return other if bool(number_of(one)) == (sign == "&&") else one
        return self._operation(sign, x, y, bool)

    def _not(self, x: Value) -> Value:
        return constant(not number_of(x)) if x.is_constant else self.known(f"!{x.text}", bool)

    def compare(self, operation: str, x: Value, y: Value) -> Value:
        """Return whether a comparison holds."""
        relation = operation.split()[1]
        if relation in ("uno", "ord"):  # of two numbers of which either is not a number; or neither
            either = self.binary("or", *(self.compare("fcmp une", one, one) for one in (x, y)))
            return either if relation == "uno" else self._not(either)
        return self._operation(_SIGNS[relation[1:] if len(relation) == 3 else relation], x, y, bool)

    def select(self, condition: Value, yes: Value, no: Value) -> Value:
        """Return `yes` where the condition holds, `no` elsewhere."""
        if condition.is_constant:
            return yes if number_of(condition) else no
        if yes.text == no.text:
            return yes
        if yes.dtype.kind == "b" and (yes.is_constant or no.is_constant):
            known, other = (yes, no) if yes.is_constant else (no, yes)
            negated = bool(number_of(known)) != yes.is_constant
            test = self._not(condition) if negated else condition
            return self._of_truths("||" if number_of(known) else "&&", test, other)
        return self.known(f"{condition.text} ? {self.text_of(yes)} : {self.text_of(no)}", yes.dtype)

    def convert(self, operation: str, x: Value, dtype: Any) -> Value:
        """Return a number in another type."""
        if operation == "bitcast":
            raise NotNative("the bits of a number in C")
        if x.is_constant:
            return constant(np.asarray(number_of(x)).astype(dtype), dtype)
        return self.known(f"({type_name(dtype)}){x.text}", dtype)

    def saturated(self, operation: str, x: Value, dtype: Any) -> Value:
        """Return a float as a whole number, 0 for what is not a number; it is taken to be within the range."""
        number = self.select(self.compare("fcmp une", x, x), constant(0, x.dtype), x)
        return self.convert(operation, number, dtype)

    def intrinsic(self, name: str, *arguments: Value) -> Value:
        """Return the result of a function of the C library by LLVM's name for it."""
        if name in ("smax", "umax", "smin", "umin"):
            x, y = arguments
            return self.select(self._operation(">" if name.endswith("max") else "<", x, y, bool), x, y)
        if name == "fmuladd":
            return self.binary("fadd", self.binary("fmul", *arguments[:2]), arguments[2])
        if arguments[0].dtype.kind != "f":
            raise NotNative(f"{name} of whole numbers in C")
        return self.by_lane(_LIBRARY.get(name, name), *arguments)

    def by_lane(self, function: str, *arguments: Value) -> Value:
        """Return the result of a function of the C library."""
        dtype = arguments[0].dtype
        if all(one.is_constant for one in arguments) and function in _NUMPY:
            return _computed(function, dtype, *arguments)
        given = ", ".join(map(self.text_of, arguments))
        return self.known(f"{function}{'f' if dtype.itemsize == 4 else ''}({given})", dtype)

    def any_lane(self, condition: Value) -> Value:
        """Return whether a condition holds."""
        return condition

    def seldom(self, condition: Value, usual: Value, compute: Callable[[], Value]) -> Value:
        """Return a number, another where a condition holds; the statements of that one are run only if it does."""
        if condition.is_constant:
            return compute() if number_of(condition) else usual
        found = self.variable(usual, usual.dtype)
        self.open(f"if ({condition.text})")
        self.assign([found], [compute()])
        self.close()
        return found

    # Arrays.

    def table(self, numbers: np.ndarray) -> str:
        """Return the name of a constant array of the file that has these numbers."""
        key = f"{numbers.dtype.str}{numbers.size}".encode() + numbers.tobytes()
        return self.tables.setdefault(key, (f"table_{len(self.tables)}", numbers))[0]

    def array(self, elements: Sequence[Value]) -> str:
        """Return the name of an array with these numbers."""
        dtype = elements[0].dtype
        if all(one.is_constant for one in elements):
            return self.table(np.array([number_of(one) for one in elements], dtype))
        given = ", ".join(map(self.text_of, elements))

        def declared() -> str:
            name = "%" + self.name("a")
            self.line(f"const {type_name(dtype)} {name}[{len(elements)}] = {{{given}}};")
            return name

        return self.once(("array", given), declared)

    def finished(self) -> str:
        """Return the statements, without those whose numbers nothing uses."""
        lines, before = self.lines, -1
        while len(lines) != before:
            before, lines = len(lines), _used(lines)
        return "\n".join(broken(re.sub(r"%(?=[A-Za-z])", "", line)) for line in lines)


class OfLibrary(Elementary):
    """The elementary functions by those of the C library."""

    def exp(self, x: Value) -> Value:
        """Return e^x."""
        return self.e.by_lane("exp", x)

    def expm1(self, x: Value) -> Value:
        """Return e^x - 1."""
        return self.e.by_lane("expm1", x)

    def log(self, x: Value) -> Value:
        """Return the natural logarithm."""
        return self.e.by_lane("log", x)

    def log1p(self, x: Value) -> Value:
        """Return log(1 + x)."""
        return self.e.by_lane("log1p", x)

    def tanh(self, x: Value) -> Value:
        """Return the hyperbolic tangent."""
        return self.e.by_lane("tanh", x)

    def asinh(self, x: Value) -> Value:
        """Return the inverse hyperbolic sine."""
        return self.e.by_lane("asinh", x)

    def sine_and_cosine(self, x: Value) -> tuple[Value, Value]:
        """Return sin and cos."""
        return self.e.by_lane("sin", x), self.e.by_lane("cos", x)

    def power(self, x: Value, y: Value) -> Value:
        """Return x^y."""
        return self.e.by_lane("pow", x, y)


def _used(lines: list[str]) -> list[str]:
    """Return the statements but for those that give a number to what no other reads."""
    targets = [re.match(r" *(?!return )(?:const )?(?:\w+ )?(%\w+)(?:\[\d+\])?(?: = |;)", line) for line in lines]
    reads = [line[target.end() :] if target else line for line, target in zip(lines, targets, strict=True)]
    used = set(re.findall(r"%[A-Za-z]\w*", "\n".join(reads)))
    return [line for line, target in zip(lines, targets, strict=True) if target is None or target[1] in used]


def broken(line: str) -> str:
    """Return a line as several that are short enough to read."""
    if len(line) <= _MOST_OF_A_LINE:
        return line
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    words, lines = line.split(" "), [""]
    for word in words:
        if len(lines[-1]) + len(word) >= _MOST_OF_A_LINE:
            lines.append(indent + word)
        else:
            lines[-1] += (" " if lines[-1] else "") + word if word or lines[-1].strip() else " "
    return "\n".join(lines)


def _within(text: str) -> str:
    return f"({text})" if text.startswith("-") else text


def _computed(operation: str, dtype: Any, *arguments: Value) -> Value:
    with np.errstate(all="ignore"):
        return constant(_NUMPY[operation](*map(number_of, arguments)), dtype)
