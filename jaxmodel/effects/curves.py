"""Curves: corrections of relations of the model as functions of one quantity.

A curve is no new physics but the correction of a table or formula: values at knots, linear between them, held at the
ends; all zero is the base model. Curves are not part of the catalogue: a case does not name them, and a fit supplies
knots, values and a prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmodel.base.errors import EffectError
from jaxmodel.model.cell import REFERENCE_DEGC, ZERO_DEGC_IN_K, arrhenius, heating
from jaxmodel.model.curves import between_knots
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.ports import CellContext, Effect, MotorContext

CELL = ("cell", "robot")
MOTOR = ("motor", "robot")
RISE_K = 10.0  # rise of temperature for which the growth of heat transfer is given
# Shares of the range that the fitted runs cover. An open-circuit voltage bends most near empty and near full: there
# knots are a thousandth apart.
_END = (0.0, 0.001, 0.002, 0.004, 0.007, 0.0125, 0.02, 0.03, 0.045, 0.065)
FINE = (*_END, *(0.09 + 0.025 * k for k in range(9)), *(0.32 + 0.04 * k for k in range(15)), 0.9,
        *(1.0 - share for share in reversed(_END)))  # fmt: skip
MEDIUM = (0.0, 0.03, 0.06, 0.1, 0.15, 0.22, 0.32, 0.45, 0.58, 0.7, 0.8, 0.9, 1.0)
FEW = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
ONE = (0.0,)


class Curve(Effect):
    """A correction f(x) of a relation of the model, piecewise linear between knots and held at the ends.

    Attributes:
        values: f at the knots, shape (knots,); 0 is exactly the base model.
        low, high: range of `over` that the knots cover.
        port: the corrected relation.
        over: the field of the port's context that is the variable of f.
        unit: of the values; "" for the logarithm of a factor.
        typical: usual size of the values.
        largest: size beyond which a correction is none of physics, in the unit of the values.
        relation: what a user calls the relation; "" if that is the port.
        usual_knots: shares of the range of `over` that the fitted runs cover; a single one for a constant.
        correlation: length over which values belong together, as a share of the number of knots.
        tables: of a case, by name, which it raises (1) or lowers (-1) where it is positive: a pair keeps its time
            constant where its resistance is corrected. None for a relation without a table.
        is_rare: most cases state no table of the relation, and an effect does the same. It then belongs to the model
            that predicts, and to the base against which effects are tested only if the case states such a table with
            an sd.
        imitates: effects that it may stand for: beside one of them it says nothing of its own.
        scales: how `typical` scales with the specimen, like `scales` of a parameter.
    """

    port: ClassVar[str]
    over: ClassVar[str]
    relation: ClassVar[str] = ""
    unit: ClassVar[str] = ""
    typical: ClassVar[float]
    largest: ClassVar[float]
    usual_knots: ClassVar[tuple[float, ...]]
    correlation: ClassVar[float] = 0.4
    tables: ClassVar[Mapping[str, float]] = {}
    is_rare: ClassVar[bool] = False
    imitates: ClassVar[tuple[str, ...]] = ()
    scales: ClassVar[str] = ""

    values: Float[Array, " knots"] = eqx.field(default=None)
    low: Float[Array, ""] = eqx.field(default=None)
    high: Float[Array, ""] = eqx.field(default=None)

    def __init__(self, values=None, low: float = 0.0, high: float = 1.0, switch: Scalar | None = None):
        """Take values (by default 0) at knots that lie between the ends of a range.

        Raises:
            EffectError: there is not one value for each knot, or the range is empty.
        """
        self.column = ""
        self.switch = switch
        self.low, self.high = jnp.asarray(low, dtype=float), jnp.asarray(high, dtype=float)
        count = len(self.usual_knots)
        self.values = jnp.zeros(count) if values is None else jnp.asarray(values, dtype=float)
        if not high > low:
            raise EffectError(f"curve '{self.name}': its range {low:g} to {high:g} is empty; give a higher end.")
        if self.values.shape != (count,):
            raise EffectError(
                f"curve '{self.name}' has {count} knots and values of shape {self.values.shape}; "
                "give one value for each knot."
            )

    @property
    def knots(self) -> np.ndarray:
        """Return the knots, (knots,), in the unit of `over`."""
        low, high = float(self.low), float(self.high)
        return low + (high - low) * np.array(self.usual_knots)

    def _at(self, x: Scalar) -> Scalar:
        # The shares are constants of the compiled step and the range is data: all cases have one program.
        return between_knots((x - self.low) / (self.high - self.low), self.usual_knots, self.values)


class OcvCurve(Curve):
    """Correction of the open-circuit voltage over state of charge."""

    name: ClassVar[str] = "ocv_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V_oc += f(SOC)"
    port: ClassVar[str] = "open_circuit_voltage"
    over: ClassVar[str] = "soc"
    unit: ClassVar[str] = "V"
    typical: ClassVar[float] = 0.005
    largest: ClassVar[float] = 0.03
    usual_knots: ClassVar[tuple[float, ...]] = FINE
    correlation: ClassVar[float] = 0.2
    tables: ClassVar[Mapping[str, float]] = {"ocv": 1.0}

    def open_circuit_voltage(self, value: Scalar, context: CellContext) -> Scalar:
        """Add f."""
        return value + self._at(context.soc)


class _Factor(Curve):
    """A factor exp(f): its values are the logarithm."""

    kinds: ClassVar[tuple[str, ...]] = CELL
    over: ClassVar[str] = "soc"
    typical: ClassVar[float] = 0.15
    largest: ClassVar[float] = 0.75
    usual_knots: ClassVar[tuple[float, ...]] = MEDIUM


class SeriesResistanceCurve(_Factor):
    """Factor on the series resistance over state of charge."""

    name: ClassVar[str] = "series_resistance_curve"
    equation: ClassVar[str] = "R_ints + R_cyc -> (R_ints + R_cyc) exp(f(SOC))"
    port: ClassVar[str] = "series_resistance"
    tables: ClassVar[Mapping[str, float]] = {"R_ints": 1.0}

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * jnp.exp(self._at(context.soc))


class ShortResistanceCurve(_Factor):
    """Factor on the resistance of the short RC pair over state of charge; its time constant stays."""

    name: ClassVar[str] = "short_resistance_curve"
    equation: ClassVar[str] = "R_TS -> R_TS exp(f(SOC)), C_TS -> C_TS exp(-f(SOC))"
    port: ClassVar[str] = "short_rc_resistance"
    tables: ClassVar[Mapping[str, float]] = {"R_TS": 1.0, "C_TS": -1.0}

    def short_rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * jnp.exp(self._at(context.soc))

    def short_rc_capacitance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the capacitance the other way."""
        return value * jnp.exp(-self._at(context.soc))


