"""What is compiled once for all calls that are alike."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.lanes import Kernel, NotNative, Pool, over

SHARED, OWN = np.arange(3.0), {"x": np.float64(0.0)}


def test_calls_that_are_alike_share_a_kernel_and_others_do_not() -> None:
    def by(known_by: str, shared: np.ndarray = SHARED, single: bool = False) -> Kernel:
        return over(Kernel, lambda some, own: jnp.sum(some) * own["x"], shared, OWN, known_by, single=single)

    first = by("sum of three")
    assert by("sum of three", SHARED + 1.0) is first
    assert by("sum of another three") is not first
    assert by("sum of three", np.arange(4.0)) is not first
    assert by("sum of three", single=True).module.results[0].dtype == np.float32
    with Pool(1) as pool:
        found = pool.start(first, SHARED + 1.0, {"x": np.array([1.0, 2.0])}, 2, 1).tree()
    np.testing.assert_array_equal(found, [6.0, 12.0])


def test_a_refusal_is_found_once() -> None:
    traced = []

    def sorts(some: jax.Array, own: dict[str, jax.Array]) -> jax.Array:
        traced.append(1)
        return jnp.sort(some * own["x"])[0]

    for _ in range(2):
        with pytest.raises(NotNative, match="sort"):
            over(Kernel, sorts, SHARED, OWN, "sorts")
    assert len(traced) == 1
