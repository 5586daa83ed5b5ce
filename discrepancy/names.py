"""Names of curves by port and quantity."""

from __future__ import annotations

from jaxmodel.effects.curves import CURVES
from jaxmodel.errors import EffectError, nearest


def curve(port: str, over: str = "soc") -> str:
    """Return the name of the curve that corrects a relation of the model as a function of one quantity.

    `investigation.add(curve("open_circuit_voltage", over="soc"))` adds a correction of the OCV table.

    Args:
        port: the relation: "open_circuit_voltage", "series_resistance", "friction_torque" and others.
        over: the quantity: "soc", "temperature_degC", "speed_rad_s", "current_A".

    Raises:
        EffectError: there is no such curve; the message lists all curves.
    """
    known = {(cls.port, cls.over): name for name, cls in CURVES.items()}
    if (port, over) in known:
        return known[port, over]
    hint = nearest(port, {name for name, _ in known})
    listed = ", ".join(f"{one} over {quantity}" for one, quantity in known)
    raise EffectError(f"no curve corrects '{port}' over '{over}'.{hint} Available: {listed}.")
