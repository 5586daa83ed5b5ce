"""Further candidate effects of the drive: friction of one direction, brushes whose drop grows, a bridge's dead time."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.effects.drive import MOTOR, ROBOT
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.ports import Effect, MotorContext

DIRECTION_RAD_S = 1.0  # a rotor faster than this has a direction
DIRECTION_DUTY = 0.02  # so has a bridge with more duty than this


class DirectionalFriction(Effect):
    """Friction is larger in one direction than in the other, as worn brushes or an angled bearing make it."""

    name: ClassVar[str] = "directional_friction"
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
    kinds: ClassVar[tuple[str, ...]] = MOTOR
    equation: ClassVar[str] = "V_M -= V_l asinh(i_a/i_b)"
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


class BridgeDeadTime(Effect):
    """Both transistors of a leg are off for a moment in every period: the bridge gives d less duty than it is asked."""

    name: ClassVar[str] = "bridge_dead_time"
    kinds: ClassVar[tuple[str, ...]] = ROBOT
    equation: ClassVar[str] = "V_M -= d tanh(rho/(0.02 + d)) V_pack"
    d: Scalar = parameter(
        0.02, unit="", meaning="duty that is lost", null=0.0, lower=0.0, upper=0.5, typical=(0.005, 0.06)
    )

    def bridge_voltage(self, value: Scalar, context: MotorContext) -> Scalar:
        """Lose the duty; a duty smaller than that loses nearly all of itself, and never more."""
        lost = self.d * jnp.tanh(context.duty / (DIRECTION_DUTY + self.d))
        return value - lost * context.pack_voltage_V
