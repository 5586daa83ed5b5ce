"""Unknown laws: a smooth function of one quantity that is added at a port.

One effect contains a law at every port of a kind, all zero until fitted. The variable and the multiplier of each law
are data, so that any law is fitted without compiling a new program.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmodel.fit.settings import SETTINGS
from jaxmodel.model.curves import between_knots
from jaxmodel.model.flow import Flow, integral
from jaxmodel.model.ports import Effect

CLOCK = "law.time_s"
# Possible variables of a law at a port, and their expressions there.
_CELL: dict[str, Callable[[Any, Any], Any]] = {
    "soc": lambda value, c: c.soc,
    "current_A": lambda value, c: c.current_A,
    "cell_temperature_degC": lambda value, c: c.temperature_degC,
    "ambient_degC": lambda value, c: c.ambient_degC,
    "cycles": lambda value, c: c.parameters.cycles,
    "time_s": lambda value, c: c.state[CLOCK],
}
_MOTOR: dict[str, Callable[[Any, Any], Any]] = {
    "current_A": lambda value, c: c.current_A,
    "speed_rad_s": lambda value, c: c.speed_rad_s,
    "winding_temperature_degC": lambda value, c: c.winding_degC,
    "ambient_degC": lambda value, c: c.ambient_degC,
    "duty": lambda value, c: c.duty,
    "time_s": lambda value, c: c.state[CLOCK],
}
_LOAD: dict[str, Callable[[Any, Any], Any]] = _MOTOR | {"load_torque_Nm": lambda value, c: value}
# By kind and port: possible variables, possible multiplier besides 1, name of the equation.
PORTS: dict[str, dict[str, tuple[dict[str, Callable], str, str]]] = {
    "cell": {
        "overpotential": (_CELL, "current_A", "the cell's overpotential (V)"),
        "counted_current": (_CELL, "current_A", "the counting of charge (eq. 1)"),
        "cell_heat": (_CELL, "", "the cell's heat"),
    },
    "motor": {
        "load_torque": (_LOAD, "load_torque_Nm", "the torque balance (eq. 13)"),
        "torque_constant": (_MOTOR, "", "the torque constant (eqs. 11 and 12)"),
        "motor_loss": (_MOTOR, "", "the winding's heat (eq. 16)"),
        "bridge_voltage": (_MOTOR, "current_A", "the armature voltage (eq. 11)"),
    },
}
PORTS["robot"] = {
    **PORTS["motor"],
    "counted_current": PORTS["cell"]["counted_current"],
    "onboard_current": (_MOTOR, "", "the on-board draw (eq. 20)"),
}
# Settings after the weights of the variables: lowest and highest value, weights of 1 and of the multiplier.
_BEHIND = 4


def quantities(kind: str) -> tuple[str, ...]:
    """Return all possible variables of laws of a kind, in the order of their weights."""
    return tuple(dict.fromkeys(name for sources, _, _ in PORTS[kind].values() for name in sources))


def no_laws(kind: str) -> np.ndarray:
    """Return the settings without any law, (ports, settings)."""
    settings = np.zeros((len(PORTS[kind]), len(quantities(kind)) + _BEHIND))
    settings[:, -3] = 1.0
    return settings


def setting(kind: str, port: str, variable: str, multiplier: str, bounds: tuple[float, float]) -> np.ndarray:
    """Return the settings of one law: its variable, the bounds of this, and its multiplier."""
    names = quantities(kind)
    found = np.zeros(len(names) + _BEHIND)
    found[names.index(variable)] = 1.0
    found[-4], found[-3] = bounds[0], max(bounds[1], bounds[0] + 1e-9)
    found[-1 if multiplier else -2] = 1.0
    return found


@functools.lru_cache
def law_effect(kind: str, knots: int = SETTINGS.law_knots) -> Effect:
    """Return the effect that contains the laws of a kind; one class, because compiled programs are identified by it."""
    ports = list(PORTS[kind])
    names = quantities(kind)
    places = tuple(np.linspace(0.0, 1.0, knots).tolist())

    def port_method(place: int, port: str) -> Callable:
        sources, multiplier, _ = PORTS[kind][port]

        def add(self, value, context):
            own = self.settings[place]
            z = sum(own[names.index(name)] * source(value, context) for name, source in sources.items())
            share = (z - own[-4]) / (own[-3] - own[-4])
            factor = own[-2] + (own[-1] * sources[multiplier](value, context) if multiplier else 0.0)
            return value + factor * between_knots(share, places, self.values[place])

        return add

    def initial_state(self, parameters, ambient_degC):
        return {CLOCK: jnp.zeros(())}

    def flows(self, cell, motor, heat_W) -> Mapping[str, Flow]:
        return {CLOCK: integral(1.0)} if (cell is None) == (kind == "motor" or kind == "robot") else {}

    methods = {port: port_method(place, port) for place, port in enumerate(ports)}
    members = {
        "__module__": __name__,
        "__annotations__": {"values": Float[Array, "ports knots"], "settings": Float[Array, "ports settings"]},
        "values": eqx.field(default=None),
        "settings": eqx.field(default=None),
        "name": "law",
        "kinds": (kind,),
        "equation": "",
        "initial_state": initial_state,
        "flows": flows,
        **methods,
    }
    cls = type(f"Laws_{kind}", (Effect,), members)
    made: Any = cls
    return made(values=jnp.zeros((len(ports), knots)), settings=jnp.asarray(no_laws(kind)))
