"""One brushed permanent-magnet DC motor: armature, rotor, losses and two thermal stages (eqs. 11-13, 15-17)."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxmodel.model.armature import ArmatureStep, Bend, Matrix, Pair, solve_pair, solve_speed, stable
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.flow import Flow, State, mean_exponential, relaxation
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import Effect, MotorContext, flows_of, fold, touches
from jaxmodel.model.root import rising_root

TerminalVoltage = Callable[[Scalar], Scalar]
# Shortest secant, as a share of its variable (and of 1 A or 1 rad/s): short enough to be a tangent, long enough to lose
# only 1e-13 to rounding.
SMALLEST_SECANT = 1e-3
# In a long step the slope of torque over current is at least this share of its chord to zero current: that of its
# tangent at a third of the current that halves the torque.
CHORD_SHARE = 0.8
# The ports whose values change with the current or speed within a step; without an effect on any the pair is linear.
BENDING = (
    "armature_voltage_drop", "motor_torque", "coulomb_torque", "friction_torque", "bridge_voltage", "onboard_current",
    "overpotential", "weakest_cell_voltage", "load_drag", "load_friction", "iron_drag", "iron_friction",
)  # fmt: skip
# Speed in rad/s below which a rotor held by friction is at rest: its sign is a rounding error.
STANDSTILL = 1e-9


class Motor(eqx.Module):
    """The quantities of one motor that do not depend on its current and speed."""

    context: MotorContext
    effects: tuple[Effect, ...]
    winding_resistance_ohm: Scalar
    inductance_H: Scalar
    torque_constant: Scalar
    load_torque_Nm: Scalar
    inertia_kg_m2: Scalar


def initial_state(parameters: Parameters) -> State:
    """Return the motor's states at the start of a run: its initial current, speed and temperature rises."""
    return {
        "x_winding_K": parameters.initial_winding_rise_K,
        "x_case_K": parameters.initial_case_rise_K,
        "motor_current_A": parameters.initial_current_A,
        "speed_rad_s": parameters.initial_speed_rad_s,
    }


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
        load_torque_Nm=load_torque_Nm,
        position_rad=jnp.zeros(()),
        step_s=jnp.zeros(()),
    )
    if (position := turned(state)) is not None:
        context = eqx.tree_at(lambda c: c.position_rad, context, position)
    load_torque = fold(effects, "load_torque", load_torque_Nm, context)
    context = eqx.tree_at(lambda c: c.load_torque_Nm, context, load_torque)
    if position is not None:
        position = fold(effects, "output_position", position, context)
        context = eqx.tree_at(lambda c: c.position_rad, context, position)
    above_reference = winding - p.T_0
    return Motor(
        context=context,
        effects=effects,
        winding_resistance_ohm=fold(effects, "winding_resistance", p.R_0 * (1.0 + p.psi_R * above_reference), context),
        inductance_H=p.L_a * (1.0 + p.psi_L * above_reference),
        torque_constant=fold(effects, "torque_constant", p.k_tau, context),
        load_torque_Nm=load_torque,
        inertia_kg_m2=fold(effects, "inertia", p.J, context),
    )


def turned(state: State) -> Scalar | None:
    """Return the position of the motor in rad, where one of the states is one; at the output of its gear."""
    return next((value for name, value in state.items() if name.endswith(".position_rad")), None)


def over(motor: Motor, duration: Scalar) -> Motor:
    """Return the motor with the seconds over which its ports are to be evaluated."""
    return eqx.tree_at(lambda m: m.context.step_s, motor, duration)


def rates(motor: Motor, terminal_voltage_V: Scalar, pair: Pair) -> Pair:
    """Return (di_a/dt, dw/dt) in A/s and rad/s^2 at a voltage on the terminals, eqs. 11-13, without Coulomb friction.

    L_a di_a/dt = V_M - R i_a - k_e w - drops; J dw/dt = tau_D - tau_l - smooth friction.
    """
    torque, resisting = _driving_torque(motor, pair), _smooth_resistance(motor, pair)
    by_current = current_rate(motor, terminal_voltage_V, pair)
    return Pair(by_current, (torque - motor.load_torque_Nm - resisting) / motor.inertia_kg_m2)


