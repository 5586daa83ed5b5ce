"""Which inputs of a program can influence its outputs at all, read off the traced program rather than off its values.

A derivative cannot show it: it may be zero at one point (friction at standstill) and not at the next. The program can:
the mass of a robot whose load torque is given is nowhere on the way to any output.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from jax.extend.core import Jaxpr, JaxprEqn, Literal

from jaxmodel.lanes.jaxprs import opened, parts_of_scan


def influential(function: Callable[[dict[str, Any]], Any], arguments: dict[str, Any]) -> set[str]:
    """Return the names of the arguments, scalars by name, on which any output of a function may depend."""
    program = jax.make_jaxpr(function)(arguments).jaxpr
    in_order = sorted(arguments)  # as jax flattens a dictionary
    return {
        name for name, live in zip(in_order, _live_inputs(program, [True] * len(program.outvars)), strict=True) if live
    }


def _live_inputs(program: Jaxpr, live_outputs: list[bool]) -> list[bool]:
    """Go back through a program and return which of its inputs are on the way to its live outputs."""
    live = {v for v, wanted in zip(program.outvars, live_outputs, strict=True) if wanted and not isinstance(v, Literal)}
    for equation in reversed(program.eqns):
        outputs = [v in live for v in equation.outvars]
        if any(outputs):
            needed = zip(equation.invars, _needed(equation, outputs), strict=True)
            live |= {v for v, wanted in needed if wanted and not isinstance(v, Literal)}
    return [v in live for v in program.invars]


def _needed(equation: JaxprEqn, outputs: list[bool]) -> list[bool]:
    """Return which inputs of one equation its live outputs need; all of them where nothing more is known."""
    if equation.primitive.name == "optimization_barrier":
        return outputs  # it passes each operand on as it is
    if equation.primitive.name == "scan":
        return _needed_by_scan(equation, outputs)
    inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
    body = None if inner is None else opened(inner)[0]
    if body is not None and (len(body.invars), len(body.outvars)) == (len(equation.invars), len(outputs)):
        return _live_inputs(body, outputs)
    return [True] * len(equation.invars)


def _needed_by_scan(equation: JaxprEqn, outputs: list[bool]) -> list[bool]:
    """Repeat the body until no more of its carry comes alive: what one step needs, the step before must give."""
    constants, carried = parts_of_scan(equation.params, len(equation.invars))
    body, _ = opened(equation.params["jaxpr"])
    while True:
        needed = _live_inputs(body, outputs)
        carry = [a or b for a, b in zip(outputs[:carried], needed[constants : constants + carried], strict=True)]
        if carry == outputs[:carried]:
            return needed
        outputs = carry + outputs[carried:]
