"""Run by MuJoCo's Python: a motor of a file, driven by a run's voltages and load torques; prints JSON."""

import json
import sys

import mujoco
import numpy as np


def main(path: str, run: str) -> None:
    """Print position, speed, current and winding's rise at the rows of a run, whose inputs hold since the row before.

    Activations of a dcmotor are temperature rise, bristle, current; the force is less the friction of its bristles.
    """
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    with open(path, encoding="utf-8") as file:
        has_current = "inductance=" in file.read()
    mujoco.mj_resetDataKeyframe(model, data, 0)
    with open(run, encoding="utf-8") as file:
        given = {name: np.array(values) for name, values in json.load(file).items()}
    control = given.get("reference_position_rad", given.get("voltage_V"))
    load = given.get("load_torque_Nm", np.zeros(control.size))
    position = [float(data.qpos[0])]
    speed, current, rise = [float(data.qvel[0])], [0.0], [0.0]
    for row in range(1, given["time_s"].size):
        data.ctrl[0] = control[row]
        data.qfrc_applied[0] = -load[row]
        while data.time < given["time_s"][row] - 0.5 * model.opt.timestep:
            mujoco.mj_step(model, data)
        speed.append(float(data.qvel[0]))
        position.append(float(data.qpos[0]))
        current.append(float(data.act[-1]) if has_current else float("nan"))
        rise.append(float(data.act[0]) if model.na else 0.0)
    found = {"position_rad": position, "speed_rad_s": speed, "current_A": current, "winding_rise_K": rise}
    print(json.dumps(found | {"version": mujoco.__version__, "step_s": model.opt.timestep}))


if __name__ == "__main__":
    main(*sys.argv[1:])
