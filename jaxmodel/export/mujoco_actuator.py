"""A case's motor as an actuator of MuJoCo: a model of a rotor on a joint, to be run alone or copied into another.

MuJoCo 4 has `dcmotor`: V = R i + L di/dt + K w with a winding that warms; LuGre friction where the case has presliding.
For older versions the general actuator has the line of torque over speed: K/R (V - K w).
"""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

import numpy as np

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.build import case_model
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.effects.drive import ViscousFriction
from jaxmodel.effects.motion import Presliding
from jaxmodel.export.wording import heading, ideal_readings, own_values_of_runs
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.sensors import sensors_of

ACTUATORS = ("dcmotor", "general")
# Of the rotor's inertia, what is the body's; the rest is armature, which a gear multiplies by its square.
_SHARE_OF_BODY = 1e-6
# A step is this share of the winding's time constant, or of the rotor's where the current has no time constant of its
# own: 0.5 to 2 ms is usual in MuJoCo.
_STEPS_OF_L_R, _STEPS_OF_ROTOR, _LONGEST_STEP_S = 5.0, 50.0, 0.002

_TEXT = """<!--
{heading}

The joint is the motor's shaft. Behind a gear, give its ratio as gear="G" of the actuator, and multiply the frictionloss
of the joint by G. The control is the terminal voltage in V. Activations are the winding's rise in K, the bristles of
friction in rad if there are any, and the current in A.
-->
<mujoco model={name}>
  <option timestep="{step}" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="rotor">
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{own} {own} {own}"/>
      <joint name="shaft" type="hinge" axis="0 0 1" frictionloss="{friction}" solreffriction="{solref} 1"/>
    </body>
  </worldbody>
  <actuator>
    {actuator}
  </actuator>
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
    if case.kind == "cell":
        raise ParameterError(f"{case.label}: it is of a cell, and this format is of a motor; give a case of a motor.")
    if actuator not in ACTUATORS:
        raise ParameterError(f"The actuator '{actuator}' is not one of {' and '.join(ACTUATORS)}.")
    model = case_model(case)
    p = {name: float(getattr(model.parameters, name)) for name in ("R_0", "k_tau", "L_a", "J", "tau_0", "R_wc", "T_0")}
    p |= {name: float(getattr(model.parameters, name)) for name in ("tau_wc", "psi_R", "initial_case_rise_K")}
    native = actuator == "dcmotor"
    viscous = sum(float(effect.b) for effect in model.effects if isinstance(effect, ViscousFriction))
    bent = next((effect for effect in model.effects if isinstance(effect, Presliding)), None) if native else None
    lugre = None if bent is None else (float(bent.s) * p["tau_0"], float(bent.d))
    ambient = float(np.mean([np.mean(run.measured.inputs["ambient_degC"]) for run in case.runs]))
    left_out = _left_out(case, model, native, bent is not None, ambient)
    rotor_s = p["J"] * p["R_0"] / p["k_tau"] ** 2
    electrical_s = p["L_a"] / p["R_0"] if native else np.inf
    step = _rounded_down(min(_LONGEST_STEP_S, rotor_s / _STEPS_OF_ROTOR, electrical_s / _STEPS_OF_L_R))
    attributes = {"name": "motor", "joint": "shaft", "armature": _number(p["J"] * (1.0 - _SHARE_OF_BODY))}
    if viscous:
        attributes["damping"] = _number(viscous)
    if native:
        case_degC = ambient + p["initial_case_rise_K"]
        thermal = (p["R_wc"], p["tau_wc"] / p["R_wc"], 0.0, p["psi_R"], p["T_0"], case_degC)
        attributes |= {
            "motorconst": _numbers(p["k_tau"], p["k_tau"]),
            "resistance": _number(p["R_0"]),
            "inductance": _numbers(p["L_a"], 0.0),
            "thermal": _numbers(*thermal),
        }
    else:
        warm = p["R_0"] * (1.0 + p["psi_R"] * (ambient + p["initial_case_rise_K"] - p["T_0"]))
        gain = p["k_tau"] / warm
        attributes |= {"gainprm": _number(gain), "biastype": "affine"}
        attributes["biasprm"] = _numbers(0.0, 0.0, -gain * p["k_tau"])
    if lugre is not None:
        torque, travel = lugre
        attributes["lugre"] = _numbers(torque / travel, 0.0, torque, torque, 1.0)
    text = _TEXT.format(
        heading=escape("\n".join(heading(case, "One motor", left_out))).replace("--", "- -"),
        name=quoteattr(case.name),
        step=_number(step),
        solref=_number(2.0 * step),
        mass=_number(max(1e-3, 1e3 * _SHARE_OF_BODY * p["J"])),
        own=_number(_SHARE_OF_BODY * p["J"]),
        friction=_number(p["tau_0"] - (0.0 if lugre is None else lugre[0])),
        actuator=f"<{actuator} {' '.join(f'{key}={quoteattr(value)}' for key, value in attributes.items())}/>",
    )
    return Exported(text, left_out)


def _left_out(case: Case, model: Model, native: bool, bent: bool, ambient: float) -> tuple[str, ...]:
    kept = (ViscousFriction, *((Presliding,) if bent else ()))
    others = [effect.label for effect in model.effects if not isinstance(effect, kept) and "motor" in effect.kinds]
    others = [name for name in others if name not in {effect.label for effect in sensors_of(model)}]
    said = []
    if others:
        said.append(f"The actuator is without {', '.join(others)} of the case.")
    if native:
        said.append(
            "The winding warms by i^2 R over a case that stays as at the start of the runs, in their mean ambient, "
            f"{ambient:.4g} degC: the second stage, from the case to the ambient, the heat of friction, and psi_L are "
            "left out."
        )
    else:
        said.append(
            f"The general actuator has neither inductance nor heat: its resistance is that at {ambient:.4g} degC, the "
            "mean ambient of the runs."
        )
    said.append("MuJoCo's dry friction is soft: a rotor held by it creeps, and a step is short enough to hold it well.")
    if case.kind == "robot":
        said.append("It is one motor of a robot: pack, duty, slope, gear and electronics are left out.")
    return (*said, *own_values_of_runs(case), *ideal_readings(model))


def _rounded_down(step_s: float) -> float:
    """Return 1, 2 or 5 times a power of ten, so that times of a log are whole steps."""
    power = 10.0 ** np.floor(np.log10(step_s))
    return float(f"{max(factor for factor in (1.0, 2.0, 5.0) if factor * power <= step_s * (1.0 + 1e-9)) * power:.3g}")


def _number(value: float) -> str:
    return f"{value:.12g}"


def _numbers(*values: float) -> str:
    return " ".join(map(_number, values))
