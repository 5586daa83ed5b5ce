"""Kernels as calls of XLA, inside of programs of JAX."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.native import in_jax
from tests.jaxmodel.native.test_kernel import LONG, RNG

SHARED = {"over": jnp.asarray(LONG), "count": jnp.asarray(3)}


def scanned(shared: Any, own: Any) -> dict[str, jax.Array]:
    def advance(value: jax.Array, given: jax.Array) -> tuple[jax.Array, jax.Array]:
        value = 0.9 * value + jnp.sin(given) * own["gain"]
        return value, value

    last, kept = jax.lax.scan(advance, own["start"], shared["over"])
    return {"last": jnp.exp(0.1 * last) * shared["count"], "kept": kept, "steps": shared["count"] + 1}


def lanes(count: int) -> dict[str, jax.Array]:
    return {"start": jnp.asarray(RNG.normal(size=count)), "gain": jnp.asarray(RNG.uniform(0.1, 2.0, count))}


def assert_like(found: Any, wanted: Any) -> None:
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12), found, wanted)


@pytest.mark.parametrize("count", [1, 5, 32])
def test_jit_of_vmap_of_a_kernel_is_that_of_the_function(count: int) -> None:
    fast, own = in_jax(scanned), lanes(count)
    text = jax.jit(jax.vmap(fast, in_axes=(None, 0))).lower(SHARED, own).as_text()
    assert "jaxmodel_kernel" in text
    found = jax.jit(jax.vmap(fast, in_axes=(None, 0)))(SHARED, own)
    assert_like(found, jax.vmap(scanned, in_axes=(None, 0))(SHARED, own))


def test_without_lanes_in_a_larger_program_and_with_two_axes_of_lanes() -> None:
    fast, own = in_jax(scanned), lanes(6)
    one = jax.tree.map(lambda x: x[0], own)
    total = jax.jit(lambda f_own: jnp.sum(fast(SHARED, f_own)["kept"]) ** 2)(one)
    np.testing.assert_allclose(total, jnp.sum(scanned(SHARED, one)["kept"]) ** 2, rtol=1e-12)
    grid = jax.tree.map(lambda x: x.reshape(2, 3), own)
    inner = jax.vmap(jax.vmap(fast, in_axes=(None, 0)), in_axes=(None, 0))
    assert_like(inner(SHARED, grid), jax.vmap(jax.vmap(scanned, in_axes=(None, 0)), in_axes=(None, 0))(SHARED, grid))


def test_forward_derivatives_go_through_the_kernel() -> None:
    fast, own = in_jax(scanned), lanes(5)
    along = jax.tree.map(lambda x: 0.5 * x + 1.0, own)

    def pushed(function: Any) -> Any:
        def of(own: Any, over: Any) -> Any:
            return jax.vmap(function, in_axes=(None, 0))(SHARED | {"over": over}, own)

        values, slopes = jax.jvp(of, (own, SHARED["over"]), (along, 0.1 * SHARED["over"]))
        return values, {name: x for name, x in slopes.items() if name != "steps"}

    assert_like(jax.jit(lambda: pushed(fast))(), pushed(scanned))
    one = jax.tree.map(lambda x: x[0], own)
    found = jax.jacfwd(lambda x: fast(SHARED, x)["last"])(one)
    assert_like(found, jax.jacfwd(lambda x: scanned(SHARED, x)["last"])(one))


def test_shared_arrays_may_differ_from_lane_to_lane() -> None:
    fast, own = in_jax(scanned), lanes(3)
    shared = {"over": jnp.asarray(RNG.normal(size=(3, 50))), "count": jnp.arange(3)}
    assert_like(jax.vmap(fast)(shared, own), jax.vmap(scanned)(shared, own))


def test_what_has_no_instructions_runs_through_xla() -> None:
    fast, x = in_jax(lambda shared, x: jnp.sort(x) * shared), jnp.asarray(RNG.normal(size=(4, 5)))
    np.testing.assert_array_equal(jax.vmap(fast, in_axes=(None, 0))(2.0, x), 2.0 * jnp.sort(x, axis=1))
    slope = jax.jvp(lambda x: jax.vmap(fast, in_axes=(None, 0))(2.0, x), (x,), (x,))[1]
    np.testing.assert_allclose(slope, 2.0 * jnp.sort(x, axis=1), rtol=1e-14)
