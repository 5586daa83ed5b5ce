"""A case's motor as an actuator of MuJoCo: a model of a rotor on a joint, to be run alone or copied into another.

MuJoCo 4 has `dcmotor`: V = R i + L di/dt + K w with a winding that warms; LuGre friction where the case has presliding.
For older versions the general actuator has the line of torque over speed: K/R (V - K w). A weight on an arm becomes a
body, and a position controller of the voltage that of the dcmotor: a servo.
"""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

import numpy as np

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.build import case_model
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.effects.controllers import NO_LIMIT, PositionController, ShaftPosition
from jaxmodel.effects.loads import GravityLoad
from jaxmodel.export.one_motor import OneMotor, one_motor
from jaxmodel.export.wording import heading
from jaxmodel.model.robot import GRAVITY_M_S2

ACTUATORS = ("dcmotor", "general")
# Of the rotor's inertia, what is the body's; the rest is armature, which a gear multiplies by its square.
_SHARE_OF_BODY = 1e-6
# A step is this share of the winding's time constant, or of the rotor's where the current has no time constant of its
# own: 0.5 to 2 ms is usual in MuJoCo.
_STEPS_OF_L_R, _STEPS_OF_ROTOR, _LONGEST_STEP_S = 5.0, 50.0, 0.002
# A winding whose time constant is a smaller share of the rotor's has no inductance: it would ask for needless steps.
_LEAST_L_R = 0.01

_TEXT = """<!--
{heading}

The joint is {what}.
Behind a{another} gear, multiply gear="..." of the actuator and the frictionloss of the joint by its ratio.
The control is {control}. Activations of a dcmotor are the
winding's rise in K, the bristles of friction in rad if there are any, and the current in A if it has inductance.
-->
<mujoco model={name}>
  <option timestep="{step}" integrator="implicitfast" gravity="0 0 -{gravity}"/>
  <worldbody>
    <body name="rotor">
      <inertial pos="0 0 -{arm}" mass="{mass}" diaginertia="{own} {own} {own}"/>
      <joint name="shaft" type="hinge" axis="0 1 0" frictionloss="{friction}" solreffriction="{solref} 1"/>
    </body>
  </worldbody>
  <actuator>
    {actuator}
  </actuator>
  <keyframe>
    <key name="start" qpos="{start}"/>
  </keyframe>
</mujoco>
"""


def export_mujoco(case: Case, *, actuator: str = "dcmotor") -> Exported:
    """Return a motor as an MJCF file.

    Args:
        case: of a motor, or of a robot, of which it is one motor of the tracks.
        actuator: "dcmotor" of MuJoCo 4, or "general" for older versions.

    Raises:
        ParameterError: the case is of a cell, or there is no such actuator.
    """
    motor = one_motor(case)
    if actuator not in ACTUATORS:
        raise ParameterError(f"The actuator '{actuator}' is not one of {' and '.join(ACTUATORS)}.")
    names = ("R_0", "k_tau", "L_a", "J", "tau_0", "R_wc", "T_0", "tau_wc", "psi_R")
    p = {name: float(getattr(motor.model.parameters, name)) for name in names}
    native = actuator == "dcmotor"
    if not native:
        motor = motor._replace(controller=None, presliding=None)
    weight, loop, bent, gear = motor.weight, motor.controller, motor.presliding, motor.gear
    bends = 0.0 if bent is None else float(bent.s) * p["tau_0"]
    inertia = p["J"] + (0.0 if weight is None else float(weight.mass_kg) * (float(weight.arm_m) / gear) ** 2)
    rotor_s, electrical_s = inertia * p["R_0"] / p["k_tau"] ** 2, p["L_a"] / p["R_0"]
    left_out = _left_out(case, motor, native)
    if native and electrical_s < _LEAST_L_R * rotor_s:
        left_out = (
            f"The inductance is left out: the winding takes {1e3 * electrical_s:.2g} ms, the rotor "
            f"{1e3 * rotor_s:.2g} ms.",
            *left_out,
        )
    if not native or electrical_s < _LEAST_L_R * rotor_s:
        electrical_s = np.inf
    step = _rounded_down(min(_LONGEST_STEP_S, rotor_s / _STEPS_OF_ROTOR, electrical_s / _STEPS_OF_L_R))
    attributes = {"name": "motor", "joint": "shaft", "armature": _number(p["J"] * (1.0 - _SHARE_OF_BODY))}
    if gear != 1.0:
        attributes["gear"] = _number(gear)
    if motor.viscous:
        attributes["damping"] = _number(motor.viscous)
    if native:
        thermal = (p["R_wc"], p["tau_wc"] / p["R_wc"], 0.0, p["psi_R"], p["T_0"], motor.case_degC)
        attributes |= {
            "motorconst": _numbers(p["k_tau"], p["k_tau"]),
            "resistance": _number(p["R_0"]),
            "thermal": _numbers(*thermal),
        }
        if np.isfinite(electrical_s):
            attributes["inductance"] = _numbers(p["L_a"], 0.0)
    else:
        gain = p["k_tau"] / motor.resistance_ohm
        attributes |= {"gainprm": _number(gain), "biastype": "affine"}
        attributes["biasprm"] = _numbers(0.0, 0.0, -gain * p["k_tau"])
    if bent is not None:
        attributes["lugre"] = _numbers(bends / float(bent.d), 0.0, bends, bends, 1.0)
    if loop is not None:
        attributes |= _of_controller(loop, gear, p["k_tau"], p["R_0"])
    text = _TEXT.format(
        heading=escape("\n".join(heading(case, "One motor", left_out))).replace("--", "- -"),
        what="the motor's shaft" if weight is None else "that of the arm with its weight, which hangs at 0",
        another="" if gear == 1.0 else "nother",
        control="the terminal voltage in V" if loop is None else "the reference position in rad of the motor",
        name=quoteattr(case.name),
        step=_number(step),
        gravity=_number(0.0 if weight is None else GRAVITY_M_S2),
        arm=_number(0.0 if weight is None else float(weight.arm_m)),
        mass=_number(max(1e-3, 1e3 * _SHARE_OF_BODY * p["J"]) if weight is None else float(weight.mass_kg)),
        own=_number(_SHARE_OF_BODY * p["J"] * gear**2),
        friction=_number(gear * (p["tau_0"] - bends)),
        solref=_number(2.0 * step),
        actuator=f"<{actuator} {' '.join(f'{key}={quoteattr(value)}' for key, value in attributes.items())}/>",
        start=_number(_first_position(case)),
    )
    return Exported(text, left_out)


