"""Candidate effects that show where a motor turns both ways: friction with a memory, drag by direction, backlash."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.effects.drive import LOST_MOTION, MOTOR, REVERSING
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.flow import Flow, State, mean_exponential
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import CellContext, Effect, MotorContext

# A travel of none would divide by zero; far below what any encoder reads.
LEAST_TRAVEL_RAD = 1e-12
# Longest step of two inertias, as a share of the time constant of their resonance (1 over its angular frequency): by
# the midpoint rule an undamped one then gains 1 % of its energy in 65 periods.
RESONANCE_SHARE = 0.05


def _followed(speed: Scalar, travel: Scalar) -> Flow:
    """Return the flow de/dt = (w - |w| e)/travel: e follows the direction of motion over a travel, within -1 and 1."""
    travel = jnp.maximum(travel, LEAST_TRAVEL_RAD)
    return Flow(speed / travel, jnp.abs(speed) / travel)


class Presliding(Effect):
    """Dry friction grows with the first travel after a reversal, as a spring, before it slides: Dahl's model.

    A share s of tau_0 acts through contacts that bend by about d; the rest has its whole size at once, and sticks.
    P. R. Dahl, Solid friction damping of mechanical vibrations, AIAA Journal 14 (1976) 1675; the LuGre model without
    its Stribeck curve, which is `stribeck_friction`, and its damping (Canudas de Wit et al., IEEE TAC 40 (1995) 419).
    """

    name: ClassVar[str] = "presliding"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "tau_0 sgn(w) -> (1 - s) tau_0 sgn(w) + s tau_0 z, dz/dt = (w - |w| z)/d"
    distinguished_by: ClassVar[str] = REVERSING
    s: Scalar = parameter(
        0.9, unit="", meaning="share of tau_0 that bends before it slides", null=0.0, lower=0.0, upper=1.0,
        typical=(0.3, 1.0),
    )  # fmt: skip
    d: Scalar = parameter(
        0.05,
        unit="rad",
        meaning="travel in which it grows to 63 %",
        lower=1e-6,
        upper=1e3,
        transform="log",
        typical=(0.003, 1.0),  # of a bearing to that of a gear behind some turns of the motor; assumed
        shape_grid=(0.02, 0.3),
    )

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Begin with contacts that are not bent."""
        return {f"{self.name}.z": jnp.zeros(())}

    def coulomb_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Leave the share that does not bend."""
        return jnp.maximum(value - self.s * context.parameters.tau_0, 0.0)

    def friction_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the mean over the step of the share that bends: a step of any length ends at a torque it holds."""
        speed, z = context.speed_rad_s, context.state[f"{self.name}.z"]
        direction = jnp.sign(speed)
        bent = direction + (z - direction) * mean_exponential(jnp.abs(speed) * context.step_s / self.d)
        return value + self.s * context.parameters.tau_0 * bent

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Bend with the motion."""
        return {} if motor is None else {f"{self.name}.z": _followed(motor.speed_rad_s, self.d)}


class DirectionalDrag(Effect):
    """Friction grows faster with speed in one direction than in the other, as of a ball screw or an angled seal.

    Separate viscous coefficients by direction: Janot, Gautier and Brunot, Data set and reference models of EMPS, 2019.
    """

    name: ClassVar[str] = "directional_drag"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "friction += b_d |w|"
    distinguished_by: ClassVar[str] = REVERSING
    b_d: Scalar = parameter(
        1e-5,
        unit="N m s/rad",
        meaning="viscous coefficient that forwards has more than the mean, and backwards less",
        null=0.0,
        lower=-1e3,
        upper=1e3,
        typical=(-1e-4, 1e-4),
        scales="torque/speed",
    )

    def friction_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add a torque of one sign in proportion to the size of the speed."""
        return value + self.b_d * jnp.abs(context.speed_rad_s)


