"""The voltage of a cell as a linear function of the values of its curves, for given time constants and energies.

    V = U(SOC) + dU(SOC, T) - i R_0 - lag(i R_S, tau_S) - lag(i R_L, tau_L) - M h
    R_x = exp(E_x u) r_x(SOC, T),   u = (1 / T_K - 1 / 298.15 K) / 8.314

U, dU and r are hat functions. Eqs. 3-6 and 10 of the paper are replaced by them; a lag is the RC pair of constant time
constant, whose capacitance is tau / R. h is the state of the effect `ocv_hysteresis`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.smoothing import Penalty, hats, lagged, products, roughness

ZERO_DEGC_IN_K, GAS_J_MOL_K, REFERENCE_DEGC = 273.15, 8.314, 25.0
# Points of a curve between the least and the largest state of charge, as fractions of the span: close where
# open-circuit curves bend. Assumed.
_END = np.array([0.0, 0.001, 0.002, 0.004, 0.007, 0.0125, 0.02, 0.03, 0.045, 0.065])
FINE = np.hstack([_END, 0.09 + np.arange(9) * 0.025, 0.32 + np.arange(15) * 0.04, 0.9, np.flip(1.0 - _END)])
COARSE = np.array([0.0, 0.03, 0.06, 0.1, 0.15, 0.22, 0.32, 0.45, 0.58, 0.7, 0.8, 0.9, 1.0])
RESISTANCES = ("R_0", "R_S", "R_L")
SIZE = 100.0  # of a resistance, in typical ones: hardly acts
LEAST_LEVEL = 0.05  # of the typical resistance: below it a resistance may leave its law as if it were that
HYSTERESIS_V = 0.1
EXACT = 1e-6
# How far curves may bend, as sd beside readings that count as `smoothing.READINGS` readings of `VOLT`. All assumed.
OCV_V = 0.01  # second difference of U from knot to knot
SHIFT_V = 0.003  # difference of dU from knot to knot, and a third of its size
OHM = 0.3  # difference of a resistance from knot to knot, as a share of the typical resistance
LAW = 0.1  # from one temperature to the next, how far a resistance leaves its Arrhenius law, as a share of it
OWN = 0.03  # how far a run's initial state of charge and capacity leave what is stated, as a share of their sd


def colder(degC: np.ndarray | float) -> np.ndarray:
    """Return (1 / T_K - 1 / 298.15 K) / 8.314 in mol/J."""
    inverse = 1.0 / (np.asarray(degC, dtype=float) + ZERO_DEGC_IN_K)
    return np.asarray((inverse - 1.0 / (REFERENCE_DEGC + ZERO_DEGC_IN_K)) / GAS_J_MOL_K)


@dataclasses.dataclass(frozen=True)
class Shape:
    """The numbers in which the voltage is not linear.

    Attributes:
        tau_S: of the short RC pair at 25 degC [s]; it follows the resistance over temperature, the capacitance
            does not depend on it.
        tau_L: the same of the long pair.
        E_0: activation energy of the series resistance [J/mol].
        E_S: of the short pair.
        E_L: of the long pair.
        g: pace of the hysteresis; None without it.
    """

    tau_S: float
    tau_L: float
    E_0: float = 0.0
    E_S: float = 0.0
    E_L: float = 0.0
    g: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Grid:
    """The points of the curves.

    Attributes:
        fine: states of charge of U.
        coarse: of the resistances and dU.
        degC: temperatures; one where the temperature does not vary.
        runs: names of the runs whose initial state of charge is uncertain.
    """

    fine: np.ndarray
    coarse: np.ndarray
    degC: np.ndarray
    runs: tuple[str, ...]

    def layout(self, shape: Shape) -> dict[str, slice]:
        """Return where the values of each curve stand."""
        table = self.coarse.size * self.degC.size
        sizes = {"U": self.fine.size, "dU": table if self.degC.size > 1 else 0}
        sizes |= dict.fromkeys(RESISTANCES, table)
        sizes |= {
            "M": int(shape.g is not None),
            "soc": len(self.runs),
            "fade": len(self.runs),
        }
        ends = np.cumsum(list(sizes.values()))
        return {name: slice(int(end - size), int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)}


@dataclasses.dataclass(frozen=True, eq=False)
class Start:
    """Where a run starts: state of charge, its sd (None: exact), state of the hysteresis, and share of its capacity.

    `fade` is the relative difference of the capacity in this run, by age or by the gain of its current sensor, about 0
    with `fade_sd`.
    """

    soc: float
    sd: float | None
    h: float = 0.0
    fade: float = 0.0
    fade_sd: float = 0.02


def soc_of(rows: Rows, start: Start, capacity_Ah: float) -> np.ndarray:
    """Return the state of charge at each row by eq. 1."""
    return start.soc - rows.drawn_Ah / (capacity_Ah * (1.0 + start.fade))


def hysteresis_of(rows: Rows, start: Start, capacity_Ah: float, g: float) -> np.ndarray:
    """Return h at each row: dh/dt = |g i / Q| (sgn(i) - h)."""
    passed = np.append(0.0, np.cumsum(np.diff(rows.time_s) * np.abs(rows.current_A[1:]))) / 3600.0
    return lagged(passed, np.sign(rows.current_A), capacity_Ah / g, first=start.h)


class Columns:
    """The derivatives of the voltage of a run by all values, at some rows, for any shape; what was last used is kept.

    Attributes:
        moves: by the initial state of charge and the fade, shape (kept, 2); None where they are known.
    """

    def __init__(
        self, rows: Rows, start: Start, grid: Grid, capacity_Ah: float, kept: np.ndarray, moves: np.ndarray | None
    ) -> None:
        """Take the run, its start, the points of the curves, the capacity, and the numbers of the rows."""
        self._rows, self._start, self._grid, self._capacity_Ah, self._kept = rows, start, grid, capacity_Ah, kept
        self.moves = moves
        soc = soc_of(rows, start, capacity_Ah)
        self._fine = hats(soc[kept], grid.fine)
        self._table = products(hats(rows.degC, grid.degC), hats(soc, grid.coarse))
        self._used = np.flatnonzero(np.any(self._table != 0.0, axis=0))  # a run does not see every temperature
        self._known: dict[str, tuple[tuple, np.ndarray]] = {}

    def _block(self, name: str, key: tuple[float, ...]) -> np.ndarray:
        """Return the columns of a resistance for its energy and time constant, or of M for its pace."""
        if name not in self._known or self._known[name][0] != key:
            self._known[name] = (key, self._made(name, *key))
        return self._known[name][1]

    def _made(self, name: str, first: float, tau_s: float = 0.0) -> np.ndarray:
        rows, kept = self._rows, self._kept
        if name == "M":
            return -hysteresis_of(rows, self._start, self._capacity_Ah, first)[kept, None]
        grown = np.exp(first * colder(rows.degC))
        drive = self._table[:, self._used] * (rows.current_A * grown)[:, None]
        block = np.zeros((kept.size, self._table.shape[1]))
        block[:, self._used] = -(drive if tau_s == 0.0 else lagged(rows.time_s, drive, tau_s * grown))[kept]
        return block

    def matrix(self, shape: Shape) -> np.ndarray:
        """Return the derivatives, shape (kept, values)."""
        layout = self._grid.layout(shape)
        matrix = np.zeros((self._kept.size, layout["fade"].stop))
        matrix[:, layout["U"]] = self._fine
        if self._grid.degC.size > 1:
            matrix[:, layout["dU"]] = self._table[self._kept]
        matrix[:, layout["R_0"]] = self._block("R_0", (shape.E_0,))
        matrix[:, layout["R_S"]] = self._block("R_S", (shape.E_S, shape.tau_S))
        matrix[:, layout["R_L"]] = self._block("R_L", (shape.E_L, shape.tau_L))
        if shape.g is not None:
            matrix[:, layout["M"]] = self._block("M", (shape.g,))
        if self.moves is not None:
            number = self._grid.runs.index(self._rows.name)
            matrix[:, layout["soc"].start + number] = self.moves[:, 0]
            matrix[:, layout["fade"].start + number] = self.moves[:, 1]
        return matrix


def penalties_of(
    grid: Grid,
    shape: Shape,
    starts: Sequence[Start],
    ohm: float,
    level: dict[str, np.ndarray] | None,
) -> list[Penalty]:
    """Return the penalties of all values.

    Args:
        grid: the points.
        shape: for the values that are there.
        starts: of the runs of `grid.runs`.
        ohm: typical resistance.
        level: each resistance over SOC at 25 degC; None: the typical one.
    """
    layout, many = grid.layout(shape), grid.degC.size > 1
    found = [Penalty(layout["U"], roughness(grid.fine.size, 2) / OCV_V**2)]
    over_soc = np.kron(np.eye(grid.degC.size), roughness(grid.coarse.size, 1))
    across = np.kron(roughness(grid.degC.size, 1), np.eye(grid.coarse.size))
    both = np.eye(over_soc.shape[0])
    if many:
        found.append(Penalty(layout["dU"], (over_soc + both / 9.0) / SHIFT_V**2))
    for name in RESISTANCES:
        total = over_soc / (OHM * ohm) ** 2 + both / (SIZE * ohm) ** 2
        if many:
            mean = ohm * np.ones(grid.coarse.size) if level is None else np.maximum(level[name], LEAST_LEVEL * ohm)
            each = np.tile(1.0 / (LAW * mean), grid.degC.size)
            total = total + each[:, None] * across * each
        found.append(Penalty(layout[name], total))
    if shape.g is not None:
        found.append(Penalty(layout["M"], np.eye(1) / HYSTERESIS_V**2))
    sd = [(start.sd or EXACT, start.fade_sd) for start in starts]
    for name, each in (("soc", [one for one, _ in sd]), ("fade", [one for _, one in sd])):
        found.append(Penalty(layout[name], np.diag([1.0 / (OWN * one) ** 2 for one in each])))
    return found
