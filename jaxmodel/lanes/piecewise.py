"""Formulas that are linear between knots, which kernels know by a name."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax

# The name of such a formula in a jaxpr.
PIECEWISE = "piecewise_linear"


def piecewise_linear(formula: Callable[..., Any]) -> Callable[..., Any]:
    """Mark a formula of x (), knots (n,), values (n,) and more that is linear between the knots and held at the ends.

    A kernel for lanes that are much alike computes the one segment in which all lanes of a packet are, and only where
    they are in several the segment of each.
    """

    @functools.wraps(formula)
    def marked(*given: Any) -> Any:
        return formula(*given)

    marked.__name__ = PIECEWISE
    return jax.jit(marked)
