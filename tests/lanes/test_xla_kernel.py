"""A scan as one kernel: the same values, whatever operations a user's effect puts into it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.lanes.xla_kernel import as_one_kernel

KNOTS = jnp.linspace(0.0, 2.0, 7)
MATRIX = jnp.array([[0.5, 0.1, 0.0], [0.2, 0.4, 0.1], [0.0, 0.3, 0.6]])

OPERATIONS = {
    "arithmetic": lambda x: jnp.tanh(x) * jnp.exp(-x) + jnp.where(x > 0.4, x**2, jnp.sign(x)),
    "interp": lambda x: jnp.interp(x, KNOTS, jnp.sin(KNOTS)),
    "gather": lambda x: jnp.sin(KNOTS)[(3 * jnp.abs(x)).astype(int) % 7],
    "matrix product": lambda x: MATRIX @ x,
    "linear solve": lambda x: jnp.linalg.solve(MATRIX + jnp.eye(3), x),
    "sort": lambda x: jnp.sort(jnp.cos(x)),
    "scatter": lambda x: x.at[jnp.array([0, 0, 2])].add(0.1 * x),
    "cumulative sum": lambda x: jnp.cumsum(x) / 3.0,
    "minimum of several": lambda x: x - jnp.min(x) + 0.1 * jnp.argmin(x),
    "branch": lambda x: jax.lax.cond(x[0] > 0.5, lambda y: 0.5 * y, lambda y: y + 0.1, x),
    "loop": lambda x: jax.lax.fori_loop(0, 3, lambda _, y: 0.9 * y + 0.01, x),
    "special function": lambda x: jax.scipy.special.erf(x) + 0.1,
    "reverse": lambda x: 0.9 * x[::-1] + 0.05,
    "noise": lambda x: x + 0.01 * jax.random.normal(jax.random.key(0), (3,)),
    "fourier": lambda x: jnp.abs(jnp.fft.rfft(x, 4)),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_values_and_derivatives_are_those_of_the_plain_scan(name: str):
    start = jnp.array([0.2, 0.7, 1.1])

    def plain(x):
        return jax.lax.scan(lambda y, _: (OPERATIONS[name](y), jnp.sum(y)), x, length=5)

    def as_one(x):
        return as_one_kernel(plain, x)

    several = jnp.stack([start, 0.5 * start])
    pairs = [(plain, as_one, start), (jax.vmap(plain), jax.vmap(as_one), several)]
    pairs += [
        (jax.jacfwd(plain), jax.jacfwd(as_one), start),
        (jax.vmap(jax.jacrev(plain)), jax.vmap(jax.jacrev(as_one)), several),
    ]
    for expected, found, at in pairs:
        for a, b in zip(jax.tree.leaves(jax.jit(expected)(at)), jax.tree.leaves(jax.jit(found)(at)), strict=True):
            np.testing.assert_allclose(b, a, rtol=1e-12, atol=1e-14)
