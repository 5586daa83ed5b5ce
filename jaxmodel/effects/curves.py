"""Curves: corrections of relations of the model as functions of one quantity.

A curve is no new physics but the correction of a table or formula: values at knots, linear between them, held at the
ends; all zero is the base model. Curves are not part of the catalogue: a case does not name them, and a fit supplies
knots, values and a prior.
"""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.base.errors import EffectError
from jaxmodel.model.cell import ZERO_DEGC_IN_K
from jaxmodel.model.curves import between_knots
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.ports import CellContext, Effect, MotorContext

CELL = ("cell", "robot")
MOTOR = ("motor", "robot")
REFERENCE_DEGC = 20.0
# Denser near empty and near full, where open-circuit voltage and resistance are most nonlinear.
SOC_KNOTS = (0.0, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
TEMPERATURE_KNOTS = (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
# For the RE50: up to its no-load speed at 24 V, and to twice its largest continuous current.
SPEED_KNOTS = (0.0, 10.0, 25.0, 50.0, 100.0, 150.0, 225.0, 325.0, 450.0, 625.0)
CURRENT_KNOTS = (0.0, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0, 22.0)


class Curve(Effect):
    """A correction f(x) of a relation of the model, piecewise linear between knots and held at the ends.

    Attributes:
        values: f at the knots, shape (knots,); 0 is exactly the base model.
        knots: strictly increasing, in the unit of `over`.
        port: the corrected relation.
        over: the field of the port's context that is the variable of f.
        unit: of the values; "" for the logarithm of a factor.
        typical: usual size of the values.
        relation: what a user calls the relation; "" if that is the port.
        usual_knots: default knots.
        scales: how `typical` scales with the specimen, like `scales` of a parameter.
        knots_scale: the same for `usual_knots`.
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
        """Take values (by default 0) at knots (by default the usual ones).

        Raises:
            EffectError: there is not one value for each knot, or the knots do not increase.
        """
        self.column = ""
        self.switch = switch
        self.knots = self.usual_knots if knots is None else tuple(map(float, knots))
        self.values = jnp.zeros(len(self.knots)) if values is None else jnp.asarray(values, dtype=float)
        if not self.knots or any(late <= early for early, late in zip(self.knots, self.knots[1:], strict=False)):
            raise EffectError(
                f"curve '{self.name}': its knots {self.knots} do not increase; sort them without repetition."
            )
        if self.values.shape != (len(self.knots),):
            raise EffectError(
                f"curve '{self.name}' has {len(self.knots)} knots and values of shape {self.values.shape}; "
                "give one value for each knot."
            )

    def _at(self, x: Scalar) -> Scalar:
        return between_knots(x, self.knots, self.values)


class OcvCurve(Curve):
    """Correction of the open-circuit voltage over state of charge."""

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
    """Factor on the series resistance over state of charge."""

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
    """Factor on the resistances of both RC pairs over state of charge."""

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
    """Factor on the capacitances of both RC pairs over state of charge."""

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
    """Factor on the series resistance over the cell's temperature."""

    name: ClassVar[str] = "series_resistance_temperature_curve"
    needs: ClassVar[tuple[str, ...]] = ("arrhenius_resistance",)  # the law that it corrects
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
    """Factor on the resistances of both RC pairs over the cell's temperature."""

    name: ClassVar[str] = "rc_resistance_temperature_curve"
    needs: ClassVar[tuple[str, ...]] = ("arrhenius_resistance",)  # the law that it corrects
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
    """Factor on the capacitances of both RC pairs over the cell's temperature."""

    name: ClassVar[str] = "rc_capacitance_temperature_curve"
    needs: ClassVar[tuple[str, ...]] = ("arrhenius_resistance",)  # the law that it corrects
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
    """Entropy coefficient over state of charge: open-circuit voltage over temperature, with reversible heat."""

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
    """Correction of the motor's friction over speed; its value at zero speed holds the rotor at rest."""

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
        """Add f(0), which acts at rest too; the total friction stays positive."""
        total = value + self._at_rest()
        return jnp.where(total < 0.0, 0.0, total)

    def friction_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add f(|w|) - f(0), which vanishes at rest, with the sign of the speed."""
        speed = context.speed_rad_s
        return value + jnp.sign(speed) * (self._at(jnp.abs(speed)) - self._at_rest())


class TorqueConstantCurve(Curve):
    """Factor on torque over the size of the current; the back-EMF is unchanged, as in saturation."""

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
