"""Made cells and motors of known truth."""

from __future__ import annotations

import numpy as np
import pandas as pd

from jaxmodel import Case, simulate_case

CAPACITY_AH, R_0, R_S, R_L, TAU_S, TAU_L = 2.0, 0.030, 0.010, 0.015, 6.0, 150.0
ENERGY = 20e3  # J/mol of all resistances
NOISE_V = 0.0005
STEP_S, LONG_STEP_S = 2.0, 10.0
SOC = np.linspace(0.0, 1.0, 41)


def open_V(soc: np.ndarray) -> np.ndarray:
    return 3.3 + 0.8 * soc - 0.25 * np.exp(-15.0 * soc)


def cell_tables() -> dict:
    flat, ends = [1.0, 1.0], [0.0, 1.0]
    tables = {"ocv": {"soc": SOC.tolist(), "voltage_V": open_V(SOC).tolist()}}
    for name, ohm in (("R_ints", R_0), ("R_TS", R_S), ("R_TL", R_L)):
        tables[name] = {"soc": ends, "ohm": [ohm * one for one in flat]}
    for name, ohm, tau in (("C_TS", R_S, TAU_S), ("C_TL", R_L, TAU_L)):
        tables[name] = {"soc": ends, "farad": [tau / ohm * one for one in flat]}
    return tables


def pulses(ambient_degC: float) -> pd.DataFrame:
    """Four times: a pulse of 10 s, a rest, a pulse back, a discharge of a fifth of the capacity, a long rest.

    As a cycler logs them: rows every 2 s, and every 10 s in what is long.
    """
    blocks = [(60.0, 0.0, STEP_S)]
    for _ in range(4):
        blocks += [(10.0, 4.0, STEP_S), (60.0, 0.0, STEP_S), (10.0, -2.0, STEP_S), (60.0, 0.0, STEP_S)]
        blocks += [(40.0, 2.0, STEP_S), (700.0, 2.0, LONG_STEP_S), (40.0, 0.0, STEP_S), (580.0, 0.0, LONG_STEP_S)]
    steps = np.concatenate([np.full(int(seconds / step), step) for seconds, _, step in blocks])
    current = np.concatenate([np.full(int(seconds / step), ampere) for seconds, ampere, step in blocks])
    return _frame(np.append(0.0, np.cumsum(steps)[:-1]), current, ambient_degC)


def slow(sign: float, ambient_degC: float = 25.0) -> pd.DataFrame:
    time = np.arange(0.0, 20.0 * 3600.0, 120.0)
    current = np.where(time > 0.0, sign * 0.1, 0.0)
    return _frame(time, current, ambient_degC)


def drive(ambient_degC: float) -> pd.DataFrame:
    rng = np.random.default_rng(5)
    current = np.repeat(rng.uniform(-2.0, 5.0, 150), 10)
    return _frame(np.arange(current.size, dtype=float), current, ambient_degC)


def _frame(time: np.ndarray, current: np.ndarray, ambient_degC: float) -> pd.DataFrame:
    return pd.DataFrame({"time_s": time, "current_A": current, "ambient_degC": ambient_degC})


def measured(frames: dict, thermometer: bool = False, effects: dict | None = None, starts: dict | None = None) -> dict:
    """Return the frames with the readings of the true cell."""
    parameters = {"capacity_Ah": CAPACITY_AH, "cycles": 0, "storage_months": 0}
    runs = {name: {"initial_soc": (starts or {}).get(name, 1.0)} for name in frames}
    truth = Case.from_dataframes(
        frames, kind="cell", parameters=parameters, tables=cell_tables(), effects=effects or {}, runs=runs
    )
    rng, found = np.random.default_rng(1), {}
    for one in simulate_case(truth):
        table = frames[one.run.name].copy()
        table["voltage_V"] = one.table["voltage_V"] + NOISE_V * rng.standard_normal(len(table))
        if thermometer:
            read = one.table["cell_temperature_degC"] + 0.02 * rng.standard_normal(len(table))
            table["cell_temperature_degC"] = read
        found[one.run.name] = table
    return found


def raw_cell(frames: dict, check=(), starts: dict | None = None) -> Case:
    """Return a case that has only runs, kind and a nominal capacity."""
    runs = {name: {"initial_soc": ((starts or {}).get(name, 1.0), 0.01)} for name in frames}
    parameters = {"capacity_Ah": (2.1, 0.2), "cycles": 0, "storage_months": 0}
    return Case.from_dataframes(frames, kind="cell", name="made", check=check, runs=runs, parameters=parameters)


MOTOR = {"R_0": 0.3, "k_tau": 0.05, "J": 1e-4, "tau_0": 0.02}
VISCOUS = 5e-5


def motor_frame() -> pd.DataFrame:
    """Steps of the voltage either way, with and without load."""
    time = np.arange(0.0, 16.0, 0.02)
    volts = np.where((time % 4.0) < 2.0, 12.0, 6.0) * np.where(time > 8.0, -1.0, 1.0)
    load = np.where((time % 8.0) < 4.0, 0.02, 0.0)
    return pd.DataFrame({"time_s": time, "voltage_V": volts, "load_torque_Nm": load, "ambient_degC": 25.0})


def measured_motor(columns=("current_A", "speed_rad_s"), load: float | None = None, **other: float) -> pd.DataFrame:
    frame = motor_frame() if load is None else motor_frame().assign(load_torque_Nm=load)
    truth = Case.from_dataframes(
        {"steps": frame}, kind="motor", parameters=MOTOR | other, effects={"viscous_friction": {"b": VISCOUS}}
    )
    table, rng = simulate_case(truth)[0].table, np.random.default_rng(2)
    for column, sd in (("current_A", 0.02), ("speed_rad_s", 0.2)):
        if column in columns:
            frame[column] = table[column] + sd * rng.standard_normal(len(frame))
    return frame
