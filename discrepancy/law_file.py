"""A found law as a file with an effect class, ready to be edited, refitted and swept."""

from __future__ import annotations

import textwrap

import numpy as np

from discrepancy.misfit import Block
from jaxmodel.ports import CELL_PORTS, MOTOR_PORTS

# Where an effect finds a condition on a port of the cell, and on one of the motor.
_IN_CELL = {
    "soc": "context.soc",
    "current_A": "context.current_A",
    "ambient_degC": "context.ambient_degC",
    "cell_temperature_degC": "context.temperature_degC",
    "cycles": "context.parameters.cycles",
}
_IN_MOTOR = {
    "current_A": "context.current_A",
    "motor_current_A": "context.current_A",
    "speed_rad_s": "context.speed_rad_s",
    "ambient_degC": "context.ambient_degC",
    "winding_temperature_degC": "context.winding_degC",
    "case_temperature_degC": "context.case_degC",
    "duty": "context.duty",
    "voltage_V": "context.pack_voltage_V",
    "soc": 'context.state["soc"]',
}
_CLOCK = "found_law.time_s"
_TEMPLATE = '''"""A law found by `jaxmodel diagnose` in the case '{case}':

{sentence}.

Give it the form that physics has for it, a name and better parameters, then fit it:

    jaxmodel diagnose CASE --effect found_law.py:FoundLaw
"""

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.declaration import Scalar, parameter
{imports}from jaxmodel.ports import Effect

AT = jnp.array([{knots}])  # {variable}
LAW = jnp.array([{values}])


class FoundLaw(Effect):
    """{port}: {sign} s f({variable}){times}."""

    name: ClassVar[str] = "found_law"
    kinds: ClassVar[tuple[str, ...]] = ("{kind}",)
    equation: ClassVar[str] = "{port} {sign}= s f({variable}){times}"
    s: Scalar = parameter(
        1.0, unit="", meaning="strength; 1 is as found", null=0.0, lower=-100.0, upper=100.0, typical=(0.3, 3.0)
    )
{clock}
    def {port}(self, value, context):
        """Add the law."""
        return value {sign} self.s * jnp.interp({where}, AT, LAW){factor}
'''
_OWN_CLOCK = '''
    def initial_state(self, parameters, ambient_degC):
        """Start a clock: a port does not know the time."""
        return {"found_law.time_s": jnp.zeros(())}

    def flows(self, cell, motor, heat_W):
        """Let it run."""
        return {"found_law.time_s": integral(1.0)}
'''


def law_file(block: Block, kind: str, case: str) -> str | None:
    """Return the source of an effect class that adds a found law to its port; None where no port could carry it.

    Args:
        block: the law; one of a channel is taken where the channel is the voltage, as a drop of it.
        kind: of the case.
        case: its name.
    """
    port, sign, per_cell = block.port, "+", ""
    if not port and block.channel in ("voltage_V", "pack_voltage_V"):
        port, sign = "overpotential", "-"
        per_cell = " / context.parameters.n_series" if block.channel == "pack_voltage_V" else ""
    if port not in CELL_PORTS | MOTOR_PORTS:
        return None
    known = dict(_IN_CELL if port in CELL_PORTS else _IN_MOTOR) | {"time_s": f'context.state["{_CLOCK}"]'}
    if port == "load_torque":
        known["load_torque_Nm"] = "value"
    if block.variable not in known or (block.multiplier and block.multiplier not in known):
        return None
    timed = "time_s" in (block.variable, block.multiplier)

    def numbers(values: np.ndarray) -> str:
        return ", ".join(f"{value:.6g}" for value in values)

    return _TEMPLATE.format(
        case=case,
        sentence="\n".join(textwrap.wrap(block.sentence()[:1].upper() + block.sentence()[1:], 116)),
        imports="from jaxmodel.flow import integral\n" if timed else "",
        knots=numbers(block.knots),
        values=numbers(block.law),
        variable=block.variable,
        port=port,
        sign=sign,
        times=f" {block.multiplier}" if block.multiplier else "",
        kind=kind,
        clock=_OWN_CLOCK if timed else "",
        where=known[block.variable],
        factor=(f" * {known[block.multiplier]}" if block.multiplier else "") + per_cell,
    )
