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
