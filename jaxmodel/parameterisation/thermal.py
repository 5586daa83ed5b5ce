"""Heat capacity and heat transfer of a cell from its heating and cooling, by linear least squares.

    C_th dT/dt = i (U - V) - hA (T - T_amb)      (the effect `self_heating`)

With tau = C_th / hA the temperature is T_0's decay plus lag(i (U - V), tau) / hA: linear in 1 / hA for each tau.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.optimize import fminbound

from jaxmodel.parameterisation.design import soc_of
from jaxmodel.parameterisation.joint import JointFit
from jaxmodel.parameterisation.result import Extraction
from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.smoothing import inflation_of, lagged

LEAST_RISE_K = 1.5  # range of the temperature by the cell's own heat: below it a run says nothing
LONGEST_S = 60.0  # a reading counts as the time it stands for, up to this
OFFSET_K = 0.5  # sd of the error of the ambient temperature of a run
SHARE_SD = 0.05  # one node is not the cell: least relative sd. Assumed.
TAU_S = (60.0, 20_000.0)
# Heat capacity of a cell for each A h, J/K: 18650s of 3 A h 15 to 17, a 26650 of LiFePO4 30, a pouch of 33 A h 30 to
# 40; the limits are assumed.
OF_CAPACITY = (15.0, 60.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Thermal:
    """C_th [J/K] and hA [W/K] of one node, with sd; and the readings with the fit."""

    C_th: float
    hA: float
    C_th_sd: float
    hA_sd: float
    rms_K: float
    points: pd.DataFrame
    runs: tuple[str, ...]


def fit_thermal(runs: Sequence[Rows], fit: JointFit, capacity_Ah: float) -> Thermal | None:
    """Return the thermal node of the runs with a thermometer; None where none of them warms by `LEAST_RISE_K`."""
    parts = []
    for rows in runs:
        if not rows.warm or np.ptp(np.percentile(rows.degC - rows.ambient_degC, [1, 99])) < LEAST_RISE_K:
            continue
        soc = soc_of(rows, fit.starts[rows.name], fit.capacity_Ah)
        open_V = _open_circuit(fit, soc, rows.degC)
        there = rows.read
        voltage = np.interp(rows.time_s, rows.time_s[there], rows.voltage_V[there])
        parts.append((rows, rows.current_A * (open_V - voltage)))
    if not parts:
        return None

    # A cell in a room that drifts seems to warm; only what its own heat explains tells of it.
    tau = _time_constant(parts)
    heated = [one for one, rise in zip(parts, _Lines(parts, tau).rises_K, strict=True) if rise >= LEAST_RISE_K]
    if heated and len(heated) < len(parts):
        parts, tau = heated, _time_constant(heated)
    return bounded(_result(parts, tau), capacity_Ah)


def bounded(found: Thermal, capacity_Ah: float) -> Thermal:
    """Return the node with a heat capacity that cells have, and its time constant; the sd covers what was found."""
    low, high = (capacity_Ah * one for one in OF_CAPACITY)
    C_th = min(max(found.C_th, low), high)
    if C_th == found.C_th:
        return found
    hA = found.hA * C_th / found.C_th
    C_th_sd, hA_sd = math.hypot(found.C_th_sd, C_th - found.C_th), math.hypot(found.hA_sd, hA - found.hA)
    return dataclasses.replace(found, C_th=C_th, hA=hA, C_th_sd=C_th_sd, hA_sd=hA_sd)


def _time_constant(parts) -> float:
    """Return the time constant of least misfit [s]."""
    grid = np.linspace(np.log(TAU_S[0]), np.log(TAU_S[1]), 25)
    best = grid[int(np.argmin([_Lines(parts, float(np.exp(at))).misfit for at in grid]))]
    step = grid[1] - grid[0]
    found = fminbound(lambda at: _Lines(parts, float(np.exp(at))).misfit, best - step, best + step)
    return float(np.exp(np.asarray(found)))


class _Lines:
    """The linear problem at one time constant: 1 / hA, and an offset of the ambient in each run, with a prior.

    Attributes:
        inverse: 1 / hA [K/W], at least a little.
        misfit: weighted squares.
        left: by run, reading minus fit [K].
        heated: by run, lag(heat, tau) [W].
        rises_K: by run, the range of the temperature that this heat explains.
    """

    def __init__(self, parts, tau: float) -> None:
        blocks, targets, self.heated = [], [], []
        for number, (rows, heat) in enumerate(parts):
            share = np.sqrt(np.minimum(np.gradient(rows.time_s), LONGEST_S) / LONGEST_S)
            warmed = lagged(rows.time_s, heat.copy(), tau)
            columns = np.zeros((rows.time_s.size, 1 + len(parts)))
            columns[:, 0] = warmed
            columns[:, 1 + number] = lagged(rows.time_s, np.ones(rows.time_s.size), tau)
            base = lagged(rows.time_s, rows.ambient_degC.copy(), tau, first=float(rows.degC[0]))
            blocks.append(columns * share[:, None])
            targets.append((rows.degC - base) * share)
            self.heated.append(warmed)
        prior = np.hstack([np.zeros((len(parts), 1)), np.eye(len(parts)) / OFFSET_K])
        self.matrix = np.vstack([*blocks, prior])
        target = np.concatenate([*targets, np.zeros(len(parts))])
        self.values = np.linalg.lstsq(self.matrix, target, rcond=None)[0]
        self.values[0] = max(self.values[0], 1e-3)
        weighted = target - self.matrix @ self.values
        self.misfit, self.inverse = float(weighted @ weighted), float(self.values[0])
        self.rises_K = [self.inverse * float(np.ptp(one)) for one in self.heated]
        ends = np.cumsum([0, *(rows.time_s.size for rows, _ in parts)])
        shares = [np.sqrt(np.minimum(np.gradient(rows.time_s), LONGEST_S) / LONGEST_S) for rows, _ in parts]
        self.weighted = [weighted[a:b] for a, b in itertools.pairwise(ends)]
        self.left = [one / share for one, share in zip(self.weighted, shares, strict=True)]


def _result(parts, tau: float) -> Thermal:
    """Return the node with its sd: from the curvature, correlated residuals allowed for, and the spread of runs."""
    lines, step = _Lines(parts, tau), 0.05
    rows_of_all = sum(one.size for one in lines.left)
    above, below = (_Lines(parts, tau * math.exp(sign * step)) for sign in (1.0, -1.0))
    rate = (above.matrix @ lines.values - below.matrix @ lines.values)[:rows_of_all] / (2.0 * step)
    # The decay of the start moves with tau too; it is in the targets.
    moved = [
        b - a for a, b in zip(_bases(parts, tau * math.exp(-step)), _bases(parts, tau * math.exp(step)), strict=True)
    ]
    rate += np.concatenate(moved) / (2.0 * step)
    jacobian = np.column_stack([lines.matrix[:rows_of_all], rate])
    penalty = np.diag([0.0, *[1.0 / OFFSET_K**2] * len(parts), 0.0])
    variance = lines.misfit / rows_of_all * inflation_of(lines.weighted)
    covariance = np.linalg.pinv(jacobian.T @ jacobian / variance + penalty)
    hA, C_th = 1.0 / lines.inverse, tau / lines.inverse
    of_inverse = covariance[0, 0] / lines.inverse**2
    of_both = of_inverse + covariance[-1, -1] - 2.0 * covariance[0, -1] / lines.inverse
    rms = float(np.sqrt(np.mean(np.concatenate(lines.left) ** 2)))
    tables = [
        pd.DataFrame({"run": rows.name, "time_s": rows.time_s, "degC": rows.degC, "fit_degC": rows.degC - one})
        for (rows, _), one in zip(parts, lines.left, strict=True)
    ]
    runs = tuple(rows.name for rows, _ in parts)
    sd = C_th * math.sqrt(max(of_both, 0.0) + SHARE_SD**2), hA * math.sqrt(of_inverse + SHARE_SD**2)
    return Thermal(C_th, hA, *sd, rms, pd.concat(tables, ignore_index=True), runs)


def _bases(parts, tau: float) -> list[np.ndarray]:
    found = []
    for rows, _ in parts:
        share = np.sqrt(np.minimum(np.gradient(rows.time_s), LONGEST_S) / LONGEST_S)
        found.append(lagged(rows.time_s, rows.ambient_degC.copy(), tau, first=float(rows.degC[0])) * share)
    return found


def _open_circuit(fit: JointFit, soc: np.ndarray, degC: np.ndarray) -> np.ndarray:
    """Return U at each row, by temperature between the points of the table."""
    levels = fit.grid.degC
    if levels.size == 1:
        return fit.curve("U", soc, float(levels[0]))
    each = np.column_stack([fit.curve("U", soc, float(T)) for T in levels])
    at = np.clip(degC, levels[0], levels[-1])
    left = np.clip(np.searchsorted(levels, at, side="right") - 1, 0, levels.size - 2)
    share = (at - levels[left]) / np.diff(levels)[left]
    rows = np.arange(soc.size)
    return (1.0 - share) * each[rows, left] + share * each[rows, left + 1]


def thermal_extractions(found: Thermal) -> list[Extraction]:
    """Return C_th and hA as extractions."""
    method, samples = (
        "heating and cooling of one node under i (V_oc - V)",
        f"all readings of the thermometer, {found.rms_K:.2g} K left",
    )
    return [
        Extraction("C_th", found.C_th, found.C_th_sd, "J/K", found.runs, samples, method),
        Extraction("hA", found.hA, found.hA_sd, "W/K", found.runs, samples, method),
    ]
