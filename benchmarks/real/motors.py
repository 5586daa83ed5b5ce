"""Motors that were measured: a gear motor on a brake, and four that turn propellers; steady points, held in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.real.writing import run_entry, write_csv, write_toml

MOTOR_COLUMNS = ("time_s", "voltage_V", "load_torque_Nm", "ambient_degC", "current_A", "speed_rad_s")
HELD_S = 10.0  # how long each steady point is held: many time constants of the motor


def brake_points(folder: Path) -> pd.DataFrame:
    """Return the points of the gear motor on a brake, without the rows that their own README calls wrong."""
    rows = pd.read_csv(folder / "static_load_points.csv")
    mislabelled = rows.applied_voltage_V == 8.0  # they look like 5 V
    unloaded_scale = (rows.torque_Nm < 0.02) & (rows.current_A > 0.2)  # the scale reads nothing at a high current
    return rows[~mislabelled & ~unloaded_scale].assign(
        voltage_V=lambda d: d.applied_voltage_V,
        speed_rad_s=lambda d: d.speed_rpm * np.pi / 30.0,
        load_torque_Nm=lambda d: d.torque_Nm,
        group=lambda d: d.applied_voltage_V,
    )[["group", "voltage_V", "current_A", "speed_rad_s", "load_torque_Nm"]]


def write_held_points(path: Path, points: pd.DataFrame) -> None:
    """Write steady points as a run: each held from its first row on, and read in its last."""
    start_s = HELD_S * np.arange(len(points))
    inputs = points[["voltage_V", "load_torque_Nm"]].assign(ambient_degC=20.0)
    read = inputs.assign(time_s=start_s + HELD_S - 1.0, current_A=points.current_A, speed_rad_s=points.speed_rad_s)
    rows = pd.concat([inputs.assign(time_s=start_s), read])
    write_csv(path, {column: rows[column] for column in MOTOR_COLUMNS})


def gear_motor(source: Path, out: Path) -> None:
    """Write the case of the gear motor: loads from the scale, two voltages kept as check."""
    points = brake_points(source / "gearmotor_prony_brake")
    text = """title = "A 12 V gear motor on a hand-loaded brake"
kind = "motor"

[parameters]
R_0 = { value = 10.9, sd = 0.6 }
k_tau = { value = 0.675, sd = 0.012 }
tau_0 = { value = 0.046, sd = 0.006 }

[sensors]
current_A = 0.01
speed_rad_s = 0.3
"""
    for voltage_V, group in points.groupby("group"):
        name = f"{voltage_V:g}V".replace(".", "p")
        write_held_points(out / f"{name}.csv", group.assign(voltage_V=voltage_V))
        text += run_entry(name, "check" if voltage_V > 10 else "fit", f"{voltage_V:g} V")
    write_toml(out, text)


# What the flight electronics draw, and rows in which the motors still follow a new level of the duty.
ELECTRONICS_A, FOLLOWING, FEWEST = 0.19, 4, 5
SLOW, FAST = 0.5, 0.8  # duties between which the sweep is parted


def propellers(source: Path, out: Path) -> None:
    """Write the case of a drone's motors, whose propellers nobody modelled: the fastest, and the way down, are check.

    Four motors share a current; each is given a quarter of it, the mean speed, and the duty's share of the voltage.
    """
    rows = pd.read_csv(source / "crazyflie21_brushed" / "thrust_stand_cf21_stock_prop.csv")
    level = (rows.pwm != rows.pwm.shift()).cumsum()
    speeds = rows[[f"motor{number}_speed_rpm" for number in range(1, 5)]]
    rows = rows.assign(
        voltage_V=rows.pwm * rows.deck_voltage_V,
        current_A=(rows.current_A - ELECTRONICS_A) / 4.0,
        speed_rad_s=speeds.mean(axis=1) * np.pi / 30.0,
    )[rows.groupby(level).cumcount() >= FOLLOWING]
    groups = rows.groupby(level)
    points = groups[["pwm", "voltage_V", "current_A", "speed_rad_s"]].mean()[groups.size() >= FEWEST]
    points = points[points.pwm > 0.15].assign(load_torque_Nm=0.0)
    fastest = points.pwm.idxmax()
    up, down = points.loc[:fastest], points.loc[fastest:]
    text = """title = "Crazyflie 2.1, four motors with propellers on a thrust stand"
kind = "motor"

[parameters]
R_0 = { value = 0.8, sd = 0.3 }
k_tau = { value = 0.001, sd = 0.0002 }
tau_0 = { value = 1e-4, sd = 5e-5 }
J = 2e-7

[sensors]
current_A = 0.02
speed_rad_s = 5.0
"""
    for name, split, some in (
        ("up_slow", "fit", up[up.pwm < SLOW]),
        ("up_middle", "fit", up[up.pwm.between(SLOW, FAST)]),
        ("up_fast", "check", up[up.pwm > FAST]),
        ("down", "check", down[down.pwm < FAST]),
    ):
        write_held_points(out / f"{name}.csv", some)
        text += run_entry(name, split, f"duty {some.pwm.min():.2f} to {some.pwm.max():.2f}, {name.split('_')[0]}")
    write_toml(out, text)
