"""What the user of a cell has before any diagnosis: an open-circuit curve, one resistance and two RC pairs."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
from scipy.optimize import nnls

from benchmarks.real.writing import SOC, toml_table

RESTING_A = 0.01
SHORT_TAU_S = (5, 10, 15, 20, 30, 45)
LONG_TAU_S = (100, 200, 300, 500, 800, 1200)
MIDDLE_SOC = (0.15, 0.9)  # where an open-circuit curve is nearly straight


def with_charge(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with the charge taken out until each, counted from the current."""
    steps_Ah = np.diff(rows.time_s) * rows.current_A.to_numpy()[1:] / 3600.0
    return rows.assign(discharged_Ah=np.append(0.0, np.cumsum(steps_Ah)))


def middle_of_branches(discharge: pd.DataFrame, charge: pd.DataFrame, capacity_Ah: float) -> np.ndarray:
    """Return the open-circuit voltage at SOC: half way between slow discharge (from full) and slow charge."""
    branches = []
    for rows, first_soc in ((discharge, 1.0), (charge, 0.0)):
        rows = rows[rows.current_A.abs() > RESTING_A]
        soc = first_soc - (rows.discharged_Ah - rows.discharged_Ah.iloc[0]) / capacity_Ah
        rows = rows.assign(soc=soc).sort_values("soc")
        branches.append(np.interp(SOC, rows.soc, rows.voltage_V))
    return np.mean(branches, axis=0)


def rested_points(rows: pd.DataFrame, capacity_Ah: float, least_s: float = 0.0, still_A: float = 0.03) -> pd.DataFrame:
    """Return the rows (with `soc`) just before each load, where the cell has been still for `least_s` or longer."""
    still = rows.current_A.abs() < still_A
    since_s = rows.time_s - rows.time_s.where(~still).ffill().fillna(-np.inf)
    last = rows[still & ~still.shift(-1, fill_value=False) & (since_s >= least_s)]
    return last.assign(soc=1.0 - last.discharged_Ah / capacity_Ah).sort_values("soc")


def rested(rows: pd.DataFrame, capacity_Ah: float) -> np.ndarray:
    """Return the open-circuit voltage at SOC: where a run of pulses has rested longest, just before each load."""
    points = rested_points(rows, capacity_Ah)
    return np.maximum.accumulate(np.interp(SOC, points.soc, points.voltage_V))


def relaxed(time_s: np.ndarray, drive: np.ndarray, tau_s: float) -> np.ndarray:
    """Return the first-order response to a drive that holds from each row to the next."""
    response = np.zeros_like(drive)
    for row, kept in enumerate(np.exp(-np.diff(time_s) / tau_s)):
        response[row + 1] = kept * response[row] + (1.0 - kept) * drive[row]
    return response


def resistances(
    rows: pd.DataFrame, ocv: np.ndarray, capacity_Ah: float, held_before: bool = False
) -> tuple[np.ndarray, tuple[float, float]]:
    """Return R_ints, R_TS, R_TL (ohm) and the two time constants (s) that fit one run best by least squares.

    V_oc - V = R_ints i + R_TS i_TS + R_TL i_TL, with i_TS and i_TL the current through a first-order lag.

    Args:
        rows: the run, from full, with its counted charge.
        ocv: open-circuit voltage at SOC (V).
        capacity_Ah: of the cell.
        held_before: a thinned log keeps the row that ends a long step: its current held before it, not after.
    """
    time_s, current = rows.time_s.to_numpy(), rows.current_A.to_numpy()
    drive = np.append(current[1:], current[-1]) if held_before else current
    soc = 1.0 - (rows.discharged_Ah - rows.discharged_Ah.iloc[0]) / capacity_Ah
    drop = np.interp(soc, SOC, ocv) - rows.voltage_V.to_numpy()
    middle = ((soc > MIDDLE_SOC[0]) & (soc < MIDDLE_SOC[1])).to_numpy()
    lagged = {tau: relaxed(time_s, drive, tau) for tau in (*SHORT_TAU_S, *LONG_TAU_S)}

    def misfit(taus: tuple[float, float]) -> tuple[float, np.ndarray]:
        columns = np.column_stack([current, *(lagged[tau] for tau in taus)])
        found, norm = nnls(columns[middle], drop[middle])
        return norm, found

    taus = min(itertools.product(SHORT_TAU_S, LONG_TAU_S), key=lambda taus: misfit(taus)[0])
    return misfit(taus)[1], taus


def two_pair_cell(
    title: str,
    capacity_Ah: float,
    capacity_sd: float,
    ocv: np.ndarray,
    known: pd.DataFrame,
    sensors: str,
    held_before: bool = False,
) -> str:
    """Return the TOML of a cell of one resistance and two RC pairs, these fitted to one run that its user knows."""
    (R_ints, R_TS, R_TL), (tau_S, tau_L) = resistances(known, ocv, capacity_Ah, held_before)
    ends, ones = np.array([0.0, 1.0]), np.ones(2)
    text = f"""title = "{title}"
kind = "cell"

[parameters]
capacity_Ah = {{ value = {capacity_Ah:.3f}, sd = {capacity_sd} }}
series_resistance_scale = {{ value = 1.0, sd = 0.1 }}
rc_resistance_scale = {{ value = 1.0, sd = 0.2 }}
rc_capacitance_scale = {{ value = 1.0, sd = 0.2 }}
storage_months = 0
cycles = 0
"""
    text += toml_table("ocv", "voltage_V", ocv) + toml_table("R_ints", "ohm", R_ints * ones, ends)
    text += toml_table("R_TS", "ohm", R_TS * ones, ends) + toml_table("C_TS", "farad", tau_S / R_TS * ones, ends)
    text += toml_table("R_TL", "ohm", R_TL * ones, ends) + toml_table("C_TL", "farad", tau_L / R_TL * ones, ends)
    return text + f"\n[sensors]\n{sensors}"
