"""Candidate effects of the motor, its gear, its bridge and the on-board electronics."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.flow import Flow, State, relaxation
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import CellContext, Effect, MotorContext

MOTOR = ("motor", "robot")
ROBOT = ("robot",)
REFERENCE_DEGC = 20.0
DIRECTION_RAD_S = 1.0  # a rotor faster than this has a direction
# What runs must show for an effect to be told from others: power that flows both ways between motor and load; motion
# both ways, in a position that is read or not; the temperatures of winding and case, at speeds that differ; or a
# voltage, in rows that follow it. And a motor must have brushes for what they do.
BACK_DRIVING, REVERSING, LOST_MOTION = "back-driving", "reversing", "lost motion"
BOTH_TEMPERATURES, BRUSHES, FAST_VOLTAGE = "both temperatures", "brushes", "fast voltage"
DIRECTION_DUTY = 0.02  # so has a bridge with more duty than this


class MagnetTemperature(Effect):
    """The magnet weakens as it warms: k_tau (1 + psi_k (T_w - T_0)), in torque and back-EMF (eq. 17)."""

    name: ClassVar[str] = "magnet_temperature"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "k_tau -> k_tau (1 + psi_k (T_w - T_0))"
    psi_k: Scalar = parameter(
        -0.001,
        unit="1/K",
        meaning="temperature coefficient of the torque constant",
        null=0.0,
        lower=-0.01,
        upper=0.003,
        typical=(-0.003, -0.0001),
    )

    def torque_constant(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the torque constant."""
        return value * (1.0 + self.psi_k * (context.winding_degC - context.parameters.T_0))


class Saturation(Effect):
    """The iron saturates: torque k_tau i_a / (1 + (i_a/i_s)^2); the back-EMF stays, else the armature is unstable."""

    name: ClassVar[str] = "saturation"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_D -> k_tau i_a/(1 + (i_a/i_s)^2)"
    i_s: Scalar = parameter(
        50.0,
        unit="A",
        meaning="current at which half the torque is lost",
        null=jnp.inf,
        lower=1e-3,
        upper=1e5,
        transform="log",
        typical=(25.0, 80.0),
        scales="motor_current",
    )

    def motor_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lose torque at high current."""
        return value / (1.0 + (context.current_A / self.i_s) ** 2)


class BrushDrop(Effect):
    """Brush voltage drop, almost independent of the current: V_M -= V_b tanh(i_a / 0.1 A)."""

    name: ClassVar[str] = "brush_drop"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "V_M -= V_b tanh(i_a/0.1)"
    distinguished_by: ClassVar[str] = BRUSHES
    V_b: Scalar = parameter(
        0.5, unit="V", meaning="drop over both brushes", null=0.0, lower=0.0, upper=5.0, typical=(0.1, 1.5)
    )

    def armature_voltage_drop(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lose the drop."""
        return value + self.V_b * jnp.tanh(context.current_A / 0.1)


class ViscousFriction(Effect):
    """Grease and bearings: a torque b w."""

    name: ClassVar[str] = "viscous_friction"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction += b w"
    b: Scalar = parameter(
        2e-5,
        unit="N m s/rad",
        meaning="viscous coefficient",
        null=0.0,
        lower=0.0,
        upper=1e3,
        typical=(1e-6, 2e-4),
        scales="torque/speed",
    )

    def friction_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add a torque in proportion to speed."""
        return value + self.b * context.speed_rad_s


class StribeckFriction(Effect):
    """Friction is higher near standstill: (tau_s) exp(-(w/w_s)^2) sgn(w)."""

    name: ClassVar[str] = "stribeck_friction"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction += tau_s exp(-(w/w_s)^2) sgn(w)"
    tau_s: Scalar = parameter(
        0.01,
        unit="N m",
        meaning="excess at standstill",
        null=0.0,
        lower=0.0,
        upper=1e3,
        typical=(0.002, 0.04),
        scales="torque",
    )
    w_s: Scalar = parameter(
        30.0,
        unit="rad/s",
        meaning="speed at which it fades",
        lower=1e-3,
        upper=2e3,
        transform="log",
        typical=(5.0, 100.0),
        shape_grid=(10.0, 30.0, 90.0),
        scales="speed",
    )

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Raise the friction, at rest and at low speed."""
        return value + self.tau_s * jnp.exp(-((context.speed_rad_s / self.w_s) ** 2))


