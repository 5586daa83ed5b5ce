"""A function of a lane that programs of JAX call: under `jit`, `vmap` and `jvp` it runs as a kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.native.ffi import register
from jaxmodel.native.kernel import Kernel, NotNative

Lanes = Callable[[Any, Any], Any]  # (shared, own) -> results, lanes along the first axis of the own arrays


def in_jax(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a function (shared, own) of a lane as one whose lanes run as vector instructions.

    `jax.vmap(fast, in_axes=(None, 0))` gives it lanes, in packets on one core. It has forward derivatives (`jax.jvp`,
    `jax.jacfwd`) and no reverse mode. On an accelerator, and where an operation has no vector instructions, it is the
    function itself, through XLA. Kernels are made when it is traced, one for the shapes of its arguments.

    Args:
        function: pure; its arguments and its result are pytrees of arrays, `own` with one array at least.
    """
    values = _with_vmap(_by_kernel(function, ""))
    slopes = _with_vmap(_by_kernel(_along(function), "by"))

    @jax.custom_jvp
    def fast(shared: Any, own: Any) -> Any:
        return _one(values, shared, own)

    @fast.defjvp
    def fast_jvp(primals: Any, tangents: Any) -> Any:
        along = jax.tree.map(lambda x, t: t if _moves(x) else jnp.zeros_like(x), primals, tangents)
        (shared, own), (shared_along, own_along) = primals, along
        start = {"of": own, "along": own_along, "by": jnp.zeros(1)}
        # The result by itself: under `jacfwd` it is one, where the slopes are many.
        result, (_, slope) = _one(values, shared, own), _one(slopes, (shared, shared_along), start)
        nothing = jax.tree.map(lambda x: np.zeros(x.shape, jax.dtypes.float0), result)
        rest, tree = iter(jax.tree.leaves(slope)), jax.tree.structure(result)
        pairs = zip(jax.tree.leaves(result), jax.tree.leaves(nothing), strict=True)
        return result, jax.tree.unflatten(tree, [next(rest)[0] if _moves(x) else none for x, none in pairs])

    return fast


def _moves(x: Any) -> bool:
    return jnp.issubdtype(jnp.result_type(x), jnp.floating)


def _along(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return the function `by` steps along a direction of its arguments."""

    def moved(shared: Any, own: Any) -> Any:
        def move(x: Any, along: Any) -> Any:
            return x + own["by"][0] * along if _moves(x) else x

        return function(jax.tree.map(move, *shared), jax.tree.map(move, own["of"], own["along"]))

    return moved


def _one(lanes: Lanes, shared: Any, own: Any) -> Any:
    """Return the result of one lane."""
    result = lanes(jax.tree.map(jnp.asarray, shared), jax.tree.map(lambda x: jnp.asarray(x)[None], own))
    return jax.tree.map(lambda x: x[0], result)


def _with_vmap(run: Lanes) -> Lanes:
    """Return a function of lanes to which `jax.vmap` gives more of them."""
    lanes = jax.custom_batching.custom_vmap(run)

    @lanes.def_vmap
    def rule(size: int, batched: Any, shared: Any, own: Any) -> Any:
        own = jax.tree.map(lambda x, has: x if has else jnp.broadcast_to(x, (size, *x.shape)), own, batched[1])
        if any(jax.tree.leaves(batched[0])):  # each has its own shared arrays: one after the other
            shared = jax.tree.map(
                lambda x, has: x if has else jnp.broadcast_to(x, (size, *x.shape)), shared, batched[0]
            )
            result = jax.lax.map(lambda pair: lanes(*pair), (shared, own))
        else:
            merged = lanes(shared, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), own))
            result = jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), merged)
        return result, jax.tree.map(lambda _: True, result)

    return lanes


def _by_kernel(function: Callable[[Any, Any], Any], by: str) -> Lanes:
    """Return a function's lanes, with derivatives as of `Kernel`, by a kernel, or through XLA where there is none."""
    known: dict[Any, tuple[Kernel, str] | None] = {}

    def run(shared: Any, own: Any) -> Any:
        like = (
            jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), shared),
            jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape[1:], x.dtype), own),
        )
        leaves, tree = jax.tree.flatten(like)
        key = (tree, tuple((x.shape, x.dtype) for x in leaves))
        if key not in known:
            known[key] = _made(function, by, *like)
        found = known[key]
        through_xla = jax.vmap(_with_slopes(function, by) if by else function, in_axes=(None, 0))
        if found is None:
            return through_xla(shared, own)
        kernel, name = found
        return jax.lax.platform_dependent(
            shared, own, cpu=lambda shared, own: _called(kernel, name, shared, own), default=through_xla
        )

    return run


def _made(function: Callable[[Any, Any], Any], by: str, shared: Any, own: Any) -> tuple[Kernel, str] | None:
    try:
        kernel = Kernel(function, shared, own, by=by)
        return kernel, register(kernel)
    except NotNative:
        return None


def _with_slopes(function: Callable[[Any, Any], Any], by: str) -> Callable[[Any, Any], Any]:
    """Return what a kernel with derivatives gives, for a vector of one number."""

    def pair(shared: Any, own: Any) -> Any:
        result, slope = jax.jvp(lambda x: function(shared, own | {by: x}), (own[by],), (jnp.ones_like(own[by]),))
        return result, jax.tree.map(lambda x, y: y[None] if _moves(x) else None, result, slope)

    return pair


def _called(kernel: Kernel, name: str, shared: Any, own: Any) -> Any:
    count = jax.tree.leaves(own)[0].shape[0]
    whole = -(-count // kernel.lanes) * kernel.lanes

    def packets(x: jax.Array) -> jax.Array:
        filled = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (whole - count, *x.shape[1:]))])
        return jnp.moveaxis(filled, 0, -1)

    consts = [jnp.asarray(x) for x in kernel.arguments_of_call if x is not None]
    call = jax.ffi.ffi_call(name, kernel.results_of_call(whole))
    results = call(*consts, *jax.tree.leaves(shared), *jax.tree.leaves(jax.tree.map(packets, own)))
    return kernel.unflattened([jnp.moveaxis(x, -1, 0)[:count] for x in results])
