"""Laws of a load that is not measured: what a propeller, a weight on an arm or the ground asks of a motor's shaft.

A case names one by `load = "propeller"`; its numbers are those of an effect, exact, with an sd, or left to the data.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.flow import Flow, State, integral
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import CellContext, Effect, MotorContext
from jaxmodel.model.robot import GRAVITY_M_S2

# Of dry air at 20 degC and 101325 Pa (International Standard Atmosphere at that temperature).
AIR_KG_M3 = 1.204


class Law(Effect):
    """A law of a load: a case states it, and no diagnosis looks for it.

    `free` is the number that the data are asked for where a case does not state it; the torque is proportional to it.
    "" for none.
    """

    kinds: ClassVar[tuple[str, ...]] = ("motor", "robot")
    is_candidate: ClassVar[bool] = False
    free: ClassVar[str] = ""


class PropellerLoad(Law):
    """A propeller or fan at rest in the air: a torque that grows with the square of the speed.

    c = C_Q rho D^5 / (4 pi^2) at rho = 1.204 kg/m3, for a propeller of diameter D and torque coefficient C_Q.
    """

    name: ClassVar[str] = "propeller_load"
    equation: ClassVar[str] = "tau_l += c (rho/1.204) w |w|"
    free: ClassVar[str] = "c"
    c: Scalar = parameter(
        1e-6,
        unit="N m s2/rad2",
        meaning="torque over the speed squared, in air of 1.204 kg/m3",
        null=0.0,
        lower=0.0,
        upper=1e3,
        typical=(1e-7, 3e-6),  # a share of 0.1 to 3 of the continuous torque at no-load speed; assumed
        scales="torque/speed2",
    )
    air_kg_m3: Scalar = parameter(
        AIR_KG_M3, unit="kg/m3", meaning="density of the air", lower=1e-3, upper=20.0, typical=(0.7, 1.4)
    )

    def load_drag(self, value: Scalar, context: MotorContext) -> Scalar:
        """Resist in proportion to the speed squared."""
        speed = context.speed_rad_s
        return value + self.c * (self.air_kg_m3 / AIR_KG_M3) * speed * jnp.abs(speed)


class GravityLoad(Law):
    """A weight on an arm: the torque follows its position, which is a state and can be read as `position_rad`.

    Position is 0 where the arm hangs, and counts at the arm: with a gear of ratio G it moves by w / G.
    """

    name: ClassVar[str] = "gravity_load"
    equation: ClassVar[str] = "tau_l += m g l sin(theta)/G, dtheta/dt = w/G, J += m l^2/G^2"
    free: ClassVar[str] = "mass_kg"
    mass_kg: Scalar = parameter(
        0.5, unit="kg", meaning="mass on the arm", null=0.0, lower=0.0, upper=1e4, typical=(0.05, 5.0)
    )
    arm_m: Scalar = parameter(
        0.1, unit="m", meaning="distance of its centre from the axis", lower=1e-4, upper=100.0, typical=(0.03, 1.0)
    )
    gear_ratio: Scalar = parameter(
        1.0, unit="", meaning="turns of the motor for one of the arm", lower=1e-3, upper=1e5, typical=(1.0, 300.0)
    )
    initial_position_rad: Scalar = parameter(
        0.0, unit="rad", meaning="position at the first row, 0 where the arm hangs", lower=-1e4, upper=1e4,
        typical=(-0.1, 0.1),
    )  # fmt: skip

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Begin at the stated position."""
        return {f"{self.name}.position_rad": jnp.asarray(self.initial_position_rad, dtype=float)}

    def load_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the torque of the weight."""
        return value + self.mass_kg * GRAVITY_M_S2 * self.arm_m * jnp.sin(context.position_rad) / self.gear_ratio

    def inertia(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add that of the weight, at the motor's shaft."""
        return value + self.mass_kg * (self.arm_m / self.gear_ratio) ** 2

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Follow the speed of the motor."""
        if motor is None:
            return {}
        return {f"{self.name}.position_rad": integral(motor.speed_rad_s / self.gear_ratio)}


class RollingLoad(Law):
    """A vehicle on wheels or tracks by eq. 18: slope, rolling resistance, and the mass that the motor speeds up.

    Mass, friction coefficient, wheel radius, gear ratio and efficiency are parameters of the case; `incline_deg` is a
    column of its runs, 0 without it.
    """

    name: ClassVar[str] = "rolling_load"
    equation: ClassVar[str] = "tau_l += s m g r (sin(th) + mu cos(th) sgn(w))/(G eta), J += s m r^2/(G^2 eta)"
    share: Scalar = parameter(
        1.0, unit="", meaning="share of mass_kg that one motor carries", null=0.0, lower=0.0, upper=1.0,
        typical=(0.2, 1.0),
    )  # fmt: skip

    def _per_force(self, context: MotorContext) -> Scalar:
        """Return the torque at the shaft for a force on the vehicle, in m."""
        p = context.parameters
        return self.share * p.wheel_radius_m / (p.gear_ratio * p.drive_efficiency)

    def load_torque(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the share of the weight along the slope."""
        slope = jnp.deg2rad(context.state.get("incline_deg", 0.0))
        return value + context.parameters.mass_kg * GRAVITY_M_S2 * jnp.sin(slope) * self._per_force(context)

    def load_friction(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the rolling resistance."""
        p = context.parameters
        slope = jnp.deg2rad(context.state.get("incline_deg", 0.0))
        weight = p.mass_kg * GRAVITY_M_S2 * jnp.cos(slope)
        return value + p.friction_coefficient * weight * self._per_force(context)

    def inertia(self, value: Scalar, context: MotorContext) -> Scalar:
        """Add the mass, at the motor's shaft."""
        p = context.parameters
        return value + p.mass_kg * self._per_force(context) * p.wheel_radius_m / p.gear_ratio


LAWS: dict[str, type[Law] | None] = {
    "free": None,
    "propeller": PropellerLoad,
    "gravity": GravityLoad,
    "rolling": RollingLoad,
}
"""By what a case calls the load: the effect that says its torque; None for a shaft that turns nothing."""
LAW_EFFECTS = frozenset(law.name for law in LAWS.values() if law is not None)
"""Names of these effects."""