def current_rate(motor: Motor, terminal_voltage_V: Scalar, pair: Pair) -> Scalar:
    """Return di_a/dt in A/s at a voltage on the terminals, eq. 11."""
    drop = _voltage_drop(motor, pair)
    ohmic, back_emf = motor.winding_resistance_ohm * pair.current, motor.torque_constant * pair.speed
    return (terminal_voltage_V - ohmic - back_emf - drop) / motor.inductance_H


def _smooth_resistance(motor: Motor, pair: Pair) -> Scalar:
    """Return the torque in N m that grows smoothly with speed: of the motor's friction and iron, and of its load."""
    context = _running(motor, pair)
    friction = fold(motor.effects, "friction_torque", jnp.zeros(()), context)
    for port in ("load_drag", "iron_drag"):
        if touches(motor.effects, port):
            friction = friction + fold(motor.effects, port, jnp.zeros(()), context)
    return friction


def _running(motor: Motor, pair: Pair) -> MotorContext:
    return eqx.tree_at(lambda c: (c.current_A, c.speed_rad_s), motor.context, (pair.current, pair.speed))


def _voltage_drop(motor: Motor, pair: Pair) -> Scalar:
    return fold(motor.effects, "armature_voltage_drop", jnp.zeros(()), _running(motor, pair))


def _driving_torque(motor: Motor, pair: Pair) -> Scalar:
    return fold(motor.effects, "motor_torque", motor.torque_constant * pair.current, _running(motor, pair))


def _secant_end(start: Scalar, expected: Scalar, rate: Scalar) -> Scalar:
    """Return the end of a secant from `start`: the expected value, or a point just ahead if that is too close."""
    ahead = SMALLEST_SECANT * (1.0 + jnp.abs(start))
    change = expected - start
    return start + jnp.where(jnp.abs(change) > ahead, change, jnp.where(rate < 0.0, -ahead, ahead))


def _coulomb_torque(motor: Motor, speed_rad_s: Scalar, current_A: Scalar | None = None) -> Scalar:
    """Return the size of all dry friction in N m: of motor, iron and load; at another current than its own."""
    level = _dry(motor, "coulomb_torque", speed_rad_s, current_A)
    for port in ("load_friction", "iron_friction"):
        if touches(motor.effects, port):
            level = level + _dry(motor, port, speed_rad_s)
    return level


