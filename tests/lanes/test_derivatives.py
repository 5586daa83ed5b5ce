"""Derivatives through kernels against `jax.jacfwd` of the same functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxmodel.lanes import Kernel, Pool
from tests.lanes.test_kernel import FUNCTIONS, LANES, LONG, RNG


def by_kernel(function: Callable, shared: Any, own: dict[str, np.ndarray], lanes: int | None = None) -> Any:
    kernel = Kernel(function, shared, jax.tree.map(lambda x: x[0], own), by="by", lanes=lanes)
    with Pool(2) as pool:
        return pool.start(kernel, shared, own, len(own["by"]), packets=1).tree()


def by_jacfwd(function: Callable, shared: Any, own: dict[str, np.ndarray]) -> Any:
    def lane(own: dict[str, jax.Array]) -> Any:
        slopes = jax.jacfwd(lambda x: function(shared, own | {"by": x}))(own["by"])
        return jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), slopes)

    return jax.vmap(lane)(jax.tree.map(jnp.asarray, own))


def along_numbers(name: str) -> tuple[Callable, Any, dict[str, Any]]:
    """Return a function of `FUNCTIONS` with its lanes' first numbers as a vector to differentiate by."""
    function, shared, lanes = FUNCTIONS[name]
    moved = {key: x.reshape(LANES, -1) for key, x in lanes.items() if x.dtype.kind == "f"}
    ends = np.cumsum([x.shape[1] for x in moved.values()])[:-1]

    def of_vector(shared: Any, own: dict[str, Any]) -> Any:
        parts = dict(zip(moved, jnp.split(own["by"], ends), strict=True))
        changed = {key: part.reshape(lanes[key].shape[1:]) for key, part in parts.items()}
        floats = jax.tree.map(lambda x: x, own["fixed"] | changed)
        return jax.tree.map(lambda x: x * 1.0, function(shared, floats))

    fixed = {key: x for key, x in lanes.items() if key not in moved}
    return of_vector, shared, {"by": np.concatenate(list(moved.values()), axis=1), "fixed": fixed}


@pytest.mark.slow("arrays", "scan", "signals", "small tables")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_are_those_of_jacfwd(name: str) -> None:
    function, shared, own = along_numbers(name)
    values, slopes = by_kernel(function, shared, own)
    wanted = by_jacfwd(function, jax.tree.map(jnp.asarray, shared), own)
    alone = jax.vmap(function, in_axes=(None, 0))(jax.tree.map(jnp.asarray, shared), own)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12), values, alone)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-10), slopes, wanted)


def late(shared: Any, own: dict[str, Any]) -> Any:
    """A derivative that is zero at the start of a scan and of its first steps, and one that stays zero."""
    a, b, c = own["by"]

    def advance(carry: Any, given: jax.Array) -> tuple[Any, Any]:
        first, second, third, count = carry
        kept = jnp.where(given > 0.0, first * second, 1.0 / (1.0 + second**2))
        return (first * 0.9 + a, second * 0.8 + jnp.tanh(first), jnp.maximum(third, first) * b, count + 1), kept

    begin = (jnp.zeros(()), jnp.ones(()), jnp.zeros(()), jnp.asarray(0))
    (first, second, third, _), kept = lax.scan(advance, begin, shared["over"])
    return {"last": first * second, "third": third, "kept": kept, "none": 2.0 * shared["over"][0] + 0.0 * c}


@pytest.mark.parametrize("lanes", [4, 8, 16])
def test_what_a_scan_moves_later_is_found(lanes: int) -> None:
    shared, own = {"over": LONG}, {"by": RNG.uniform(0.1, 0.9, (LANES, 3))}
    _, slopes = by_kernel(late, shared, own, lanes)
    wanted = by_jacfwd(late, {"over": jnp.asarray(LONG)}, own)
    assert slopes["kept"].shape == (LANES, 3, LONG.size)
    assert not np.any(slopes["none"])
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-12), slopes, wanted)


def test_whole_numbers_have_no_derivatives() -> None:
    def function(_: Any, own: dict[str, Any]) -> Any:
        return {"value": own["by"][0] ** 2, "whole": jnp.floor(own["by"][1]).astype(int)}

    own = {"by": RNG.uniform(0.0, 9.0, (5, 2))}
    values, slopes = by_kernel(function, {}, own)
    np.testing.assert_array_equal(values["whole"], np.floor(own["by"][:, 1]))
    assert slopes["whole"] is None
    np.testing.assert_array_equal(slopes["value"], np.stack([2.0 * own["by"][:, 0], np.zeros(5)], axis=1))


def test_a_larger_of_equal_numbers_moves_by_half() -> None:
    """As in JAX."""
    own = {"by": np.array([[1.0, 1.0], [2.0, 1.0]])}
    _, slopes = by_kernel(lambda _, own: jnp.maximum(own["by"][0], own["by"][1]), {}, own)
    np.testing.assert_array_equal(slopes, [[0.5, 0.5], [1.0, 0.0]])