class Backlash(Effect):
    """The load stands while the motor crosses a gap after each reversal: its position lags by half of the gap.

    The play operator of a load that friction holds, made smooth: after a reversal the load starts to move with a slope
    of 0 and gains the motor's speed over the gap. M. Nordin and P.-O. Gutman, Controlling mechanical systems with
    backlash - a survey, Automatica 38 (2002) 1633. The position that is read is that of the load.
    """

    name: ClassVar[str] = "backlash"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = ("motor",)
    equation: ClassVar[str] = "theta -> theta - (g/2) e, de/dt = (w - |w| e)/g"
    distinguished_by: ClassVar[str] = LOST_MOTION
    g: Scalar = parameter(
        0.02,
        unit="rad",
        meaning="gap, in the position that is read",
        null=0.0,
        lower=0.0,
        upper=10.0,
        typical=(0.003, 0.1),
        shape_grid=(0.01, 0.05),
    )

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Begin in the middle of the gap."""
        return {f"{self.name}.e": jnp.zeros(())}

    def output_position(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lag by the part of the gap that is taken up."""
        return value - 0.5 * self.g * context.state[f"{self.name}.e"]

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Take up the gap in the direction of motion."""
        return {} if motor is None else {f"{self.name}.e": _followed(motor.speed_rad_s, self.g)}


class Compliance(Effect):
    """Shaft and gear twist under the load: its position lags behind the motor's by c tau_l.

    The static part of a flexible joint, below its resonance; what the load's own inertia asks is not in tau_l. M. W.
    Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. Meas. Control 109 (1987) 310.
    """

    name: ClassVar[str] = "compliance"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = ("motor",)
    equation: ClassVar[str] = "theta -> theta - c tau_l"
    distinguished_by: ClassVar[str] = LOST_MOTION
    c: Scalar = parameter(
        0.2,
        unit="rad/(N m)",
        meaning="twist over load torque",
        null=0.0,
        lower=0.0,
        upper=1e6,
        typical=(0.02, 1.0),  # of an arm or gear that twists by 0.1 to 6 degrees at the motor's torque; assumed
        scales="1/torque",
    )

    def output_position(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lag by the twist."""
        return value - self.c * context.load_torque_Nm