def _first_position(case: Case) -> float:
    """Return where the joint is at the start of the first run."""
    effects = case_model(case, case.runs[0]).effects
    starts = [effect for effect in effects if isinstance(effect, GravityLoad | ShaftPosition)]
    return float(starts[0].initial_position_rad) if starts else 0.0


def _of_controller(loop: PositionController, gear: float, k: float, R: float) -> dict[str, str]:
    """Return the attributes of the controller u = k_p e + k_i int e dt - k_d w, |u| <= limit, in V.

    MuJoCo's is v = R/K (kp e + ki int e dt - kd w) + K w, e and w of the motor: kd takes the K w back.
    """
    k_p, k_i, k_d = float(loop.k_p) / gear, float(loop.k_i) / gear, float(loop.k_d)
    limit = float(loop.limit) if float(loop.limit) < NO_LIMIT else 0.0
    largest = limit / k_i if k_i else 0.0
    return {"input": "pos", "controller": _numbers(k_p * k / R, k_i * k / R, (k_d + k) * k / R, 0.0, largest, limit)}


def _left_out(case: Case, motor: OneMotor, native: bool) -> tuple[str, ...]:
    said = list(motor.without())
    if native:
        said.append(
            f"The winding warms by i^2 R over a case that stays at {motor.case_degC:.4g} degC, its mean at the start "
            "of the runs: the second stage, from the case to the ambient, the heat of friction, and psi_L are left out."
        )
    else:
        said.append(
            "The general actuator has neither inductance nor heat: its resistance is that at "
            f"{motor.case_degC:.4g} degC, the mean of the motor's case at the start of the runs."
        )
    if motor.controller is not None and float(motor.controller.k_i):
        said.append("The integral of the controller is held to its limit; in the case it stands still at the limit.")
    if motor.gear != 1.0 and motor.controller is not None:
        said.append("The reference is that of the motor: that of the arm times the ratio of the gear.")
    said.append("MuJoCo's dry friction is soft: a rotor held by it creeps, and a step is short enough to hold it well.")
    return (*said, *motor.of_its_case(case))


def _rounded_down(step_s: float) -> float:
    """Return 1, 2 or 5 times a power of ten, so that times of a log are whole steps."""
    power = 10.0 ** np.floor(np.log10(step_s))
    return float(f"{max(factor for factor in (1.0, 2.0, 5.0) if factor * power <= step_s * (1.0 + 1e-9)) * power:.3g}")


def _number(value: float) -> str:
    return f"{value:.12g}"


def _numbers(*values: float) -> str:
    return " ".join(map(_number, values))
