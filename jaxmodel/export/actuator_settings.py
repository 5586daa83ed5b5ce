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
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.effects.controllers import NO_LIMIT
from jaxmodel.effects.drive import CommandDelay
from jaxmodel.export.one_motor import OneMotor, one_motor
from jaxmodel.export.wording import heading

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
    motor = one_motor(case)
    if library not in LIBRARIES:
        raise ParameterError(f"There is no library '{library}' to write settings for.{instead(library, LIBRARIES)}")
    module, name, of_joints, of_friction = LIBRARIES[library]
    motor = motor._replace(presliding=None)  # neither library has it
    p, gear, loop = motor.model.parameters, motor.gear, motor.controller
    highest_V = _voltage(case, loop, voltage_V)
    k, R = float(p.k_tau), motor.resistance_ohm
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
    if loop is not None:
        settings["stiffness"] = gear * k * float(loop.k_p) / R
        settings["damping"] = gear**2 * (k * (float(loop.k_d) + k) / R + motor.viscous)
    left_out = _left_out(case, motor, highest_V)
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


def _left_out(case: Case, motor: OneMotor, highest_V: float) -> tuple[str, ...]:
    said = [
        f"Torque over speed is that at {highest_V:.4g} V of the bridge and {motor.case_degC:.4g} degC of the motor, "
        "the mean of its case at the start of the runs: inductance and heat are left out.",
        "The effort limit is twice the torque at standstill, with which a motor brakes that is reversed at full speed: "
        "set it lower if current or heat allow less.",
    ]
    if motor.controller is None:
        said.append(
            "The case has no controller of a position by the voltage: commands are torques, and the gains are 0."
        )
        if motor.viscous:
            said.append(f"The viscous friction of the case, {motor.viscous:.4g} N m s/rad at the shaft, is left out.")
    elif float(motor.controller.k_i):
        said.append(f"The integral gain of the controller, {float(motor.controller.k_i):.4g} V/(rad s), is left out.")
    if motor.weight is not None:
        said.append("The weight on the arm is a matter of the robot's own file.")
    for effect in motor.model.effects:
        if isinstance(effect, CommandDelay):
            said.append(
                f"The command comes late by a lag of {1e3 * float(effect.tau):.3g} ms: delay it by as many steps "
                "(DelayedPDActuatorCfg of Isaac Lab, DelayedActuatorCfg of mjlab)."
            )
    return (*said, *motor.without([CommandDelay]), *motor.of_its_case(case))
