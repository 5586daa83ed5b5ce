"""One brushed permanent-magnet DC motor: armature, rotor, losses and two thermal stages (eqs. 11-13, 15-17)."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxmodel.armature import ArmatureStep, Matrix, Pair, solve_pair, solve_speed, stable
from jaxmodel.declaration import Scalar
from jaxmodel.flow import Flow, State, relaxation
from jaxmodel.parameters import Parameters
from jaxmodel.ports import Effect, MotorContext, fold, touches

TerminalVoltage = Callable[[Scalar], Scalar]
BENDING_PORTS = ("armature_voltage_drop", "motor_torque", "friction_torque")


class Motor(eqx.Module):
    """The quantities of one motor that do not depend on its present current and speed."""

    context: MotorContext
    effects: tuple[Effect, ...]
    winding_resistance_ohm: Scalar
    inductance_H: Scalar
    torque_constant: Scalar
    load_torque_Nm: Scalar


def initial_state() -> State:
    """Return the motor's states at the start of a run: at rest, at ambient temperature."""
    return {name: jnp.zeros(()) for name in ("x_winding_K", "x_case_K", "motor_current_A", "speed_rad_s")}


def evaluate(
    parameters: Parameters,
    effects: tuple[Effect, ...],
    state: State,
    ambient_degC: Scalar,
    load_torque_Nm: Scalar,
    duty: Scalar,
    pack_voltage_V: Scalar,
) -> Motor:
    """Return the motor's temperatures (degC), resistance, inductance and torque constant at a state, eqs. 15 and 17."""
    p = parameters
    case = ambient_degC + state["x_case_K"]
    winding = case + state["x_winding_K"]
    context = MotorContext(
        parameters=p,
        state=state,
        ambient_degC=ambient_degC,
        winding_degC=winding,
        case_degC=case,
        duty=duty,
        pack_voltage_V=pack_voltage_V,
        current_A=state["motor_current_A"],
        speed_rad_s=state["speed_rad_s"],
    )
    above_reference = winding - p.T_0
    return Motor(
        context=context,
        effects=effects,
        winding_resistance_ohm=fold(effects, "winding_resistance", p.R_0 * (1.0 + p.psi_R * above_reference), context),
        inductance_H=p.L_a * (1.0 + p.psi_L * above_reference),
        torque_constant=fold(effects, "torque_constant", p.k_tau, context),
        load_torque_Nm=fold(effects, "load_torque", load_torque_Nm, context),
    )


def _running(motor: Motor, current_A: Scalar, speed_rad_s: Scalar) -> MotorContext:
    return eqx.tree_at(lambda c: (c.current_A, c.speed_rad_s), motor.context, (current_A, speed_rad_s))


def rates(motor: Motor, terminal_voltage: TerminalVoltage, pair: Pair) -> Pair:
    """Return (di_a/dt, dw/dt) in A/s and rad/s^2, eqs. 11-13, without the Coulomb friction.

    L_a di_a/dt = V_M - R i_a - k_e w - drops; J dw/dt = tau_D - tau_l - smooth friction.
    """
    current, speed = pair
    across = terminal_voltage(current) - motor.winding_resistance_ohm * current - motor.torque_constant * speed
    torque = motor.torque_constant * current - motor.load_torque_Nm
    return jnp.stack([across / motor.inductance_H, torque / motor.context.parameters.J]) + _departure(motor, pair)


def _departure(motor: Motor, pair: Pair) -> Pair:
    """Return what effects on drop, torque and friction add to the rates of the linear pair."""
    context = _running(motor, pair[0], pair[1])
    drop = fold(motor.effects, "armature_voltage_drop", jnp.zeros(()), context)
    linear_torque = motor.torque_constant * pair[0]
    torque = fold(motor.effects, "motor_torque", linear_torque, context) - linear_torque
    friction = fold(motor.effects, "friction_torque", jnp.zeros(()), context)
    return jnp.stack([-drop / motor.inductance_H, (torque - friction) / motor.context.parameters.J])


