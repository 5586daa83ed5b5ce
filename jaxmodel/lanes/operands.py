"""What the operations of a kernel act on: small arrays in registers, long ones as functions of an index."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from jaxmodel.lanes.emitter import NotNative, Value, constant

# Arrays of more elements are not written out; arrays that many lanes share, or that one number fills, stay in memory
# from fewer on.
MOST_IN_REGISTERS = 512
MOST_SPREAD = 128

Array = np.ndarray  # of `Value`s


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


def constants(value: Any, dtype: Any = None) -> Array:
    """Return numbers that are known when the kernel is compiled."""
    array = np.asarray(value, dtype)
    if array.size > MOST_IN_REGISTERS:
        raise NotNative(f"a constant of shape {array.shape}")
    result = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        result[index] = constant(array[index], array.dtype)
    return result


def array_of(value: Value) -> Array:
    """Return an array without axes of one number."""
    result = np.empty((), dtype=object)
    result[()] = value
    return result
