"""Small arrays as a list of numbers, for what goes through a loop or through memory, and back."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from jaxmodel.lanes.emitter import Emitter, Value
from jaxmodel.lanes.operands import Array, NotNative, Operand
from jaxmodel.lanes.tangents import Form, form_of, from_numbers, joined, numbers_of


@dataclasses.dataclass(frozen=True)
class Layout:
    """Which numbers some arrays consist of.

    Attributes:
        shapes: of the arrays.
        forms: of their elements, one after the other.
        dtypes: of the elements.
    """

    shapes: tuple[tuple[int, ...], ...]
    forms: tuple[Form, ...]
    dtypes: tuple[np.dtype, ...]

    @classmethod
    def of(cls, arrays: Sequence[Operand], directions: int) -> Layout:
        """Return the layout of arrays.

        Raises:
            NotNative: one is long.
        """
        elements, shapes = flattened(arrays)
        return cls(tuple(shapes), tuple(form_of(x, directions) for x in elements), tuple(x.dtype for x in elements))

    def joined(self, other: Layout) -> Layout:
        """Return a layout with room for the arrays of both."""
        forms = tuple(joined(one, more) for one, more in zip(self.forms, other.forms, strict=True))
        return dataclasses.replace(self, forms=forms)

    def numbers(self, e: Emitter, arrays: Sequence[Operand]) -> list[Value]:
        """Return the numbers of arrays."""
        return [
            number
            for x, form in zip(flattened(arrays)[0], self.forms, strict=True)
            for number in numbers_of(e, x, form)
        ]  # fmt: skip

    def arrays(self, numbers: Iterable[Value]) -> list[Array]:
        """Return the arrays that consist of numbers."""
        rest = iter(numbers)
        return reshaped([from_numbers(rest, *kind) for kind in zip(self.forms, self.dtypes, strict=True)], self.shapes)


def flattened(arrays: Sequence[Operand]) -> tuple[list[Any], list[tuple[int, ...]]]:
    """Return the elements of small arrays one after the other, and the shapes; NotNative of a long one."""
    if any(not isinstance(x, np.ndarray) for x in arrays):
        raise NotNative("a long array carried from step to step")
    return [element for x in arrays for element in x.ravel()], [x.shape for x in arrays]


def reshaped(elements: Iterable[Any], shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """Return small arrays of some shapes from their elements."""
    rest, result = iter(elements), []
    for shape in shapes:
        flat = np.empty(math.prod(shape), dtype=object)
        for number in range(flat.size):
            flat[number] = next(rest)
        result.append(flat.reshape(shape))
    return result
