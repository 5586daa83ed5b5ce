"""Further candidate faults of sensors: scales and zero points of current, temperature, speed, torque and chamber."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array

from jaxmodel.effects.sensors import ANY, SensorEffect
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.sensors import Signal

DRIVEN = ("motor", "robot")
CALIBRATION_DEGC = 25.0


class CurrentGain(SensorEffect):
    """The current sensor's scale is off: it reads (1 + g) times the current."""

    name: ClassVar[str] = "current_gain"
    reads: ClassVar[str] = "_A"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured current = true current (1 + g)"
    g: Scalar = parameter(0.01, unit="", meaning="gain error", null=0.0, lower=-0.5, upper=0.5, typical=(-0.03, 0.03))

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Scale the reading."""
        return value * (1.0 + self.g)

    def true_input(self, value: Array, context: None) -> Array:
        """Take the gain off."""
        return value / (1.0 + self.g)


class TemperatureOffset(SensorEffect):
    """A thermometer reads c too much."""

    name: ClassVar[str] = "temperature_offset"
    reads: ClassVar[str] = "temperature_degC"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured temperature = true temperature + c"
    c: Scalar = parameter(1.0, unit="K", meaning="offset", null=0.0, lower=-50.0, upper=50.0, typical=(-2.0, 2.0))

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Add the offset."""
        return value + self.c


class TemperatureGain(SensorEffect):
    """A thermometer's scale is off, about 25 degC where it was calibrated."""

    name: ClassVar[str] = "temperature_gain"
    reads: ClassVar[str] = "temperature_degC"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured temperature = T + g (T - 25)"
    g: Scalar = parameter(0.03, unit="", meaning="gain error", null=0.0, lower=-0.9, upper=2.0, typical=(-0.1, 0.1))

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Scale the reading's distance from 25 degC."""
        return value + self.g * (value - CALIBRATION_DEGC)


class SpeedGain(SensorEffect):
    """The speed sensor's scale is off: it reads (1 + g) times the speed."""

    name: ClassVar[str] = "speed_gain"
    reads: ClassVar[str] = "speed_rad_s"
    kinds: ClassVar[tuple[str, ...]] = DRIVEN
    equation: ClassVar[str] = "measured speed = true speed (1 + g)"
    g: Scalar = parameter(0.01, unit="", meaning="gain error", null=0.0, lower=-0.5, upper=0.5, typical=(-0.03, 0.03))

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Scale the reading."""
        return value * (1.0 + self.g)


class TorqueOffset(SensorEffect):
    """The torque transducer of the load reads c too much."""

    name: ClassVar[str] = "torque_offset"
    reads: ClassVar[str] = "load_torque_Nm"
    kinds: ClassVar[tuple[str, ...]] = DRIVEN
    equation: ClassVar[str] = "measured torque = true torque + c"
    column: str = eqx.field(static=True, default="load_torque_Nm")
    c: Scalar = parameter(
        0.01,
        unit="N m",
        meaning="offset",
        null=0.0,
        lower=-1e3,
        upper=1e3,
        typical=(-0.02, 0.02),
        scales="torque",
    )

    def true_input(self, value: Array, context: None) -> Array:
        """Take the offset off."""
        return value - self.c


class TorqueGain(SensorEffect):
    """The torque transducer's scale is off: it reads (1 + g) times the load torque."""

    name: ClassVar[str] = "torque_gain"
    reads: ClassVar[str] = "load_torque_Nm"
    kinds: ClassVar[tuple[str, ...]] = DRIVEN
    equation: ClassVar[str] = "measured torque = true torque (1 + g)"
    column: str = eqx.field(static=True, default="load_torque_Nm")
    g: Scalar = parameter(0.02, unit="", meaning="gain error", null=0.0, lower=-0.5, upper=0.5, typical=(-0.05, 0.05))

    def true_input(self, value: Array, context: None) -> Array:
        """Take the gain off."""
        return value / (1.0 + self.g)


class ChamberOffset(SensorEffect):
    """The chamber's thermometer reads c too much: what surrounds the specimen is colder than reported."""

    name: ClassVar[str] = "chamber_offset"
    reads: ClassVar[str] = "ambient_degC"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured ambient = true ambient + c"
    column: str = eqx.field(static=True, default="ambient_degC")
    c: Scalar = parameter(1.0, unit="K", meaning="offset", null=0.0, lower=-50.0, upper=50.0, typical=(-3.0, 3.0))

    def true_input(self, value: Array, context: None) -> Array:
        """Take the offset off."""
        return value - self.c