def _dry(motor: Motor, port: str, speed_rad_s: Scalar, current_A: Scalar | None = None) -> Scalar:
    """Return the size in N m of the dry friction of one port; only the first has a value without effects, tau_0."""
    current = motor.context.current_A if current_A is None else current_A
    least = motor.context.parameters.tau_0 if port == "coulomb_torque" else jnp.zeros(())
    return fold(motor.effects, port, least, _running(motor, Pair(current, speed_rad_s)))


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
        later: the motor at the state that represents the step; its coefficients are linearised.
        voltage_now: terminal voltage (V) as a function of i_a (A), at the start.
        voltage_later: the same, at the later state.
        duration: of the step, s.
        lead: seconds from the start to the later state; 0 where it is the same.
        expected: expected i_a and w at the end, zeros if unknown. The linearisation is the tangent of a
            linear pair; else the secant up to there, as a tangent would miss the nonlinearity of an effect (brush
            drop, saturation).
    """
    pair = Pair(now.context.current_A, now.context.speed_rad_s)
    inertia = now.inertia_kg_m2
    volts_at_start = voltage_later(pair.current)
    at_start = rates(later, volts_at_start, pair)
    rate_now = at_start if now is later else rates(now, voltage_now(pair.current), pair)
    # Teeth rub in proportion to the current: that of the middle of the step, where the first half has told it.
    level = _coulomb_torque(later, pair.speed, None if now is later else expected.current)
    if now is not later and touches(later.effects, "coulomb_torque"):
        # The friction level below is that of the later state; its growth until then is missing at the start.
        direction = jnp.where(jnp.abs(pair.speed) > STANDSTILL, jnp.sign(pair.speed), 0.0)
        growth = direction * (level - _coulomb_torque(now, pair.speed)) / inertia
        rate_now = Pair(rate_now.current, rate_now.speed + growth)
    drift = at_start.plus(rate_now, -1.0).times(jnp.where(lead > 0.0, 1.0 / jnp.where(lead > 0.0, lead, 1.0), 0.0))

    if touches(later.effects, *BENDING):
        end = Pair(*(_secant_end(*each) for each in zip(pair, expected, at_start, strict=True)))
        jacobian = _secants(later, voltage_later, pair, end, at_start, level)
    else:
        end, jacobian = pair, _tangents(later, voltage_later, pair)
    if touches(later.effects, "motor_torque"):
        jacobian = _following_the_torque(jacobian, later, pair, end, duration)
    if touches(later.effects, *BENDING):
        jacobian = stable(jacobian, later.torque_constant / inertia, duration)
    bend = _bend_of_the_drop(later, pair, end) if touches(later.effects, "armature_voltage_drop") else None
    return solve_pair(pair, rate_now, drift, jacobian, level, inertia, duration, bend)


def _secants(motor: Motor, voltage: TerminalVoltage, start: Pair, end: Pair, at_start: Pair, level: Scalar) -> Matrix:
    """Return the change of the rates, friction included, along the current and then along the speed."""
    at_corner = rates(motor, voltage(end.current), Pair(end.current, start.speed))
    at_end = rates(motor, voltage(end.current), end)
    by_current = at_corner.plus(at_start, -1.0).times(1.0 / (end.current - start.current))
    by_speed = at_end.plus(at_corner, -1.0).times(1.0 / (end.speed - start.speed))
    level_slope = (_coulomb_torque(motor, end.speed) - _coulomb_torque(motor, start.speed)) / (end.speed - start.speed)
    friction_slope = jnp.sign(start.speed) * level_slope / motor.inertia_kg_m2
    return Matrix(by_current.current, by_speed.current, by_current.speed, by_speed.speed - friction_slope)


def _tangents(motor: Motor, voltage: TerminalVoltage, at: Pair) -> Matrix:
    """Return the derivatives of the rates by current and speed; exact, as the pair is linear here."""

    def along_current(current: Scalar) -> Pair:
        return rates(motor, voltage(current), Pair(current, at.speed))

    def along_speed(speed: Scalar) -> Pair:
        return rates(motor, jnp.zeros(()), Pair(at.current, speed))

    by_current, by_speed = (
        jax.jvp(along, (x,), (jnp.ones_like(x),))[1]
        for along, x in ((along_current, at.current), (along_speed, at.speed))
    )
    return Matrix(by_current.current, by_speed.current, by_current.speed, by_speed.speed)


def _following_the_torque(jacobian: Matrix, motor: Motor, start: Pair, end: Pair, duration: Scalar) -> Matrix:
    """Bound d(dw/dt)/di from below in a step that is long compared with the rotor's time constant.

    If saturation makes the torque fall as the current grows, the secant of a long step would keep the torque up while
    the current falls, and the rotor would overshoot its equilibrium. There the torque follows approximately its chord
    to zero current. Shorter steps keep their secant, which gives a correct start and a correct heat of the inrush.
    """
    inertia = motor.inertia_kg_m2

    def chord(pair: Pair) -> Scalar:
        none = jnp.abs(pair.current) < SMALLEST_SECANT  # of a motor at rest, 1e-250 A
        torque = _driving_torque(motor, pair)
        return jnp.where(none, motor.torque_constant, torque / jnp.where(none, 1.0, pair.current)) / inertia

    least = CHORD_SHARE * jnp.minimum(chord(start), chord(end))
    far_longer = (duration * jacobian.b * least / jacobian.a) ** 8  # duration in time constants; 0 or all, and smooth
    share = far_longer / (1.0 + far_longer)
    return jacobian._replace(c=jacobian.c + share * jnp.maximum(least - jacobian.c, 0.0))


def _bend_of_the_drop(motor: Motor, start: Pair, secant_end: Pair) -> Bend:
    """Return the deviation of a voltage drop from its secant in the current; it is large near zero current."""
    at_start = _voltage_drop(motor, start)
    at_end = _voltage_drop(motor, Pair(secant_end.current, start.speed))
    slope = (at_end - at_start) / (secant_end.current - start.current)

    def off_the_line(pair: Pair) -> Scalar:
        return (_voltage_drop(motor, pair) - at_start - slope * (pair.current - start.current)) / motor.inductance_H

    return Bend(off_the_line, slope / motor.inductance_H)


def run_at_current(motor: Motor, current_A: Scalar, duration: Scalar) -> ArmatureStep:
    """Advance the speed over a step with the motor's current imposed."""
    speed = motor.context.speed_rad_s

    def acceleration(w):
        return rates(motor, jnp.zeros(()), Pair(current_A, w)).speed

    rate = acceleration(speed)
    ahead = _secant_end(speed, speed, rate)
    slope = (acceleration(ahead) - rate) / (ahead - speed)
    level = _coulomb_torque(motor, speed)
    return solve_speed(current_A, speed, rate, jnp.minimum(slope, 0.0), level, motor.inertia_kg_m2, duration)


