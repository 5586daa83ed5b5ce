"""Operations on small arrays by the names of JAX's primitives: (lowering, arrays, params, abstract result) -> array."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from jaxmodel.lanes.elements import ELEMENTS, REDUCE, convert, neutral
from jaxmodel.lanes.emitter import Value
from jaxmodel.lanes.operands import (
    MOST_IN_REGISTERS,
    MOST_SPREAD,
    Array,
    NotNative,
    Operand,
    Rows,
    Series,
    array_of,
    constants,
)


def _reduce(name: str) -> Callable:
    def operation(lowering: Any, given: list[Array], params: dict, out: Any) -> Array:
        axes = params["axes"]
        moved = np.moveaxis(given[0], axes, range(len(axes)))
        moved = moved.reshape(-1, *out.shape)
        result = np.empty(out.shape, dtype=object)
        for index in np.ndindex(*out.shape):
            values = [moved[(row, *index)] for row in range(moved.shape[0])]
            total = values[0] if values else neutral(name, np.dtype(out.dtype))
            for value in values[1:]:
                total = REDUCE[name](lowering, [total, value], {}, np.dtype(out.dtype))
            result[index] = total
        return result

    return operation


def _broadcast(lowering: Any, given: list[Array], params: dict, out: Any) -> Operand:
    if math.prod(out.shape) > MOST_SPREAD and given[0].size == 1:
        if math.prod(out.shape) == max(out.shape):
            value = given[0].ravel()[0]
            return Series(max(out.shape), value.dtype, lambda index: value)
        if 0 not in params["broadcast_dimensions"]:
            value = given[0].ravel()[0]
            return Rows(out.shape[0], lambda index: np.broadcast_to(array_of(value), out.shape[1:]))
    if math.prod(out.shape) > MOST_IN_REGISTERS:
        if 0 not in params["broadcast_dimensions"]:
            row_out = jax.ShapeDtypeStruct(out.shape[1:], out.dtype)
            inner = {"broadcast_dimensions": tuple(axis - 1 for axis in params["broadcast_dimensions"])}
            row = _broadcast(lowering, given, inner, row_out)
            return Rows(out.shape[0], lambda index: row)
        raise NotNative(f"an array of shape {out.shape}")
    shape = [1] * len(out.shape)
    for axis, size in zip(params["broadcast_dimensions"], given[0].shape, strict=True):
        shape[axis] = size
    return np.broadcast_to(given[0].reshape(shape), out.shape)


def _slice(lowering: Any, given: list[Array], params: dict, out: Any) -> Array:
    strides = params["strides"] or (1,) * given[0].ndim
    return given[0][tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]


def _dynamic_slice(lowering: Any, given: list[Array], params: dict, out: Any) -> Array:
    source, *starts = given
    places: list[Any] = [x[()] for x in starts]
    if not all(place.is_constant for place in places):
        return lowering.rows_at(lowering.spilled(source.ravel()), source.shape, places, out)
    at = places_held(places, source.shape, out.shape)
    return source[tuple(slice(start, start + width) for start, width in zip(at, out.shape, strict=True))]


def places_held(places: Sequence[Value], shape: tuple[int, ...], part: tuple[int, ...]) -> tuple[int, ...]:
    """Return where a part of an array begins, moved so that it lies within the array."""
    return tuple(
        min(max(int(place.text), 0), size - width) for place, size, width in zip(places, shape, part, strict=True)
    )


def _pad(lowering: Any, given: list[Array], params: dict, out: Any) -> Array:
    source, value = given
    result = np.empty(out.shape, dtype=object)
    result.fill(value[()])
    places = []
    for (low, high, inner), size in zip(params["padding_config"], source.shape, strict=True):
        if low < 0 or high < 0:
            raise NotNative("a negative padding")
        places.append(slice(low, low + (size - 1) * (inner + 1) + 1, inner + 1))
    result[tuple(places)] = source
    return result


def _dot(lowering: Any, given: list[Array], params: dict, out: Any) -> Array:
    (left, right), (batch_left, batch_right) = params["dimension_numbers"]
    if batch_left or batch_right:
        raise NotNative("a product of matrices over further axes")
    x = np.moveaxis(given[0], left, range(-len(left), 0)) if left else given[0]
    y = np.moveaxis(given[1], right, range(len(right))) if right else given[1]
    inner = math.prod(given[0].shape[axis] for axis in left)
    rows, columns = x.reshape(-1, inner), y.reshape(inner, -1)
    dtype = np.dtype(out.dtype)
    result = np.empty((rows.shape[0], columns.shape[1]), dtype=object)
    for i, j in np.ndindex(*result.shape):
        total = ELEMENTS["mul"](lowering, [rows[i, 0], columns[0, j]], {}, dtype)
        for k in range(1, inner):
            product = ELEMENTS["mul"](lowering, [rows[i, k], columns[k, j]], {}, dtype)
            total = ELEMENTS["add"](lowering, [total, product], {}, dtype)
        result[i, j] = total
    return result.reshape(out.shape)


def _cumulative(name: str) -> Callable:
    def operation(lowering: Any, given: list[Array], params: dict, out: Any) -> Array:
        source = np.moveaxis(given[0], params["axis"], 0)
        source = source[::-1] if params["reverse"] else source
        result = np.empty(source.shape, dtype=object)
        for index in np.ndindex(source.shape[1:]):
            total = None
            for row in range(source.shape[0]):
                value = source[(row, *index)]
                total = value if total is None else REDUCE[name](lowering, [total, value], {}, np.dtype(out.dtype))
                result[(row, *index)] = total
        result = result[::-1] if params["reverse"] else result
        return np.moveaxis(result, 0, params["axis"])

    return operation


def _iota(lowering: Any, given: list[Array], params: dict, out: Any) -> Operand:
    if len(out.shape) == 1 and out.shape[0] > MOST_SPREAD:
        whole = np.dtype(np.int64)
        return Series(
            out.shape[0], np.dtype(out.dtype), lambda i: convert(lowering, [Value(i, whole)], {}, np.dtype(out.dtype))
        )
    if math.prod(out.shape) > MOST_IN_REGISTERS:
        raise NotNative(f"an array of shape {out.shape}")
    shape = [1] * len(out.shape)
    shape[params["dimension"]] = -1
    count = np.arange(out.shape[params["dimension"]], dtype=out.dtype).reshape(shape)
    return constants(np.broadcast_to(count, out.shape))


ON_ARRAYS: dict[str, Callable] = {
    **{name: _reduce(name) for name in REDUCE},
    "broadcast_in_dim": _broadcast,
    "reshape": lambda lowering, given, params, out: given[0].reshape(out.shape),
    "squeeze": lambda lowering, given, params, out: given[0].reshape(out.shape),
    "expand_dims": lambda lowering, given, params, out: given[0].reshape(out.shape),
    "transpose": lambda lowering, given, params, out: given[0].transpose(params["permutation"]),
    "rev": lambda lowering, given, params, out: np.flip(given[0], params["dimensions"]),
    "concatenate": lambda lowering, given, params, out: np.concatenate(given, axis=params["dimension"]),
    "stack": lambda lowering, given, params, out: np.stack(given, axis=params.get("axis", params.get("dimension", 0))),
    "slice": _slice,
    "dynamic_slice": _dynamic_slice,
    "gather": lambda lowering, given, params, out: lowering.gather(given, params, out),
    "pad": _pad,
    "dot_general": _dot,
    "cumsum": _cumulative("reduce_sum"),
    "cumprod": _cumulative("reduce_prod"),
    "cummax": _cumulative("reduce_max"),
    "cummin": _cumulative("reduce_min"),
    "iota": _iota,
}  # fmt: skip
