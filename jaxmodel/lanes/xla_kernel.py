"""A scan as one compiled CPU kernel; otherwise XLA would dispatch a kernel for each operation of a step."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.core import Tracer, eval_jaxpr
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Jaxpr

# Operations that XLA cannot emit inside another CPU kernel: sorting, scattering, linear algebra, callbacks, FFTs.
_NEEDS_A_KERNEL = (
    "sort", "top_k", "scatter", "dot_general", "conv_general", "fft", "cholesky", "lu", "qr", "svd", "eig", "schur",
    "triangular", "tridiagonal", "householder", "callback", "custom_call", "ffi", "threefry", "rng", "cumsum",
    "cumprod", "cummax", "reduce_window", "select_and",
)  # fmt: skip


def as_one_kernel(function: Callable, *arguments):
    """Return function(*arguments), compiled as one kernel if the backend is a CPU and its operations allow it.

    A scan over a step of some hundred scalar operations then runs without dispatch overhead: 4 to 20 times as fast,
    also for derivatives. Values are the same to rounding. Pure; may be vmapped and differentiated.

    Do not put a compiled loop around it (`lax.map`, `scan`, `while_loop`): loop on the host, or put the loop inside.
    With such a loop over 90,000 readings of 6 runs, 3 of 112 fits gave a different result on a busy machine (jaxlib
    0.10.2); without the loop all of 600 evaluations were identical.
    """
    if jax.default_backend() != "cpu":
        return function(*arguments)
    traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    values = (traced.consts, jax.tree.leaves(arguments))
    if not _fits_one_kernel(traced.jaxpr):
        found = eval_jaxpr(traced.jaxpr, values[0], *values[1])
    else:
        with set_xla_metadata(inlineable="false", xla_cpu_small_call="true"):
            found = jax.jit(lambda consts, leaves: eval_jaxpr(traced.jaxpr, consts, *leaves))(*values)
    return jax.tree.unflatten(jax.tree.structure(shapes), found)


def holds_constants(values: object) -> bool:
    """Return True if a traced program would contain some of these arrays as constants.

    The CPU compiler of XLA aborts on kernels with constant arrays. Under `jax.jit`, pass such arrays as arguments.
    """
    staged = isinstance(jnp.zeros(()), Tracer)
    arrays = [leaf for leaf in jax.tree.leaves(values) if isinstance(leaf, jax.Array) and leaf.ndim > 0]
    return staged and not all(isinstance(leaf, Tracer) for leaf in arrays)


def _fits_one_kernel(jaxpr: Jaxpr) -> bool:
    """Return True if all operations can be part of one kernel."""
    names = _primitives(jaxpr)
    return not any(name.startswith(_NEEDS_A_KERNEL) or name.endswith("callback") for name in names)


def _primitives(jaxpr: Jaxpr):
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for value in jax.tree.leaves(equation.params, is_leaf=lambda x: isinstance(x, (Jaxpr, ClosedJaxpr))):
            if isinstance(value, ClosedJaxpr):
                value = value.jaxpr
            if isinstance(value, Jaxpr):
                yield from _primitives(value)
