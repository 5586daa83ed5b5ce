"""Draw docs/export/*.png: what another tool makes of an exported case, and what we do.

From the root of the repository:

    export PYTHONPATH=. JAXMODEL_PYTHON_OF_PYBAMM=... JAXMODEL_PYTHON_OF_MUJOCO=... JAXMODEL_PYTHON_OF_FMPY=...
    python docs/export/make_pictures.py [SERVO]

The variables name a Python that has the tool; SERVO is the folder `servo-results` of docs/how_to/simulated_servo.md,
without which that picture is left as it is. The others need a C compiler, `cc`.
"""

from __future__ import annotations

import ctypes
import dataclasses
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from jaxmodel import Case, case_model, plots, read_case, run_profile, simulate
from tests.export.other_python import run_by

HERE = Path(__file__).parent
WARM = {"self_heating": {"C_th": 45.0, "hA": 0.15}, "arrhenius_resistance": {}}


def by_both(case: Case, run: int, tool: str, suffix: str) -> tuple[np.ndarray, dict, dict]:
    """Return times, what the tool makes of a run, and what we do."""
    profile = run_profile(case.runs[run])
    model = case_model(case, case.runs[run])
    ours = {name: np.asarray(values) for name, values in simulate(model, profile).readings.items()}
    given = {"time_s": profile.time_s} | profile.inputs
    start = {}
    if case.kind == "cell":
        start = {"initial_soc": case.runs[run].initial_soc.value, "cell_degC": float(ours["cell_temperature_degC"][0])}
    with tempfile.TemporaryDirectory() as folder:
        file, inputs = Path(folder, f"exported.{suffix}"), Path(folder, "run.json")
        case.export(tool, file)
        inputs.write_text(json.dumps({name: np.asarray(x).tolist() for name, x in given.items()} | start))
        return profile.time_s, run_by(tool, f"by_{tool}.py", file, inputs), ours


