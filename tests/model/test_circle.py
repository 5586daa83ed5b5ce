"""Sine and cosine of our own are those of the library, derivatives too."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.model.circle import sine_and_cosine

ANGLES = np.concatenate(
    [[0.0], np.geomspace(1e-12, 1e-3, 50), np.linspace(0.0, 40.0, 4001), np.geomspace(40, 1e6, 500)]
)
QUADRANTS = 0.5 * np.pi * (np.arange(0, 24)[:, None] + np.array([-1e-9, 0.0, 1e-9, 0.5 - 1e-9, 0.5 + 1e-9]))


def test_values_and_two_derivatives_over_all_quadrants():
    angles = np.concatenate([ANGLES, np.abs(QUADRANTS.ravel())])
    exact = np.sin(angles.astype(np.longdouble)), np.cos(angles.astype(np.longdouble))

    def derivative(function):
        return lambda x: jax.jvp(function, (x,), (jnp.ones(()),))[1]

    for function, (sine, cosine) in (
        (sine_and_cosine, exact),
        (derivative(sine_and_cosine), (exact[1], -exact[0])),
        (derivative(derivative(sine_and_cosine)), (-exact[0], -exact[1])),
    ):
        found = jax.jit(jax.vmap(function))(jnp.asarray(angles))
        np.testing.assert_allclose(np.asarray(found[0]), sine, rtol=0, atol=2e-15)
        np.testing.assert_allclose(np.asarray(found[1]), cosine, rtol=0, atol=2e-15)
