"""Winding resistance and torque constant: V = R_0 (1 + psi_R (T_w - T_0)) i + k w by least squares.

This is eq. 11 at rest of the current; without a thermometer in the winding, T_w is T_0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import statsmodels.api as sm

from jaxmodel.case.known import Known
from jaxmodel.fit.likelihood import autocorrelation_time
from jaxmodel.parameterisation.motor_rows import MotorRows
from jaxmodel.parameterisation.result import Extraction

LOCKED = "A locked rotor, or a heavy load, would give R; a run at no load would give k_tau."


def electrical(
    runs: Sequence[MotorRows], psi_R: float, T_0: float, known: Known | None = None
) -> tuple[list[Extraction], pd.DataFrame]:
    """Return R_0 and k_tau, where voltage, current and speed were measured, and the readings with the fit.

    Robust least squares (Huber) over all rows; sd by the number of independent readings. Where k_tau is known better
    than these rows tell it, R_0 alone is found, with the sd that k_tau gives it too.

    Args:
        runs: of one motor.
        psi_R: temperature coefficient of the winding [1/K].
        T_0: its reference temperature [degC].
        known: k_tau [N m/A] of a data sheet or preset.

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
    values, sd = _robust(table, matrix)
    if known is not None and not (both and 0.0 < sd[1] < (known.sd or 0.0)):
        return _at_a_known_constant(table, matrix, known)
    table["fit_V"] = matrix @ values
    names, samples = _of(table)
    R, k = (float(value) for value in values)
    found = []
    if both and R > 0.0 and R > sd[0]:
        found.append(Extraction("R_0", R, float(sd[0]), "ohm", names, samples, "V = R i + k w by robust least squares"))
    if both and k > 0.0 and k > sd[1]:
        found.append(
            Extraction("k_tau", k, float(sd[1]), "N m/A", names, samples, "V = R i + k w by robust least squares")
        )
    return found, table


def _robust(table: pd.DataFrame, matrix: np.ndarray, beside: float | np.ndarray = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients of the columns of a matrix in the voltage, less what is beside them, and their sd."""
    volts = table["voltage_V"].to_numpy() - beside
    fit = sm.RLM(volts, matrix, M=sm.robust.norms.HuberT()).fit()
    left = volts - matrix @ fit.params
    lost = [left[(table["run"] == name).to_numpy()] for name in table["run"].unique()]
    return np.asarray(fit.params), np.asarray(fit.bse) * math.sqrt(autocorrelation_time(lost))


def _of(table: pd.DataFrame) -> tuple[tuple[str, ...], str]:
    """Return the runs of a fitted table, and how many readings there are with what is left."""
    left = table["voltage_V"] - table["fit_V"]
    return tuple(table["run"].unique()), f"{len(table)} rows, {np.sqrt(np.mean(left**2)):.2g} V left"


def _at_a_known_constant(
    table: pd.DataFrame, matrix: np.ndarray, known: Known
) -> tuple[list[Extraction], pd.DataFrame]:
    """Return R_0 from the voltage less that of the known torque constant, and the readings with the fit."""
    current, back_emf = matrix[:, :1], known.value * matrix[:, 1]
    values, sd = _robust(table, current, back_emf)
    table["fit_V"] = current @ values + back_emf
    names, samples = _of(table)
    per_constant = float(current[:, 0] @ matrix[:, 1]) / float(current[:, 0] @ current[:, 0])
    R, spread = float(values[0]), math.hypot(float(sd[0]), per_constant * (known.sd or 0.0))
    if not R > spread:
        return [], table
    method = "V - k w = R i by robust least squares, k_tau as it is stated"
    return [Extraction("R_0", R, spread, "ohm", names, samples, method)], table
