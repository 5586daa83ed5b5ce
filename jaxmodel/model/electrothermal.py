"""The model: kind, parameters, curves and effects; its pure step and its ideal readings."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxmodel.base.in_short import InShort
from jaxmodel.model import cell as cells
from jaxmodel.model import motor as motors
from jaxmodel.model import robot as robots
from jaxmodel.model.armature import ArmatureStep, Pair
from jaxmodel.model.cell import Cell
from jaxmodel.model.curves import CellCurves
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.flow import State, advance
from jaxmodel.model.motor import Motor
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import Effect, fold, touches
from jaxmodel.model.robot import Inputs

Readings = dict[str, Scalar]
# Inputs that stand in the place of a state, or that an effect reads as one.
IMPOSED = ("speed_rad_s", "incline_deg", "reference_position_rad", "reference_speed_rad_s")


class Model(InShort, eqx.Module):
    """A pytree whose leaves are all the numbers of one model: any of them may carry lanes or derivatives.

    Example:
        >>> from jaxmodel import Model, effects
        >>> Model("cell", effects=(effects.CATALOGUE["self_heating"](C_th=60.0),))
        <Model: cell, self_heating, all by default>
    """

    kind: str = eqx.field(static=True)
    parameters: Parameters = Parameters()
    curves: CellCurves = CellCurves()
    effects: tuple[Effect, ...] = ()

    def _in_short(self) -> str:
        effects = f", {', '.join(effect.label for effect in self.effects)}" if self.effects else ""
        return f"{self.kind}{effects}, {self.parameters._in_short()}"


class Drive(eqx.Module):
    """The fast quantities over one step: means of the current of a cell, and of a motor's current and speed."""

    cell_current_A: Scalar
    cell_current_variance_A2: Scalar
    motor: Motor | None
    armature: ArmatureStep | None


def initial_state(model: Model, inputs: Inputs) -> State:
    """Return the state at the start of a run: RC pairs, currents and temperature rises at zero."""
    inputs = true_inputs(model, inputs)
    state: State = {}
    if model.kind in ("cell", "robot"):
        state |= cells.initial_state(model.parameters)
    if model.kind in ("motor", "robot"):
        state |= motors.initial_state(model.parameters)
        state |= {name: inputs[name] for name in state if name in IMPOSED and name in inputs}
    for effect in model.effects:
        state |= effect.initial_state(model.parameters, inputs["ambient_degC"])
    # What follows an input begins at it.
    return state | {name: inputs[at] for name in state if (at := name.partition(".")[2]) in inputs}


def step(model: Model, state: State, inputs: Inputs, duration: Scalar) -> State:
    """Return the state after `duration` seconds (>= 0) under constant inputs: second order, stable at any step.

    Exponential midpoint: the slow states move half a step with the coefficients of the start, then the whole step with
    those of the middle; each time the fast ones (armature current and speed) are solved exactly for their means over
    the span.
    """
    inputs = true_inputs(model, inputs)
    half = 0.5 * duration
    with jax.named_scope("first_half"):
        here = _once(_parts(model, state, inputs))
        start = _once(_drive(model, inputs, here, here, half, jnp.zeros(())))
        middle = _once(advance(state, _flows(model, here, start), half))
    with jax.named_scope("whole_step"):
        there = _once(_parts(model, middle, inputs))
        drive = _once(_drive(model, inputs, here, there, duration, half, start.armature))
        end = advance(state, _flows(model, there, drive), duration)
    if drive.armature is not None:
        end |= {"motor_current_A": drive.armature.current_A, "speed_rad_s": drive.armature.speed_rad_s}
    return end


def _once(values):
    """Prevent the compiler from recomputing these in every kernel that uses them."""
    arrays, rest = eqx.partition(values, eqx.is_array)
    return eqx.combine(jax.lax.optimization_barrier(arrays), rest)


def read(model: Model, state: State, inputs: Inputs) -> Readings:
    """Return ideal readings in a state under inputs, by the names of case files; temperatures in degC."""
    inputs = true_inputs(model, inputs)
    cell, motor = _parts(model, state, inputs)
    readings: Readings = {}
    if model.kind == "cell":
        assert cell is not None
        readings["voltage_V"] = cells.voltage(cell, inputs["current_A"])
    if model.kind == "robot":
        assert cell is not None
        assert motor is not None
        accessories = robots.accessory_draw(model.parameters, inputs)
        voltage, current = robots.pack(cell, motor, accessories, state["motor_current_A"])
        readings |= {"pack_voltage_V": voltage, "pack_current_A": current}
    if motor is not None:
        name = "motor_current_A" if model.kind == "robot" else "current_A"
        readings[name] = state["motor_current_A"]
        readings["speed_rad_s"] = motor.context.speed_rad_s
        if motors.turned(state) is not None:
            readings["position_rad"] = motor.context.position_rad
        if (set_by := _controlled(model)) == "voltage_V":
            readings[set_by] = fold(model.effects, "command", jnp.zeros(()), motor.context)
    if cell is not None:
        readings["cell_temperature_degC"] = cells.surface_temperature(cell)
    if motor is not None:
        readings["winding_temperature_degC"] = motor.context.winding_degC
        readings["case_temperature_degC"] = motor.context.case_degC
    if cell is not None:
        readings["soc"] = state["soc"]
    return readings


