"""Where the calibration of a cell's heat starts: one node under the losses of its runs, by linear least squares.

    C_th dT/dt = i (U - V) - hA (T - T_amb)      (the effect `self_heating`)

With tau = C_th / hA the temperature is T_0's decay plus lag(i (U - V), tau) / hA: linear in 1 / hA for each tau.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.parameterisation.linear import lagged
from jaxmodel.parameterisation.rows import Rows

LEAST_RISE_K = 1.5  # range of the temperature by the cell's own heat: below it a run says nothing
# Without single readings that are wrong; the end of a discharge, which warms most, may be a hundredth of a run.
SEEN_PERCENT = (0.1, 99.9)
LONGEST_S = 60.0  # a reading counts as the time it stands for, up to this
OFFSET_K = 0.5  # sd of the error of the ambient temperature of a run
TAUS_S = np.geomspace(60.0, 20_000.0, 49)
# Heat capacity of a cell for each A h, J/K: 18650s of 3 A h 15 to 17, a 26650 of LiFePO4 30, a pouch of 33 A h 30 to
# 40; the limits are assumed.
OF_CAPACITY = (15.0, 60.0)


def thermal_start(
    runs: Sequence[Rows], heat_W: Mapping[str, np.ndarray], capacity_Ah: float
) -> tuple[float, float] | None:
    """Return C_th [J/K] and hA [W/K] of the runs with a thermometer; None where none of them warms by its own heat.

    Args:
        runs: fit runs.
        heat_W: by run, i (U - V) at each row.
        capacity_Ah: for the limits of C_th.
    """
    warm = [
        rows
        for rows in runs
        if rows.warm and np.ptp(np.percentile(rows.degC - rows.ambient_degC, SEEN_PERCENT)) >= LEAST_RISE_K
    ]
    if not warm:
        return None
    # A cell in a room that drifts seems to warm; only what its own heat explains tells of it.
    tau, inverse, rises_K = _least_misfit(warm, heat_W)
    heated = [rows for rows, rise in zip(warm, rises_K, strict=True) if rise >= LEAST_RISE_K]
    if heated and len(heated) < len(warm):
        tau, inverse, _ = _least_misfit(heated, heat_W)
    return bounded(tau / inverse, 1.0 / inverse, capacity_Ah)


def bounded(C_th: float, hA: float, capacity_Ah: float) -> tuple[float, float]:
    """Return a node with a heat capacity that cells have, and its time constant, which readings show best."""
    kept = min(max(C_th, capacity_Ah * OF_CAPACITY[0]), capacity_Ah * OF_CAPACITY[1])
    return kept, hA * kept / C_th


def _least_misfit(runs: Sequence[Rows], heat_W: Mapping[str, np.ndarray]) -> tuple[float, float, list[float]]:
    """Return the time constant of least misfit [s], 1 / hA, and by run the rise that its own heat explains [K]."""
    fits = [(*_fitted(runs, heat_W, float(tau)), float(tau)) for tau in TAUS_S]
    _, inverse, rises_K, tau = min(fits, key=lambda one: one[0])
    return tau, inverse, rises_K


def _fitted(runs: Sequence[Rows], heat_W: Mapping[str, np.ndarray], tau: float) -> tuple[float, float, list[float]]:
    """Return misfit, 1 / hA and rises at one time constant, with an offset of the ambient in each run."""
    blocks, targets, heated = [], [], []
    for number, rows in enumerate(runs):
        share = np.sqrt(np.minimum(np.gradient(rows.time_s), LONGEST_S) / LONGEST_S)
        columns = np.zeros((rows.time_s.size, 1 + len(runs)))
        columns[:, 0] = lagged(rows.time_s, heat_W[rows.name].copy(), tau)
        columns[:, 1 + number] = lagged(rows.time_s, np.ones(rows.time_s.size), tau)
        base = lagged(rows.time_s, rows.ambient_degC.copy(), tau, first=float(rows.degC[0]))
        heated.append(columns[:, 0])
        blocks.append(columns * share[:, None])
        targets.append((rows.degC - base) * share)
    prior = np.hstack([np.zeros((len(runs), 1)), np.eye(len(runs)) / OFFSET_K])
    matrix, target = np.vstack([*blocks, prior]), np.concatenate([*targets, np.zeros(len(runs))])
    values = np.linalg.lstsq(matrix, target, rcond=None)[0]
    values[0] = max(values[0], 1e-3)
    left = target - matrix @ values
    return float(left @ left), float(values[0]), [float(values[0] * np.ptp(one)) for one in heated]
