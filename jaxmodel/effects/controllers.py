"""Controllers of a servo: what sets the current or voltage of a motor from a reference and what is measured.

A case states one by `controller = "position"`; its gains are those of an effect, exact or with an sd.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.flow import Flow, State, integral
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import CellContext, Effect, MotorContext

# No output of a drive is larger; a limit there is none.
NO_LIMIT = 1e6


class ShaftPosition(Effect):
    """The position of the shaft, a state: read as `position_rad`, and what a position controller acts on."""

    name: ClassVar[str] = "shaft_position"
    kinds: ClassVar[tuple[str, ...]] = ("motor",)
    equation: ClassVar[str] = "dtheta/dt = w"
    is_candidate: ClassVar[bool] = False
    initial_position_rad: Scalar = parameter(
        0.0, unit="rad", meaning="position at the first row", lower=-1e9, upper=1e9, typical=(-0.1, 0.1)
    )

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Begin at the stated position."""
        return {f"{self.name}.position_rad": jnp.asarray(self.initial_position_rad, dtype=float)}

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Follow the speed of the motor."""
        return {} if motor is None else {f"{self.name}.position_rad": integral(motor.speed_rad_s)}


class Controller(Effect):
    """A controller with an integral that stops while the output is at its limit; `column` is what it sets.

    e is the reference less what is measured. It acts on what holds in each step, and its output holds over the step,
    as that of a digital controller does.
    """

    kinds: ClassVar[tuple[str, ...]] = ("motor",)
    is_candidate: ClassVar[bool] = False
    k_p: Scalar = parameter(
        10.0, unit="A/rad or V/rad", meaning="proportional gain", lower=0.0, upper=1e12, typical=(0.1, 1000.0)
    )
    k_i: Scalar = parameter(
        0.0, unit="A/(rad s) or V/(rad s)", meaning="integral gain", lower=0.0, upper=1e12, typical=(0.0, 1000.0)
    )
    limit: Scalar = parameter(
        NO_LIMIT, unit="A or V", meaning="largest output", lower=0.0, upper=NO_LIMIT, typical=(1.0, 100.0)
    )

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Begin with an empty integral."""
        return {f"{self.name}.integral": jnp.zeros(())}

    def command(self, value: Scalar, context: MotorContext) -> Scalar:
        """Set the output, within its limit."""
        return value + jnp.clip(self._free(context), -self.limit, self.limit)

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Integrate the error, but at the limit (conditional integration, Astrom and Hagglund 2006, section 3.5)."""
        if motor is None:
            return {}
        within = jnp.abs(self._free(motor)) < self.limit
        return {f"{self.name}.integral": integral(jnp.where(within, self._error(motor), 0.0))}

    def _error(self, context: MotorContext) -> Scalar:
        raise NotImplementedError

    def _free(self, context: MotorContext) -> Scalar:
        """Return the output without its limit."""
        return self.k_p * self._error(context) + self.k_i * context.state[f"{self.name}.integral"]


class PositionController(Controller):
    """A PID controller of the position, whose derivative acts on the measured speed: u = k_p e + k_i int e dt - k_d w.

    A cascade of a position loop K_p (1/s) and a proportional speed loop K_v (A s/rad) is k_p = K_p K_v, k_d = K_v.
    """

    name: ClassVar[str] = "position_controller"
    equation: ClassVar[str] = "u = k_p (theta_ref - theta) + k_i int(theta_ref - theta) dt - k_d w, |u| <= limit"
    k_d: Scalar = parameter(
        0.0, unit="A s/rad or V s/rad", meaning="gain of the measured speed", lower=0.0, upper=1e12, typical=(0.0, 10.0)
    )

    def _error(self, context: MotorContext) -> Scalar:
        return context.state["reference_position_rad"] - context.position_rad

    def _free(self, context: MotorContext) -> Scalar:
        return super()._free(context) - self.k_d * context.speed_rad_s


class SpeedController(Controller):
    """A PI controller of the speed: u = k_p e + k_i int e dt."""

    name: ClassVar[str] = "speed_controller"
    equation: ClassVar[str] = "u = k_p (w_ref - w) + k_i int(w_ref - w) dt, |u| <= limit"
    k_p: Scalar = parameter(
        0.1, unit="A s/rad or V s/rad", meaning="proportional gain", lower=0.0, upper=1e12, typical=(1e-3, 10.0)
    )
    k_i: Scalar = parameter(
        0.0, unit="A/rad or V/rad", meaning="integral gain", lower=0.0, upper=1e12, typical=(0.0, 100.0)
    )

    def _error(self, context: MotorContext) -> Scalar:
        return context.state["reference_speed_rad_s"] - context.speed_rad_s


CONTROLLERS: dict[str, type[Controller]] = {"position": PositionController, "speed": SpeedController}
"""By what a case calls the controller: its effect."""
SERVO: dict[str, type[Effect]] = {cls.name: cls for cls in (ShaftPosition, *CONTROLLERS.values())}
"""What a case of a servo adds to its model, by name; without the columns of its runs there is none of it."""
