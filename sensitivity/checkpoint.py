"""Reverse mode in little memory and time: what a step computes on its way is not kept but computed again.

Reverse mode needs every step's intermediate numbers, last step first. Kept, some hundred numbers a step go to memory
and back, which takes twenty times as long as the run. Here a step keeps its state alone and is run again, forward and
back in one piece. A long run is cut into blocks of sqrt(steps), of which only the first state is kept: memory grows
with the root of the run's length, for one more forward run.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, jaxpr_as_fun

from jaxmodel.lanes.jaxprs import opened, parts_of_scan
from jaxmodel.lanes.xla_kernel import as_one_kernel, holds_constants

# A scan shorter than this is left as it is; one longer than that is cut into blocks.
SHORTEST, LONGEST = 16, 4096


def in_blocks(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return function(*arguments), the steps of every scan in it computed anew for a gradient, long scans in blocks.

    Values are those of the function; only what is kept for its gradient differs. Pure; may be vmapped, and
    differentiated in either mode.
    """
    program, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    outputs = _evaluate(program, jax.tree.leaves(arguments))
    return jax.tree.unflatten(jax.tree.structure(shapes), outputs)


def _evaluate(program: ClosedJaxpr | Jaxpr, arguments: Sequence[Any]) -> list[Any]:
    """Evaluate a traced program equation by equation, long scans in blocks."""
    jaxpr, constants = opened(program)
    known = dict(zip(jaxpr.constvars, constants, strict=True))
    known |= dict(zip(jaxpr.invars, arguments, strict=True))

    def read(atom: Any) -> Any:
        return atom.val if isinstance(atom, Literal) else known[atom]

    for equation in jaxpr.eqns:
        given = [read(atom) for atom in equation.invars]
        name = equation.primitive.name
        if name == "scan" and equation.params["length"] >= SHORTEST and not equation.params["reverse"]:
            found = _scan_in_blocks(equation, given)
        elif name in ("jit", "pjit"):
            found = _evaluate(equation.params["jaxpr"], given)
        else:
            found = equation.primitive.bind(*given, **equation.params)
            found = found if equation.primitive.multiple_results else [found]
        known |= dict(zip(equation.outvars, found, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _scan_in_blocks(equation: JaxprEqn, given: Sequence[Any]) -> list[Any]:
    constants, carried = parts_of_scan(equation.params, len(given))
    body = jaxpr_as_fun(ClosedJaxpr(*opened(equation.params["jaxpr"])))
    fixed, carry = tuple(given[:constants]), tuple(given[constants : constants + carried])
    rows = tuple(given[constants + carried :])
    length = equation.params["length"]

    def steps_from(fixed: tuple[Any, ...], carry: tuple[Any, ...], some: tuple[Any, ...]) -> tuple[Any, Any]:
        def step(carry: tuple[Any, ...], row: tuple[Any, ...]) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
            after = body(*fixed, *carry, *row)
            return tuple(after[:carried]), tuple(after[carried:])

        # In a scan nothing can be shared with the first pass anyway: no need to forbid it, which would forbid fusion.
        return jax.lax.scan(jax.checkpoint(step, prevent_cse=False), carry, some, length=None if some else length)

    if length <= LONGEST:
        run = steps_from if holds_constants((fixed, carry, rows)) else functools.partial(as_one_kernel, steps_from)
        carry, outputs = run(fixed, carry, rows)
        return [*carry, *outputs]

    def steps(carry: tuple[Any, ...], some: tuple[Any, ...]) -> tuple[Any, Any]:
        return steps_from(fixed, carry, some)

    block = math.isqrt(length)
    whole = length // block * block
    in_front = tuple(x[:whole].reshape(-1, block, *x.shape[1:]) for x in rows)
    carry, outputs = jax.lax.scan(jax.checkpoint(steps, prevent_cse=False), carry, in_front)
    outputs = [x.reshape(whole, *x.shape[2:]) for x in outputs]
    if whole < length:
        carry, rest = steps(carry, tuple(x[whole:] for x in rows))
        outputs = [jnp.concatenate(pair) for pair in zip(outputs, rest, strict=True)]
    return [*carry, *outputs]
