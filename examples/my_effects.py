"""A template for an effect of your own: one class, on every command that takes --effect.

    jaxmodel diagnose examples/samsung_30q --effect examples/my_effects.py:HotContact --out results

docs/your_own_effect.md explains each line.
"""

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel import CellContext, Effect, Flow, MotorContext, Scalar, State, parameter, relaxation

COPPER = 0.0039  # 1/K, temperature coefficient of the contact's resistance


class HotContact(Effect):
    """The contact outside the can, between cell and voltage tap, has a resistance that warms itself."""

    name: ClassVar[str] = "hot_contact"
    kinds: ClassVar[tuple[str, ...]] = ("cell", "robot")
    equation: ClassVar[str] = "V -= i R_c (1 + 0.0039 x); tau_c dx/dt = R_th i^2 R_c (1 + 0.0039 x) - x"

    R_c: Scalar = parameter(
        0.005, unit="ohm", meaning="contact resistance, cold", null=0.0, lower=0.0, upper=1.0, typical=(1e-3, 0.02)
    )
    R_th: Scalar = parameter(
        20.0,
        unit="K/W",
        meaning="thermal resistance, contact to ambient",
        lower=0.1,
        upper=1e3,
        transform="log",
        typical=(5.0, 80.0),
        shape_grid=(10.0, 40.0),
    )
    tau_c: Scalar = parameter(
        60.0,
        unit="s",
        meaning="thermal time constant of the contact",
        lower=1.0,
        upper=1e4,
        transform="log",
        typical=(10.0, 300.0),
        shape_grid=(20.0, 150.0),
    )

    def _resistance(self, state: State) -> Scalar:
        return self.R_c * (1.0 + COPPER * state["hot_contact.x_K"])

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start at the ambient temperature."""
        return {"hot_contact.x_K": jnp.zeros(())}

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Relax towards the temperature rise of the contact's loss."""
        if cell is None:  # kind robot calls it again, for the motor
            return {}
        target = self.R_th * cell.current_A**2 * self._resistance(cell.state)
        return {"hot_contact.x_K": relaxation(target, self.tau_c)}

    def overpotential(self, value: Scalar, context: CellContext) -> Scalar:
        """Lose i R_c (1 + 0.0039 x)."""
        return value + context.current_A * self._resistance(context.state)

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Subtract the contact's part of i (V_oc - V_cell), which is generated outside the can."""
        return value - context.current_A**2 * self._resistance(context.state)
