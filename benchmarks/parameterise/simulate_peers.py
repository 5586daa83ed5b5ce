"""Run in the peers' environment: jobs as JSON on stdin, voltages as JSON on stdout."""

import json
import sys

import numpy as np


def _ramps(job):
    """Return times and currents that ramp to a row's current in the first tenth of its step: solvers stop at steps."""
    time_s, current = np.array(job["time_s"]), np.array(job["current_A"])
    ends = time_s[:-1] + 0.1 * np.diff(time_s)
    at = np.concatenate([time_s, ends])
    order = np.argsort(at)
    return at[order], np.concatenate([current, current[1:]])[order]


def _thevenin(job):
    import thevenin

    R_0, R_1, R_2 = job["R"]
    soc, ocv = np.array(job["soc"]), np.array(job["ocv"])
    parameters = {
        "num_RC_pairs": 2,
        "soc0": job["soc0"],
        "capacity": job["capacity_Ah"],
        "gamma": 0.0,
        "ce": 1.0,
        "mass": 1.0,
        "isothermal": True,
        "Cp": 1000.0,
        "T_inf": 298.15,
        "h_therm": 0.0,
        "A_therm": 1.0,
        "ocv": lambda x: np.interp(x, soc, ocv),
        "M_hyst": lambda x: 0.0,
        "R0": lambda x, T: R_0,
        "R1": lambda x, T: R_1,
        "C1": lambda x, T: job["tau_s"][0] / R_1,
        "R2": lambda x, T: R_2,
        "C2": lambda x, T: job["tau_s"][1] / R_2,
    }
    time_s, (at, ampere) = np.array(job["time_s"]), _ramps(job)
    experiment = thevenin.Experiment(max_step=1.0)
    experiment.add_step("current_A", lambda t: np.interp(t, at, ampere), time_s)
    solution = thevenin.Simulation(parameters).run(experiment)
    return np.interp(time_s, solution.vars["time_s"], solution.vars["voltage_V"])


def _pybamm(job):
    import pybamm

    R_0, R_1, R_2 = job["R"]
    soc, ocv = np.array(job["soc"]), np.array(job["ocv"])
    model = pybamm.equivalent_circuit.Thevenin(options={"number of rc elements": 2})
    values = model.default_parameter_values
    time_s, (at, ampere) = np.array(job["time_s"]), _ramps(job)
    values.update(
        {
            "Initial SoC": min(job["soc0"], 0.9999),
            "Cell capacity [A.h]": job["capacity_Ah"],
            "Nominal cell capacity [A.h]": job["capacity_Ah"],
            "Open-circuit voltage [V]": lambda x: pybamm.Interpolant(soc, ocv, x, interpolator="linear"),
            "R0 [Ohm]": R_0,
            "R1 [Ohm]": R_1,
            "C1 [F]": job["tau_s"][0] / R_1,
            "R2 [Ohm]": R_2,
            "C2 [F]": job["tau_s"][1] / R_2,
            "Element-1 initial overpotential [V]": 0.0,
            "Element-2 initial overpotential [V]": 0.0,
            "Entropic change [V/K]": 0.0,
            "Upper voltage cut-off [V]": 6.0,
            "Lower voltage cut-off [V]": 0.1,
            "Current function [A]": pybamm.Interpolant(at, ampere, pybamm.t, interpolator="linear"),
        },
        check_already_exists=False,
    )
    simulation = pybamm.Simulation(model, parameter_values=values)
    solution = simulation.solve(time_s)
    return np.interp(time_s, solution["Time [s]"].entries, solution["Voltage [V]"].entries, right=np.nan)


def main():
    """Run each job by each peer; a failure is told on stderr and left out."""
    found = []
    for job in json.load(sys.stdin):
        for peer, method in (("thevenin", _thevenin), ("pybamm", _pybamm)):
            try:
                found.append({"peer": peer, "run": job["run"], "voltage_V": np.asarray(method(job)).tolist()})
            except Exception as error:
                print(f"{peer}, {job['run']}: {type(error).__name__}: {error}", file=sys.stderr)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
