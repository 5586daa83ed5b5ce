"""NREL's `thevenin` with two RC pairs, isothermal, lane by lane."""

import sys

import numpy as np
import thevenin
from serve import serve


def _formula(amplitude, rate, offset):
    return lambda soc, T_cell: amplitude * np.exp(-rate * np.maximum(soc, 0.012)) + offset


def prepare(job):
    """Return the run."""
    ambient = job["ambient_degC"]
    at_temperature = ambient * (-2.768e-4 - 1.399e-5 * ambient)
    base = {
        "num_RC_pairs": 2,
        "soc0": 1.0,
        "capacity": job["charge_C"] / 3600.0,
        "gamma": 0.0,
        "ce": 1.0,
        "mass": 1.0,
        "isothermal": True,
        "Cp": 1000.0,
        "T_inf": 273.15 + ambient,
        "h_therm": 0.0,
        "A_therm": 1.0,
        "ocv": lambda soc: -1.031 * np.exp(-35.0 * soc) + 3.685 + soc * (0.2156 + soc * (-0.1178 + soc * 0.3201)),
        "M_hyst": lambda soc: 0.0,
        "R1": _formula(0.3208, 29.14, 0.04669),
        "C1": _formula(-752.9, 13.51, 703.6),
        "R2": _formula(6.603, 155.2, 0.04984),
        "C2": _formula(-6056.0, 27.12, 4475.0),
    }

    lanes = []
    for current, cycles in zip(job["current_A"], job["cycles"], strict=True):
        offset = at_temperature + 0.07446 + 0.0015 * np.sqrt(cycles)
        simulation = thevenin.Simulation({**base, "R0": _formula(0.1562, 24.37, offset)})
        experiment = thevenin.Experiment(rtol=job["tolerance"], atol=job["tolerance"])
        experiment.add_step("current_A", current, (job["duration_s"], 2))
        lanes.append((simulation, experiment))

    def run():
        solutions = [simulation.run(experiment) for simulation, experiment in lanes]
        return [s.vars["soc"][-1] for s in solutions], [s.vars["voltage_V"][-1] for s in solutions]

    return run


if __name__ == "__main__":
    sys.exit(serve(prepare))