def valid(model: Model, state: State, inputs: Inputs) -> Any:
    """Return True where the cell's equations are valid: within tables and formulas, with positive resistances."""
    if model.kind == "motor":
        return jnp.asarray(True)
    cell, _ = _parts(model, state, true_inputs(model, inputs))
    assert cell is not None
    soc, temperature = cell.context.soc, cell.context.temperature_degC
    inside = (cell.context.series_resistance_ohm > 0.0) & (cell.context.usable_charge_C > 0.0)
    for curve in (model.curves.ocv, model.curves.R_ints, model.curves.R_TS, model.curves.R_TL):
        inside &= curve.inside(soc, temperature)
    return inside


def true_inputs(model: Model, inputs: Inputs) -> Inputs:
    """Return the true inputs, if effects say that their sensors are wrong."""
    for effect in model.effects:
        correct = getattr(effect, "true_input", None)
        if correct is not None and effect.column in inputs:
            reported = inputs[effect.column]
            true = correct(reported, None)
            blended = true if effect.switch is None else reported + effect.switch * (true - reported)
            inputs = inputs | {effect.column: blended}
    return inputs


def _parts(model: Model, state: State, inputs: Inputs) -> tuple[Cell | None, Motor | None]:
    """Evaluate everything that depends only on the slow state; includes an effect's own inputs, 'effect.input'."""
    state = state | {name: value for name, value in inputs.items() if "." in name or name in IMPOSED}
    ambient = inputs["ambient_degC"]
    cell = motor = None
    if model.kind in ("cell", "robot"):
        cell = cells.evaluate(model.parameters, model.curves, model.effects, state, ambient)
    if model.kind == "motor":
        motor = motors.evaluate(
            model.parameters,
            model.effects,
            state,
            ambient,
            robots.load_torque(model.parameters, inputs, model.effects),
            duty=jnp.ones(()),
            pack_voltage_V=inputs.get("voltage_V", jnp.zeros(())),
        )
    if model.kind == "robot":
        motor = motors.evaluate(
            model.parameters,
            model.effects,
            state,
            ambient,
            robots.load_torque(model.parameters, inputs, model.effects),
            duty=inputs["duty"],
            pack_voltage_V=jnp.zeros(()),
        )
    return cell, motor


def _controlled(model: Model) -> str:
    """Return what a controller sets, `current_A` or `voltage_V`; "" without one."""
    return next((effect.column for effect in model.effects if hasattr(effect, "command")), "")


def _drive(
    model: Model,
    inputs: Inputs,
    now: tuple,
    later: tuple,
    duration: Scalar,
    lead: Scalar,
    first: ArmatureStep | None = None,
) -> Drive:
    """Solve the fast quantities from the state `now` over a span whose slow coefficients are those of `later`."""
    zero = jnp.zeros(())
    expected = Pair(zero, zero) if first is None else Pair(first.current_A, first.speed_rad_s)
    if model.kind != "cell" and touches(model.effects, "friction_torque"):
        same = now[1] is later[1]
        later = (later[0], motors.over(later[1], duration - lead))
        now = later if same else (now[0], motors.over(now[1], duration))
    if set_by := _controlled(model):
        inputs = inputs | {set_by: fold(model.effects, "command", zero, later[1].context)}
        if set_by == "voltage_V":
            told = eqx.tree_at(lambda m: m.context.pack_voltage_V, later[1], inputs[set_by])
            now, later = now if now[1] is not later[1] else (now[0], told), (later[0], told)
    if model.kind == "cell":
        return Drive(inputs["current_A"], zero, None, None)
    if model.kind == "motor":

        def voltage(current):
            return fold(model.effects, "bridge_voltage", inputs["voltage_V"], later[1].context)

        if "voltage_V" not in inputs:
            current = inputs["current_A"]
            at_speed = "speed_rad_s" in inputs
            armature = (
                motors.run_imposed(later[1], current)
                if at_speed
                else motors.run_at_current(later[1], current, duration)
            )
        elif "speed_rad_s" in inputs:
            armature = motors.run_at_speed(later[1], voltage, duration)
        else:
            armature = motors.run(now[1], later[1], voltage, voltage, duration, lead, expected)
        return Drive(zero, zero, later[1], armature)

    accessories = robots.accessory_draw(model.parameters, inputs)

    def terminal_voltage(parts):
        return lambda current: robots.bridge_voltage(parts[0], parts[1], accessories, current)

    if "speed_rad_s" in inputs:
        armature = motors.run_at_speed(later[1], terminal_voltage(later), duration)
    else:
        volts = terminal_voltage(now), terminal_voltage(later)
        armature = motors.run(now[1], later[1], *volts, duration, lead, expected)
    cell, motor = later
    pack_voltage, pack_current = robots.pack(cell, motor, accessories, armature.mean_current_A)
    ratio = model.parameters.n_motors * inputs["duty"]
    motor = eqx.tree_at(lambda m: m.context.pack_voltage_V, motor, pack_voltage)
    return Drive(pack_current, ratio**2 * armature.current_variance_A2, motor, armature)


def _flows(model: Model, parts: tuple[Cell | None, Motor | None], drive: Drive):
    flows = {}
    if parts[0] is not None:
        flows |= cells.flows(parts[0], drive.cell_current_A, drive.cell_current_variance_A2)
    if drive.motor is not None and drive.armature is not None:
        flows |= motors.flows(drive.motor, drive.armature)
    return flows
