"""Names of curves by port and quantity."""

from __future__ import annotations

from jaxmodel.base.errors import EffectError, nearest
from jaxmodel.effects.curves import CURVES


def curve(relation: str, over: str = "soc") -> str:
    """Return the name of the curve that corrects a relation of the model as a function of one quantity.

    `investigation.add(curve("open_circuit_voltage", over="soc"))` adds a correction of the OCV table.

    Args:
        relation: "open_circuit_voltage", "series_resistance", "entropic_coefficient", "friction_torque" and others.
        over: the quantity: "soc", "temperature_degC", "speed_rad_s", "current_A".

    Raises:
        EffectError: there is no such curve; the message lists all curves.
    """
    known = {(cls.relation or cls.port, cls.over): name for name, cls in CURVES.items()}
    if (relation, over) in known:
        return known[relation, over]
    hint = nearest(relation, {name for name, _ in known})
    listed = ", ".join(f"{one} over {quantity}" for one, quantity in known)
    raise EffectError(f"no curve corrects '{relation}' over '{over}'.{hint} Available: {listed}.")