def run_at_speed(motor: Motor, voltage: TerminalVoltage, duration: Scalar) -> ArmatureStep:
    """Advance the current over a step with the voltage given and the speed imposed, eq. 11; eq. 13 is not used.

    The current relaxes to i_e, where di_a/dt is zero, with the slope of di_a/dt between its start and i_e: exact if
    eq. 11 is linear in the current, and at the end of a step far longer than L_a / R otherwise.
    """
    speed, start = motor.context.speed_rad_s, motor.context.current_A

    def falling(current: Scalar) -> Scalar:
        return current_rate(motor, voltage(current), Pair(current, speed))

    ohmic = motor.winding_resistance_ohm / motor.inductance_H
    rate = falling(start)
    if touches(motor.effects, *BENDING):
        settled = rising_root(lambda current: -falling(current), near=start, least_slope=ohmic)
    else:
        slope = jax.jvp(falling, (start,), (jnp.ones_like(start),))[1]
        settled = start - rate / slope
    away = start - settled
    far = jnp.abs(away) > SMALLEST_SECANT * (1.0 + jnp.abs(start))
    decay = jnp.where(far, rate / jnp.where(far, -away, 1.0), ohmic) * duration
    mean = mean_exponential(decay)
    return ArmatureStep(
        current_A=settled + away * jnp.exp(-decay),
        speed_rad_s=speed,
        mean_current_A=settled + away * mean,
        mean_speed_rad_s=speed,
        current_variance_A2=away**2 * (mean_exponential(2.0 * decay) - mean**2),
        coulomb_torque_Nm=_imposed_friction(motor),
    )


def run_imposed(motor: Motor, current_A: Scalar) -> ArmatureStep:
    """Return a step with current and speed imposed: what is left to be found is heat."""
    speed = motor.context.speed_rad_s
    return ArmatureStep(current_A, speed, current_A, speed, jnp.zeros(()), _imposed_friction(motor))


def asked_torque(motor: Motor, rate_rad_s2: Scalar) -> Scalar:
    """Return what a load asks of the shaft at the motor's speed in N m: torque, drag, dry friction and its inertia."""
    context, speed = motor.context, motor.context.speed_rad_s
    drag = fold(motor.effects, "load_drag", jnp.zeros(()), context)
    dry = jnp.sign(speed) * fold(motor.effects, "load_friction", jnp.zeros(()), context)
    return motor.load_torque_Nm + drag + dry + (motor.inertia_kg_m2 - context.parameters.J) * rate_rad_s2


def shaft_torque(motor: Motor, pair: Pair) -> Scalar:
    """Return what is left of the motor's torque for load and inertia in N m: less friction and iron, eqs. 12 and 13."""
    direction = jnp.where(jnp.abs(pair.speed) > STANDSTILL, jnp.sign(pair.speed), 0.0)
    left = _driving_torque(motor, pair)
    for port in ("coulomb_torque", "iron_friction"):
        left = left - direction * _dry(motor, port, pair.speed)
    for port in ("friction_torque", "iron_drag"):
        left = left - fold(motor.effects, port, jnp.zeros(()), _running(motor, pair))
    return left


