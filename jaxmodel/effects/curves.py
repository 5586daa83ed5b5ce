"""Curves as effects: by how much a relation of the model is off, as a function of what it depends on.

A curve is no new physics. It says "this table of yours is off by so much there": values at knots, straight between
them, held at the ends; all zero is the base model. It stands beside the catalogue, not in it: a case names no curve,
and who fits one gives it knots, values and a prior.
"""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.cell import ZERO_DEGC_IN_K
from jaxmodel.curves import between_knots
from jaxmodel.declaration import Scalar
from jaxmodel.errors import EffectError
from jaxmodel.ports import CellContext, Effect, MotorContext

CELL = ("cell", "robot")
MOTOR = ("motor", "robot")
REFERENCE_DEGC = 20.0
# Denser where an open-circuit voltage and a resistance bend, near empty and near full.
SOC_KNOTS = (0.0, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
TEMPERATURE_KNOTS = (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
# Of the RE50: to its no-load speed at 24 V, and to twice its largest continuous current.
SPEED_KNOTS = (0.0, 10.0, 25.0, 50.0, 100.0, 150.0, 225.0, 325.0, 450.0, 625.0)
CURRENT_KNOTS = (0.0, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0, 22.0)


class Curve(Effect):
    """A relation of the model that is off by f(x), piecewise linear between knots and held at the ends.

    Attributes:
        values: f at the knots, shape (knots,); 0 is the base model, to the bit.
        knots: where, strictly increasing, in the unit of `over`.
        port: the relation that is off.
        over: the field of the port's context that f is a function of.
        relation: what a user calls the relation; "" where that is the port.
        unit: of the values; "" is the logarithm of a factor.
        typical: the size of the values that a designer meets often.
        usual_knots: the knots where nobody gives others.
        scales: how `typical` grows with the specimen, as a parameter's `scales`.
        knots_scale: the same of `usual_knots`.
    """

    port: ClassVar[str]
    over: ClassVar[str]
    relation: ClassVar[str] = ""
    unit: ClassVar[str] = ""
    typical: ClassVar[float]
    usual_knots: ClassVar[tuple[float, ...]]
    scales: ClassVar[str] = ""
    knots_scale: ClassVar[str] = ""

    values: Float[Array, " knots"] = eqx.field(default=None)
    knots: tuple[float, ...] = eqx.field(static=True, default=())

    def __init__(self, values=None, knots=None, switch: Scalar | None = None):
        """Take values (0 where there are none) at knots (the usual ones where there are none).

        Raises:
            EffectError: there is not one value for each knot, or the knots do not increase.
        """
        self.column = ""
        self.switch = switch
        self.knots = self.usual_knots if knots is None else tuple(map(float, knots))
        self.values = jnp.zeros(len(self.knots)) if values is None else jnp.asarray(values, dtype=float)
        if not self.knots or any(late <= early for early, late in zip(self.knots, self.knots[1:], strict=False)):
            raise EffectError(f"curve '{self.name}': its knots {self.knots} do not increase; sort them, each once.")
        if self.values.shape != (len(self.knots),):
            raise EffectError(
                f"curve '{self.name}' has {len(self.knots)} knots and values of shape {self.values.shape}; "
                "give one value for each knot."
            )

    def _at(self, x: Scalar) -> Scalar:
        return between_knots(x, self.knots, self.values)


class OcvCurve(Curve):
    """The open-circuit voltage is off, over the state of charge."""

    name: ClassVar[str] = "ocv_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V_oc += f(SOC)"
    port: ClassVar[str] = "open_circuit_voltage"
    over: ClassVar[str] = "soc"
    unit: ClassVar[str] = "V"
    typical: ClassVar[float] = 0.02
    usual_knots: ClassVar[tuple[float, ...]] = SOC_KNOTS

    def open_circuit_voltage(self, value: Scalar, context: CellContext) -> Scalar:
        """Add f."""
        return value + self._at(context.soc)


class SeriesResistanceCurve(Curve):
    """The series resistance is off by a factor, over the state of charge."""

    name: ClassVar[str] = "series_resistance_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_ints + R_cyc -> (R_ints + R_cyc) exp(f(SOC))"
    port: ClassVar[str] = "series_resistance"
    over: ClassVar[str] = "soc"
    typical: ClassVar[float] = 0.3
    usual_knots: ClassVar[tuple[float, ...]] = SOC_KNOTS

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * jnp.exp(self._at(context.soc))


class RcResistanceCurve(Curve):
    """The resistances of both RC pairs are off by one factor, over the state of charge."""

    name: ClassVar[str] = "rc_resistance_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_TS, R_TL -> R exp(f(SOC))"
    port: ClassVar[str] = "rc_resistance"
    over: ClassVar[str] = "soc"
    typical: ClassVar[float] = 0.4
    usual_knots: ClassVar[tuple[float, ...]] = SOC_KNOTS

    def rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale R_TS and R_TL."""
        return value * jnp.exp(self._at(context.soc))


class RcCapacitanceCurve(Curve):
    """The capacitances of both RC pairs are off by one factor, over the state of charge."""

    name: ClassVar[str] = "rc_capacitance_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "C_TS, C_TL -> C exp(f(SOC))"
    port: ClassVar[str] = "rc_capacitance"
    over: ClassVar[str] = "soc"
    typical: ClassVar[float] = 0.5
    usual_knots: ClassVar[tuple[float, ...]] = SOC_KNOTS

    def rc_capacitance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale C_TS and C_TL."""
        return value * jnp.exp(self._at(context.soc))


class SeriesResistanceTemperatureCurve(Curve):
    """The series resistance is off by a factor, over the cell's temperature."""

    name: ClassVar[str] = "series_resistance_temperature_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_ints + R_cyc -> (R_ints + R_cyc) exp(f(T))"
    port: ClassVar[str] = "series_resistance"
    over: ClassVar[str] = "temperature_degC"
    typical: ClassVar[float] = 0.5
    usual_knots: ClassVar[tuple[float, ...]] = TEMPERATURE_KNOTS

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * jnp.exp(self._at(context.temperature_degC))


class RcResistanceTemperatureCurve(Curve):
    """The resistances of both RC pairs are off by one factor, over the cell's temperature."""

    name: ClassVar[str] = "rc_resistance_temperature_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_TS, R_TL -> R exp(f(T))"
    port: ClassVar[str] = "rc_resistance"
    over: ClassVar[str] = "temperature_degC"
    typical: ClassVar[float] = 0.7
    usual_knots: ClassVar[tuple[float, ...]] = TEMPERATURE_KNOTS

    def rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale R_TS and R_TL."""
        return value * jnp.exp(self._at(context.temperature_degC))


class RcCapacitanceTemperatureCurve(Curve):
    """The capacitances of both RC pairs are off by one factor, over the cell's temperature."""

    name: ClassVar[str] = "rc_capacitance_temperature_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "C_TS, C_TL -> C exp(f(T))"
    port: ClassVar[str] = "rc_capacitance"
    over: ClassVar[str] = "temperature_degC"
    typical: ClassVar[float] = 0.5
    usual_knots: ClassVar[tuple[float, ...]] = TEMPERATURE_KNOTS

    def rc_capacitance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale C_TS and C_TL."""
        return value * jnp.exp(self._at(context.temperature_degC))


class EntropyCurve(Curve):
    """The open-circuit voltage moves with temperature, more or less by the state of charge, with reversible heat."""

    name: ClassVar[str] = "entropy_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V_oc += f(SOC) (T - 20); heat -i T_K f(SOC)"
    port: ClassVar[str] = "open_circuit_voltage"
    over: ClassVar[str] = "soc"
    relation: ClassVar[str] = "entropic_coefficient"
    unit: ClassVar[str] = "V/K"
    typical: ClassVar[float] = 1e-4
    usual_knots: ClassVar[tuple[float, ...]] = SOC_KNOTS

    def open_circuit_voltage(self, value: Scalar, context: CellContext) -> Scalar:
        """Shift V_oc from its value at 20 degC."""
        return value + self._at(context.soc) * (context.temperature_degC - REFERENCE_DEGC)

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the reversible heat."""
        return value - context.current_A * (context.temperature_degC + ZERO_DEGC_IN_K) * self._at(context.soc)


class FrictionCurve(Curve):
    """The motor's friction is off, over its speed; what is off at rest holds the rotor there."""

    name: ClassVar[str] = "friction_curve"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction += f(|w|) sgn(w)"
    port: ClassVar[str] = "friction_torque"
    over: ClassVar[str] = "speed_rad_s"
    unit: ClassVar[str] = "N m"
    typical: ClassVar[float] = 0.005
    usual_knots: ClassVar[tuple[float, ...]] = SPEED_KNOTS
    scales: ClassVar[str] = "torque"
    knots_scale: ClassVar[str] = "speed"

    def _at_rest(self) -> Scalar:
        return self._at(jnp.zeros(()))

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add f(0), which does not vanish at rest; friction as a whole does not drive."""
        total = value + self._at_rest()
        return jnp.where(total < 0.0, 0.0, total)

    def friction_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add f(|w|) - f(0), which does, signed as the speed."""
        speed = context.speed_rad_s
        return value + jnp.sign(speed) * (self._at(jnp.abs(speed)) - self._at_rest())


class TorqueConstantCurve(Curve):
    """The torque for a current is off by a factor, over the current's size; the back-EMF stays, as in saturation."""

    name: ClassVar[str] = "torque_constant_curve"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_D -> k_tau i_a exp(f(|i_a|))"
    port: ClassVar[str] = "motor_torque"
    over: ClassVar[str] = "current_A"
    relation: ClassVar[str] = "torque_constant"
    typical: ClassVar[float] = 0.05
    usual_knots: ClassVar[tuple[float, ...]] = CURRENT_KNOTS
    knots_scale: ClassVar[str] = "motor_current"

    def motor_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the torque."""
        return value * jnp.exp(self._at(jnp.abs(context.current_A)))


CURVES: dict[str, type[Curve]] = {
    cls.name: cls
    for cls in (
        OcvCurve,
        SeriesResistanceCurve,
        RcResistanceCurve,
        RcCapacitanceCurve,
        SeriesResistanceTemperatureCurve,
        RcResistanceTemperatureCurve,
        RcCapacitanceTemperatureCurve,
        EntropyCurve,
        FrictionCurve,
        TorqueConstantCurve,
    )
}
