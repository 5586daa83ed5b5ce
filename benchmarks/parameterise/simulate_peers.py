"""Run in the peers' environment: fit runs and jobs as JSON on stdin, voltages as JSON on stdout."""

import contextlib
import json
import sys

import numpy as np

ITERATIONS = 80  # of Nelder and Mead by PyBOP, some 190 simulations; the gain of the last 20 is below 1 %
FACTOR = 8.0  # each parameter may leave the usual recipe's by this


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


def _model(job, R, C):
    """Return PyBaMM's Thevenin model of two pairs, with its parameter values."""
    import pybamm

    soc, ocv = np.array(job["soc"]), np.array(job["ocv"])
    model = pybamm.equivalent_circuit.Thevenin(options={"number of rc elements": 2})
    values = model.default_parameter_values
    at, ampere = _ramps(job)
    values.update(
        {
            "Initial SoC": min(job["soc0"], 0.9999),
            "Cell capacity [A.h]": job["capacity_Ah"],
            "Nominal cell capacity [A.h]": job["capacity_Ah"],
            "Open-circuit voltage [V]": lambda x: pybamm.Interpolant(soc, ocv, x, interpolator="linear"),
            "R0 [Ohm]": R[0],
            "R1 [Ohm]": R[1],
            "C1 [F]": C[0],
            "R2 [Ohm]": R[2],
            "C2 [F]": C[1],
            "Element-1 initial overpotential [V]": 0.0,
            "Element-2 initial overpotential [V]": 0.0,
            "Entropic change [V/K]": 0.0,
            "Upper voltage cut-off [V]": 6.0,
            "Lower voltage cut-off [V]": 0.1,
            "Current function [A]": pybamm.Interpolant(at, ampere, pybamm.t, interpolator="linear"),
        },
        check_already_exists=False,
    )
    return model, values


def _pybamm(job):
    import pybamm

    model, values = _model(job, job["R"], [tau / R for tau, R in zip(job["tau_s"], job["R"][1:], strict=True)])
    simulation = pybamm.Simulation(model, parameter_values=values)
    time_s = np.array(job["time_s"])
    solution = simulation.solve(time_s)
    return np.interp(time_s, solution["Time [s]"].entries, solution["Voltage [V]"].entries, right=np.nan)


def _identified(fit):
    """Return resistances and time constants by PyBOP: least squares of a fit run from those of the usual recipe."""
    import pybop

    R, tau_s = fit["R"], fit["tau_s"]
    first = dict(zip(("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]"), R, strict=True))
    first |= {"C1 [F]": tau_s[0] / R[1], "C2 [F]": tau_s[1] / R[2]}
    model, values = _model(fit, R, [first["C1 [F]"], first["C2 [F]"]])
    for name, value in first.items():
        values[name] = pybop.Parameter(
            bounds=(value / FACTOR, value * FACTOR), initial_value=value, transformation=pybop.LogTransformation()
        )
    columns = {"Time [s]": "time_s", "Current [A]": "current_A", "Voltage [V]": "voltage_V"}
    dataset = pybop.Dataset({name: np.array(fit[key]) for name, key in columns.items()})
    simulator = pybop.pybamm.Simulator(model, parameter_values=values, protocol=dataset)
    problem = pybop.Problem(simulator, pybop.RootMeanSquaredError(dataset))
    options = pybop.SciPyMinimizeOptions(method="Nelder-Mead", maxiter=ITERATIONS)
    found = {
        name: float(value) for name, value in pybop.SciPyMinimize(problem, options=options).run().best_inputs.items()
    }
    R = [found[f"R{number} [Ohm]"] for number in range(3)]
    return {"R": R, "tau_s": [R[number] * found[f"C{number} [F]"] for number in (1, 2)]}


def main():
    """Run each job by each peer; a failure is told on stderr and left out."""
    content, found, known = json.load(sys.stdin), [], {}

    def by_pybop(job):
        """Predict with PyBOP's numbers by thevenin, whose solver passes the steps that stop PyBaMM's."""
        if job["fit"] not in known:
            known[job["fit"]] = _identified(content["fits"][job["fit"]])
        return _thevenin(job | known[job["fit"]])

    for job in content["jobs"]:
        for peer, method in (("thevenin", _thevenin), ("pybamm", _pybamm), ("pybop", by_pybop)):
            try:
                with contextlib.redirect_stdout(sys.stderr):
                    voltage = method(job)
                found.append({"peer": peer, "run": job["run"], "voltage_V": np.asarray(voltage).tolist()})
            except Exception as error:
                print(f"{peer}, {job['run']}: {type(error).__name__}: {error}", file=sys.stderr)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
