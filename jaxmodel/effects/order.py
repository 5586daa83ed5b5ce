"""Which quantities a port does not have yet: an effect that asks for one is refused, because it would read 0."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
from typing import Any

import jax

from jaxmodel.base.errors import EffectError
from jaxmodel.model.curves import CellCurves
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import CELL_PORTS, MOTOR_PORTS, CellContext, Effect, MotorContext

_CURRENT = ("current_A", "voltage_V", "counted_current_A")
_ELEMENTS = ("series_resistance_ohm", "R_TS", "C_TS", "R_TL", "C_TL", "heat_transfer")
# By port, what of its context comes later, in the order of `jaxmodel.model.cell`.
LATER: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(CELL_PORTS, (*_ELEMENTS, *_CURRENT)),
    **dict.fromkeys(("overpotential", "cell_heat", "weakest_cell_voltage"), _CURRENT[1:]),
    "surface_temperature": _CURRENT,
    "counted_current": _CURRENT[2:],
    **dict.fromkeys(MOTOR_PORTS, ()),
}
_FIELDS = {field.name for context in (CellContext, MotorContext) for field in dataclasses.fields(context)}
# A robot's motor has no pack voltage before its current is known, but here.
_WITH_PACK_VOLTAGE = ("bridge_voltage", "onboard_current", "motor_loss")


class _AnyState(dict):
    """States of which each is 0: those of other effects need not be there."""

    def __missing__(self, name: str) -> float:
        return 0.0


class _SoFar:
    """Stands for a context in which every number is 0, and refuses what is not known yet."""

    def __init__(self, later: tuple[str, ...], where: str, port: str) -> None:
        self._later, self._where, self._port = later, where, port
        self.parameters, self.state, self.curves = Parameters(), _AnyState(), CellCurves()

    def __getattr__(self, name: str) -> float:
        if name in self._later:
            ports = MOTOR_PORTS if name == "pack_voltage_V" else CELL_PORTS
            known = ", ".join(port for port in ports if _has(port, name))
            raise EffectError(
                f"{self._where}.{self._port}: context.{name} is not known at this port, and would be 0; use it at "
                f"{known} or in flows, where a state of the effect can follow it."
            )
        if name not in _FIELDS:
            raise AttributeError(name)
        return 0.0


def _has(port: str, name: str) -> bool:
    return port in _WITH_PACK_VOLTAGE if name == "pack_voltage_V" else name not in LATER[port]


def refuse_what_comes_later(cls: type[Effect]) -> None:
    """Refuse an effect that reads a quantity at a port which does not have it yet.

    Each of its ports is traced once at zeros; nothing is computed. What else is wrong with the effect shows when its
    model is run.

    Args:
        cls: an effect class that is complete.

    Raises:
        EffectError: it does; the message names the port, the quantity, and where it is known.
    """
    for port in (*CELL_PORTS, *MOTOR_PORTS):
        method = inspect.getattr_static(cls, port, None)
        later = LATER[port]
        if port in MOTOR_PORTS and "robot" in cls.kinds and port not in _WITH_PACK_VOLTAGE:
            later = (*later, "pack_voltage_V")
        if method is None or not later:
            continue
        with contextlib.suppress(_Other):
            _trace(cls, port, later)


class _Other(Exception):
    """A mistake of another kind than the one looked for."""


def _trace(cls: type[Effect], port: str, later: tuple[str, ...]) -> None:
    def called() -> Any:
        return getattr(cls(), port)(1.0, _SoFar(later, cls.__name__, port))

    try:
        jax.eval_shape(called)
    except EffectError:
        raise
    except Exception as error:
        raise _Other from error
