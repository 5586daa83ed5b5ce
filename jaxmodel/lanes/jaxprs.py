"""What a traced program holds inside its operations, whichever release of JAX traced it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from jax.extend.core import ClosedJaxpr, Jaxpr


def opened(program: ClosedJaxpr | Jaxpr) -> tuple[Jaxpr, Sequence[Any]]:
    """Return a program inside an operation and its constants; from JAX 0.11 on it is no `ClosedJaxpr`."""
    if isinstance(program, ClosedJaxpr):
        return program.jaxpr, program.consts
    return program, getattr(program, "consts", ()) if program.constvars else ()


def parts_of_scan(params: Mapping[str, Any], arguments: int) -> tuple[int, int]:
    """Return how many of a scan's arguments its steps share, and how many they carry; the others are its rows."""
    if "num_consts" in params:
        return params["num_consts"], params["num_carry"]
    fixed, carried, _ = (list(part) for part in params["ft_in"].update(range(arguments)).unpack())  # from JAX 0.11 on
    return len(fixed), len(carried)


def length_of(equation: Any) -> int:
    """Return how many operations an equation has, those of the functions that it calls too."""
    inner = equation.params.get("jaxpr")
    return 1 if inner is None else length(getattr(inner, "jaxpr", inner))


def length(jaxpr: Any) -> int:
    """Return how many operations a function has, those of the functions that it calls too."""
    return sum(map(length_of, jaxpr.eqns))