class Windage(Effect):
    """Air drag of rotor and fan: c w |w|."""

    name: ClassVar[str] = "windage"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction += c w |w|"
    c: Scalar = parameter(
        5e-8,
        unit="N m s2/rad2",
        meaning="drag coefficient",
        null=0.0,
        lower=0.0,
        upper=1e3,
        typical=(1e-9, 1e-6),
        scales="torque/speed2",
    )

    def friction_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add a torque in proportion to the speed squared."""
        return value + self.c * context.speed_rad_s * jnp.abs(context.speed_rad_s)


class IronLoss(Effect):
    """The iron loses power as its magnetisation turns: by hysteresis T_h |w|, and by eddy currents T_h w^2 / w_e.

    P = k_h f B^n + k_e f^2 B^2 (Steinmetz, Trans. AIEE 9 (1892) 3; Bertotti, IEEE Trans. Magn. 24 (1988) 621) at the
    induction B that the magnets give, with f in proportion to the speed; the excess loss f^1.5 lies between the two. It
    drags the rotor as friction and viscous friction do, and warms the stator, which is the case, not the winding.
    """

    name: ClassVar[str] = "iron_loss"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction += T_h sgn(w) (1 + |w|/w_e), whose heat is of the case"
    distinguished_by: ClassVar[str] = BOTH_TEMPERATURES
    T_h: Scalar = parameter(
        0.01,
        unit="N m",
        meaning="drag of hysteresis",
        null=0.0,
        lower=0.0,
        upper=1e3,
        typical=(0.002, 0.04),  # as of friction: 0.5 to 10 % of the torque of a motor with a stator of iron; assumed
        scales="torque",
    )
    w_e: Scalar = parameter(
        200.0,
        unit="rad/s",
        meaning="speed at which eddy currents lose as much as hysteresis",
        lower=1e-3,
        upper=1e6,
        transform="log",
        # 50 to 500 Hz of sheets of 0.5 to 0.2 mm, at 4 to 14 pole pairs; assumed.
        typical=(30.0, 800.0),
        shape_grid=(60.0, 400.0),
    )

    def iron_friction(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the drag of hysteresis, which holds at rest too."""
        return value + self.T_h

    def iron_drag(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the drag of eddy currents."""
        return value + self.T_h * context.speed_rad_s / self.w_e


class HeatPath(Effect):
    """The case warms after the winding: a share s of the winding's heat reaches it through the winding alone.

    Eq. 15 is a Foster network, whose stages warm at once; at s = 1 it is a Cauer network of the same two heat
    capacities tau/R, whose case follows. Infineon AN2008-03, Thermal equivalent circuit models, 2008.
    """

    name: ClassVar[str] = "heat_path"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = (
        "C_c dx_2/dt = (1 - s) P_M + s x_1/R_wc - x_2/R_ca, C_w (dx_1/dt + s dx_2/dt) = P_M - x_1/R_wc, C = tau/R"
    )
    shown_by: ClassVar[str] = "case_temperature_degC"
    s: Scalar = parameter(
        1.0,
        unit="",
        meaning="share of the heat that reaches the case through the winding",
        null=0.0,
        lower=0.0,
        upper=1.0,
        typical=(0.3, 1.0),
    )

    def heat_path(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lead the share through the winding."""
        return value + self.s


class FrictionTemperature(Effect):
    """Grease thins as the motor warms: tau_0 exp(-b_T (T_c - 20))."""

    name: ClassVar[str] = "friction_temperature"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_0 -> tau_0 exp(-b_T (T_c - 20))"
    b_T: Scalar = parameter(
        0.015, unit="1/K", meaning="thinning", null=0.0, lower=-0.05, upper=0.2, typical=(0.005, 0.05)
    )

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the no-load torque itself, not what other effects added to it."""
        factor = jnp.exp(-self.b_T * (context.case_degC - REFERENCE_DEGC))
        return value + context.parameters.tau_0 * (factor - 1.0)


class GearLoss(Effect):
    """The gear asks for more torque than it passes on: load torque (1 + e), whichever way power flows."""

    name: ClassVar[str] = "gear_loss"
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_l -> tau_l (1 + e)"
    e: Scalar = parameter(
        0.05, unit="", meaning="lost share of the load torque", null=0.0, lower=0.0, upper=3.0, typical=(0.004, 0.4)
    )

    def load_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Raise the load torque."""
        return value * (1.0 + self.e)


class GearFriction(Effect):
    """Teeth under load rub: dry friction in proportion to the load, so that driving takes more than back-driving gives.

    The motor needs tau_l (1 + f) to drive a load and tau_l (1 - f) to hold one that drives it; it locks from f = 1 on.
    The terms of external torque of models M3 to M6 of Duclusaud et al. 2024, arXiv 2410.08650.
    """

    name: ClassVar[str] = "gear_friction"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_0 -> tau_0 + f |tau_l|"
    distinguished_by: ClassVar[str] = BACK_DRIVING
    f: Scalar = parameter(
        0.1, unit="", meaning="friction over load torque", null=0.0, lower=0.0, upper=3.0, typical=(0.02, 0.5)
    )

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Rub in proportion to the load, at rest too."""
        return value + self.f * jnp.abs(context.load_torque_Nm)


class TorqueFriction(Effect):
    """The first stages of a gear rub in proportion to the torque that the motor puts into them.

    The term of motor torque of models M3 to M6 of Duclusaud et al. 2024, arXiv 2410.08650.
    """

    name: ClassVar[str] = "torque_friction"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_0 -> tau_0 + f |k_tau i_a|"
    distinguished_by: ClassVar[str] = BACK_DRIVING
    f: Scalar = parameter(
        0.1, unit="", meaning="friction over motor torque", null=0.0, lower=0.0, upper=0.9, typical=(0.02, 0.5)
    )

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Rub in proportion to the motor's torque, at rest too."""
        return value + self.f * context.parameters.k_tau * jnp.abs(context.current_A)


class PwmRipple(Effect):
    """The switching ripple heats the winding: k_r (rho (1 - rho) V_pack)^2, rho signed as in eq. 14.

    Forward it peaks at half duty and vanishes at full. In reverse the form, taken as it stands, grows all the way to
    2 V_pack at rho = -1, where the ripple of a real bridge would mirror that of forward.
    """

    name: ClassVar[str] = "pwm_ripple"
    kinds: ClassVar[tuple[str, ...]] = ROBOT
    equation: ClassVar[str] = "P_M += k_r (rho (1 - rho) V_pack)^2"
    k_r: Scalar = parameter(
        0.02,
        unit="W/V2",
        meaning="ripple loss",
        null=0.0,
        lower=0.0,
        upper=10.0,
        typical=(1e-3, 0.1),
        scales="motor_current/supply",
    )

    def motor_loss(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the ripple's heat."""
        duty = context.duty
        return value + self.k_r * (duty * (1.0 - duty) * context.pack_voltage_V) ** 2


class BridgeResistance(Effect):
    """The transistors of the bridge drop a voltage: V_M = rho V_pack - i_a R_on; i_Mx unchanged."""

    name: ClassVar[str] = "bridge_resistance"
    kinds: ClassVar[tuple[str, ...]] = ROBOT
    equation: ClassVar[str] = "V_M = rho V_pack - i_a R_on"
    R_on: Scalar = parameter(
        0.02,
        unit="ohm",
        meaning="on-resistance of the bridge",
        null=0.0,
        lower=0.0,
        upper=20.0,
        typical=(5e-3, 0.1),
        scales="supply/motor_current",
    )

    def bridge_voltage(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lose the drop."""
        return value - context.current_A * self.R_on


class ConstantPowerLoad(Effect):
    """Converters draw constant power: I_ob goes from constant (s = 0) to P_ob / V_pack (s = 1)."""

    name: ClassVar[str] = "constant_power_load"
    kinds: ClassVar[tuple[str, ...]] = ROBOT
    equation: ClassVar[str] = "I_ob -> (1 - s) I_ob + s I_ob V_nominal/V_pack"
    s: Scalar = parameter(
        1.0, unit="", meaning="share of constant power", null=0.0, lower=0.0, upper=1.0, typical=(0.3, 1.0)
    )

    def onboard_current(self, value: Scalar, context: MotorContext) -> Scalar:
        """Blend towards constant power."""
        p = context.parameters
        nominal = p.nominal_cell_voltage_V * p.n_series
        return value * (1.0 + self.s * (nominal / context.pack_voltage_V - 1.0))


class OnboardTemperature(Effect):
    """The electronics draw more or less as the air warms: I_ob (1 + a (T_amb - 20))."""

    name: ClassVar[str] = "onboard_temperature"
    kinds: ClassVar[tuple[str, ...]] = ROBOT
    equation: ClassVar[str] = "I_ob -> I_ob (1 + a (T_amb - 20))"
    a: Scalar = parameter(
        0.01, unit="1/K", meaning="change of the draw", null=0.0, lower=-0.1, upper=0.1, typical=(-0.03, 0.03)
    )

    def onboard_current(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the draw."""
        return value * (1.0 + self.a * (context.ambient_degC - REFERENCE_DEGC))


class DirectionalFriction(Effect):
    """Friction is larger in one direction than in the other, as worn brushes or an angled bearing make it."""

    name: ClassVar[str] = "directional_friction"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_0 -> tau_0 (1 + a w|w|/(w^2 + 1))"
    a: Scalar = parameter(
        0.15,
        unit="",
        meaning="share by which friction is larger forwards than on average",
        null=0.0,
        lower=-1.0,
        upper=1.0,
        typical=(-0.3, 0.3),
    )

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Scale the no-load torque itself; level at rest, where the sign of the speed is that of a rounding error."""
        speed = context.speed_rad_s
        direction = speed * jnp.abs(speed) / (speed**2 + DIRECTION_RAD_S**2)
        return value + self.a * context.parameters.tau_0 * direction


class BrushCurrentDrop(Effect):
    """The brush voltage drop grows with the logarithm of the current."""

    name: ClassVar[str] = "brush_current_drop"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "V_M -= V_l asinh(i_a/i_b)"
    distinguished_by: ClassVar[str] = BRUSHES
    V_l: Scalar = parameter(
        0.1,
        unit="V",
        meaning="drop gained when the current grows by a factor of e",
        null=0.0,
        lower=0.0,
        upper=5.0,
        typical=(0.03, 0.3),
    )
    i_b: Scalar = parameter(
        1.0,
        unit="A",
        meaning="current above which the drop grows as a logarithm",
        lower=1e-3,
        upper=1e3,
        transform="log",
        typical=(0.3, 4.0),
        shape_grid=(0.5, 2.0),
        scales="motor_current",
    )

    def armature_voltage_drop(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lose the drop."""
        return value + self.V_l * jnp.arcsinh(context.current_A / self.i_b)


class CommandDelay(Effect):
    """The voltage of the winding follows its command late, by a first-order lag: filters, and a slow bridge.

    A pure delay is `clock_shift`: in an open loop a command that acts late and readings that come late are one. What
    lags here is within a controller's loop too.
    """

    name: ClassVar[str] = "command_delay"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = ("motor",)
    equation: ClassVar[str] = "V_M = y, tau dy/dt = V - y"
    distinguished_by: ClassVar[str] = FAST_VOLTAGE
    tau: Scalar = parameter(
        0.02, unit="s", meaning="time constant", null=0.0, lower=0.0, upper=100.0, typical=(0.005, 0.1)
    )

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Begin at the voltage of the first row, 0 under a controller."""
        return {f"{self.name}.voltage_V": jnp.zeros(())}

    def bridge_voltage(self, value: Scalar, context: MotorContext) -> Scalar:
        """Give what has come through."""
        return jnp.where(self.tau > 0.0, context.state[f"{self.name}.voltage_V"], value)

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Follow the command."""
        if motor is None:
            return {}
        lag = jnp.where(self.tau > 0.0, self.tau, 1.0)
        return {f"{self.name}.voltage_V": relaxation(motor.pack_voltage_V, lag)}


class BridgeDeadTime(Effect):
    """Both transistors of a leg are off for a moment in every period: the bridge gives d less duty than it is asked."""

    name: ClassVar[str] = "bridge_dead_time"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = ROBOT
    equation: ClassVar[str] = "V_M -= d tanh(rho/(0.02 + d)) V_pack"
    d: Scalar = parameter(
        0.02, unit="", meaning="duty that is lost", null=0.0, lower=0.0, upper=0.5, typical=(0.005, 0.06)
    )

    def bridge_voltage(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lose the duty; a duty smaller than that loses nearly all of itself, and never more."""
        lost = self.d * jnp.tanh(context.duty / (DIRECTION_DUTY + self.d))
        return value - lost * context.pack_voltage_V
