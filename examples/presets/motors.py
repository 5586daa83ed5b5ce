"""The parameters of a geared brushed motor, seen at its output shaft, from steady points of voltage, current and speed.

V = R i + k w and k i = tau_0 + (1 + e) load (eqs. 11 to 13 at rest of all rates, with the gear's loss e): both linear.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd

RPM = 2.0 * np.pi / 60.0
LIFT_V = 7.15
STEADY_DEG = (40.0, 120.0)  # of the 153 degrees of a lift: past the start, before the controller slows down
STARTED_A = 1.0  # the current of a start is about 3 A, that at rest 0.1 A


@dataclasses.dataclass(frozen=True)
class Estimates:
    """Values and sd by parameter; `e` is that of the effect `gear_loss`."""

    value: dict[str, float]
    sd: dict[str, float]


def brake_points(folder: Path) -> pd.DataFrame:
    """Return the points of the gear motor on a brake, without the rows that their own README calls wrong."""
    rows = pd.read_csv(folder / "static_load_points.csv")
    mislabelled = rows.applied_voltage_V == 8.0  # they look like 5 V
    unloaded_scale = (rows.torque_Nm < 0.02) & (rows.current_A > 0.2)  # the scale reads nothing at a high current
    return rows[~mislabelled & ~unloaded_scale].assign(
        voltage_V=lambda d: d.applied_voltage_V,
        speed_rad_s=lambda d: d.speed_rpm * RPM,
        load_torque_Nm=lambda d: d.torque_Nm,
        group=lambda d: d.applied_voltage_V,
    )[["group", "voltage_V", "current_A", "speed_rad_s", "load_torque_Nm"]]


def lift_points(folder: Path) -> pd.DataFrame:
    """Return one steady point for each lift of the servo, and how long its start lagged behind its current."""
    points = []
    for entry in pd.read_csv(folder / "runs.csv").itertuples():
        rows = pd.read_csv(folder / str(entry.file))
        for _, lift in rows[rows.direction == "lift"].groupby("run"):
            steady = lift[lift.angle_deg.between(*STEADY_DEG)]
            if len(steady) < 20:  # the heaviest mass was not lifted every time
                continue
            speed, offset = np.polyfit(steady.time_s, np.radians(steady.angle_deg), 1)
            on_s = lift.time_s[lift.current_A > STARTED_A].iloc[0]
            # A first-order start lags behind a line through the origin by its time constant.
            lag_s = -(offset - np.radians(lift.angle_deg.iloc[0])) / speed - on_s
            points.append((entry.mass_g / 1e3, LIFT_V, steady.current_A.mean(), speed, entry.load_torque_Nm, lag_s))
    return pd.DataFrame(points, columns=["group", "voltage_V", "current_A", "speed_rad_s", "load_torque_Nm", "lag_s"])


def identify(points: pd.DataFrame) -> dict[str, float]:
    """Return R_0 (ohm), k_tau (N m/A), tau_0 (N m), e, and where a start was seen J (kg m2)."""
    electrical = points[["current_A", "speed_rad_s"]].to_numpy()
    R, k = np.linalg.lstsq(electrical, points.voltage_V.to_numpy(), rcond=None)[0]
    load = np.column_stack([np.ones(len(points)), points.load_torque_Nm])
    tau_0, gain = np.linalg.lstsq(load, k * points.current_A.to_numpy(), rcond=None)[0]
    found = {"R_0": R, "k_tau": k, "tau_0": tau_0, "e": gain - 1.0}
    if "lag_s" in points:
        # J R / k^2 is the time constant. What the hanging mass adds is left free: it is 2.6 times its m r^2.
        found["J"] = np.polyfit(points.group, points.lag_s * k**2 / R, 1)[1]
    return {name: float(value) for name, value in found.items()}


def estimate(points: pd.DataFrame) -> Estimates:
    """Return the parameters with the sd from leaving out one load (or voltage) at a time."""
    groups = points.group.unique()
    others = pd.DataFrame([identify(points[points.group != group]) for group in groups])
    spread = np.sqrt((len(groups) - 1) * others.var(ddof=0))
    return Estimates(identify(points), {str(name): float(value) for name, value in spread.items()})
