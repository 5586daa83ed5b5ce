"""Ports: the named constitutive relations of the model, and how an effect enters through them.

An effect is a class that declares its parameters and the kinds it applies to. For each port that it changes it has a
method with the name of the port, which takes the port's value and the context and returns the new value. The model
applies its effects to each port in order. An effect with states also gives their initial values and flows.
"""

from __future__ import annotations

import inspect
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxmodel.base.errors import EffectError, nearest
from jaxmodel.base.in_short import InShort, text_of
from jaxmodel.lanes.switch import switched
from jaxmodel.model.curves import CellCurves
from jaxmodel.model.declaration import Scalar, describe
from jaxmodel.model.flow import Flow, State
from jaxmodel.model.parameters import Parameters


class CellContext(eqx.Module):
    """The quantities available to an effect on a port of the cell: for one cell, SI, temperatures in degC.

    Ports are evaluated in order: temperature, usable charge, open-circuit voltage and resistances, then quantities that
    depend on the current. Quantities of later ports are zero in the context; an effect of a user that reads one there
    is refused (`jaxmodel.effects.order`).
    """

    parameters: Parameters
    curves: CellCurves
    state: State
    soc: Scalar
    ambient_degC: Scalar
    temperature_degC: Scalar
    usable_charge_C: Scalar
    series_resistance_ohm: Scalar
    R_TS: Scalar
    C_TS: Scalar
    R_TL: Scalar
    C_TL: Scalar
    current_A: Scalar
    voltage_V: Scalar
    counted_current_A: Scalar
    heat_transfer: Scalar


class MotorContext(eqx.Module):
    """The quantities available to an effect on a port of the motor, its bridge or the on-board electronics.

    Kind motor has no duty and no pack: there the duty is 1 and the pack voltage is the terminal voltage. `position_rad`
    is that of the load, up to `output_position` that of the motor, and 0 where no state of the model is a position.
    `step_s` is the time for which a value holds, 0 where nothing is integrated.
    """

    parameters: Parameters
    state: State
    ambient_degC: Scalar
    winding_degC: Scalar
    case_degC: Scalar
    duty: Scalar
    pack_voltage_V: Scalar
    current_A: Scalar
    speed_rad_s: Scalar
    load_torque_Nm: Scalar
    position_rad: Scalar
    step_s: Scalar


CELL_PORTS = {
    "cell_temperature": "degC; the ambient in the base model",
    "usable_charge": "C; eqs. 1 and 8",
    "counted_current": "A; the current that eq. 1 integrates",
    "open_circuit_voltage": "V of one cell",
    "cycle_resistance": "ohm; eq. 7",
    "series_resistance": "ohm; R_ints + R_cyc, eqs. 7, 9 and 10",
    "rc_resistance": "ohm; R_TS and R_TL in turn, eqs. 3 and 5",
    "rc_capacitance": "F; C_TS and C_TL in turn, eqs. 4 and 6",
    "short_rc_resistance": "ohm; R_TS alone, eq. 3",
    "short_rc_capacitance": "F; C_TS alone, eq. 4",
    "long_rc_resistance": "ohm; R_TL alone, eq. 5",
    "long_rc_capacitance": "F; C_TL alone, eq. 6",
    "heat_transfer": "factor on the heat transfer of one cell to the ambient, 1 without effects",
    "overpotential": "V lost in addition to i R, V_TS and V_TL",
    "cell_heat": "W made in one cell",
    "weakest_cell_voltage": "V by which the weakest cell of the pack is below the others",
    "surface_temperature": "degC at a thermometer on the cell; that of the cell in the base model",
}
MOTOR_PORTS = {
    "torque_constant": "N m/A and V s/rad; eqs. 11 and 12",
    "motor_torque": "N m; eq. 12",
    "winding_resistance": "ohm; eq. 17",
    "armature_voltage_drop": "V lost in addition to i R and the back-EMF",
    "coulomb_torque": "N m; friction of constant size against the motion, also at standstill",
    "friction_torque": "N m; friction that grows smoothly with speed, signed as the speed",
    "load_torque": "N m; signed, active",
    "load_drag": "N m; load that grows smoothly with speed, signed as the speed, which does not warm the motor",
    "load_friction": "N m; load of constant size against the motion, also at standstill, which does not warm the motor",
    "iron_drag": "N m; of the iron, that grows smoothly with speed, signed as the speed; it warms the case",
    "iron_friction": "N m; of the iron, of constant size against the motion, also at standstill; it warms the case",
    "inertia": "kg m2; of rotor and load, at the motor's shaft",
    "motor_loss": "W that heat the winding; eq. 16",
    "heat_path": "share of the winding's heat that reaches the case through the winding; eq. 15 has 0",
    "bridge_voltage": "V at the motor's terminals; eq. 14",
    "command": "A or V that a controller sets; 0 without one",
    "output_position": "rad; of the load, which lags behind the motor by what lies between them",
    "onboard_current": "A; eq. 20",
}
SENSOR_PORTS = {
    "true_input": "the true value of a measured input",
    "reading": "a sensor's reading of an output over the whole run",
}
PORTS = CELL_PORTS | MOTOR_PORTS | SENSOR_PORTS
"""By the name of each port, the value that a method of that name receives and returns."""
_HOOKS = {"initial_state", "flows", "longest_step_s"}


