"""Where the calibration of a cell starts: its curves by one linear least-squares fit, for assumed energies.

    V = U(SOC) - i R_0 - lag(i R_S, tau_S) - lag(i R_L, tau_L) - M h
    R_x = r_x(SOC) exp(E_x / 8.314 (1/T_K - 1/293.15))

U and r are linear between knots; a lag is an RC pair of constant time constant; h is the state of `ocv_hysteresis`. Of
some pairs of time constants that with the least error is taken. Everything here is fitted again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from jaxmodel.effects.curves import FINE, MEDIUM
from jaxmodel.model.cell import GAS_CONSTANT, REFERENCE_DEGC, ZERO_DEGC_IN_K
from jaxmodel.parameterisation.linear import hats, lagged
from jaxmodel.parameterisation.rows import Rows

RESISTANCES = ("R_0", "R_S", "R_L")
TAUS_S = ((2.0, 50.0), (4.0, 120.0), (10.0, 300.0), (10.0, 1000.0), (30.0, 1000.0))  # of seconds and minutes. Assumed.
STEPS, ENOUGH = (1.6, 1.25), 0.99  # of a time constant, while the misfit falls to such a share
APART = 4.0  # least ratio of the time constants
PACE = 40.0  # of the hysteresis, the usual one of its effect
MOST_ROWS = 12_000  # of all runs together
EDGE_ROWS, STEP_SHARE = 3, 0.1  # rows kept after each step of the current, by this share of the largest current
LONGEST_S = 10.0  # a reading counts as the root of the time it stands for, up to this
# How far curves may bend, beside readings that count as so many of such an sd: all assumed.
READINGS, VOLT = 1000.0, 0.01
OCV_V = 0.01  # second difference of U from knot to knot
LEAST_SOC = 0.05  # least range of the curves
SHARE = 0.03  # of the typical resistance, its difference from knot to knot
LEAST = 0.3  # of the mean of a resistance: factors on nothing would leave nothing
FAINT = 100.0  # typical resistances: hardly acts


@dataclasses.dataclass(frozen=True, eq=False)
class LinearStart:
    """The curves of a cell, roughly.

    Attributes:
        soc: knots of U.
        ocv_V: U there.
        coarse: knots of the resistances.
        ohm: r at 20 degC by name of the resistance, at those knots.
        tau_s: of both pairs.
        M_V: half width of the hysteresis.
        rms_V: of what is left, of readings that count by the time they stand for.
    """

    soc: np.ndarray
    ocv_V: np.ndarray
    coarse: np.ndarray
    ohm: dict[str, np.ndarray]
    tau_s: tuple[float, float]
    M_V: float
    rms_V: float


def linear_start(
    runs: Sequence[Rows],
    soc: Mapping[str, np.ndarray],
    h: Mapping[str, np.ndarray] | None,
    energies: Mapping[str, float],
    ohm: float,
    taus_s: Sequence[tuple[float, float]] = (),
) -> LinearStart:
    """Return curves with which a calibration may start.

    Args:
        runs: fit runs.
        soc: by run, the counted state of charge at each row.
        h: by run, the state of the hysteresis; None without.
        energies: activation energy of each resistance [J/mol].
        ohm: typical resistance of the cell.
        taus_s: more pairs of time constants that are tried.
    """
    low = min(max(min(float(one.min()) for one in soc.values()), 0.0), 1.0 - LEAST_SOC)
    high = min(max(max(float(one.max()) for one in soc.values()), low + LEAST_SOC), 1.0)
    fine, coarse = (low + (high - low) * np.array(shares) for shares in (FINE, MEDIUM))
    total = sum(int(rows.read.sum()) for rows in runs)
    kept = {rows.name: _rows_kept(rows, max(200, MOST_ROWS * int(rows.read.sum()) // total)) for rows in runs}
    columns = {rows.name: hats(soc[rows.name], coarse) * rows.current_A[:, None] for rows in runs}

    def block(rows: Rows, name: str, tau_s: float = 0.0) -> np.ndarray:
        colder = 1.0 / (rows.degC + ZERO_DEGC_IN_K) - 1.0 / (REFERENCE_DEGC + ZERO_DEGC_IN_K)
        drive = columns[rows.name] * np.exp(energies[name] / GAS_CONSTANT * colder)[:, None]
        return -(lagged(rows.time_s, drive, tau_s) if tau_s else drive)[kept[rows.name]]

    fixed, weights = {}, {}
    for rows in runs:
        at = kept[rows.name]
        loop = [] if h is None else [-h[rows.name][at, None]]
        fixed[rows.name] = np.hstack([hats(soc[rows.name][at], fine), *loop, block(rows, "R_0")])
        weights[rows.name] = np.sqrt(np.clip(np.gradient(rows.time_s[at]), 1e-3, LONGEST_S))
    target = np.concatenate([rows.voltage_V[kept[rows.name]] for rows in runs])
    weight = np.concatenate([weights[rows.name] for rows in runs])
    prior = _prior(fine.size, coarse.size, h is not None, ohm)
    known: dict[tuple[str, float], np.ndarray] = {}

    def pair(name: str, tau_s: float) -> np.ndarray:
        if (name, tau_s) not in known:
            known[name, tau_s] = np.vstack([block(rows, name, tau_s) for rows in runs])
        return known[name, tau_s]

    def solved(taus: tuple[float, float]) -> tuple[float, np.ndarray]:
        matrix = np.hstack([np.vstack([*fixed.values()]), pair("R_S", taus[0]), pair("R_L", taus[1])])
        scale = READINGS / (weight.sum() * VOLT**2)
        precision = scale * (matrix.T * weight) @ matrix + prior
        lower = np.linalg.cholesky(precision + 1e-12 * np.diag(np.diag(precision)))
        values = nnls(lower.T, solve_triangular(lower, scale * (matrix.T * weight) @ target, lower=True))[0]
        return float(weight @ (target - matrix @ values) ** 2), values

    misfit, values, taus = min(((*solved(taus), taus) for taus in (*taus_s, *TAUS_S)), key=lambda one: one[0])
    for step in STEPS:
        for factors in ((step, 1.0), (1.0 / step, 1.0), (1.0, step), (1.0, 1.0 / step)):
            while taus[1] * factors[1] >= APART * taus[0] * factors[0]:
                there = (taus[0] * factors[0], taus[1] * factors[1])
                reached, other = solved(there)
                if reached > ENOUGH * misfit:
                    break
                misfit, values, taus = reached, other, there
    parts = np.split(values, np.cumsum([fine.size, int(h is not None), coarse.size, coarse.size]))
    M_V = float(parts[1][0]) if h is not None else 0.0
    found = {
        name: np.maximum(one, LEAST * max(float(one.mean()), 0.1 * ohm))
        for name, one in zip(RESISTANCES, parts[2:], strict=True)
    }
    return LinearStart(fine, parts[0], coarse, found, taus, M_V, float(np.sqrt(misfit / weight.sum())))


def _prior(fine: int, coarse: int, loop: bool, ohm: float) -> np.ndarray:
    """Return the precision of all values: of the bends of U, and of the differences of each resistance."""
    bends, steps = np.diff(np.eye(fine), 2, axis=0), np.diff(np.eye(coarse), axis=0)
    size = fine + int(loop) + len(RESISTANCES) * coarse
    prior = np.zeros((size, size))
    prior[:fine, :fine] = bends.T @ bends / OCV_V**2
    for first in range(size - len(RESISTANCES) * coarse, size, coarse):
        at = slice(first, first + coarse)
        prior[at, at] = steps.T @ steps / (SHARE * ohm) ** 2 + np.eye(coarse) / (FAINT * ohm) ** 2
    return prior


def _rows_kept(rows: Rows, most: int) -> np.ndarray:
    """Return the numbers of the rows to fit: every k-th with a voltage, and the first ones after each current step."""
    there = np.flatnonzero(rows.read)
    if there.size <= most:
        return there
    edges = np.flatnonzero(np.abs(np.diff(rows.current_A)) > STEP_SHARE * float(np.max(np.abs(rows.current_A)))) + 1
    edges = edges[:: max(1, edges.size * EDGE_ROWS * 2 // most)]
    near = np.unique(np.clip(edges[:, None] + np.arange(-1, EDGE_ROWS), 0, rows.time_s.size - 1))
    every = there[:: max(1, there.size // max(most - near.size, most // 2))]
    return np.union1d(every, np.intersect1d(near, there))
