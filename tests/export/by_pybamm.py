"""Run by PyBaMM's Python: a file of parameter values, simulated under a run's currents; prints JSON."""

import importlib.util
import json
import sys

import numpy as np
import pybamm


def main(path: str, run: str) -> None:
    """Print time, voltage and temperature of the cell of a file under the current of a run, held between its rows."""
    spec = importlib.util.spec_from_file_location("parameters", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with open(run, encoding="utf-8") as file:
        given = json.load(file)
    time_s = np.array(given["time_s"])
    # The inputs of a row hold since the row before: after each row they jump within a microsecond.
    at = np.append(np.repeat(time_s[:-1], 2) + np.tile([0.0, 1e-6], time_s.size - 1), time_s[-1])

    def held(name):
        return pybamm.Interpolant(at, np.repeat(np.array(given[name]), 2)[1:], pybamm.t)

    model, values = module.thevenin()
    values.update({"Current function [A]": held("current_A"), "Initial SoC": given["initial_soc"]})
    values.update({"Ambient temperature [K]": 273.15 + held("ambient_degC")})
    values.update({"Initial temperature [K]": 273.15 + given["cell_degC"]})
    solver = pybamm.IDAKLUSolver(rtol=1e-8, atol=1e-8)
    simulation = pybamm.Simulation(model, parameter_values=values, solver=solver)
    solution = simulation.solve([0.0, time_s[-1]], t_interp=time_s)
    names = {"time_s": "Time [s]", "voltage_V": "Voltage [V]", "cell_degC": "Cell temperature [degC]"}
    found = {key: solution[name](time_s).tolist() for key, name in names.items()}
    print(json.dumps(found | {"version": pybamm.__version__, "stopped": solution.termination}))


if __name__ == "__main__":
    main(*sys.argv[1:])
