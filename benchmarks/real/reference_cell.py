"""A cell as an engineer models it in an afternoon: least squares alone, nothing of this project's physics.

    V = U(SOC) + dU(SOC) - R_0 i - lag(R_S i, tau_S) - lag(R_L i, tau_L)
    R_x = exp(E_x u) (r_x(SOC) + s_x(SOC) E_1 u),   u = (1 / T_K - 1 / 298.15 K) / 8.314
    T = lag(T_amb, tau) + [lag(i (U - V), tau) - lag(i T_K dU/dT(SOC), tau)] / hA

U is the stated table, SOC is counted from the stated start with the stated capacity. dU, r, s and dU/dT are hat
functions with a ridge on their roughness. Time constants, activation energies and the strengths of the ridges are
searched one after the other for the least error at the fit run left out. T in R_x is measured where the model is fitted
and foretold where it is judged. Where runs state different `cycles`, capacity and R_0 are straight
lines of them or of their root.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from benchmarks.real.least_squares import COARSE, FINE, Sums, differences, hats, left_out, relaxed, ridge
from jaxmodel.case.records import Case, Run

ZERO_DEGC_IN_K, GAS_J_MOL_K, REFERENCE_K = 273.15, 8.314, 298.15
E_SCALE = 20e3  # J/mol; the unit of what a resistance adds to its exponential
VOLT = 0.01  # what a ridge weighs an open-circuit voltage with
MOST_ROWS = 10_000  # of all fit runs together, while numbers are searched
MOST_FADE, FADE_POWERS = 0.5, (0.5, 1.0)  # of the capacity in 100 cycles
ROUNDS = 2

SEARCHED = {
    "taus_s": tuple(itertools.product((3.0, 6.0, 12.0, 30.0), (100.0, 200.0, 350.0, 600.0))),
    "E_series": (0.0, 5e3, 10e3, 15e3, 20e3, 25e3, 30e3, 40e3, 50e3),
    "E_pairs": (0.0, 5e3, 10e3, 15e3, 20e3, 25e3, 30e3, 40e3, 50e3),
    "ocv": (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 100.0),
    "ohm": (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0),
    "bend": (1e-3, 1e-2, 1e-1, 1.0, 1e4),
}
FIRST = {"taus_s": (12.0, 200.0), "E_series": 15e3, "E_pairs": 25e3, "ocv": 0.01, "ohm": 0.1, "bend": 1.0}
THERMAL_TAU_S = np.geomspace(60.0, 6000.0, 40)
ENTROPIC = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 1e6)
ENTROPY_V_K = 1e-4  # the unit of dU/dT


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """One run; every array has shape (rows,). `degC` is NaN-free: the ambient temperature where nothing was read."""

    time_s: np.ndarray
    current_A: np.ndarray
    ambient_degC: np.ndarray
    voltage_V: np.ndarray
    degC: np.ndarray
    drawn_Ah: np.ndarray
    first_soc: float
    cycles: float
    warm: bool


def rows_of(run: Run, cycles: float) -> Rows:
    """Return a run's arrays, with the charge drawn until each row."""
    measured = run.measured
    time_s, current = measured.time_s, measured.inputs["current_A"]
    ambient = measured.inputs["ambient_degC"]
    read = measured.outputs.get("cell_temperature_degC", np.full(time_s.size, np.nan))
    there = np.isfinite(read)
    warm = bool(there.any())
    own = run.overrides.get("cycles")
    return Rows(
        time_s=time_s,
        current_A=current,
        ambient_degC=ambient,
        voltage_V=measured.outputs["voltage_V"],
        degC=np.interp(time_s, time_s[there], read[there]) if warm else ambient,
        drawn_Ah=np.append(0.0, np.cumsum(np.diff(time_s) * current[1:])) / 3600.0,
        first_soc=run.initial_soc.value,
        cycles=cycles if own is None else own.value,
        warm=warm,
    )


