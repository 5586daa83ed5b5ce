"""Run by MuJoCo's Python: a motor of a file, driven by a run's voltages and load torques; prints JSON."""

import json
import sys

import mujoco
import numpy as np


def main(path: str, run: str) -> None:
    """Print speed, current and rise of the winding at the rows of a run, whose inputs hold since the row before.

    Activations of a dcmotor are temperature rise, bristle, current; the force is less the friction of its bristles.
    """
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    with open(run, encoding="utf-8") as file:
        given = {name: np.array(values) for name, values in json.load(file).items()}
    speed, current, rise = [float(data.qvel[0])], [0.0], [0.0]
    for row in range(1, given["time_s"].size):
        data.ctrl[0] = given["voltage_V"][row]
        data.qfrc_applied[0] = -given["load_torque_Nm"][row]
        while data.time < given["time_s"][row] - 0.5 * model.opt.timestep:
            mujoco.mj_step(model, data)
        speed.append(float(data.qvel[0]))
        current.append(float(data.act[-1]) if model.na else float("nan"))
        rise.append(float(data.act[0]) if model.na else 0.0)
    found = {"speed_rad_s": speed, "current_A": current, "winding_rise_K": rise}
    print(json.dumps(found | {"version": mujoco.__version__, "step_s": model.opt.timestep}))


if __name__ == "__main__":
    main(*sys.argv[1:])