class FlexibleShaft(Effect):
    """A load of its own inertia hangs on a spring with a damper, and on a gap: two inertias that resonate.

    J is that of the rotor alone then, J_l that of the load, of a law's mass too; the load torque acts on the load. With
    current or torque as the input the pair resonates at sqrt(k (1/J + 1/J_l)), and at sqrt(k/J_l) the rotor stands. In
    the gap neither spring nor damper acts. The position that is read is the load's, the speed the rotor's. Spong 1987,
    as of `compliance`, which is this below the resonance; the gap is that of Nordin and Gutman 2002.
    """

    name: ClassVar[str] = "flexible_shaft"
    kinds: ClassVar[tuple[str, ...]] = ("motor",)
    equation: ClassVar[str] = (
        "J dw/dt = tau_D - friction - T_s, J_l dv/dt = T_s - tau_l, T_s = k phi + d dphi/dt, dphi/dt = w - v"
    )
    is_candidate: ClassVar[bool] = False
    J_l: Scalar = parameter(
        5e-5, unit="kg m2", meaning="inertia of the load", null=0.0, lower=0.0, upper=1e3, typical=(1e-5, 5e-4)
    )
    k: Scalar = parameter(
        2.0, unit="N m/rad", meaning="stiffness", lower=1e-9, upper=1e9, transform="log", typical=(0.1, 50.0)
    )
    d: Scalar = parameter(
        1e-4, unit="N m s/rad", meaning="damping between the two", lower=0.0, upper=1e6, typical=(0.0, 1e-3)
    )
    gap: Scalar = parameter(
        0.0, unit="rad", meaning="free play in the spring", lower=0.0, upper=10.0, typical=(0.0, 0.1)
    )

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Begin without twist, the load at the speed of the rotor."""
        speed = jnp.asarray(parameters.initial_speed_rad_s, dtype=float)
        return {f"{self.name}.twist_rad": jnp.zeros(()), f"{self.name}.load_speed_rad_s": speed}

    def longest_step_s(self, parameters: Parameters) -> Scalar:
        """Return a twentieth of the time constant of the resonance."""
        load = jnp.where(self.J_l > 0.0, self.J_l, 1.0)
        longest = RESONANCE_SHARE / jnp.sqrt(self.k * (1.0 / parameters.J + 1.0 / load))
        return jnp.where(self.J_l > 0.0, longest, jnp.inf)

    def inertia(self, value: Scalar, context: MotorContext) -> Scalar:
        """Leave that of the rotor."""
        return jnp.where(self.J_l > 0.0, context.parameters.J, value)

    def load_drag(self, value: Scalar, context: MotorContext) -> Scalar:
        """Put the torque of the spring in the place of the load's."""
        twisting, load_speed = self._spring(context)
        spring = twisting + self._damping(context) * (context.speed_rad_s - load_speed)
        return value + jnp.where(self.J_l > 0.0, spring - context.load_torque_Nm, 0.0)

    def output_position(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lag by the twist."""
        return value - jnp.where(self.J_l > 0.0, context.state[f"{self.name}.twist_rad"], 0.0)

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Twist by the difference of the speeds, and speed the load up."""
        if motor is None:
            return {}
        load = jnp.where(self.J_l > 0.0, self.J_l, 1.0)
        (twisting, load_speed), damping = self._spring(motor), self._damping(motor)
        pull = twisting + damping * motor.speed_rad_s - motor.load_torque_Nm
        return {
            f"{self.name}.twist_rad": Flow(motor.speed_rad_s - load_speed),
            f"{self.name}.load_speed_rad_s": Flow(pull / load, damping / load),
        }

    def _spring(self, context: MotorContext) -> tuple[Scalar, Scalar]:
        """Return the torque of the spring beyond its gap, and the speed of the load."""
        twist = context.state[f"{self.name}.twist_rad"]
        beyond = twist - jnp.clip(twist, -0.5 * self.gap, 0.5 * self.gap)
        return self.k * beyond, context.state[f"{self.name}.load_speed_rad_s"]

    def _damping(self, context: MotorContext) -> Scalar:
        """Return the damping, which acts where the spring does."""
        return jnp.where(jnp.abs(context.state[f"{self.name}.twist_rad"]) >= 0.5 * self.gap, self.d, 0.0)


class Cogging(Effect):
    """Magnets pull the rotor towards its teeth: a torque that swings with its angle, and does no work over a turn.

    The fundamental of the torque's Fourier series over a turn. J. F. Gieras, Permanent Magnet Motor Technology, 3rd
    ed., 2010, section 6.3: its periods for a turn of the motor are the least common multiple of slots and poles. Rows
    must be closer than a quarter of a period, or it averages out.
    """

    name: ClassVar[str] = "cogging"
    kinds: ClassVar[tuple[str, ...]] = ("motor",)
    equation: ClassVar[str] = "tau_l += c_s sin(n theta) + c_c cos(n theta)"
    is_candidate: ClassVar[bool] = False
    c_s: Scalar = parameter(
        0.001, unit="N m", meaning="part in phase with the position", null=0.0, lower=-1e3, upper=1e3,
        typical=(-0.01, 0.01), scales="torque",
    )  # fmt: skip
    c_c: Scalar = parameter(
        0.0, unit="N m", meaning="part a quarter of a period ahead", lower=-1e3, upper=1e3, typical=(-0.01, 0.01),
        scales="torque",
    )  # fmt: skip
    n: Scalar = parameter(
        12.0, unit="", meaning="periods for a turn of the position", lower=1.0, upper=1e5, typical=(6.0, 84.0)
    )

    def load_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the torque at the position of the motor."""
        angle = self.n * context.position_rad
        return value + self.c_s * jnp.sin(angle) + self.c_c * jnp.cos(angle)
