"""Heat capacity and heat transfer of a cell from its heating and cooling, by linear least squares.

    C_th dT/dt = i (U - V) - hA (T - T_amb)      (the effect `self_heating`)

With tau = C_th / hA the temperature is T_0's decay plus lag(i (U - V), tau) / hA: linear in 1 / hA for each tau.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from parameterisation.joint import JointFit
from parameterisation.result import Extraction
from parameterisation.rows import Rows
from parameterisation.design import soc_of
from parameterisation.smoothing import inflation_of, lagged

LEAST_RISE_K = 1.0  # of a cell above its surroundings: below it the data say nothing
TAU_S = (60.0, 20_000.0)


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


def fit_thermal(runs: Sequence[Rows], fit: JointFit) -> Thermal | None:
    """Return the thermal node of the runs with a thermometer; None where none of them warms by `LEAST_RISE_K`."""
    parts = []
    for rows in runs:
        if not rows.warm or np.max(np.abs(rows.degC - rows.ambient_degC)) < LEAST_RISE_K:
            continue
        soc = soc_of(rows, fit.starts[rows.name], fit.capacity_Ah)
        open_V = _open_circuit(fit, soc, rows.degC)
        there = rows.read
        voltage = np.interp(rows.time_s, rows.time_s[there], rows.voltage_V[there])
        parts.append((rows, rows.current_A * (open_V - voltage)))
    if not parts:
        return None

    def columns(tau: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        found = []
        for rows, heat in parts:
            base = lagged(rows.time_s, rows.ambient_degC.copy(), tau, first=float(rows.degC[0]))
            share = np.sqrt(np.minimum(np.gradient(rows.time_s), 60.0))
            found.append((lagged(rows.time_s, heat.copy(), tau), rows.degC - base, share))
        return found

    def solved(log_tau: float) -> tuple[float, float]:
        every = columns(float(np.exp(log_tau)))
        over = sum(float((w * x) @ (w * y)) for x, y, w in every)
        under = sum(float((w * x) @ (w * x)) for x, _, w in every)
        inverse = max(over / under, 1e-6) if under > 0.0 else 1e-6
        return inverse, sum(float(np.sum((w * (y - inverse * x)) ** 2)) for x, y, w in every)

    grid = np.linspace(*np.log(TAU_S), 25)
    best = grid[int(np.argmin([solved(at)[1] for at in grid]))]
    step = grid[1] - grid[0]
    found = minimize_scalar(lambda at: solved(at)[1], bounds=(best - step, best + step), method="bounded")
    tau = float(np.exp(found.x))
    inverse, _ = solved(float(found.x))
    return _result(parts, columns, tau, inverse)


def _result(parts, columns, tau: float, inverse: float) -> Thermal:
    every = columns(tau)
    left = [y - inverse * x for x, y, _ in every]
    rms = float(np.sqrt(np.mean(np.concatenate(left) ** 2)))
    slopes = [(a[0] * inverse - a[1] - (b[0] * inverse - b[1])) / 0.1 for a, b in zip(columns(tau * math.exp(0.05)), columns(tau * math.exp(-0.05)), strict=True)]
    jacobian = np.concatenate([np.column_stack([x * inverse, s]) for (x, _, _), s in zip(every, slopes, strict=True)])
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * rms**2 * inflation_of(left)  # of log(1 / hA), log(tau)
    hA, C_th = 1.0 / inverse, tau / inverse
    tables = [
        pd.DataFrame({"run": rows.name, "time_s": rows.time_s, "degC": rows.degC, "fit_degC": rows.degC - one})
        for (rows, _), one in zip(parts, left, strict=True)
    ]
    hA_sd = hA * math.sqrt(covariance[0, 0])
    C_th_sd = C_th * math.sqrt(max(covariance[0, 0] + covariance[1, 1] - 2.0 * covariance[0, 1], 0.0))
    # Runs differ by more than one fit shows: the spread of hA between runs is part of its sd.
    single = [float(x @ y) / float(x @ x) for x, y, _ in every if float(x @ x) > 0.0]
    spread = float(np.std(single)) / inverse if len(single) > 1 else 0.05
    hA_sd, C_th_sd = math.hypot(hA_sd, hA * spread), math.hypot(C_th_sd, C_th * spread)
    runs = tuple(rows.name for rows, _ in parts)
    return Thermal(C_th, hA, C_th_sd, hA_sd, rms, pd.concat(tables, ignore_index=True), runs)


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
    method, samples = "heating and cooling of one node under i (V_oc - V)", f"all readings of the thermometer, {found.rms_K:.2g} K left"
    return [
        Extraction("C_th", found.C_th, found.C_th_sd, "J/K", found.runs, samples, method),
        Extraction("hA", found.hA, found.hA_sd, "W/K", found.runs, samples, method),
    ]