@plots.styled
def two(time_s: np.ndarray, lines: dict[str, np.ndarray], differences: dict[str, np.ndarray], units: tuple) -> Figure:
    """Draw lines above, and differences below."""
    figure = plots.new_figure(15.0, 9.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    for number, (name, values) in enumerate(lines.items()):
        above.plot(time_s, values, label=name, linestyle=("-", "--", ":")[number])
    for number, (name, values) in enumerate(differences.items()):
        below.plot(time_s, values, label=name, linestyle=("-", "--")[number])
    above.set_ylabel(units[0])
    below.set_ylabel(units[1])
    below.set_xlabel("time (s)")
    above.legend()
    below.legend()
    return figure


def of_filter() -> None:
    """Draw the filter in C, in both precisions, over a discharge from a wrong start."""
    case = read_case("examples/samsung_30q")
    measured = case.runs[0].measured
    columns = measured.inputs | measured.outputs
    rows = np.stack([columns["current_A"], columns["ambient_degC"], columns["voltage_V"]], axis=1)
    durations = np.diff(measured.time_s)
    found = {}
    for precision, number in (("float64", ctypes.c_double), ("float32", ctypes.c_float)):
        with tempfile.TemporaryDirectory() as folder:
            case.export("c-filter", Path(folder, "filter.c"), precision=precision)
            library = Path(folder, "filter.so")
            command = ["cc", "-std=c99", "-O2", "-shared", "-fPIC", f"{folder}/filter.c", "-o", str(library), "-lm"]
            subprocess.run(command, check=True)
            c = ctypes.CDLL(str(library))
        memory, estimate = (number * 90)(), (number * 8)()
        c.samsung_30q_filter_start(*map(number, (0.2, *rows[0, :2], 0.0)), memory)
        c.samsung_30q_filter_first(*map(number, rows[0]), memory, estimate)
        told = [estimate[0]]
        for duration, row in zip(durations, rows[1:], strict=True):
            c.samsung_30q_filter_step(*map(number, (duration, *row)), memory, estimate)
            told.append(estimate[0])
        found[precision] = np.array(told)
    counted_Ah = np.cumsum(rows[1:, 0] * durations) / 3600.0
    counted = case.runs[0].initial_soc.value - counted_Ah / float(case_model(case).parameters.capacity_Ah)
    lines = {"counted from the known start": np.append(case.runs[0].initial_soc.value, counted)}
    lines |= {f"C of the filter in {precision}": values for precision, values in found.items()}
    difference = 1e6 * (found["float32"] - found["float64"])
    units = ("state of charge", "difference (1e-6)")
    two(measured.time_s, lines, {"float32 less float64": difference}, units).savefig(HERE / "filter.png")
    print(f"filter: float32 less float64 {np.abs(difference).max():.2f}e-6 at most")


def of_fmu() -> None:
    """Draw a drive of the paper's robot: a start, a slope that grows and falls, and a stop."""
    time_s = np.arange(0.0, 120.5, 0.5)
    columns = {
        "duty": np.interp(time_s, [0.0, 10.0, 60.0, 70.0, 100.0, 105.0], [0.0, 0.8, 0.8, 0.4, 0.4, 0.0]),
        "load_torque_Nm": np.interp(
            time_s, [0.0, 10.0, 20.0, 50.0, 60.0, 100.0, 105.0], [0.0, 0.05, 0.05, 0.2, 0.05, 0.05, 0.0]
        ),
        "ambient_degC": 20.0,
        "pack_voltage_V": 22.0,
    }
    case = Case.from_dataframes({"drive": pd.DataFrame({"time_s": time_s} | columns)}, kind="robot", name="robot")
    profile = run_profile(case.runs[0])
    ours = {name: np.asarray(values) for name, values in simulate(case_model(case), profile).readings.items()}
    rows = {name: values.tolist() for name, values in profile.inputs.items()}
    given = {"time_s": time_s.tolist(), "inputs": rows, "parameters": {}}
    lines, differences = {"jaxmodel": ours["speed_rad_s"]}, {}
    for fmi in (2, 3):
        with tempfile.TemporaryDirectory() as folder:
            file, inputs = Path(folder, "robot.fmu"), Path(folder, "run.json")
            case.export("fmu", file, fmi=fmi)
            inputs.write_text(json.dumps(given))
            theirs = run_by("fmpy", "by_fmpy.py", file, inputs)
        readings = dict(zip(theirs["names"], map(np.array, theirs["readings"]), strict=True))
        lines[f"FMPy {theirs['version']}, FMI {fmi}.0"] = readings["speed_rad_s"]
        differences[f"FMI {fmi}.0 less jaxmodel"] = 1e12 * (readings["speed_rad_s"] - ours["speed_rad_s"])
        for name, values in readings.items():
            print(f"FMI {fmi}.0: {name} {np.abs(values - ours[name]).max() / np.abs(ours[name]).max():.2g}")
    two(time_s, lines, differences, ("speed of the motors (rad/s)", "difference\n(1e-12 rad/s)")).savefig(
        HERE / "fmu.png"
    )


def of_pybamm() -> None:
    """Draw a discharge by PyBaMM."""
    cell = dataclasses.replace(read_case("examples/samsung_30q"), effects=WARM)
    time_s, theirs, ours = by_both(cell, -1, "pybamm", "py")
    found, voltage = np.array(theirs["voltage_V"]), ours["voltage_V"]
    lines = {"jaxmodel": voltage, f"PyBaMM {theirs['version']}": found}
    error = 1e3 * (found - voltage)
    figure = two(time_s, lines, {"PyBaMM less jaxmodel": error}, ("voltage (V)", "difference (mV)"))
    figure.savefig(HERE / "pybamm.png")
    print(f"PyBaMM: {np.abs(error).max():.3f} mV at most")


def of_servo(servo: str) -> None:
    """Draw a servo by MuJoCo."""
    case = read_case(servo)
    time_s, theirs, ours = by_both(case, 0, "mujoco", "xml")
    found, own = np.array(theirs["position_rad"]), ours["position_rad"]
    measured = case.runs[0].measured.outputs["position_rad"]
    lines = {"measured": measured, "jaxmodel": own, f"MuJoCo {theirs['version']}": found}
    differences = {"jaxmodel less measured": own - measured, "MuJoCo less jaxmodel": found - own}
    two(time_s, lines, differences, ("position (rad)", "difference (rad)")).savefig(HERE / "servo.png")
    for name, values in differences.items():
        print(f"{name}: rms {np.sqrt(np.mean(values**2)):.4f} rad, {np.abs(values).max():.4f} rad at most")


def main(servo: str = "") -> None:
    """Draw the pictures and print the differences."""
    of_filter()
    of_fmu()
    of_pybamm()
    if servo:
        of_servo(servo)


if __name__ == "__main__":
    main(*sys.argv[1:])
