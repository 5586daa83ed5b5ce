"""Functions of JAX as functions of C in one file: named constants, tables, and statements."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from jaxmodel.export.wording import identifier
from jaxmodel.lanes.c_emitter import CEmitter, broken, literal, type_name
from jaxmodel.lanes.c_lowering import LOOK_UP, CLowering, numbers
from jaxmodel.lanes.emitter import Value
from jaxmodel.lanes.operands import array_of

_A_LINE = 6  # numbers of a table in a line
LOOK_UP_TEXT = """/* The value at x of a function that is linear between knots, and held at its ends. */
static {real} {name}({real} x, const {real} *knots, const {real} *values, int32_t count)
{{
    int32_t low = 0, high = count - 1;
    if (x <= knots[0]) {{ return values[0]; }}
    if (x >= knots[high]) {{ return values[high]; }}
    while (high - low > 1) {{
        const int32_t middle = low + (high - low) / 2;
        if (x >= knots[middle]) {{ low = middle; }} else {{ high = middle; }}
    }}
    return values[low] + (x - knots[low]) / (knots[high] - knots[low]) * (values[high] - values[low]);
}}
"""


def comment(lines: Sequence[str]) -> str:
    """Return lines as a comment of C."""
    first, *rest = (line.replace("*/", "* /") for line in lines)
    return "\n".join([f"/* {first}", *(f" * {line}".rstrip() for line in rest), " */"])


@dataclasses.dataclass(frozen=True)
class Given:
    """An argument of a function of JAX, and what it is in C.

    Attributes:
        value: of the argument, or of its shape.
        text: the expression in C of a scalar, such as "state->soc"; of an array, that of its first element.
        name: of the local variable that holds it; "" for a constant that `text` names.
        is_table: whether its numbers are written into the file.
    """

    value: Any
    text: str
    name: str = ""
    is_table: bool = False


class CFile:
    """The constants, tables and functions of one file."""

    def __init__(self, dtype: Any) -> None:
        """Begin a file whose numbers are of one type."""
        self.dtype = np.dtype(dtype)
        self.real = type_name(self.dtype)
        self.tables: dict[bytes, tuple[str, np.ndarray]] = {}
        self.constants: dict[str, tuple[float, str]] = {}
        self.functions: list[str] = []

    def name_table(self, name: str, values: np.ndarray) -> None:
        """Give a table its name, and each row of one of two axes."""
        if values.ndim == 2:
            self.name_table(name, values.ravel())
            for number, row in enumerate(values):
                self.name_table(f"{name}_{number}", row)
        elif values.ndim == 1 and values.size > 1:
            kept = values.astype(self.dtype)
            key = f"{kept.dtype.str}{kept.size}".encode() + kept.tobytes()
            self.tables.setdefault(key, (identifier(name), kept))

    def write(
        self,
        head: str,
        function: Callable,
        arguments: Any,
        given: Sequence[Given],
        targets: Mapping[str, Any],
        returned: str | None = None,
    ) -> None:
        """Write a function that takes its arguments apart, computes, and puts each result where it belongs.

        Args:
            head: of the function in C.
            function: of JAX, of the arguments.
            arguments: a tuple of pytrees.
            given: what each leaf of the arguments is in C, in order.
            targets: an expression in C for each result by its name, where `function` returns a dictionary of them; of
                an array, the name of an array.
            returned: what the function in C returns.
        """
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
        emitter = CEmitter(self.tables)
        lowering = CLowering(emitter)
        operands = [self._operand(emitter, one) for one in given]
        found = lowering.run(traced.jaxpr, [numbers(x) for x in traced.consts], operands)
        for name, result in zip(sorted(shapes), found, strict=True):
            elements = list(result.ravel())
            for number, element in enumerate(elements):
                place = f"[{number}]" if result.shape else ""
                emitter.line(f"{targets[name]}{place} = {emitter.text_of(element)};")
        body = emitter.finished()
        words = set(re.findall(r"\w+", body))
        unused = [f"    (void){name};\n" for name in re.findall(r"(\w+)[,)]", head) if name not in words]
        result = "" if returned is None else f"    return {returned};\n"
        self.functions.append(f"{head}\n{{\n{''.join(unused)}{body}\n{result}}}\n")

    def _operand(self, emitter: CEmitter, given: Given) -> Any:
        value = np.asarray(given.value) if given.is_table else given.value
        if given.is_table:
            return numbers(value)
        if not given.name:
            return array_of(Value(f"%{given.text}", self.dtype))
        result = np.empty(value.shape, dtype=object)
        for place, index in enumerate(np.ndindex(value.shape)):
            name = f"%{given.name}_{place}" if value.shape else f"%{given.name}"
            at = f"[{place}]" if value.shape else ""
            emitter.line(f"const {self.real} {name} = {given.text}{at};")
            result[index] = Value(name, self.dtype)
        return result

    def text(self) -> str:
        """Return constants and tables that are used, and the functions."""
        bodies = "\n".join(self.functions)
        words = set(re.findall(r"[A-Za-z_]\w*", bodies))
        lines = [
            f"static const {self.real} {name} = {literal(value, self.dtype)};{f'  /* {about} */' if about else ''}"
            for name, (value, about) in self.constants.items()
            if name in words
        ]
        for name, values in self.tables.values():
            if name in words:
                lines += ["", f"static const {type_name(values.dtype)} {name}[{values.size}] = {{"]
                texts = [literal(value, values.dtype) for value in values]
                rows = [texts[first : first + _A_LINE] for first in range(0, len(texts), _A_LINE)]
                lines += [broken(f"    {', '.join(row)},") for row in rows]
                lines.append("};")
        if LOOK_UP in words:
            lines += ["", LOOK_UP_TEXT.format(real=self.real, name=LOOK_UP).rstrip()]
        return "\n".join(lines) + "\n\n" + bodies
