"""The common form of all slow states, and its integration."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

State = dict[str, Array]


class Flow(eqx.Module):
    """dx/dt = source - decay x: an integral where decay is zero, else a relaxation to source / decay.

    It uses the decay instead of the time constant, so that a relaxation may stop (hysteresis at zero current) with
    finite values and derivatives. A known target is kept too: with it the solution needs one exponential and no
    division.
    """

    source: Float[Array, ""]
    decay: Float[Array, ""]
    target: Float[Array, ""] | None = None


def integral(rate) -> Flow:
    """Return the flow dx/dt = rate."""
    return Flow(jnp.asarray(rate), jnp.zeros(()))


def relaxation(target, time_constant) -> Flow:
    """Return the flow dx/dt = (target - x) / time_constant, with a time constant above zero, in s."""
    decay = 1.0 / jnp.asarray(time_constant)
    return Flow(target * decay, decay, jnp.asarray(target))


def mean_exponential(z):
    """Return (1 - e^(-z)) / z, the mean of e^(-s) over 0..z, exact through z = 0 in value and derivative."""
    near_zero = jnp.abs(z) < 1e-4
    away = jnp.where(near_zero, 1.0, z)
    return jnp.where(near_zero, 1.0 - z * (0.5 - z * (1.0 / 6.0 - z / 24.0)), -jnp.expm1(-away) / away)


def advance(state: State, flows: dict[str, Flow], duration) -> State:
    """Move each state over `duration` seconds by the exact solution of its flow with source and decay held.

    x(h) = x e^(-d h) + source h (1 - e^(-d h)) / (d h). States without a flow (those of the armature) stay.
    """
    moved = dict(state)
    for name, flow in flows.items():
        if flow.target is not None:
            # Rounding in 1 - e^-z only rounds the target; `expm1` would cost three times as much.
            moved[name] = state[name] + (flow.target - state[name]) * (1.0 - jnp.exp(-flow.decay * duration))
            continue
        # x + h (source - d x) mean(e^-ds) is the same solution, and exact for an integral.
        rate = flow.source - flow.decay * state[name]
        moved[name] = state[name] + duration * rate * mean_exponential(flow.decay * duration)
    return moved
