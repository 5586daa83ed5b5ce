"""The root of a rising scalar function, as part of a compiled step."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from jaxmodel.declaration import Scalar

# Halving takes over where Newton's method leaves the bracket: seven halvings and five steps of Newton find a bend of a
# hundredth of the bracket to rounding.
ROUNDS = 14


def rising_root(function: Callable[[Scalar], Scalar], near: Scalar, least_slope: Scalar) -> Scalar:
    """Return the x where a rising function is zero: Newton's method within a bracket that always holds the root.

    Args:
        function: of one scalar; its slope is at least `least_slope` everywhere.
        near: where to begin; one end of the bracket.
        least_slope: above zero; it bounds how far away the root can be.
    """
    value = function(near)
    far = near - value / least_slope
    bracket = (jnp.minimum(near, far), jnp.maximum(near, far), near)

    def narrow(_, bracket):
        low, high, x = bracket
        value, slope = jax.jvp(function, (x,), (jnp.ones(()),))
        low, high = jnp.where(value < 0.0, x, low), jnp.where(value > 0.0, x, high)
        newton = x - value / jnp.maximum(slope, least_slope)
        inside = (newton >= low) & (newton <= high)
        return low, high, jnp.where(inside, newton, 0.5 * (low + high))

    found = jax.lax.stop_gradient(jax.lax.fori_loop(0, ROUNDS, narrow, jax.lax.stop_gradient(bracket)))[2]
    # One more step from the root, now with derivatives: those of the root by whatever the function depends on.
    slope = jax.lax.stop_gradient(jax.jvp(function, (found,), (jnp.ones(()),))[1])
    return found - function(found) / jnp.maximum(slope, least_slope)
