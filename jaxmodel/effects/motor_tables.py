"""Curves of a motor that a case states as tables, and that act as effects do."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.effects.curves import FrictionCurve, TorqueConstantCurve
from jaxmodel.model.curves import interpolate
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.ports import MotorContext


class FrictionTable(FrictionCurve):
    """Friction beside tau_0 over the size of the speed; its value at zero speed holds the rotor at rest.

    Attributes:
        at: increasing sizes of the speed in rad/s, shape (points,).
        values: the friction there in N m, shape (points,).
    """

    name: ClassVar[str] = "friction"

    at: Float[Array, " points"] = eqx.field(default=None)

    def __init__(self, at, values) -> None:
        """Take a table of any points; between them it is linear, beyond them constant."""
        self.column, self.switch = "", None
        self.low, self.high = jnp.zeros(()), jnp.ones(())
        self.at, self.values = jnp.asarray(at, dtype=float), jnp.asarray(values, dtype=float)

    def _at(self, x: Scalar) -> Scalar:
        return interpolate(x, self.at, self.values)


class TorqueFactorTable(TorqueConstantCurve):
    """Factor on torque over the size of the current; the back-EMF is unchanged, as in saturation.

    Attributes:
        at: increasing sizes of the current in A, shape (points,).
        values: the factor there, shape (points,).
    """

    name: ClassVar[str] = "torque_factor"
    equation: ClassVar[str] = "tau_D -> k_tau i_a f(|i_a|)"

    at: Float[Array, " points"] = eqx.field(default=None)

    def __init__(self, at, values) -> None:
        """Take a table of any points; between them it is linear, beyond them constant."""
        self.column, self.switch = "", None
        self.low, self.high = jnp.zeros(()), jnp.ones(())
        self.at, self.values = jnp.asarray(at, dtype=float), jnp.asarray(values, dtype=float)

    def motor_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the torque."""
        return value * interpolate(jnp.abs(context.current_A), self.at, self.values)


TABLES = {cls.name: cls for cls in (FrictionTable, TorqueFactorTable)}
