"""Differences: what one of several like motors or cells of a case may have of its own, such as a higher resistance.

Each is an effect, but not part of the catalogue: at 0 it is absent, and it is fitted in all runs of one specimen ("the
left motor has 12 % more resistance than the right one"). Factors are exp(s), so that twice and half are as far.
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp

from jaxmodel.effects.shifts import TemperatureShift
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.ports import CellContext, Effect, MotorContext

CELL = ("cell", "robot")
MOTOR = ("motor", "robot")


def _factor(meaning: str, usual: float) -> Any:
    """Declare the logarithm of a factor; its usual range is assumed."""
    return parameter(
        usual, unit="", meaning=f"logarithm of the factor on {meaning}", null=0.0, lower=-5.0, upper=5.0,
        typical=(-usual, usual),
    )  # fmt: skip


class ResistanceDifference(Effect):
    """The winding of this motor has another resistance: brushes, contacts, cable or winding."""

    name: ClassVar[str] = "resistance_difference"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "R -> R exp(s)"
    s: Scalar = _factor("its resistance", 0.2)

    def winding_resistance(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the resistance."""
        return value * jnp.exp(self.s)


class TorqueConstantDifference(Effect):
    """The magnets of this motor have another strength."""

    name: ClassVar[str] = "torque_constant_difference"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "k_tau -> k_tau exp(s)"
    s: Scalar = _factor("its torque constant", 0.1)

    def torque_constant(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale torque constant and back-EMF."""
        return value * jnp.exp(self.s)


class FrictionDifference(Effect):
    """The bearings, brushes or gear of this motor rub more or less."""

    name: ClassVar[str] = "friction_difference"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction -> friction exp(s)"
    s: Scalar = _factor("all friction of the motor", 0.7)

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the friction of constant size."""
        return value * jnp.exp(self.s)

    def friction_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the friction that grows with speed."""
        return value * jnp.exp(self.s)


class LoadDifference(Effect):
    """This motor has another load than the law gives the others, such as a chipped propeller or more of the weight."""

    name: ClassVar[str] = "load_difference"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_l -> tau_l exp(s)"
    s: Scalar = _factor("the load of its law", 0.3)

    def load_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the load."""
        return value * jnp.exp(self.s)

    def load_drag(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale what grows with speed."""
        return value * jnp.exp(self.s)

    def load_friction(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale what rubs."""
        return value * jnp.exp(self.s)


class CapacityDifference(Effect):
    """This cell holds another charge."""

    name: ClassVar[str] = "capacity_difference"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "usable charge -> usable charge exp(s)"
    s: Scalar = _factor("its charge", 0.05)

    def usable_charge(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the charge."""
        return value * jnp.exp(self.s)


class CellResistanceDifference(Effect):
    """This cell has other resistances: all three by the same factor."""

    name: ClassVar[str] = "cell_resistance_difference"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_ints + R_cyc, R_TS and R_TL -> the same exp(s)"
    s: Scalar = _factor("its resistances", 0.2)

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the series resistance."""
        return value * jnp.exp(self.s)

    def rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistances of both pairs."""
        return value * jnp.exp(self.s)


class ThermometerDifference(TemperatureShift):
    """The thermometer of this specimen reads c too high."""

    name: ClassVar[str] = "thermometer_difference"


DIFFERENCES: dict[str, type[Effect]] = {
    cls.name: cls
    for cls in (
        ResistanceDifference,
        TorqueConstantDifference,
        FrictionDifference,
        LoadDifference,
        CapacityDifference,
        CellResistanceDifference,
        ThermometerDifference,
    )
}
"""What a specimen may have of its own beside parameters, by name."""
WHAT: dict[str, str] = {
    "resistance_difference": "resistance",
    "torque_constant_difference": "torque constant",
    "friction_difference": "friction",
    "load_difference": "load",
    "capacity_difference": "capacity",
    "cell_resistance_difference": "resistance",
    "thermometer_difference": "thermometer",
}
"""What each is of, in words."""
