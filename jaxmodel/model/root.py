"""The root of an increasing scalar function, as part of a compiled step."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from jaxmodel.model.declaration import Scalar

# The bracket is narrowed until it, or the function, is this share of its initial size; one Newton step from there is
# exact to rounding, wherever a kink lies in the bracket.
NARROW = 1e-10
# Enough for all of 400,000 brush drops.
MOST_ROUNDS = 24


def rising_root(function: Callable[[Scalar], Scalar], near: Scalar, least_slope: Scalar) -> Scalar:
    """Return the root of an increasing function: Chandrupatla's method in a bracket, then one Newton step.

    Newton's method alone may oscillate between the sides of a kink. This method starts at the secant through both ends,
    then bisects unless inverse quadratic interpolation is reliable (Chandrupatla 1997). Values that are not finite,
    such as those of a law beyond its range, count as beyond the root.

    Args:
        function: of one scalar; its slope is at least `least_slope` everywhere.
        near: start; one end of the bracket.
        least_slope: above zero; it bounds how far away the root can be.
    """
    value = function(near)
    far = near - value / least_slope

    def side(x):
        at_x = function(x)
        return jax.lax.stop_gradient(jnp.where(jnp.isnan(at_x), -jnp.inf * jnp.sign(value), at_x))

    a, b, at_a = jax.lax.stop_gradient((near, far, value))
    at_b = side(far)
    near_enough = NARROW * jnp.abs(b - a), NARROW * jnp.abs(at_a)

    def goes_on(points):
        rounds, _, (a, b, _), (at_a, at_b, _) = points
        wide = jnp.abs(a - b) > near_enough[0]
        return wide & (jnp.minimum(jnp.abs(at_a), jnp.abs(at_b)) > near_enough[1]) & (rounds < MOST_ROUNDS)

    def narrow(points):
        rounds, share, (a, b, c), (at_a, at_b, at_c) = points
        x = a + share * (b - a)
        at_x = side(x)
        same_side = jnp.sign(at_x) == jnp.sign(at_a)
        c, at_c = jnp.where(same_side, a, b), jnp.where(same_side, at_a, at_b)
        b, at_b = jnp.where(same_side, b, a), jnp.where(same_side, at_b, at_a)
        a, at_a = x, at_x
        place, height = _ratio(a - b, c - b), _ratio(at_a - at_b, at_c - at_b)
        trusted = (height**2 < place) & ((1.0 - height) ** 2 < 1.0 - place)
        quadratic = _ratio(at_a, at_b - at_a) * _ratio(at_c, at_b - at_c)
        quadratic += _ratio(c - a, b - a) * _ratio(at_a, at_c - at_a) * _ratio(at_b, at_c - at_b)
        share = jnp.where(trusted, jnp.clip(quadratic, 1e-9, 1.0 - 1e-9), 0.5)
        return rounds + 1, share, (a, b, c), (at_a, at_b, at_c)

    straight = _ratio(at_a, at_a - at_b)  # root of the secant
    points = jnp.asarray(0), straight, (a, b, a), (at_a, at_b, at_a)
    _, _, (a, b, _), (at_a, at_b, _) = jax.lax.while_loop(goes_on, narrow, points)
    found = jax.lax.stop_gradient(jnp.where(jnp.abs(at_a) < jnp.abs(at_b), a, b))
    # One more step with derivatives, which gives those of the root with respect to the function's parameters.
    slope = jax.lax.stop_gradient(jax.jvp(function, (found,), (jnp.ones(()),))[1])
    return found - function(found) / jnp.maximum(slope, least_slope)


def _ratio(numerator: Scalar, denominator: Scalar) -> Scalar:
    """Return the quotient, or the numerator if the denominator is zero."""
    return numerator / jnp.where(denominator == 0.0, 1.0, denominator)