def _imposed_friction(motor: Motor) -> Scalar:
    speed = motor.context.speed_rad_s
    return jnp.where(jnp.abs(speed) > STANDSTILL, jnp.sign(speed), 0.0) * _coulomb_torque(motor, speed)


def loss(motor: Motor, step: ArmatureStep) -> Scalar:
    """Return the mean power in W that heats the winding over a step, eq. 16.

    P_M = i_a^2 R + |w| (sum of the motor's friction torques), the first with the variance of i_a over the step.
    """
    context = _running(motor, Pair(step.mean_current_A, step.mean_speed_rad_s))
    copper = (step.mean_current_A**2 + step.current_variance_A2) * motor.winding_resistance_ohm
    dry = step.coulomb_torque_Nm
    for port in ("load_friction", "iron_friction"):  # what rubs outside of the winding does not warm it
        if touches(motor.effects, port):
            dry = dry - _share(motor, step, port)
    friction = dry + fold(motor.effects, "friction_torque", jnp.zeros(()), context)
    return fold(motor.effects, "motor_loss", copper + friction * step.mean_speed_rad_s, context)


def _share(motor: Motor, step: ArmatureStep, port: str) -> Scalar:
    """Return the part of a step's dry friction in N m that is of one port."""
    every = _coulomb_torque(motor, step.mean_speed_rad_s)
    part = _dry(motor, port, step.mean_speed_rad_s)
    return step.coulomb_torque_Nm * part / jnp.where(every > 0.0, every, 1.0)


def _iron_loss(motor: Motor, step: ArmatureStep) -> Scalar | None:
    """Return the mean power in W that heats the iron, and so the case without the winding; None without an effect."""
    if not touches(motor.effects, "iron_drag", "iron_friction"):
        return None
    context = _running(motor, Pair(step.mean_current_A, step.mean_speed_rad_s))
    drag = _share(motor, step, "iron_friction") + fold(motor.effects, "iron_drag", jnp.zeros(()), context)
    return drag * step.mean_speed_rad_s


def _stages(motor: Motor, power: Scalar, iron: Scalar | None) -> dict[str, Flow]:
    """Return the flows of the rises of the winding over the case x_1 and of the case over the ambient x_2.

    Eq. 15 warms both by P at once. Where a share s of it reaches the case through the winding, with C_w = tau_wc / R_wc
    and C_c = tau_ca / R_ca: C_c dx_2/dt = (1 - s) P + s x_1/R_wc + P_iron - x_2/R_ca and
    C_w (dx_1/dt + s dx_2/dt) = P - x_1/R_wc. At s = 1 it is the chain of two heat capacities. What x_1 does to itself
    through x_2 is in its decay, so that a step of any length is stable.
    """
    p = motor.context.parameters
    at_once = power if iron is None else power + iron
    if not touches(motor.effects, "heat_path"):
        return {"x_winding_K": relaxation(p.R_wc * power, p.tau_wc), "x_case_K": relaxation(p.R_ca * at_once, p.tau_ca)}
    share, state = fold(motor.effects, "heat_path", jnp.zeros(()), motor.context), motor.context.state
    at_once = at_once - share * power
    taken = share * (p.tau_wc / p.R_wc) * (p.R_ca / p.tau_ca)  # s C_w / C_c
    faster = 1.0 + share * taken
    over_case = p.R_wc * (power - taken * (at_once - state["x_case_K"] / p.R_ca)) / faster
    through = at_once + share * state["x_winding_K"] / p.R_wc
    return {"x_winding_K": relaxation(over_case, p.tau_wc / faster), "x_case_K": relaxation(p.R_ca * through, p.tau_ca)}


def flows(motor: Motor, step: ArmatureStep) -> dict[str, Flow]:
    """Return the flows of the motor's two temperature rises, eq. 15."""
    own = _stages(motor, loss(motor, step), _iron_loss(motor, step))
    context = _running(motor, Pair(step.mean_current_A, step.mean_speed_rad_s))
    return own | flows_of(motor.effects, None, context, jnp.zeros(()))
