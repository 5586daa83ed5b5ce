"""What need not be computed: equations that count only by a switch that may be 0 in all lanes of a packet."""

from __future__ import annotations

import collections
from collections.abc import Sequence
from typing import Any

from jax.extend.core import Jaxpr, Literal

from jaxmodel.lanes.jaxprs import length_of
from jaxmodel.lanes.switch import SWITCHED

# Fewer equations are computed whether they count or not: a jump takes as long.
LEAST = 3


def behind_switches(jaxpr: Jaxpr, needed: Sequence[bool]) -> dict[int, list[int]]:
    """Return the places of equations `switched`, each with those of the equations that nothing else needs.

    Args:
        jaxpr: of a lane.
        needed: whether a result depends on an equation, for each.
    """
    uses: dict[Any, set[tuple[int, int]]] = collections.defaultdict(set)
    for number, equation in enumerate(jaxpr.eqns):
        if needed[number]:
            for place, atom in enumerate(equation.invars):
                if not isinstance(atom, Literal):
                    uses[atom].add((number, place))
    for atom in jaxpr.outvars:
        if not isinstance(atom, Literal):
            uses[atom].add((len(jaxpr.eqns), 0))
    made_by = {v: number for number, equation in enumerate(jaxpr.eqns) for v in equation.outvars}
    found: dict[int, list[int]] = {}
    taken: set[int] = set()
    for number, equation in enumerate(jaxpr.eqns):
        if not (needed[number] and _is_switched(equation)):
            continue
        inside: set[int] = set()
        asked = [] if isinstance(equation.invars[2], Literal) else [equation.invars[2]]
        while asked:
            if (earlier := made_by.get(asked.pop())) is None or earlier in inside:
                continue
            used = (use for v in jaxpr.eqns[earlier].outvars for use in uses[v])
            if all(use == (number, 2) or use[0] in inside for use in used):
                inside.add(earlier)
                asked += [atom for atom in jaxpr.eqns[earlier].invars if not isinstance(atom, Literal)]
        alone = sorted(inside - taken)
        if sum(length_of(jaxpr.eqns[one]) for one in alone) >= LEAST:
            found[number] = alone
            taken |= inside
    return found


def _is_switched(equation: Any) -> bool:
    is_call = equation.primitive.name in ("jit", "pjit") and equation.params.get("name") == SWITCHED
    return is_call and len(equation.invars) == 3 and all(v.aval.shape == () for v in equation.invars)
