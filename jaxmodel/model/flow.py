"""The common form of all slow states, and its integration."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.lanes.switch import switched

State = dict[str, Array]
"""What a step carries on, by name; the states of an effect are called `effect.state`."""
# Ends the name of what is lost when a state is added to.
REST = ".rest"


class Flow(eqx.Module):
    """dx/dt = source - decay x: an integral where decay is zero, else a relaxation to source / decay.

    It uses the decay instead of the time constant, so that a relaxation may stop (hysteresis at zero current) with
    finite values and derivatives. Without a decay it is an integral. A known target is kept too: with it the solution
    needs one exponential and no division. The state of an effect that is switched off stays: kernels then leave out
    what would move it.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import relaxation
        >>> flow = relaxation(jnp.array(5.0), jnp.array(20.0))  # to 5, with 20 s
        >>> float(flow.source / flow.decay)
        5.0
    """

    source: Float[Array, ""]
    decay: Float[Array, ""] | None = None
    target: Float[Array, ""] | None = None
    switch: Float[Array, ""] | None = None


def integral(rate) -> Flow:
    """Return the flow dx/dt = rate.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import integral
        >>> integral(jnp.array(2.0)).source
        Array(2., dtype=float64, weak_type=True)
    """
    return Flow(jnp.asarray(rate))


def relaxation(target, time_constant) -> Flow:
    """Return the flow dx/dt = (target - x) / time_constant, with a time constant above zero, in s.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import relaxation
        >>> flow = relaxation(jnp.array(5.0), jnp.array(20.0))
        >>> float(flow.target), float(flow.decay)
        (5.0, 0.05)
    """
    decay = 1.0 / jnp.asarray(time_constant)
    return Flow(target * decay, decay, jnp.asarray(target))


def mean_exponential(z):
    """Return (1 - e^(-z)) / z, the mean of e^(-s) over 0..z, exact through z = 0 in value and derivative."""
    near_zero = jnp.abs(z) < 1e-4
    away = jnp.where(near_zero, 1.0, z)
    return jnp.where(near_zero, 1.0 - z * (0.5 - z * (1.0 / 6.0 - z / 24.0)), -jnp.expm1(-away) / away)


def advance(state: State, flows: dict[str, Flow], duration) -> State:
    """Move each state over `duration` seconds by the exact solution of its flow with source and decay held.

    x(h) = x e^(-d h) + source h (1 - e^(-d h)) / (d h). States without a flow (those of the armature) stay. A state
    that `with_rests` gave one is added up without loss, in float32 too.
    """
    moved = dict(state)
    for name, flow in flows.items():
        rest = state.get(name + REST)
        if flow.decay is None:
            move = duration * flow.source
        elif flow.target is not None:
            # Rounding in 1 - e^-z only rounds the target; `expm1` would cost three times as much. In float32 it would
            # round it visibly where z is small.
            z = flow.decay * duration
            share = 1.0 - jnp.exp(-z) if rest is None else -jnp.expm1(-z)
            move = (flow.target - state[name]) * share
        else:
            # x + h (source - d x) mean(e^-ds) is the same solution, and exact where the decay is zero.
            rate = flow.source - flow.decay * state[name]
            move = duration * rate * mean_exponential(flow.decay * duration)
        if flow.switch is not None:
            move = switched(flow.switch, jnp.zeros_like(move), move)
        if rest is None:
            moved[name] = state[name] + move
        else:
            moved[name], moved[name + REST] = sum_and_rest(state[name], rest, move)
    return moved


def with_rests(state: State) -> State:
    """Return a state with a place for what is lost when each of its numbers is added to."""
    return state | {name + REST: jnp.zeros_like(value) for name, value in state.items()}


def sum_and_rest(total, rest, part):
    """Return total + rest + part, rounded, and what the rounding lost (Kahan's sum)."""
    added = part + rest
    now = total + added
    return now, added - (now - total)
