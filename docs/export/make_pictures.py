"""Draw docs/export/*.png: what another tool makes of an exported case, and what we do.

From the root of the repository:

    export PYTHONPATH=. JAXMODEL_PYTHON_OF_PYBAMM=... JAXMODEL_PYTHON_OF_MUJOCO=...
    python docs/export/make_pictures.py SERVO

The variables name a Python that has the tool; SERVO is the folder `servo-results` of docs/how_to/simulated_servo.md.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
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
    for name, values in differences.items():
        below.plot(time_s, values, label=name)
    above.set_ylabel(units[0])
    below.set_ylabel(units[1])
    below.set_xlabel("time (s)")
    above.legend()
    below.legend()
    return figure


def main(servo: str) -> None:
    """Draw both pictures and print the differences."""
    cell = dataclasses.replace(read_case("examples/samsung_30q"), effects=WARM)
    time_s, theirs, ours = by_both(cell, -1, "pybamm", "py")
    found, voltage = np.array(theirs["voltage_V"]), ours["voltage_V"]
    lines = {"jaxmodel": voltage, f"PyBaMM {theirs['version']}": found}
    error = 1e3 * (found - voltage)
    figure = two(time_s, lines, {"PyBaMM less jaxmodel": error}, ("voltage (V)", "difference (mV)"))
    figure.savefig(HERE / "pybamm.png")
    print(f"PyBaMM: {np.abs(error).max():.3f} mV at most")

    case = read_case(servo)
    time_s, theirs, ours = by_both(case, 0, "mujoco", "xml")
    found, own = np.array(theirs["position_rad"]), ours["position_rad"]
    measured = case.runs[0].measured.outputs["position_rad"]
    lines = {"measured": measured, "jaxmodel": own, f"MuJoCo {theirs['version']}": found}
    differences = {"jaxmodel less measured": own - measured, "MuJoCo less jaxmodel": found - own}
    two(time_s, lines, differences, ("position (rad)", "difference (rad)")).savefig(HERE / "servo.png")
    for name, values in differences.items():
        print(f"{name}: rms {np.sqrt(np.mean(values**2)):.4f} rad, {np.abs(values).max():.4f} rad at most")


if __name__ == "__main__":
    main(*sys.argv[1:])
