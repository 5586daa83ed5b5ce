"""The loop over the steps of a run: all of them, or only those needed by the longest of some runs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmodel.lanes.xla_kernel import as_one_kernel

# Steps between two checks whether more are needed.
ROUND = 128


def states_after(advance: Callable, begin, given, steps: Array | None, one_kernel: bool):
    """Return the states after every step, stacked along a first axis.

    Args:
        advance: from a state and what is given for one step to the next state.
        begin: the state before; arrays without axes.
        given: inputs of every step along a first axis; its length is a multiple of `ROUND` if not all are needed.
        steps: number of needed steps, the same for all lanes; None for all. Later ones are skipped, with the last state
            as their result. Reverse mode is not available with them.
        one_kernel: see `jaxmodel.lanes.xla_kernel`.
    """
    run = as_one_kernel if one_kernel else _plainly
    if steps is None:
        return run(partial(_follow, advance, lambda state, _: state), begin, given)[1]
    last, kept = _in_rounds(run, advance, lambda state, _: state, begin, given, steps)
    past = jnp.repeat(jnp.arange(-(-_count(given) // ROUND)) >= -(-steps // ROUND), ROUND)
    return jax.tree.map(lambda x, held: jnp.where(past, held, x), kept, last)


def observed_after(advance: Callable, observe: Callable, begin, given, steps: Array | None, one_kernel: bool):
    """Return observations after every step, stacked along a first axis; undefined after the needed steps, if stated.

    Args:
        advance: as of `states_after`.
        observe: from the state after a step, and its inputs, to numbers.
        begin: as of `states_after`.
        given: the same.
        steps: the same.
        one_kernel: the same.
    """
    run = as_one_kernel if one_kernel else _plainly
    if steps is None:
        return run(partial(_follow, advance, observe), begin, given)[1]
    return _in_rounds(run, advance, observe, begin, given, steps)[1]


def _count(given) -> int:
    """Return the number of given steps."""
    return jax.tree.leaves(given)[0].shape[0]


def _follow(advance: Callable, observe: Callable, state, given):
    def keep(state, given):
        after = advance(state, given)
        return after, observe(after, given)

    return jax.lax.scan(keep, state, given)


def _in_rounds(run: Callable, advance: Callable, observe: Callable, begin, given, steps: Array):
    """Return the last state, and the outputs of every step; rounds that are not needed are skipped."""

    def follow_rounds(begin, given, rounds, kept):
        def follow_one(number, carried):
            state, kept = carried
            some = jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, number, keepdims=False), given)
            # A scan has its lanes side by side; a loop of single steps has not.
            state, more = _follow(advance, observe, state, some)
            kept = jax.tree.map(lambda x, new: jax.lax.dynamic_update_index_in_dim(x, new, number, 0), kept, more)
            return state, kept

        return jax.lax.fori_loop(0, rounds, follow_one, (begin, kept))

    # Room is made, and filled, outside of the kernel: there, large arrays are none of its business.
    given = jax.tree.map(lambda x: x.reshape(-1, ROUND), given)
    rounds, (count, _) = -(-steps // ROUND), jax.tree.leaves(given)[0].shape
    first = observe(begin, jax.tree.map(lambda x: x[0, 0], given))
    room = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, ROUND)), first)
    last, kept = run(follow_rounds, begin, given, rounds, room)
    return last, jax.tree.map(lambda x: x.reshape(-1), kept)


def _plainly(function: Callable, *arguments):
    return function(*arguments)