def _secant(function: Callable[[Pair], Pair], start: Pair, end: Pair) -> Matrix:
    """Return the matrix that takes end - start to f(end) - f(start), less the Jacobian at the start."""
    tangent = jax.jacfwd(function)(start)
    at_start, at_end = function(start), function(end)
    at_corner = function(jnp.stack([end[0], start[1]]))
    change = end - start
    apart = jnp.abs(change) > 1e-6 * (1.0 + jnp.abs(start))
    safe = jnp.where(apart, change, 1.0)
    columns = jnp.stack([(at_corner - at_start) / safe[0], (at_end - at_corner) / safe[1]], axis=1)
    return jnp.where(apart, columns, tangent) - tangent


def _coulomb_torque(motor: Motor, speed_rad_s: Scalar) -> Scalar:
    context = _running(motor, motor.context.current_A, speed_rad_s)
    return fold(motor.effects, "coulomb_torque", motor.context.parameters.tau_0, context)


def run(
    now: Motor,
    later: Motor,
    voltage_now: TerminalVoltage,
    voltage_later: TerminalVoltage,
    duration: Scalar,
    lead: Scalar,
    expected: Pair,
) -> ArmatureStep:
    """Advance current and speed over a step, the voltage given.

    Args:
        now: the motor at the start of the step.
        later: the motor at the state that stands for the step; its coefficients are those linearised.
        voltage_now: terminal voltage (V) as a function of i_a (A), at the start.
        voltage_later: the same, at the later state.
        duration: of the step, s.
        lead: seconds from the start to the later state; 0 where it is the same.
        expected: i_a and w towards which the step goes, as far as is known; zeros where it is not. Effects that bend
            (brush drop, saturation) enter with their secant up to there: a tangent would step over the bend.
    """
    pair = jnp.stack([now.context.current_A, now.context.speed_rad_s])
    inertia = now.context.parameters.J

    def later_rates(x):
        return rates(later, voltage_later, x)

    rate_later, jacobian = later_rates(pair), jax.jacfwd(later_rates)(pair)
    if any(touches(later.effects, port) for port in BENDING_PORTS):
        jacobian = jacobian + _secant(lambda x: _departure(later, x), pair, expected)
    rate_now = rates(now, voltage_now, pair)
    drift = jnp.where(lead > 0.0, (rate_later - rate_now) / jnp.where(lead > 0.0, lead, 1.0), 0.0)

    level, slope = jax.value_and_grad(lambda w: _coulomb_torque(later, w))(pair[1])
    jacobian = jacobian.at[1, 1].add(-jnp.sign(pair[1]) * slope / inertia)
    jacobian = stable(jacobian, later.torque_constant / inertia, duration)
    return solve_pair(pair, rate_now, drift, jacobian, level, inertia, duration)


def run_at_current(motor: Motor, current_A: Scalar, duration: Scalar) -> ArmatureStep:
    """Advance the speed over a step with the motor's current imposed."""
    speed = motor.context.speed_rad_s

    def acceleration(w):
        return rates(motor, lambda _: jnp.zeros(()), jnp.stack([current_A, w]))[1]

    rate, slope = jax.value_and_grad(acceleration)(speed)
    level = _coulomb_torque(motor, speed)
    return solve_speed(current_A, speed, rate, jnp.minimum(slope, 0.0), level, motor.context.parameters.J, duration)


def loss(motor: Motor, step: ArmatureStep) -> Scalar:
    """Return the mean power in W that heats the winding over a step, eq. 16 as the design reads it.

    P_M = i_a^2 R + |w| (sum of the motor's friction torques), the first with the variance of i_a over the step.
    """
    context = _running(motor, step.mean_current_A, step.mean_speed_rad_s)
    copper = (step.mean_current_A**2 + step.current_variance_A2) * motor.winding_resistance_ohm
    friction = step.coulomb_torque_Nm + fold(motor.effects, "friction_torque", jnp.zeros(()), context)
    return fold(motor.effects, "motor_loss", copper + friction * step.mean_speed_rad_s, context)


def flows(motor: Motor, step: ArmatureStep) -> dict[str, Flow]:
    """Return the flows of the motor's two temperature rises, eq. 15."""
    p = motor.context.parameters
    power = loss(motor, step)
    own = {
        "x_winding_K": relaxation(p.R_wc * power, p.tau_wc),
        "x_case_K": relaxation(p.R_ca * power, p.tau_ca),
    }
    context = _running(motor, step.mean_current_A, step.mean_speed_rad_s)
    for effect in motor.effects:
        own |= effect.flows(None, context, jnp.zeros(()))
    return own
