"""The loop over the steps of a run: all of them, or as many as the longest of some runs needs."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmodel.kernel import as_one_kernel

# Steps between two questions whether there are more.
ROUND = 128


def states_after(advance: Callable, begin, given, steps: Array | None, one_kernel: bool):
    """Return the states after every step, stacked along a first axis.

    Args:
        advance: from a state and what is given for one step to the next state.
        begin: the state before; arrays without axes.
        given: for every step, along a first axis, a multiple of `ROUND` long where not all are needed.
        steps: how many are needed, the same for all lanes; all where None. Those past them take no time, and what
            stands for them is the last state. There is no reverse mode through them.
        one_kernel: see `jaxmodel.kernel`.
    """
    run = as_one_kernel if one_kernel else _plainly

    def follow(state, given):
        def keep(state, given):
            state = advance(state, given)
            return state, state

        return jax.lax.scan(keep, state, given)

    if steps is None:
        return run(follow, begin, given)[1]

    def follow_rounds(begin, given, rounds, kept):
        def follow_one(number, carried):
            state, kept = carried
            some = jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, number, keepdims=False), given)
            state, more = follow(state, some)  # a scan has its lanes side by side; a loop of single steps has not
            kept = jax.tree.map(lambda x, new: jax.lax.dynamic_update_index_in_dim(x, new, number, 0), kept, more)
            return state, kept

        return jax.lax.fori_loop(0, rounds, follow_one, (begin, kept))

    # Room is made, and filled, outside of the kernel: there, large arrays are none of its business.
    given = jax.tree.map(lambda x: x.reshape(-1, ROUND), given)
    rounds, (count, _) = -(-steps // ROUND), jax.tree.leaves(given)[0].shape
    room = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, ROUND)), begin)
    last, kept = run(follow_rounds, begin, given, rounds, room)
    past = jnp.repeat(jnp.arange(count) >= rounds, ROUND)
    return jax.tree.map(lambda x, held: jnp.where(past, held, x.reshape(-1)), kept, last)


def _plainly(function: Callable, *arguments):
    return function(*arguments)
