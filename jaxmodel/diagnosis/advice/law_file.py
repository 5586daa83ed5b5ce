"""Source code of an effect class for a fitted law, to be edited, refitted and swept."""

from __future__ import annotations

import textwrap

import numpy as np

from jaxmodel.fit.candidates import Candidate
from jaxmodel.fit.laws import PORTS

# Expressions for the quantities at a port of the cell, and at one of the motor.
_IN_CELL = {
    "soc": "context.soc",
    "current_A": "context.current_A",
    "ambient_degC": "context.ambient_degC",
    "cell_temperature_degC": "context.temperature_degC",
    "cycles": "context.parameters.cycles",
}
_IN_MOTOR = {
    "current_A": "context.current_A",
    "speed_rad_s": "context.speed_rad_s",
    "ambient_degC": "context.ambient_degC",
    "winding_temperature_degC": "context.winding_degC",
    "duty": "context.duty",
}
_CLOCK = 'context.state["found_law.time_s"]'
_TEMPLATE = '''"""A law found by `jaxmodel diagnose` in the case '{case}':

{sentence}.

Replace the table by a physical formula with a name and parameters, then fit it:

    jaxmodel diagnose CASE --effect found_law.py:FoundLaw --add found_law
"""

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel import Effect, Scalar, between_knots, {also}parameter

AT = ({knots})  # {variable}
LAW = jnp.array([{values}])


class FoundLaw(Effect):
    """{port}: + s f({variable}){times}."""

    name: ClassVar[str] = "found_law"
    kinds: ClassVar[tuple[str, ...]] = ("{kind}",)
    equation: ClassVar[str] = "{port} += s f({variable}){times}"
    s: Scalar = parameter(
        1.0, unit="", meaning="strength; 1 is as found", null=0.0, lower=-100.0, upper=100.0, typical=(0.3, 3.0)
    )
{clock}
    def {port}(self, value, context):
        """Add the law."""
        return value + self.s * between_knots({where}, AT, LAW){factor}
'''
_OWN_CLOCK = '''
    def initial_state(self, parameters, ambient_degC):
        """Start a clock, because ports do not receive the time."""
        return {"found_law.time_s": jnp.zeros(())}

    def flows(self, cell, motor, heat_W):
        """Advance the clock."""
        return {"found_law.time_s": integral(1.0)}
'''


def law_file(candidate: Candidate, values: np.ndarray, knots: np.ndarray, kind: str, case: str) -> str | None:
    """Return the source of an effect class that adds a fitted law to its port; None if a port cannot express the law.

    Args:
        candidate: the law.
        values: at its knots, in the port's unit, per unit of its multiplier.
        knots: in the unit of its variable.
        kind: of the case.
        case: its name.
    """
    if candidate.port not in PORTS[kind] or knots.size < 2:
        return None
    sources, _, equation = PORTS[kind][candidate.port]
    in_cell = candidate.port in PORTS["cell"]
    known = (_IN_CELL if in_cell else _IN_MOTOR) | {"time_s": _CLOCK, "load_torque_Nm": "value"}
    for name in filter(None, (candidate.over, candidate.multiplier)):
        if name not in sources or name not in known:
            return None
    timed = candidate.over == "time_s"
    proportional = f" proportional to {candidate.multiplier}" if candidate.multiplier else ""
    sentence = (
        f"A term is added to {equation}{proportional}, as a function of {candidate.over}: from "
        f"{values.min():.3g} to {values.max():.3g} over {knots[0]:.3g} to {knots[-1]:.3g}"
    )

    def numbers(values: np.ndarray) -> str:
        return ", ".join(repr(float(f"{value:.8g}")) for value in values)

    return _TEMPLATE.format(
        case=case,
        sentence="\n".join(textwrap.wrap(sentence, 116)),
        also="integral, " if timed else "",
        knots=numbers(knots),
        values=numbers(values),
        variable=candidate.over,
        port=candidate.port,
        times=f" {candidate.multiplier}" if candidate.multiplier else "",
        kind=kind,
        clock=_OWN_CLOCK if timed else "",
        where=known[candidate.over],
        factor=f" * {known[candidate.multiplier]}" if candidate.multiplier else "",
    )