class Effect(InShort, eqx.Module):
    """A candidate effect: parameters as fields, one method for each port it touches.

    `column` is the column of a sensor effect, "" for others; `reads` is the ending of its possible columns ("" for one
    effect on all outputs). `is_candidate` is False for what a case may state and no diagnosis looks for.
    `distinguished_by` is the parameter that must differ between runs to distinguish the effect from a calibration, or
    a mark of `jaxmodel.effects.drive`, such as `BACK_DRIVING`, of what runs must show.
    `rare` marks an effect that is seldom the cause: a diagnosis asks for more evidence. `needs` are names of effects
    without which a diagnosis does not try this one, where they are candidates of the case. `shown_by` is the quantity
    through which it acts if no input sets that: without a reading of it a diagnosis names the effect only where all
    tables are exact. `has_state` marks sensor
    effects with internal state or delay. `switch` serves to test many effects at once: at 0 the effect is absent,
    exactly; at 1 it is present; the derivative at 0 is the direction in which it moves the model. None, the default,
    means 1.

    Example:
        >>> from typing import ClassVar
        >>> from jaxmodel import Effect, parameter
        >>> class SealDrag(Effect):
        ...     name: ClassVar[str] = "seal_drag"
        ...     kinds: ClassVar[tuple[str, ...]] = ("motor", "robot")
        ...     equation: ClassVar[str] = "friction + b"
        ...     b: float = parameter(1e-3, unit="N m", meaning="drag of the seal", null=0.0, lower=0.0)
        ...
        ...     def friction_torque(self, value, context):
        ...         return value + self.b
        >>> float(SealDrag(b=0.002).friction_torque(0.01, None))
        0.012
    """

    name: ClassVar[str]
    kinds: ClassVar[tuple[str, ...]]
    equation: ClassVar[str]
    is_sensor: ClassVar[bool] = False
    is_candidate: ClassVar[bool] = True
    has_state: ClassVar[bool] = False
    reads: ClassVar[str] = ""
    distinguished_by: ClassVar[str] = ""
    rare: ClassVar[bool] = False
    needs: ClassVar[tuple[str, ...]] = ()
    shown_by: ClassVar[str] = ""

    column: str = eqx.field(static=True, default="")
    switch: Scalar | None = None

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Refuse a class whose methods are not ports: a misspelt method would have no effect."""
        super().__init_subclass__(**kwargs)
        for method, value in vars(cls).items():
            if inspect.isfunction(value) and not method.startswith("_") and method not in PORTS.keys() | _HOOKS:
                raise EffectError(
                    f"effect class {cls.__name__}: '{method}' is not a port.{nearest(method, PORTS)} "
                    f"Ports are {', '.join(PORTS)}; start a helper's name with an underscore."
                )

    @property
    def label(self) -> str:
        """Return the name of this effect, unique in a model."""
        return self.name

    def _in_short(self) -> str:
        """Say every number, as each is a matter of the case: usual values are no default."""
        said = [f"{name}={text_of(getattr(self, name))}" for name in describe(type(self))]
        return ", ".join([*([self.column] if self.column else []), *said])

    def initial_state(self, parameters: Parameters, ambient_degC: Scalar) -> State:
        """Return the effect's own states at the start of a run, named 'effect.state'."""
        return {}

    def flows(self, cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar) -> dict[str, Flow]:
        """Return the flow of each of the effect's own states; `heat_W` is that of one cell."""
        return {}


def fold(effects: tuple[Effect, ...], port: str, value: Any, context: Any) -> Any:
    """Apply every effect that acts on a port to its value, in order."""
    for effect in effects:
        method = getattr(effect, port, None)
        if method is None:
            continue
        changed = method(value, context)
        value = changed if effect.switch is None else switched(effect.switch, value, changed)
    return value


def flows_of(
    effects: tuple[Effect, ...], cell: CellContext | None, motor: MotorContext | None, heat_W: Scalar
) -> dict[str, Flow]:
    """Return the flows of the states of all effects.

    The states of an effect that is switched off stay. One that is a little on, to learn what it would change, moves its
    states as it does whole.
    """
    found = {}
    for effect in effects:
        switch = None if effect.switch is None else jnp.where(effect.switch != 0.0, 1.0, 0.0)
        for name, flow in effect.flows(cell, motor, heat_W).items():
            found[name] = Flow(flow.source, flow.decay, flow.target, switch)
    return found


def touches(effects: tuple[Effect, ...], *ports: str) -> bool:
    """Return True if any effect acts on any of the ports."""
    return any(hasattr(effect, port) for effect in effects for port in ports)
