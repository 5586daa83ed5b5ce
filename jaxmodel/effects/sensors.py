"""Sensor faults, declared like other effects, so that a fault is not mistaken for physics."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array

from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.ports import Effect
from jaxmodel.model.sensors import Signal, lagged, shifted, shifted_rows

ANY = ("cell", "motor", "robot")
DRIVEN = ("motor", "robot")
CALIBRATION_DEGC = 25.0


class SensorEffect(Effect):
    """A fault of one sensor; `column` names the column of the measurements, "" all outputs.

    Example:
        >>> from typing import ClassVar
        >>> from jaxmodel import parameter
        >>> from jaxmodel.effects import SensorEffect
        >>> class Stuck(SensorEffect):
        ...     name: ClassVar[str] = "stuck"
        ...     kinds: ClassVar[tuple[str, ...]] = ("cell",)
        ...     equation: ClassVar[str] = "reading = (1 - share) true + share value"
        ...     value: float = parameter(25.0, unit="degC", meaning="where it sticks")
        ...     share: float = parameter(0.5, unit="", meaning="how much", null=0.0, lower=0.0, upper=1.0)
        ...
        ...     def reading(self, value, context):
        ...         return (1.0 - self.share) * value + self.share * self.value
        >>> Stuck(column="cell_temperature_degC").label
        'stuck:cell_temperature_degC'
    """

    is_sensor: ClassVar[bool] = True

    @property
    def label(self) -> str:
        """Return the name with the column, so that several sensors may have the same kind of fault."""
        return f"{self.name}:{self.column}" if self.column else self.name


class CurrentOffset(SensorEffect):
    """The current sensor reads c too much."""

    name: ClassVar[str] = "current_offset"
    reads: ClassVar[str] = "_A"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured current = true current + c"
    c: Scalar = parameter(0.05, unit="A", meaning="offset", null=0.0, lower=-50.0, upper=50.0, typical=(-0.5, 0.5))

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Add the offset."""
        return value + self.c

    def true_input(self, value: Array, context: None) -> Array:
        """Take the offset off."""
        return value - self.c


class VoltageGain(SensorEffect):
    """The voltage sensor's scale is off: it reads (1 + g) times the voltage."""

    name: ClassVar[str] = "voltage_gain"
    reads: ClassVar[str] = "_V"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured voltage = true voltage (1 + g)"
    g: Scalar = parameter(0.01, unit="", meaning="gain error", null=0.0, lower=-0.5, upper=0.5, typical=(-0.05, 0.05))

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Scale the reading."""
        return value * (1.0 + self.g)

    def true_input(self, value: Array, context: None) -> Array:
        """Take the gain off."""
        return value / (1.0 + self.g)


class VoltageOffset(SensorEffect):
    """The voltage sensor reads c too much."""

    name: ClassVar[str] = "voltage_offset"
    reads: ClassVar[str] = "_V"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured voltage = true voltage + c"
    c: Scalar = parameter(0.01, unit="V", meaning="offset", null=0.0, lower=-5.0, upper=5.0, typical=(-0.1, 0.1))

    def reading(self, value: Array, context: Signal | None) -> Array:
        """Add the offset."""
        return value + self.c

    def true_input(self, value: Array, context: None) -> Array:
        """Take the offset off."""
        return value - self.c


class TemperatureLag(SensorEffect):
    """A temperature sensor follows late: first-order lag, starting at the first true value."""

    name: ClassVar[str] = "temperature_lag"
    reads: ClassVar[str] = "temperature_degC"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "tau dT_read/dt = T - T_read"
    has_state: ClassVar[bool] = True
    tau: Scalar = parameter(
        30.0,
        unit="s",
        meaning="time constant",
        null=0.0,
        lower=0.0,
        upper=5e3,
        transform="log",
        typical=(5.0, 300.0),
        shape_grid=(15.0, 100.0),
    )

    def reading(self, value: Array, context: Signal) -> Array:
        """Follow the true trajectory with a lag; changes by other sensor effects are kept."""
        return value + (lagged(context, self.tau) - context.rows)


class ClockShift(SensorEffect):
    """The outputs' clock runs d seconds late against that of the inputs.

    A separate logger samples the true trajectory at its own times (`resampled` 0); readings interpolated to the rows of
    the inputs are linear between rows, also across a jump (`resampled` 1).
    """

    name: ClassVar[str] = "clock_shift"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "y(t) -> y(t - d), of the true trajectory or of the rows"
    has_state: ClassVar[bool] = True
    d: Scalar = parameter(
        1.0,
        unit="s",
        meaning="delay of the outputs",
        null=0.0,
        lower=-120.0,
        upper=120.0,
        typical=(-20.0, 20.0),
        shape_grid=(-20.0, -13.0, -8.0, -4.0, -1.5, -0.5, 0.5, 1.5, 4.0, 8.0, 13.0, 20.0),
    )

    resampled: Scalar = parameter(
        0.0,
        unit="",
        meaning="0: sampled at shifted moments, 1: interpolated between rows",
        lower=0.0,
        upper=1.0,
        typical=(0.0, 1.0),
        shape_grid=(0.5,),
    )

    def reading(self, value: Array, context: Signal) -> Array:
        """Read the true trajectory, or the rows, at another time."""
        sampled, between_rows = shifted(context, self.d), shifted_rows(context, self.d)
        return value + (sampled + self.resampled * (between_rows - sampled) - context.rows)


class CurrentGain(SensorEffect):
    """The current sensor's scale is off: it reads (1 + g) times the current."""

    name: ClassVar[str] = "current_gain"
    rare: ClassVar[bool] = True
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

    # Not rare: a thermocouple of type K may be off by 1.5 K (class 1) or 2.5 K (class 2) by IEC 60584-1.

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
    rare: ClassVar[bool] = True
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
    rare: ClassVar[bool] = True
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
    rare: ClassVar[bool] = True
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
    rare: ClassVar[bool] = True
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
    rare: ClassVar[bool] = True
    reads: ClassVar[str] = "ambient_degC"
    kinds: ClassVar[tuple[str, ...]] = ANY
    equation: ClassVar[str] = "measured ambient = true ambient + c"
    column: str = eqx.field(static=True, default="ambient_degC")
    c: Scalar = parameter(1.0, unit="K", meaning="offset", null=0.0, lower=-50.0, upper=50.0, typical=(-3.0, 3.0))

    def true_input(self, value: Array, context: None) -> Array:
        """Take the offset off."""
        return value - self.c
