"""Winding resistance and torque constant: V = R_0 (1 + psi_R (T_w - T_0)) i + k w by least squares.

This is eq. 11 at rest of the current; without a thermometer in the winding, T_w is T_0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import statsmodels.api as sm

from jaxmodel.fit.likelihood import autocorrelation_time
from jaxmodel.parameterisation.motor_rows import MotorRows
from jaxmodel.parameterisation.result import Extraction

LOCKED = "A locked rotor, or a heavy load, would give R; a run at no load would give k_tau."


def electrical(runs: Sequence[MotorRows], psi_R: float, T_0: float) -> tuple[list[Extraction], pd.DataFrame]:
    """Return R_0 and k_tau, where voltage, current and speed were measured, and the readings with the fit.

    Robust least squares (Huber) over all rows; sd by the number of independent readings.

    Args:
        runs: of one motor.
        psi_R: temperature coefficient of the winding [1/K].
        T_0: its reference temperature [degC].

    Returns:
        Extractions (none where a column is missing everywhere), and run, time_s, current_A, speed_rad_s, voltage_V,
        fit_V.
    """
    used = [rows for rows in runs if rows.voltage_V is not None and rows.current_A is not None]
    used = [rows for rows in used if rows.speed_rad_s is not None and rows.read.sum() > 2]
    if not used:
        return [], pd.DataFrame()
    tables = []
    for rows in used:
        at = rows.read
        current_A, speed_rad_s, voltage_V = map(np.asarray, (rows.current_A, rows.speed_rad_s, rows.voltage_V))
        columns = {"time_s": rows.time_s, "current_A": current_A, "speed_rad_s": speed_rad_s, "voltage_V": voltage_V}
        columns["warm_current_A"] = current_A * (1.0 + psi_R * (rows.hot_degC(T_0) - T_0))
        tables.append(pd.DataFrame({"run": rows.name, **{name: one[at] for name, one in columns.items()}}))
    table = pd.concat(tables, ignore_index=True)
    matrix = table[["warm_current_A", "speed_rad_s"]].to_numpy()
    both = (
        np.all(np.ptp(matrix, axis=0) > 1e-9)
        or np.linalg.matrix_rank(matrix / (np.abs(matrix).max(axis=0) + 1e-30)) == 2
    )
    fit = sm.RLM(table["voltage_V"].to_numpy(), matrix, M=sm.robust.norms.HuberT()).fit()
    left = table["voltage_V"].to_numpy() - matrix @ fit.params
    lost = [left[(table["run"] == rows.name).to_numpy()] for rows in used]
    sd = np.asarray(fit.bse) * math.sqrt(autocorrelation_time(lost))
    table["fit_V"] = matrix @ fit.params
    names, samples = tuple(rows.name for rows in used), f"{len(table)} rows, {np.sqrt(np.mean(left**2)):.2g} V left"
    R, k = (float(value) for value in fit.params)
    found = []
    if both and R > 0.0 and R > sd[0]:
        found.append(Extraction("R_0", R, float(sd[0]), "ohm", names, samples, "V = R i + k w by robust least squares"))
    if both and k > 0.0 and k > sd[1]:
        found.append(
            Extraction("k_tau", k, float(sd[1]), "N m/A", names, samples, "V = R i + k w by robust least squares")
        )
    return found, table