class LongResistanceCurve(_Factor):
    """Factor on the resistance of the long RC pair over state of charge; its time constant stays."""

    name: ClassVar[str] = "long_resistance_curve"
    equation: ClassVar[str] = "R_TL -> R_TL exp(f(SOC)), C_TL -> C_TL exp(-f(SOC))"
    port: ClassVar[str] = "long_rc_resistance"
    tables: ClassVar[Mapping[str, float]] = {"R_TL": 1.0, "C_TL": -1.0}

    def long_rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * jnp.exp(self._at(context.soc))

    def long_rc_capacitance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the capacitance the other way."""
        return value * jnp.exp(-self._at(context.soc))


class ShortTimeCurve(_Factor):
    """Factor on the time constant of the short RC pair over state of charge."""

    name: ClassVar[str] = "short_time_curve"
    equation: ClassVar[str] = "C_TS -> C_TS exp(f(SOC))"
    port: ClassVar[str] = "short_rc_capacitance"
    usual_knots: ClassVar[tuple[float, ...]] = FEW
    tables: ClassVar[Mapping[str, float]] = {"C_TS": 1.0}

    def short_rc_capacitance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the capacitance."""
        return value * jnp.exp(self._at(context.soc))


class LongTimeCurve(_Factor):
    """Factor on the time constant of the long RC pair over state of charge."""

    name: ClassVar[str] = "long_time_curve"
    equation: ClassVar[str] = "C_TL -> C_TL exp(f(SOC))"
    port: ClassVar[str] = "long_rc_capacitance"
    usual_knots: ClassVar[tuple[float, ...]] = FEW
    tables: ClassVar[Mapping[str, float]] = {"C_TL": 1.0}

    def long_rc_capacitance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the capacitance."""
        return value * jnp.exp(self._at(context.soc))


class EntropyCurve(Curve):
    """Entropy coefficient over state of charge: open-circuit voltage over temperature, with reversible heat."""

    name: ClassVar[str] = "entropy_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V_oc += f(SOC) (T - 20); heat -i T_K f(SOC)"
    port: ClassVar[str] = "open_circuit_voltage"
    over: ClassVar[str] = "soc"
    relation: ClassVar[str] = "entropic_coefficient"
    tables: ClassVar[Mapping[str, float]] = {"dU_dT": 1.0}
    is_rare: ClassVar[bool] = True
    unit: ClassVar[str] = "V/K"
    imitates: ClassVar[tuple[str, ...]] = ("entropic_ocv",)
    typical: ClassVar[float] = 1e-4
    largest: ClassVar[float] = 3e-4
    usual_knots: ClassVar[tuple[float, ...]] = MEDIUM

    def open_circuit_voltage(self, value: Scalar, context: CellContext) -> Scalar:
        """Shift V_oc from its value at 20 degC."""
        return value + self._at(context.soc) * (context.temperature_degC - REFERENCE_DEGC)

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the reversible heat."""
        return value - context.current_A * (context.temperature_degC + ZERO_DEGC_IN_K) * self._at(context.soc)


