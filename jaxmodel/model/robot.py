"""The robot: duty, slope, flippers, on-board electronics and the pack that supplies all (eqs. 14, 18-22)."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxmodel.model import cell as cells
from jaxmodel.model.cell import Cell
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.motor import Motor
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import Effect, MotorContext, fold, touches

GRAVITY_M_S2 = 9.81
Inputs = dict[str, Scalar]


def duty_of_signal(signal_V):
    """Return the duty for the operator's signal, eq. 22: (V_set - 2.5) / 2.5, with V_set in 0..5 V."""
    return (signal_V - 2.5) / 2.5


def track_torque(p: Parameters, incline_deg: Scalar, acceleration_m_s2: Scalar) -> Scalar:
    """Return the load torque of one track motor in N m, eq. 18: (m a + mu m g cos + m g sin) r / (G eta).

    As printed, it is the load of each motor of eq. 13; where motors share the mass, `mass_kg` is what one carries.
    """
    slope = jnp.deg2rad(incline_deg)
    weight = p.mass_kg * GRAVITY_M_S2
    force = p.mass_kg * acceleration_m_s2 + weight * (p.friction_coefficient * jnp.cos(slope) + jnp.sin(slope))
    return force * p.wheel_radius_m / (p.gear_ratio * p.drive_efficiency)


def flipper_torque(load_kg: Scalar, length_m: Scalar, gear_ratio: Scalar, efficiency: Scalar) -> Scalar:
    """Return the torque of a flipper's motor in N m, eq. 19: (m_l g l / 2) / (G eta)."""
    return 0.5 * load_kg * GRAVITY_M_S2 * length_m / (gear_ratio * efficiency)


def onboard_current(computer_A: Scalar, sensors_A: Scalar, converter_efficiency: Scalar) -> Scalar:
    """Return the draw of the on-board electronics in A, eq. 20: (I_comp + I_sens) (2 - eta_conv)."""
    return (computer_A + sensors_A) * (2.0 - converter_efficiency)


def load_torque(p: Parameters, inputs: Inputs, effects: tuple[Effect, ...]) -> Scalar:
    """Return the load torque of one motor: the input itself, or eq. 18 from incline and acceleration.

    It is 0 where no input says it: the load is then a law (`jaxmodel.effects.loads`), or unknown beside a known speed.
    A law with dry friction has the incline to itself.
    """
    if "load_torque_Nm" in inputs or "incline_deg" not in inputs or touches(effects, "load_friction"):
        return inputs.get("load_torque_Nm", jnp.zeros(()))
    return track_torque(p, inputs["incline_deg"], inputs.get("acceleration_m_s2", jnp.zeros(())))


def accessory_draw(p: Parameters, inputs: Inputs) -> Scalar:
    """Return I_Mf + I_Ma in A: flipper and arm motors in equilibrium at their torque, eqs. 12-14 and 19."""

    def draw(limb: str, count: Scalar) -> Scalar:
        if f"{limb}_torque_Nm" not in inputs:
            return jnp.zeros(())
        torque = inputs[f"{limb}_torque_Nm"]
        moving = torque + jnp.sign(torque) * p.tau_0
        return count * inputs[f"{limb}_duty"] * moving / p.k_tau

    return draw("flipper", p.n_flipper_motors) + draw("arm", p.n_arm_motors)


def pack(cell: Cell, motor: Motor, accessories_A: Scalar, motor_current_A: Scalar) -> tuple[Scalar, Scalar]:
    """Return the pack's voltage (V) and current (A) for a current in each track motor, eqs. 14 and 21.

    i_draw = n rho i_a + I_Mf + I_Ma + I_ob and V_pack = n_series V_cell. If an effect makes the on-board draw depend on
    the pack's voltage, the loop is solved by iteration on the secant of the pack's voltage over its current: the draw
    changes the voltage by some 1e-3 of itself, so that three iterations reach rounding.
    """
    p = cell.context.parameters
    motors_A = p.n_motors * motor.context.duty * motor_current_A + accessories_A

    def voltage_at(current):
        shortfall = fold(cell.effects, "weakest_cell_voltage", jnp.zeros(()), cells.carrying(cell, current))
        return p.n_series * cells.voltage(cell, current) - shortfall

    def draw_at(pack_voltage):
        context = _at_pack_voltage(motor.context, pack_voltage)
        return motors_A + fold(motor.effects, "onboard_current", p.onboard_current_A, context)

    current = motors_A + p.onboard_current_A
    voltage = voltage_at(current)
    if touches(motor.effects, "onboard_current"):
        first = draw_at(voltage)
        differs = jnp.abs(first - current) > 1e-9
        slope = jnp.where(differs, (voltage_at(first) - voltage) / jnp.where(differs, first - current, 1.0), 0.0)
        start = voltage
        for _ in range(3):
            current = draw_at(voltage)
            voltage = start + slope * (current - (motors_A + p.onboard_current_A))
    return voltage, draw_at(voltage)


def bridge_voltage(cell: Cell, motor: Motor, accessories_A: Scalar, motor_current_A: Scalar) -> Scalar:
    """Return the voltage at the motor's terminals in V, eq. 14: V_M = rho V_pack."""
    voltage, _ = pack(cell, motor, accessories_A, motor_current_A)
    context = _at_pack_voltage(motor.context, voltage, motor_current_A)
    return fold(motor.effects, "bridge_voltage", motor.context.duty * voltage, context)


def _at_pack_voltage(context: MotorContext, voltage: Scalar, current: Scalar | None = None) -> MotorContext:
    context = eqx.tree_at(lambda c: c.pack_voltage_V, context, voltage)
    return context if current is None else eqx.tree_at(lambda c: c.current_A, context, current)