class CellReference:
    """The model, fitted to the fit runs of a case.

    Attributes:
        chosen: what was searched, by name.
    """

    def __init__(self, case: Case) -> None:
        stated = case.parameters.get("cycles")
        self._cycles = stated.value if stated else 0.0
        self._capacity_Ah, self._ocv, self._fade = case.parameters["capacity_Ah"].value, case.tables["ocv"], 0.0
        self._power = 1.0
        self._runs = [rows_of(run, self._cycles) for run in case.runs if run.split == "fit"]
        self._every = max(1, sum(run.time_s.size for run in self._runs) // MOST_ROWS)
        self.chosen: dict = dict(FIRST)
        self._blocks: dict[tuple, np.ndarray] | None = None  # parts of the design that a search uses again
        self._ages = len({run.cycles for run in self._runs}) > 1
        self._place_knots()
        self._typical_ohm = self._resistance()
        if self._ages:
            self._fit_fade()
        self._search()
        self._values = ridge(self._sums(1), self._penalty())
        self._fit_heat()

    def predict(self, run: Run) -> dict[str, np.ndarray]:
        """Return what the model foretells of a run from its inputs, its stated start and its first temperature."""
        rows = rows_of(run, self._cycles)
        degC = rows.degC if not rows.warm else np.full(rows.time_s.size, rows.degC[0])
        voltage = self._voltage(rows, degC)
        if not rows.warm or self._heat is None:
            return {"voltage_V": voltage}
        for _ in range(20):
            before, degC = degC, self._temperature(rows, voltage, degC)
            voltage = self._voltage(rows, degC)
            if np.max(np.abs(degC - before)) < 1e-3:
                break
        return {"voltage_V": voltage, "cell_temperature_degC": degC}

    def series_ohm(self, soc: np.ndarray, degC: float) -> np.ndarray:
        """Return R_0 at states of charge and one temperature, of a cell without age."""
        colder = (1.0 / (degC + ZERO_DEGC_IN_K) - 1.0 / REFERENCE_K) / GAS_J_MOL_K
        level, bend = np.split(self._values[len(FINE) : len(FINE) + 2 * len(COARSE)], 2)
        return np.exp(self.chosen["E_series"] * colder) * hats(soc, self._coarse) @ (level + E_SCALE * colder * bend)

    # The voltage

    def _soc(self, rows: Rows) -> np.ndarray:
        return rows.first_soc - rows.drawn_Ah / (self._capacity_Ah * (1.0 - self._fade * self._age(rows)))

    def _age(self, rows: Rows) -> float:
        return (rows.cycles / 100.0) ** self._power

    def _stated_V(self, soc: np.ndarray) -> np.ndarray:
        return np.interp(soc, self._ocv.soc, self._ocv.values)

    def _place_knots(self) -> None:
        seen = np.concatenate([self._soc(run) for run in self._runs])
        least, span = seen.min(), np.ptp(seen)
        self._fine, self._coarse = least + span * FINE, least + span * COARSE

    def _resistance(self) -> float:
        """Return the one resistance (ohm) that fits best: the scale of all."""
        drop = np.concatenate([self._stated_V(self._soc(run)) - run.voltage_V for run in self._runs])
        current = np.concatenate([run.current_A for run in self._runs])
        there = np.isfinite(drop)
        return max(float(current[there] @ drop[there] / (current[there] @ current[there])), 1e-5)

    def _series(self, rows: Rows, degC: np.ndarray, energy: float) -> np.ndarray:
        """Return the drive of a resistance: the current times exp(E u) (r, E_1 u s) over SOC, shape (rows, 2 knots)."""
        colder = (1.0 / (degC + ZERO_DEGC_IN_K) - 1.0 / REFERENCE_K) / GAS_J_MOL_K
        level = hats(self._soc(rows), self._coarse) * (rows.current_A * np.exp(energy * colder))[:, None]
        return np.hstack([level, level * (E_SCALE * colder)[:, None]])

    def _design(self, rows: Rows, degC: np.ndarray, kept: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Return the voltage's derivatives by all values at some rows: dU, r and s of each resistance, age."""
        energy, chosen = self.chosen["E_pairs"], self.chosen

        def block(name: str, *at: float) -> np.ndarray:
            if name == "ocv":
                return hats(self._soc(rows), self._fine)[kept]
            drive = self._series(rows, degC, at[0])
            return (drive if name == "series" else relaxed(rows.time_s, drive, at[1]))[kept]

        def known(*key) -> np.ndarray:
            if self._blocks is None:
                return block(*key)
            if (id(rows), *key) not in self._blocks:
                self._blocks[(id(rows), *key)] = block(*key)
            return self._blocks[(id(rows), *key)]

        series = known("series", chosen["E_series"])
        pairs = [known("pair", energy, tau) for tau in chosen["taus_s"]]
        older = self._age(rows) * series[:, : len(COARSE)].sum(axis=1, keepdims=True)
        return np.hstack([known("ocv"), -series, *(-pair for pair in pairs), -older])

    def _penalty(self) -> np.ndarray:
        """Return the ridge: roughness of dU and of each r over SOC, roughness and size of each s.

        A roughness of VOLT, or of the typical resistance, costs VOLT^2 times the strength.
        """
        chosen = self.chosen
        bends, steps, ohm = differences(2, len(FINE)), differences(1, len(COARSE)), (VOLT / self._typical_ohm) ** 2
        ocv = chosen["ocv"] * (bends.T @ bends + 0.01 * np.eye(len(FINE)))
        level = chosen["ohm"] * ohm * (steps.T @ steps + 0.001 * np.eye(len(COARSE)))
        bend = chosen["bend"] * ohm * (steps.T @ steps + 0.1 * np.eye(len(COARSE)))
        return np.asarray(block_diag(ocv, *[level, bend] * 3, [[1e-3 * ohm]]))

    def _sums(self, every: int) -> list[Sums]:
        """Return the normal equations of each run, of each quarter where there is one run."""
        found = []
        for rows in self._runs:
            there = np.flatnonzero(np.isfinite(rows.voltage_V))[::every]
            target = (rows.voltage_V - self._stated_V(self._soc(rows)))[there]
            matrix = self._design(rows, rows.degC, there)
            parts = np.array_split(np.arange(there.size), 4 if len(self._runs) == 1 else 1)
            found += [Sums.of(matrix[part], target[part]) for part in parts]
        return found

    def _fit_fade(self) -> None:
        """Fit the fading of the capacity in 100 cycles, and choose its power of them, by the least mean square."""

        def misfit(fade: float) -> float:
            self._fade = fade
            self._place_knots()
            sums = self._sums(self._every)
            values = ridge(sums, self._penalty())
            return float(np.mean([part.mean_square(values) for part in sums]))

        found = {}
        for self._power in FADE_POWERS:
            least = minimize_scalar(misfit, bounds=(0.0, MOST_FADE), method="bounded")
            found[self._power] = (float(least.fun), float(least.x))
        self._power = min(found, key=found.__getitem__)
        self._fade = found[self._power][1]
        self._place_knots()
        self.chosen |= {"fade": self._fade, "fade_power": self._power}

    def _search(self) -> None:
        """Choose each number in turn for the least error at the run left out."""
        known: dict[tuple, list[Sums]] = {}
        self._blocks = {}

        def score() -> float:
            key = tuple(self.chosen[name] for name in ("taus_s", "E_series", "E_pairs"))
            if key not in known:
                known[key] = self._sums(self._every)
            return left_out(known[key], self._penalty())

        for _, (name, grid) in itertools.product(range(ROUNDS), SEARCHED.items()):
            scores = {}
            for value in grid:
                self.chosen[name] = value
                scores[value] = score()
            self.chosen[name] = min(scores, key=scores.__getitem__)
        self._blocks = None

    def _voltage(self, rows: Rows, degC: np.ndarray) -> np.ndarray:
        return self._stated_V(self._soc(rows)) + self._design(rows, degC) @ self._values

    # The temperature

    def _fit_heat(self) -> None:
        """Fit 1 / hA and dU/dT / hA at the time constant and the ridge that leave least at the run left out."""
        warm, self._heat = [run for run in self._runs if run.warm], None
        if not warm:
            return
        best = np.inf
        steps = differences(1, len(COARSE))
        for tau in THERMAL_TAU_S:
            sums = [self._heat_sums(run, tau) for run in warm]
            hA = sum(part.square[0, 0] for part in sums) / sum(part.aim[0] for part in sums)
            for strength in ENTROPIC:
                penalty = np.zeros((len(COARSE) + 1,) * 2)
                # A tenth of a kelvin for an entropy of a tenth of a millivolt per kelvin, at this heat transfer.
                penalty[1:, 1:] = strength * 0.01 * hA**2 * (steps.T @ steps + 0.1 * np.eye(len(COARSE)))
                score = left_out(sums, penalty) if len(sums) > 1 else sums[0].mean_square(ridge(sums, penalty))
                if score < best:
                    best, self._heat = score, (tau, ridge(sums, penalty))
                    self.chosen |= {"tau_thermal_s": float(tau), "entropic": strength}

    def _heat_design(self, rows: Rows, tau: float, voltage: np.ndarray, degC: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the temperature's derivatives by 1 / hA and dU/dT / hA, and the temperature without any heat."""
        soc, current = self._soc(rows), rows.current_A
        open_V = self._stated_V(soc) + hats(soc, self._fine) @ self._values[: len(FINE)]
        reversible = -ENTROPY_V_K * (current * (degC + ZERO_DEGC_IN_K))[:, None] * hats(soc, self._coarse)
        heat = np.column_stack([current * (open_V - voltage), reversible])
        cold = relaxed(rows.time_s, rows.ambient_degC, tau, first=rows.degC[0])
        return relaxed(rows.time_s, heat, tau), cold

    def _heat_sums(self, rows: Rows, tau: float) -> Sums:
        there = np.isfinite(rows.voltage_V)
        voltage = np.interp(rows.time_s, rows.time_s[there], rows.voltage_V[there])
        matrix, cold = self._heat_design(rows, tau, voltage, rows.degC)
        return Sums.of(matrix[:: self._every], (rows.degC - cold)[:: self._every])

    def _temperature(self, rows: Rows, voltage: np.ndarray, degC: np.ndarray) -> np.ndarray:
        assert self._heat is not None
        tau, values = self._heat
        matrix, cold = self._heat_design(rows, tau, voltage, degC)
        return cold + matrix @ values
