"""Faults as they change a measured run: each takes the rows of a CSV and a size, and returns the rows with the fault.

Columns and signs are those of a cell's case: current positive on discharge, temperatures in degC.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

CURRENT, VOLTAGE, THERMOMETER = "current_A", "voltage_V", "cell_temperature_degC"
# What a lagging thermometer is given follows the reading without its noise: the mean over this share of its time
# constant. Assumed.
SMOOTHED = 1.0 / 3.0
# Above this share of the run's largest current the cell is loaded, as in the preparation of a fit.
LOADED = 0.03
# Digits to which a column is written at most, and a voltage or a current at least: a set point may be a round number.
MOST_DIGITS, LEAST_DIGITS = 6, 4


def offset(rows: pd.DataFrame, kelvin: float) -> pd.DataFrame:
    """Return a run whose thermometer reads so many kelvin too much."""
    return rows.assign(**{THERMOMETER: (rows[THERMOMETER] + kelvin).round(digits(rows[THERMOMETER]))})


def lag(rows: pd.DataFrame, tau_s: float) -> pd.DataFrame:
    """Return a run whose thermometer follows late, tau dT_read/dt = T - T_read, and begins at its first reading.

    The sensor's noise and rounding stay as they are, because they arise behind the lag: what is lagged is the reading
    without its noise, the mean over a third of tau.
    """
    times = pd.to_timedelta(rows.time_s, unit="s")
    smooth = rows[THERMOMETER].set_axis(times).rolling(f"{SMOOTHED * tau_s:g}s", center=True).mean().to_numpy()
    read = first_order(rows.time_s.to_numpy(), smooth, tau_s)
    return rows.assign(**{THERMOMETER: (rows[THERMOMETER] + read - smooth).round(digits(rows[THERMOMETER]))})


def first_order(time_s: np.ndarray, values: np.ndarray, tau_s: float) -> np.ndarray:
    """Return values (rows,), straight between rows, behind a first-order lag that begins at the first; exact."""
    found = values.copy()
    for row, step in enumerate(np.diff(time_s), start=1):
        kept, slope = np.exp(-step / tau_s), (values[row] - values[row - 1]) / step
        found[row] = values[row] - slope * tau_s + (found[row - 1] - values[row - 1] + slope * tau_s) * kept
    return found


def contact(rows: pd.DataFrame, ohm: float) -> pd.DataFrame:
    """Return a run whose voltage was measured behind a contact of so many ohm: V - i R."""
    return rows.assign(**{VOLTAGE: (rows[VOLTAGE] - ohm * rows[CURRENT]).round(digits(rows[VOLTAGE], LEAST_DIGITS))})


def stuck(rows: pd.DataFrame, share: float) -> pd.DataFrame:
    """Return a run whose thermometer repeats one reading from where this share of the loaded time has passed."""
    first = stuck_row(rows, share)
    values = rows[THERMOMETER].to_numpy(copy=True)
    values[first:] = values[first]
    return rows.assign(**{THERMOMETER: values})


def stuck_row(rows: pd.DataFrame, share: float) -> int:
    """Return the row at which this share of the time under load has passed."""
    current = rows[CURRENT].abs().to_numpy()
    loaded_s = np.cumsum(np.diff(rows.time_s, prepend=rows.time_s.iloc[0]) * (current > LOADED * current.max()))
    return int(np.searchsorted(loaded_s, share * loaded_s[-1]))


def late_voltage(rows: pd.DataFrame, delay_s: float) -> pd.DataFrame:
    """Return a run whose voltage comes so many seconds late against all else, held before its first row.

    Between two rows it is straight, as a logger's export by interpolation makes it.
    """
    late = np.interp(rows.time_s - delay_s, rows.time_s, rows[VOLTAGE])
    return rows.assign(**{VOLTAGE: late.round(digits(rows[VOLTAGE], LEAST_DIGITS))})


def high_current(rows: pd.DataFrame, share: float) -> pd.DataFrame:
    """Return a run whose current sensor reads this share too much."""
    return rows.assign(**{CURRENT: (rows[CURRENT] * (1.0 + share)).round(digits(rows[CURRENT], LEAST_DIGITS))})


def digits(values: pd.Series, least: int = 0) -> int:
    """Return the digits behind the point that a column is written with, at least and at most so many."""
    choices = range(least, MOST_DIGITS)
    return next((n for n in choices if np.allclose(values, values.round(n), rtol=0.0, atol=1e-9)), MOST_DIGITS)
