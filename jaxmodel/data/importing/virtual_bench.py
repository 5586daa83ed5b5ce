"""A bench for the cells of PyBaMM: its model of a parameter set is tested, and the logs are those of a cycler.

A physics-based model has no table that an equivalent circuit could take over. What it has is a voltage and a
temperature, so that it is measured as any cell is, and parameterised from the logs.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError, nearest

PREFIX = "pybamm:"
# The tests, as a week at a cycler has them; rates are over the one-hour current of the nominal capacity. Assumed.
SLOW_DEGC, PULSES_DEGC, FAST_DEGC, DRIVE_DEGC = 25.0, (10.0, 25.0, 40.0), 30.0, 20.0
PULSES, DRIVE_S, DRIVE_SEED = 10, 2400.0, 0
# Rows that are closer are the two sides of a step of the current, which PyBaMM has both.
SAME_S = 0.05
FULL = 0.9999  # of an equivalent circuit, which PyBaMM does not start at its limit
_HEAT = (
    "Cell volume [m3]",
    "Negative electrode density [kg.m-3]",
    "Positive electrode specific heat capacity [J.kg-1.K-1]",
)
_CIRCUIT = "Open-circuit voltage [V]"  # a set that has it is one of an equivalent circuit


@dataclasses.dataclass(frozen=True)
class Bench:
    """A parameter set at a bench.

    Attributes:
        name: of the set.
        pybamm: the package.
        values: of the set.
    """

    name: str
    pybamm: Any
    values: Any

    @property
    def is_circuit(self) -> bool:
        """Return True for a set of an equivalent circuit."""
        return _CIRCUIT in self.values

    @property
    def limits_V(self) -> tuple[float, float]:
        """Return the voltages between which the cell is used."""
        return float(self.values["Lower voltage cut-off [V]"]), float(self.values["Upper voltage cut-off [V]"])

    def log(self, steps: list[Any], ambient_degC: float) -> pd.DataFrame:
        """Return the log of a test that begins with a full cell at rest.

        Args:
            steps: of the test, in PyBaMM's words.
            ambient_degC: of the chamber; the cell begins with it.

        Raises:
            MeasurementError: PyBaMM finds no solution.
        """
        pybamm, values = self.pybamm, self.values.copy()
        kelvin = 273.15 + ambient_degC
        values.update({"Ambient temperature [K]": kelvin, "Initial temperature [K]": kelvin})
        if self.is_circuit:
            values.update({"Initial SoC": FULL})
            model, temperature = pybamm.equivalent_circuit.Thevenin(), "Cell temperature [degC]"
        else:
            model, temperature = pybamm.lithium_ion.DFN(self._options()), "Volume-averaged cell temperature [C]"
        simulation = pybamm.Simulation(
            model, parameter_values=values, experiment=pybamm.Experiment(steps), solver=pybamm.IDAKLUSolver()
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                solution = simulation.solve(**({} if self.is_circuit else {"initial_soc": 1.0}))
            except (ArithmeticError, KeyError, RuntimeError, ValueError, pybamm.SolverError) as error:
                raise MeasurementError(f"{PREFIX}{self.name}: PyBaMM does not simulate it ({_told(error)}).") from error
        time_s = np.asarray(solution.t)
        kept = np.diff(time_s, prepend=-np.inf) > SAME_S
        columns = {
            "time_s": time_s,
            "current_A": solution["Current [A]"].entries,
            "voltage_V": solution["Voltage [V]"].entries,
        }
        if self.is_circuit or self._has_heat:
            columns["cell_temperature_degC"] = solution[temperature].entries
        frame = pd.DataFrame({name: np.asarray(column)[kept] for name, column in columns.items()})
        return frame.assign(ambient_degC=ambient_degC).round(6)

    @property
    def _has_heat(self) -> bool:
        return all(name in self.values for name in _HEAT)

    def _options(self) -> dict[str, Any]:
        options: dict[str, Any] = {"thermal": "lumped" if self._has_heat else "isothermal"}
        if "Exchange-current density for lithium metal electrode [A.m-2]" in self.values:
            options["working electrode"] = "positive"
        if any(name.startswith("Secondary: Negative") for name in self.values):
            options["particle phases"] = ("2", "1")
        return options


def bench(name: str) -> Bench:
    """Return the bench of a parameter set, by its name in PyBaMM or the path of a BPX file.

    Raises:
        MeasurementError: PyBaMM is not installed, or there is no such set.
    """
    try:
        import pybamm  # pyrefly: ignore
    except ImportError as error:
        raise MeasurementError(f"{PREFIX}{name}: PyBaMM is not installed; install jaxmodel[pybamm].") from error
    pybamm.set_logging_level("ERROR")
    if name.endswith(".json"):
        return Bench(Path(name).stem, pybamm, _of_bpx(name, pybamm))
    known = sorted(pybamm.parameter_sets)
    if name not in known:
        raise MeasurementError(
            f"{PREFIX}{name}: PyBaMM has no such set; it has {', '.join(known)}.{nearest(name, known)}"
        )
    return Bench(name, pybamm, pybamm.ParameterValues(name))


def _of_bpx(path: str, pybamm: Any) -> Any:
    if importlib.util.find_spec("bpx") is None:
        raise MeasurementError(f"{PREFIX}{path}: PyBaMM reads BPX by bpx; install jaxmodel[pybamm].")
    try:
        return pybamm.ParameterValues.create_from_bpx(path)
    except FileNotFoundError as error:
        raise MeasurementError(f"{PREFIX}{path}: there is no such file.") from error
    except Exception as error:  # whatever its reader, which is another package, makes of a file
        raise MeasurementError(f"{PREFIX}{path}: PyBaMM cannot read it as BPX ({_told(error)}).") from error


def tests_of(one: Bench) -> Iterator[tuple[str, list[Any], float]]:
    """Give the name, the steps and the ambient temperature of each test.

    A slow cycle for capacity and open-circuit voltage, pulses at three temperatures for resistances and their energies,
    a discharge at 1C for heat, and a drive cycle to judge by.
    """
    low, high = one.limits_V
    yield f"slow_{SLOW_DEGC:g}degC", [
        "Rest for 2 minutes (10 second period)",
        f"Discharge at C/20 until {low} V (2 minute period)",
        "Rest for 1 hour (1 minute period)",
        f"Charge at C/20 until {high} V (2 minute period)",
    ], SLOW_DEGC  # fmt: skip
    pulses = [
        f"Discharge at 1C for 30 seconds or until {low} V (1 second period)",
        "Rest for 1 minute (1 second period)",
        f"Charge at C/2 for 30 seconds or until {high + 0.1:g} V (1 second period)",
        "Rest for 1 minute (1 second period)",
        f"Discharge at C/2 for 10 minutes or until {low} V (10 second period)",
        "Rest for 20 minutes (10 second period)",
    ]
    for ambient in PULSES_DEGC:
        yield f"pulses_{ambient:g}degC", ["Rest for 2 minutes (10 second period)", *pulses * PULSES], ambient
    yield f"discharge_1C_{FAST_DEGC:g}degC", [
        "Rest for 2 minutes (10 second period)",
        f"Discharge at 1C until {low} V (5 second period)",
        "Rest for 30 minutes (10 second period)",
    ], FAST_DEGC  # fmt: skip
    yield f"drive_{DRIVE_DEGC:g}degC", ["Rest for 2 minutes (1 second period)", _drive(one)], DRIVE_DEGC


def _drive(one: Bench) -> Any:
    """Return a drive cycle: pull away, cruise, brake and stand, over and over."""
    random, one_hour = np.random.default_rng(DRIVE_SEED), float(one.values["Nominal cell capacity [A.h]"])
    rates: list[float] = []
    while len(rates) < DRIVE_S:
        hard = random.uniform(0.5, 1.5)
        for seconds, rate in (
            (random.integers(5, 20), hard),
            (random.integers(20, 80), random.uniform(0.1, 0.5) * hard),
            (random.integers(5, 15), -random.uniform(0.1, 0.4) * hard),
            (random.integers(5, 60), 0.0),
        ):
            rates += int(seconds) * [float(rate)]
    # Each second in its own row, a hundredth of one for the step between two.
    time_s = np.ravel(np.column_stack([np.arange(len(rates)) + 0.01, np.arange(1, len(rates) + 1)]))
    time_s[0], current = 0.0, np.repeat(rates, 2) * one_hour
    return one.pybamm.step.current(np.column_stack([time_s, current]), duration=float(len(rates)), period=1.0)


def logs_of(name: str, folder: Path) -> list[Path]:
    """Test a parameter set of PyBaMM, and write a CSV log of each test.

    Args:
        name: of the set, or the path of a BPX file.
        folder: of the logs; made if need be.

    Returns:
        The logs. Columns are time_s, current_A (positive on discharge; it holds over the step that ends at its row),
        voltage_V, cell_temperature_degC where the set has heat, and ambient_degC.

    Raises:
        MeasurementError: PyBaMM is not installed, there is no such set, or it cannot be simulated.
    """
    one, found = bench(name), []
    folder.mkdir(parents=True, exist_ok=True)
    for test, steps, ambient in tests_of(one):
        path = folder / f"{test}.csv"
        write_whole(path, one.log(steps, ambient).to_csv(index=False))
        found.append(path)
    return found


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
