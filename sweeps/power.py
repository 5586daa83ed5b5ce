"""The power balance at one time: power of the cells or terminals, losses by cause, and work."""

from __future__ import annotations

import jax.numpy as jnp

from jaxmodel.model import cell as cells
from jaxmodel.model import motor as motors
from jaxmodel.model import robot as robots
from jaxmodel.model.cell import Cell
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.electrothermal import Model, true_inputs
from jaxmodel.model.flow import State
from jaxmodel.model.motor import Motor
from jaxmodel.model.ports import fold
from jaxmodel.model.robot import Inputs

BATTERY = ("ohmic_W", "polarisation_W")
DRIVE = ("copper_W", "friction_W")
LOSSES = {"cell": BATTERY, "motor": DRIVE, "robot": (*BATTERY, *DRIVE, "electronics_W")}


def powers(model: Model, state: State, inputs: Inputs) -> dict[str, Scalar]:
    """Return powers in W by name, and a robot's `ground_speed_m_s`.

    source_W = the losses of `LOSSES` + work_W + what coils and rotors store. A pack has source_W = n V_oc i, and its
    polarisation is all that its terminals lack beside i^2 R; what the RC pairs still hold counts as lost, as in the
    cells' heat. Copper includes the brushes; friction is every torque between i_a k_tau and the load; electronics are
    the on-board draw and the bridge. work_W is i_cell V_cell of a cell, w tau_l of motors, and with them what flippers
    and arms draw.
    """
    inputs = true_inputs(model, inputs)
    p, ambient = model.parameters, inputs["ambient_degC"]
    if model.kind == "cell":
        cell = cells.evaluate(p, model.curves, model.effects, state, ambient)
        current = inputs["current_A"]
        voltage = cells.voltage(cell, current)
        return _of_battery(cell, current, voltage, 1.0) | {"work_W": current * voltage}
    if model.kind == "motor":
        load = robots.load_torque(p, inputs, model.effects)
        volts = inputs.get("voltage_V", jnp.zeros(()))
        motor = motors.evaluate(p, model.effects, state, ambient, load, jnp.ones(()), volts)
        lost = _of_motor(motor, load, 1.0)
        current, speed = state["motor_current_A"], state["speed_rad_s"]
        imposed = motor.torque_constant * speed * current + lost["copper_W"]
        source = current * volts if "voltage_V" in inputs else imposed
        return lost | {"source_W": source, "work_W": load * speed}
    load = robots.load_torque(p, inputs, model.effects)
    cell = cells.evaluate(p, model.curves, model.effects, state, ambient)
    motor = motors.evaluate(p, model.effects, state, ambient, load, inputs["duty"], jnp.zeros(()))
    accessories_A = robots.accessory_draw(p, inputs)
    current, speed = state["motor_current_A"], state["speed_rad_s"]
    voltage, drawn = robots.pack(cell, motor, accessories_A, current)
    to_motors = p.n_motors * current * robots.bridge_voltage(cell, motor, accessories_A, current)
    accessories = accessories_A * voltage
    return {
        **_of_battery(cell, drawn, voltage, p.n_series),
        **_of_motor(motor, load, p.n_motors),
        "electronics_W": drawn * voltage - accessories - to_motors,
        "work_W": p.n_motors * load * speed + accessories,
        "pack_W": drawn * voltage,
        "ground_speed_m_s": speed / p.gear_ratio * p.wheel_radius_m,
    }


def _of_battery(cell: Cell, current: Scalar, voltage: Scalar, n_series: Scalar | float) -> dict[str, Scalar]:
    source = n_series * cell.open_circuit_voltage_V * current
    ohmic = n_series * current**2 * cell.context.series_resistance_ohm
    return {"source_W": source, "ohmic_W": ohmic, "polarisation_W": source - ohmic - voltage * current}


def _of_motor(motor: Motor, load_torque_Nm: Scalar, count: Scalar | float) -> dict[str, Scalar]:
    """Return the losses of all motors: eq. 16 less the heat that no draw pays for, and what the effects add."""
    context, nothing = motor.context, jnp.zeros(())
    current, speed = context.current_A, context.speed_rad_s
    drop = fold(motor.effects, "armature_voltage_drop", nothing, context)
    friction = jnp.sign(speed) * fold(motor.effects, "coulomb_torque", context.parameters.tau_0, context)
    friction += fold(motor.effects, "friction_torque", nothing, context)
    friction += jnp.sign(speed) * fold(motor.effects, "iron_friction", nothing, context)
    friction += fold(motor.effects, "iron_drag", nothing, context)
    ideal = motor.torque_constant * current
    magnetic = ideal - fold(motor.effects, "motor_torque", ideal, context)
    gear = motor.load_torque_Nm - load_torque_Nm
    return {
        "copper_W": count * (current**2 * motor.winding_resistance_ohm + current * drop),
        "friction_W": count * speed * (friction + magnetic + gear),
    }