class _Energy(Curve):
    """An activation energy of one resistance, above that of the case; its one value is in J/mol."""

    kinds: ClassVar[tuple[str, ...]] = CELL
    over: ClassVar[str] = "temperature_degC"
    imitates: ClassVar[tuple[str, ...]] = ("arrhenius_resistance", "arrhenius_polarisation")
    is_rare: ClassVar[bool] = True
    unit: ClassVar[str] = "J/mol"
    typical: ClassVar[float] = 20e3
    largest: ClassVar[float] = 30e3
    usual_knots: ClassVar[tuple[float, ...]] = ONE

    def _factor(self, context: CellContext) -> Scalar:
        return arrhenius(self.values[0], context.temperature_degC)


class SeriesEnergy(_Energy):
    """Activation energy of the series resistance."""

    name: ClassVar[str] = "series_energy"
    equation: ClassVar[str] = "R_ints + R_cyc -> (R_ints + R_cyc) exp(E/8.314 (1/T_K - 1/293.15))"
    port: ClassVar[str] = "series_resistance"

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * self._factor(context)


class ShortEnergy(_Energy):
    """Activation energy of the short RC pair's resistance."""

    name: ClassVar[str] = "short_energy"
    equation: ClassVar[str] = "R_TS -> R_TS exp(E/8.314 (1/T_K - 1/293.15))"
    port: ClassVar[str] = "short_rc_resistance"

    def short_rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * self._factor(context)


