"""PyBaMM's Thevenin model with two RC pairs, solved by IDAKLU lane by lane; its own thermal part made inert."""

import sys

import numpy as np
import pybamm
from serve import serve


def _elements(soc, cycles, ambient):
    held = pybamm.maximum(soc, 0.012)
    at_temperature = ambient * (-2.768e-4 - 1.399e-5 * ambient)
    return {
        "R0 [Ohm]": at_temperature + 0.1562 * pybamm.exp(-24.37 * held) + 0.07446 + 0.0015 * np.sqrt(cycles),
        "R1 [Ohm]": 0.3208 * pybamm.exp(-29.14 * held) + 0.04669,
        "C1 [F]": -752.9 * pybamm.exp(-13.51 * held) + 703.6,
        "R2 [Ohm]": 6.603 * pybamm.exp(-155.2 * held) + 0.04984,
        "C2 [F]": -6056.0 * pybamm.exp(-27.12 * held) + 4475.0,
    }


def _ocv(soc):
    return -1.031 * pybamm.exp(-35.0 * soc) + 3.685 + soc * (0.2156 + soc * (-0.1178 + soc * 0.3201))


def prepare(job):
    """Return the run."""
    pybamm.set_logging_level("ERROR")
    model = pybamm.equivalent_circuit.Thevenin(options={"number of rc elements": 2})
    model.events = []
    values = model.default_parameter_values
    ageing = pybamm.InputParameter("cycles")
    resistances = {
        name: lambda T, i, soc, name=name: _elements(soc, ageing, job["ambient_degC"])[name]
        for name in ("R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R2 [Ohm]", "C2 [F]")
    }
    values.update(
        {
            "Initial SoC": 1.0,
            "Cell capacity [A.h]": job["charge_C"] / 3600.0,
            "Nominal cell capacity [A.h]": job["charge_C"] / 3600.0,
            "Current function [A]": pybamm.InputParameter("current"),
            "Open-circuit voltage [V]": _ocv,
            "Entropic change [V/K]": lambda ocv, T: 0.0 * ocv,
            "Element-2 initial overpotential [V]": 0.0,
            "Cell thermal mass [J/K]": 1e9,
            "Jig thermal mass [J/K]": 1e9,
            **resistances,
        },
        check_already_exists=False,
    )
    solver = pybamm.IDAKLUSolver(rtol=job["tolerance"], atol=job["tolerance"])
    simulation = pybamm.Simulation(model, parameter_values=values, solver=solver)
    ends = [0.0, job["duration_s"]]

    def run():
        soc, volts = [], []
        for current, cycles in zip(job["current_A"], job["cycles"], strict=True):
            solution = simulation.solve(ends, inputs={"current": current, "cycles": cycles})
            soc.append(solution["SoC"].entries[-1])
            volts.append(solution["Voltage [V]"].entries[-1])
        return soc, volts

    return run


if __name__ == "__main__":
    sys.exit(serve(prepare))
