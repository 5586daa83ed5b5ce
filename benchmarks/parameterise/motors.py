"""Raw cases of motors, and the linear model beside which they are judged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from jaxmodel import Case
from jaxmodel.parameterisation.linear import lagged

RPM, DEGREE = np.pi / 30.0, np.pi / 180.0
FORCE_N_V = 35.15  # of the current amplifier and screw of EMPS
EMPS_STEP = 10  # rows of 1 ms whose mean is one row
PUBLISHED_EMPS = {"J": 95.109, "tau_0": 20.39, "b": 203.5, "offset_N": -3.165}
FIT_SHARE = 0.6


def _halves(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the first part of a log to fit and the rest as check, each with its own clock."""
    cut = int(FIT_SHARE * len(rows))
    parts = {"fit": rows.iloc[:cut], "check": rows.iloc[cut:]}
    return {name: part.assign(time_s=part.time_s - part.time_s.iloc[0]) for name, part in parts.items()}


def emps(source: Path) -> Case:
    """Carriage on a screw as a motor: force is k_tau times drive voltage, mass stands for inertia, m/s for rad/s."""
    rows = pd.read_csv(source / "emps" / "emps_estimation.csv")
    step = float(np.median(np.diff(rows.time_s)))
    speed = np.asarray(savgol_filter(rows.position_m, 61, 3, deriv=1, delta=step))
    count = len(rows) // EMPS_STEP * EMPS_STEP
    mean = rows.drive_voltage_V.to_numpy()[:count].reshape(-1, EMPS_STEP).mean(axis=1)
    at = np.arange(EMPS_STEP - 1, count, EMPS_STEP)
    table = pd.DataFrame({"time_s": rows.time_s.to_numpy()[at], "current_A": mean, "speed_rad_s": speed[at]})
    table = table.assign(load_torque_Nm=0.0, ambient_degC=20.0)
    return Case.from_dataframes(
        _halves(table),
        kind="motor",
        name="emps",
        check=["check"],
        parameters={"k_tau": FORCE_N_V, "tau_0": (20.0, 20.0), "J": (100.0, 50.0)},
    )


def hslu(source: Path) -> Case:
    """Voltage and speed of a laboratory motor. Fit: an open-loop step. Check: a closed-loop one."""
    frames = {}
    for name, file in (("fit", "open_loop_5_15V_brake_off"), ("check", "closed_loop_2000_2500rpm_brake_off_pid1")):
        rows = pd.read_csv(source / "hslu_dcmotor_eddy_brake" / f"{file}.csv")
        frames[name] = pd.DataFrame(
            {"time_s": rows.time_s - rows.time_s.iloc[0], "voltage_V": rows.motor_voltage_V}
        ).assign(speed_rad_s=rows.speed_rpm * RPM, load_torque_Nm=0.0, ambient_degC=20.0)
    return Case.from_dataframes(frames, kind="motor", name="hslu", check=["check"])


def undc(source: Path) -> Case:
    """Commanded voltage and speed of a geared motor on a coarse driver: the first part of a PRBS, and the rest."""
    rows = pd.read_csv(source / "undcmotor" / "prbs_open_loop.csv").drop_duplicates("time_s")
    table = pd.DataFrame({"time_s": rows.time_s, "voltage_V": rows.command_voltage_V})
    table = table.assign(speed_rad_s=rows.speed_deg_s * DEGREE, load_torque_Nm=0.0, ambient_degC=20.0)
    return Case.from_dataframes(_halves(table), kind="motor", name="undc", check=["check"])


MOTORS = {"emps": emps, "hslu": hslu, "undc": undc}


def linear_errors(case: Case) -> dict[str, float]:
    """Return the RMS speed error by run of a linear model: for EMPS the published one, else one fitted here.

    The fitted one is dw/dt = (gain u - w) / tau, by output error on the fit runs.
    """
    driven = "current_A" if case.name == "emps" else "voltage_V"

    def said(run, x: np.ndarray) -> np.ndarray:
        time_s, speed = run.measured.time_s, run.measured.outputs["speed_rad_s"]
        if case.name == "emps":
            return _published(time_s, run.measured.inputs[driven], float(speed[0]))
        return lagged(time_s, x[0] * run.measured.inputs[driven], abs(x[1]) + 1e-4, first=float(speed[0]))

    def left(x: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [run.measured.outputs["speed_rad_s"] - said(run, x) for run in case.runs if run.split == "fit"]
        )

    start = np.array([1.0, 0.1])
    if case.name != "emps":
        first = case.runs[0].measured
        start[0] = np.std(first.outputs["speed_rad_s"]) / np.std(first.inputs[driven])
        start = least_squares(left, start, x_scale=np.abs(start)).x
    return {
        run.name: float(np.sqrt(np.mean((run.measured.outputs["speed_rad_s"] - said(run, start)) ** 2)))
        for run in case.runs
    }


def _published(time_s: np.ndarray, drive: np.ndarray, first: float) -> np.ndarray:
    """Return the carriage's speed by the authors' linear model, integrated in steps of a tenth of a row."""
    found = np.empty(time_s.size)
    found[0] = speed = first
    p = PUBLISHED_EMPS
    for row in range(1, time_s.size):
        step = (time_s[row] - time_s[row - 1]) / 10.0
        for _ in range(10):
            force = FORCE_N_V * drive[row] - p["offset_N"] - p["b"] * speed
            holds = abs(speed) < 1e-4 and abs(force) < p["tau_0"]
            speed = 0.0 if holds else speed + step * (force - p["tau_0"] * np.sign(speed if speed else force)) / p["J"]
        found[row] = speed
    return found
