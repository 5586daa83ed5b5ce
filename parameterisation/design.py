"""The voltage of a cell as a linear function of the values of its curves, for given time constants and energies.

    V = U(SOC) + dU(SOC, T) - i R_0 - lag(i R_S, tau_S) - lag(i R_L, tau_L) - lag(i, tau_3) R_3 - M h
    R_x = exp(E_x u) r_x(SOC, T),   u = (1 / T_K - 1 / 298.15 K) / 8.314

U, dU and r are hat functions. Eqs. 3-6 and 10 of the paper are replaced by them; a lag is the RC pair of constant time
constant, whose capacitance is tau / R. h is the state of the effect `ocv_hysteresis`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from parameterisation.rows import Rows
from parameterisation.smoothing import Penalty, hats, lagged, products, roughness

ZERO_DEGC_IN_K, GAS_J_MOL_K, REFERENCE_DEGC = 273.15, 8.314, 25.0
# Points of a curve between the least and the largest state of charge, as fractions of the span: close where
# open-circuit curves bend. Assumed.
FINE = np.hstack(
    [np.arange(8) * 0.0125, 0.1 + np.arange(8) * 0.025, 0.3 + np.arange(15) * 0.04, [0.9, 0.93, 0.96, 0.98, 1.0]]
)
COARSE = np.array([0.0, 0.03, 0.06, 0.1, 0.15, 0.22, 0.32, 0.45, 0.58, 0.7, 0.8, 0.9, 1.0])
LAWFUL = 0.003  # of the typical resistance: how far a table leaves its Arrhenius law while energies are searched
LEAVES = 0.5  # of the resistance: the same for the tables, from one temperature to the next. Assumed.
RESISTANCES = ("R_0", "R_S", "R_L")


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
        tau_3: of a third pair without dependence on SOC or temperature [s]; None without it.
        g: pace of the hysteresis; None without it.
    """

    tau_S: float
    tau_L: float
    E_0: float = 0.0
    E_S: float = 0.0
    E_L: float = 0.0
    tau_3: float | None = None
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
            "R_3": int(shape.tau_3 is not None),
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


def design(
    rows: Rows, soc: np.ndarray, start: Start, grid: Grid, shape: Shape, capacity_Ah: float, kept: np.ndarray
) -> np.ndarray:
    """Return the derivatives of the voltage by all values but the initial states of charge, at some rows.

    Args:
        rows: of one run.
        soc: at each row.
        start: of the run.
        grid: the points of the curves.
        shape: the numbers in which the voltage is not linear.
        capacity_Ah: of the cell.
        kept: numbers of the rows.

    Returns:
        Shape (kept, values), the columns of the initial states of charge zero.
    """
    layout = grid.layout(shape)
    matrix = np.zeros((kept.size, layout["fade"].stop))
    matrix[:, layout["U"]] = hats(soc[kept], grid.fine)
    table = products(hats(rows.degC, grid.degC), hats(soc, grid.coarse))
    if grid.degC.size > 1:
        matrix[:, layout["dU"]] = table[kept]
    cold = colder(rows.degC)
    drive = table * rows.current_A[:, None]
    matrix[:, layout["R_0"]] = -drive[kept] * np.exp(shape.E_0 * cold[kept])[:, None]
    for name, tau, energy in (("R_S", shape.tau_S, shape.E_S), ("R_L", shape.tau_L, shape.E_L)):
        used = np.flatnonzero(np.any(table != 0.0, axis=0))  # a run does not see every temperature
        columns = -lagged(rows.time_s, drive[:, used] * np.exp(energy * cold)[:, None], tau * np.exp(energy * cold))[
            kept
        ]
        block = np.zeros((kept.size, table.shape[1]))
        block[:, used] = columns
        matrix[:, layout[name]] = block
    if shape.tau_3 is not None:
        matrix[:, layout["R_3"]] = -lagged(rows.time_s, rows.current_A.copy(), shape.tau_3)[kept, None]
    if shape.g is not None:
        matrix[:, layout["M"]] = -hysteresis_of(rows, start, capacity_Ah, shape.g)[kept, None]
    return matrix


def penalties_of(
    grid: Grid, shape: Shape, starts: Sequence[Start], ohm: float, level: dict[str, np.ndarray] | None = None
) -> list[Penalty]:
    """Return the penalties of all values.

    U has an estimated bend; dU an estimated size and slope; each resistance an estimated slope over SOC, a known
    distance from its Arrhenius law over temperature, and a size that hardly acts.

    Args:
        grid: the points.
        shape: for the values that are there.
        starts: of the runs of `grid.runs`.
        ohm: typical resistance.
        level: each resistance over SOC; its table may leave its Arrhenius law by the share `LEAVES` of it from one
            temperature to the next. None: hardly at all, so that the energies of the laws are found first.
    """
    layout = grid.layout(shape)
    found = [Penalty(layout["U"], roughness(grid.fine.size, 2))]
    over_soc = np.kron(np.eye(grid.degC.size), roughness(grid.coarse.size, 1))
    across = np.kron(roughness(grid.degC.size, 1), np.eye(grid.coarse.size))
    both = np.eye(over_soc.shape[0])
    if grid.degC.size > 1:
        found += [Penalty(layout["dU"], over_soc), Penalty(layout["dU"], both)]
    for name in RESISTANCES:
        found.append(Penalty(layout[name], over_soc))
        if grid.degC.size > 1:
            sd = (
                np.full(grid.coarse.size, LAWFUL * ohm)
                if level is None
                else LEAVES * np.maximum(level[name], 0.05 * ohm)
            )
            each = np.tile(1.0 / sd, grid.degC.size)
            found.append(Penalty(layout[name], each[:, None] * across * each, fixed=1.0))
        found.append(Penalty(layout[name], both, fixed=(1.0 / (10.0 * ohm)) ** 2))
    if shape.tau_3 is not None:
        found.append(Penalty(layout["R_3"], np.eye(1), fixed=(1.0 / ohm) ** 2))
    if shape.g is not None:
        found.append(Penalty(layout["M"], np.eye(1), fixed=(1.0 / 0.1) ** 2))
    for number, start in enumerate(starts):
        at = layout["soc"].start + number
        found.append(Penalty(slice(at, at + 1), np.eye(1), fixed=1.0 / max(start.sd or 1e-6, 1e-6) ** 2))
        at = layout["fade"].start + number
        found.append(Penalty(slice(at, at + 1), np.eye(1), fixed=1.0 / start.fade_sd**2))
    return found
