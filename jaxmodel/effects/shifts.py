"""Shifts: one parameter that may differ in a single run, such as a contact resistance, cooling or a zero point.

Each is an effect, but not part of the catalogue: at 0 it is absent, and it is fitted in single runs ("run 3 has 11 mohm
more than the others").
"""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmodel.effects.sensors import ANY, CurrentGain, SensorEffect
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.ports import CellContext, Effect, MotorContext
from jaxmodel.model.sensors import Signal

CELL = ("cell", "robot")
MOTOR = ("motor", "robot")


class ContactResistance(Effect):
    """Additional resistance between the cell and where its voltage is read; its heat does not warm the cell."""

    name: ClassVar[str] = "contact_resistance"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_ints + R_cyc -> R_ints + R_cyc + r; heat -i^2 r"
    r: Scalar = parameter(
        0.01,
        unit="ohm",
        meaning="resistance of one cell above that of other runs",
        null=0.0,
        lower=-10.0,
        upper=10.0,
        typical=(-0.01, 0.01),
        scales="1/capacity",
    )

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the resistance."""
        return value + self.r

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Leave out the heat of the contact, which is not in the cell."""
        return value - context.current_A**2 * self.r


class HeatTransferShift(Effect):
    """Factor on the heat transfer of a self-heating cell, for example from a draught or another holder."""

    name: ClassVar[str] = "heat_transfer_shift"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "hA -> hA exp(s)"
    s: Scalar = parameter(
        0.5,
        unit="",
        meaning="logarithm of the factor on hA",
        null=0.0,
        lower=-5.0,
        upper=5.0,
        typical=(-0.7, 0.7),
    )

    def heat_transfer(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the heat transfer."""
        return value * jnp.exp(self.s)


class FrictionShift(Effect):
    """Additional Coulomb friction of the motor, for example from another mounting or a tight bearing."""

    name: ClassVar[str] = "friction_shift"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_0 -> tau_0 + t"
    t: Scalar = parameter(
        0.005,
        unit="N m",
        meaning="friction torque above that of other runs",
        null=0.0,
        lower=-1e3,
        upper=1e3,
        typical=(-0.005, 0.005),
        scales="torque",
    )

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the torque; the total friction stays positive."""
        total = value + self.t
        return jnp.where(total < 0.0, 0.0, total)


class VoltageShift(SensorEffect):
    """A voltage reads c too high in this run."""

    name: ClassVar[str] = "voltage_shift"
    reads: ClassVar[str] = "voltage_V"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "measured voltage = true voltage + c"
    c: Scalar = parameter(
        0.01, unit="V", meaning="shift of the reading", null=0.0, lower=-10.0, upper=10.0, typical=(-0.02, 0.02)
    )

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Add the shift."""
        return value + self.c


class GainShift(CurrentGain):
    """The scale of the current sensor of this run is off: another sensor or range than in other runs."""

    name: ClassVar[str] = "gain_shift"
    rare: ClassVar[bool] = False
    kinds: ClassVar[tuple[str, ...]] = ("cell",)


class TemperatureShift(SensorEffect):
    """A thermometer reads c too high in this run."""

    name: ClassVar[str] = "temperature_shift"
    reads: ClassVar[str] = "temperature_degC"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured temperature = true temperature + c"
    c: Scalar = parameter(
        1.0, unit="K", meaning="shift of the reading", null=0.0, lower=-50.0, upper=50.0, typical=(-1.0, 1.0)
    )

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Add the shift."""
        return value + self.c


class AmbientShift(SensorEffect):
    """The true ambient temperature is c above the reported one in this run."""

    name: ClassVar[str] = "ambient_shift"
    reads: ClassVar[str] = "ambient_degC"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "true ambient = reported ambient + c"
    column: str = eqx.field(static=True, default="ambient_degC")
    c: Scalar = parameter(
        1.0,
        unit="K",
        meaning="difference of true and reported ambient temperature",
        null=0.0,
        lower=-100.0,
        upper=100.0,
        typical=(-2.0, 2.0),
    )

    def true_input(self, value: Array, context: None) -> Array:
        """Add the shift."""
        return value + self.c


SHIFTS: dict[str, type[Effect]] = {
    cls.name: cls
    for cls in (
        ContactResistance,
        HeatTransferShift,
        FrictionShift,
        VoltageShift,
        GainShift,
        TemperatureShift,
        AmbientShift,
    )
}
