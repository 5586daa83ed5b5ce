"""Sums over the steps of a lane: plain in float64, compensated in float32."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array

from jaxmodel.model.declaration import Scalar
from jaxmodel.model.flow import sum_and_rest

# The sum, and in float32 what its roundings lost: 100,000 equal parts would otherwise miss some 1e-3 of it.
Sum = tuple[Array, ...]


def nothing() -> Sum:
    """Return the sum of nothing."""
    zero = jnp.zeros(())
    return (zero,) if zero.dtype == jnp.float64 else (zero, zero)


def add(total: Sum, part: Scalar) -> Sum:
    """Return a sum with one more part."""
    return (total[0] + part,) if len(total) == 1 else sum_and_rest(total[0], total[1], part)