class LongEnergy(_Energy):
    """Activation energy of the long RC pair's resistance."""

    name: ClassVar[str] = "long_energy"
    equation: ClassVar[str] = "R_TL -> R_TL exp(E/8.314 (1/T_K - 1/293.15))"
    port: ClassVar[str] = "long_rc_resistance"

    def long_rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the resistance."""
        return value * self._factor(context)


class Convection(Curve):
    """How a self-heating cell's heat transfer grows with its temperature above the ambient: free convection."""

    name: ClassVar[str] = "convection_curve"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "hA -> hA exp(f (T - T_amb)/10)"
    port: ClassVar[str] = "heat_transfer"
    over: ClassVar[str] = "temperature_rise_K"
    typical: ClassVar[float] = 0.05
    largest: ClassVar[float] = 0.15
    usual_knots: ClassVar[tuple[float, ...]] = ONE
    needs: ClassVar[tuple[str, ...]] = ("self_heating",)

    def heat_transfer(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the heat transfer."""
        return value * jnp.exp(self.values[0] * (context.temperature_degC - context.ambient_degC) / RISE_K)


class _HeatShare(Curve):
    """A share of what an RC pair loses that becomes heat in addition; at -1 and below none of it is left."""

    kinds: ClassVar[tuple[str, ...]] = CELL
    port: ClassVar[str] = "cell_heat"
    over: ClassVar[str] = "current_A"
    typical: ClassVar[float] = 0.3
    largest: ClassVar[float] = 0.5
    usual_knots: ClassVar[tuple[float, ...]] = ONE
    needs: ClassVar[tuple[str, ...]] = ("self_heating",)


class ShortHeat(_HeatShare):
    """Share of the short RC pair's loss that becomes heat in addition."""

    name: ClassVar[str] = "short_heat"
    equation: ClassVar[str] = "heat += max(f, -1) i V_TS"

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the share."""
        return value + heating(self.values[0]) * context.current_A * context.state["v_ts_V"]


class LongHeat(_HeatShare):
    """Share of the long RC pair's loss that becomes heat in addition."""

    name: ClassVar[str] = "long_heat"
    equation: ClassVar[str] = "heat += max(f, -1) i V_TL"

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the share."""
        return value + heating(self.values[0]) * context.current_A * context.state["v_tl_V"]


class FrictionCurve(Curve):
    """Correction of the motor's friction over speed; its value at zero speed holds the rotor at rest."""

    name: ClassVar[str] = "friction_curve"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction += f(|w|) sgn(w)"
    port: ClassVar[str] = "friction_torque"
    tables: ClassVar[Mapping[str, float]] = {"friction": 1.0}
    is_rare: ClassVar[bool] = True
    imitates: ClassVar[tuple[str, ...]] = (
        "viscous_friction", "windage", "stribeck_friction", "directional_friction", "gear_loss",
    )  # fmt: skip
    over: ClassVar[str] = "speed_rad_s"
    unit: ClassVar[str] = "N m"
    typical: ClassVar[float] = 0.002
    largest: ClassVar[float] = 0.02
    usual_knots: ClassVar[tuple[float, ...]] = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.65, 0.85, 1.0)
    scales: ClassVar[str] = "torque"

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
    tables: ClassVar[Mapping[str, float]] = {"torque_factor": 1.0}
    is_rare: ClassVar[bool] = True
    imitates: ClassVar[tuple[str, ...]] = ("saturation", "brush_current_drop", "gear_loss")
    over: ClassVar[str] = "current_A"
    relation: ClassVar[str] = "torque_constant"
    typical: ClassVar[float] = 0.05
    largest: ClassVar[float] = 0.2
    usual_knots: ClassVar[tuple[float, ...]] = FEW

    def motor_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the torque."""
        return value * jnp.exp(self._at(jnp.abs(context.current_A)))


CURVES: dict[str, type[Curve]] = {
    cls.name: cls
    for cls in (
        OcvCurve,
        SeriesResistanceCurve,
        ShortResistanceCurve,
        LongResistanceCurve,
        ShortTimeCurve,
        LongTimeCurve,
        Convection,
        ShortHeat,
        LongHeat,
        EntropyCurve,
        SeriesEnergy,
        ShortEnergy,
        LongEnergy,
        FrictionCurve,
        TorqueConstantCurve,
    )
}
