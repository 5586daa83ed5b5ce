"""Curves of a motor that a case states as tables, and that act as effects do."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.effects.curves import Curve, FrictionCurve, TorqueConstantCurve
from jaxmodel.model.curves import interpolate
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.ports import MotorContext


class _Stated(Curve):
    """A curve with points of its own; between them it is linear, beyond them constant.

    Attributes:
        at: increasing points, shape (points,).
        values: there, shape (points,).
    """

    at: Float[Array, " points"] = eqx.field(default=None)

    def __init__(self, at, values) -> None:
        """Take a table of any points."""
        self.column, self.switch = "", None
        self.low, self.high = jnp.zeros(()), jnp.ones(())
        self.at, self.values = jnp.asarray(at, dtype=float), jnp.asarray(values, dtype=float)

    def _at(self, x: Scalar) -> Scalar:
        return interpolate(x, self.at, self.values)


class FrictionTable(_Stated, FrictionCurve):
    """Friction in N m beside tau_0 over the size of the speed in rad/s; that at zero speed holds the rotor at rest."""

    name: ClassVar[str] = "friction"


class TorqueFactorTable(_Stated, TorqueConstantCurve):
    """Factor on torque over the size of the current in A; the back-EMF is unchanged, as in saturation."""

    name: ClassVar[str] = "torque_factor"
    equation: ClassVar[str] = "tau_D -> k_tau i_a f(|i_a|)"

    def motor_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the torque."""
        return value * self._at(jnp.abs(context.current_A))


TABLES: dict[str, type[_Stated]] = {cls.name: cls for cls in (FrictionTable, TorqueFactorTable)}
