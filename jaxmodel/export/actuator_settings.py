"""A case's motor as the settings of a DC-motor actuator of Isaac Lab or mjlab: a file of Python that imports it.

Both hold a joint's torque by a proportional and derivative law to the line of torque over speed:

    tau = clip(stiffness (q_ref - q) - damping q', -s (1 + q'/v), s (1 - q'/v)),   |tau| <= effort limit

With s = N K U/R and v = U/(K N), for a gear of ratio N and a voltage U, that is a motor under a controller of its
voltage: K/R (clip(k_p e - k_d w, -U, U) - K w) at the shaft, if the damping has the K^2/R of the winding too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxmodel.base.errors import ParameterError, instead
from jaxmodel.case.build import case_model
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.effects.controllers import NO_LIMIT, ShaftPosition
from jaxmodel.effects.drive import CommandDelay, ViscousFriction
from jaxmodel.export.mujoco_actuator import MotorParts, case_degC_of, parts_of
from jaxmodel.export.wording import heading, ideal_readings, own_values_of_runs
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.sensors import sensors_of

# Import, class, and the library's names for joints and for dry friction.
LIBRARIES = {
    "isaaclab": ("isaaclab.actuators", "DCMotorCfg", "joint_names_expr", "friction"),
    "mjlab": ("mjlab.actuator", "DcMotorActuatorCfg", "target_names_expr", "frictionloss"),
}


def export_actuator(
    case: Case, *, library: str = "isaaclab", voltage_V: float | str = "", joints: str = ".*"
) -> Exported:
    """Return the settings of a motor, or of a servo, as a file of Python with `MOTOR`, a configuration of its actuator.

    Args:
        case: of a motor, or of a robot, of which it is one motor of the tracks.
        library: "isaaclab" or "mjlab".
        voltage_V: the largest voltage of the bridge; by default the limit of a position controller, without one the
            largest voltage of the runs.
        joints: a regular expression of the joints that have it.

    Raises:
        ParameterError: the case is of a cell, there is no such library, or no voltage is known.
    """
    if case.kind == "cell":
        raise ParameterError(f"{case.label}: it is of a cell, and this format is of a motor; give a case of a motor.")
    if library not in LIBRARIES:
        raise ParameterError(f"There is no library '{library}' to write settings for.{instead(library, LIBRARIES)}")
    module, name, of_joints, of_friction = LIBRARIES[library]
    model = case_model(case)
    p, parts, case_degC = model.parameters, parts_of(model, native=True), case_degC_of(case)
    gear = 1.0 if parts.weight is None else float(parts.weight.gear_ratio)
    highest_V = _voltage(case, parts.controller, voltage_V)
    k = float(p.k_tau)
    R = float(p.R_0) * (1.0 + float(p.psi_R) * (case_degC - float(p.T_0)))
    viscous = sum(float(effect.b) for effect in model.effects if isinstance(effect, ViscousFriction))
    stall = gear * k * highest_V / R
    settings: dict[str, Any] = {
        of_joints: [joints] if library == "isaaclab" else (joints,),
        "stiffness": 0.0,
        "damping": 0.0,
        "saturation_effort": stall,
        "effort_limit": 2.0 * stall,
        "velocity_limit": highest_V / (k * gear),
        "armature": gear**2 * float(p.J),
        of_friction: gear * float(p.tau_0),
    }
    if parts.controller is not None:
        settings["stiffness"] = gear * k * float(parts.controller.k_p) / R
        settings["damping"] = gear**2 * (k * (float(parts.controller.k_d) + k) / R + viscous)
    left_out = _left_out(case, model, parts, case_degC, highest_V, viscous)
    lines = [f"# {line}".rstrip() for line in heading(case, "One motor", left_out)]
    lines += ["", f"from {module} import {name}", "", f"MOTOR = {name}("]
    lines += [
        f"    {key}={f'{value:.9g}' if isinstance(value, float) else repr(value)}," for key, value in settings.items()
    ]
    return Exported("\n".join([*lines, ")"]) + "\n", left_out)


def _voltage(case: Case, controller: Any, stated: float | str) -> float:
    """Return the largest voltage of the bridge, in V."""
    if stated != "":
        try:
            found = float(stated)
        except ValueError:
            raise ParameterError(f"{case.label}: voltage_V is a number in V, not '{stated}'.") from None
    elif controller is not None and float(controller.limit) < NO_LIMIT:
        found = float(controller.limit)
    else:
        inputs = [
            run.measured.inputs[n]
            for run in case.runs
            for n in ("voltage_V", "pack_voltage_V")
            if n in run.measured.inputs
        ]
        found = max((float(np.nanmax(np.abs(values))) for values in inputs), default=0.0)
    if not (np.isfinite(found) and found > 0.0):
        raise ParameterError(f"{case.label}: no run has a voltage above 0; state the bridge's as voltage_V=12.")
    return found


def _left_out(
    case: Case, model: Model, parts: MotorParts, case_degC: float, highest_V: float, viscous: float
) -> tuple[str, ...]:
    carried: tuple[type, ...] = (ViscousFriction, ShaftPosition, CommandDelay)
    carried = (*carried, *(type(one) for one in (parts.weight, parts.controller) if one is not None))
    sensors = {effect.label for effect in sensors_of(model)}
    others = [one.label for one in model.effects if "motor" in one.kinds and not isinstance(one, carried)]
    said = [
        f"Torque over speed is that at {highest_V:.4g} V of the bridge and {case_degC:.4g} degC of the motor, the mean "
        "of its case at the start of the runs: inductance and heat are left out.",
        "The effort limit is twice the torque at standstill, with which a motor brakes that is reversed at full speed: "
        "set it lower if current or heat allow less.",
    ]
    if parts.controller is None:
        said.append(
            "The case has no controller of a position by the voltage: commands are torques, and the gains are 0."
        )
        if viscous:
            said.append(f"The viscous friction of the case, {viscous:.4g} N m s/rad at the shaft, is left out.")
    elif float(parts.controller.k_i):
        said.append(f"The integral gain of the controller, {float(parts.controller.k_i):.4g} V/(rad s), is left out.")
    if parts.weight is not None:
        said.append("The weight on the arm is a matter of the robot's own file.")
    for effect in model.effects:
        if isinstance(effect, CommandDelay):
            said.append(
                f"The command comes late by a lag of {1e3 * float(effect.tau):.3g} ms: delay it by as many steps "
                "(DelayedPDActuatorCfg of Isaac Lab, DelayedActuatorCfg of mjlab)."
            )
    if others := [name for name in others if name not in sensors]:
        said.append(f"The actuator is without {', '.join(others)} of the case.")
    if case.kind == "robot":
        said.append("It is one motor of a robot: pack, duty, slope, gear and electronics are left out.")
    return (*said, *own_values_of_runs(case), *ideal_readings(model))
