"""Friction, loss of the gear and inertia by least squares: eqs. 12 and 13.

k i - tau_load = tau_0 sgn(w) + b w + c w |w| + e tau_load + J dw/dt

Which of b, c, e and a torque of constant sign are needed is chosen by the error in blocks left out.
Without a measured current the same equation is scaled: k (V - k w) / R stands for the torque, and only ratios to
k^2 / R are seen.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.optimize import lsq_linear

from jaxmodel.fit.likelihood import autocorrelation_time
from jaxmodel.parameterisation.motor_rows import MotorRows

EXTRA = ("b", "c", "e", "direction")
BLOCKS = 8
GAINED = 0.98  # a further term must lower the error left out to this share
SIGNED = ("direction",)


@dataclasses.dataclass(frozen=True, eq=False)
class Mechanics:
    """Terms of the torque by name with sd, the readings, and what is left.

    Attributes:
        values: `tau_0`, `b`, `c`, `e`, `direction` (a torque of constant sign), `J`, `load` (the free number of the
            load's law).
        sd: of each.
        points: run, time_s, speed_rad_s, torque_Nm (what drives, without load), fit_Nm.
        rms_Nm: left.
        runs: used.
    """

    values: dict[str, float]
    sd: dict[str, float]
    points: pd.DataFrame
    rms_Nm: float
    runs: tuple[str, ...]


def mechanics(runs: Sequence[MotorRows], k: float, R: float | None = None) -> Mechanics | None:
    """Return friction and inertia of the runs with a speed; None where no motor turns.

    Args:
        runs: of one motor.
        k: torque constant [N m/A].
        R: winding resistance [ohm], for runs whose current was not measured.
    """
    parts = []
    for rows in runs:
        if rows.speed_rad_s is None:
            continue
        if rows.current_A is not None:
            drive = k * rows.current_A
        elif rows.voltage_V is not None and R is not None:
            drive = k * (rows.voltage_V - k * rows.speed_rad_s) / R
        else:
            continue
        at = rows.read & rows.moving
        if at.sum() > 2:
            parts.append((rows, at, (drive - rows.load_Nm)[at]))
    if not parts:
        return None
    speed = np.concatenate([rows.speed_rad_s[at] for rows, at, _ in parts if rows.speed_rad_s is not None])
    rate = np.concatenate([rows.rate[at] for rows, at, _ in parts])
    torque = np.concatenate([drive for _, _, drive in parts])
    columns = {"tau_0": np.sign(speed), "b": speed, "c": speed * np.abs(speed), "direction": np.ones(speed.size)}
    columns["e"] = np.concatenate([rows.load_Nm[at] for rows, at, _ in parts])
    # The inertia is the same in every choice; it needs accelerations that are more than noise.
    lawful = all(rows.law is not None for rows, _, _ in parts)
    if lawful:
        columns["load"] = np.concatenate([rows.law[at] for rows, at, _ in parts if rows.law is not None])
    follows = any(rows.follows for rows, _, _ in parts) and np.std(rate) > 0.0
    always = ["tau_0", *(["load"] if lawful else []), *(["J"] if follows else [])]
    columns["J"] = rate
    possible = [name for name in EXTRA if _told_apart(columns, always, name)]
    best, chosen = math.inf, tuple(always)
    for size in range(len(possible) + 1):
        for more in itertools.combinations(possible, size):
            names = (*always, *more)
            score = _left_out(columns, names, torque)
            if score < best * (GAINED if size else 1.0):
                best, chosen = score, names
    values, fitted = _solve(columns, chosen, torque)
    left = torque - fitted
    ends = np.cumsum([0, *(int(at.sum()) for _, at, _ in parts)])
    inflation = autocorrelation_time([left[a:b] for a, b in itertools.pairwise(ends)])
    matrix = np.column_stack([columns[name] for name in chosen])
    variance = float(left @ left) / max(left.size - len(chosen), 1) * inflation
    sd = np.sqrt(np.diag(np.linalg.pinv(matrix.T @ matrix)) * variance)
    tables = [
        pd.DataFrame(
            {
                "run": rows.name,
                "time_s": rows.time_s[at],
                "speed_rad_s": speed[a:b],
                "torque_Nm": torque[a:b],
                "fit_Nm": fitted[a:b],
            }
        )
        for (rows, at, _), (a, b) in zip(parts, itertools.pairwise(ends), strict=True)
    ]
    return Mechanics(
        dict(zip(chosen, map(float, values), strict=True)),
        dict(zip(chosen, map(float, sd), strict=True)),
        pd.concat(tables, ignore_index=True),
        float(np.sqrt(np.mean(left**2))),
        tuple(rows.name for rows, _, _ in parts),
    )


def _told_apart(columns: dict[str, np.ndarray], always: Sequence[str], name: str) -> bool:
    """Return whether a term differs from those that are there by more than rounding."""
    known = np.column_stack([columns[one] for one in always])
    fit = known @ np.linalg.lstsq(known, columns[name], rcond=None)[0]
    left, whole = (float(np.mean(one**2)) for one in (columns[name] - fit, columns[name]))
    return left > 0.02**2 * whole


def _solve(columns: dict[str, np.ndarray], names: Sequence[str], torque: np.ndarray, kept=slice(None)):
    """Return the values, none negative but signed ones, and the fit of all rows."""
    matrix = np.column_stack([columns[name] for name in names])
    size = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-30
    low = [-np.inf if name in SIGNED else 0.0 for name in names]
    found = lsq_linear(matrix[kept] / size, torque[kept], (low, np.inf), method="bvls")
    values = found.x / size
    return values, matrix @ values


def _left_out(columns: dict[str, np.ndarray], names: Sequence[str], torque: np.ndarray) -> float:
    """Return the mean square of blocks of neighbouring rows as the others predict them."""
    block = np.arange(torque.size) * BLOCKS // torque.size
    found = 0.0
    for number in range(BLOCKS):
        out = block == number
        if out.all() or not out.any():
            continue
        _, fit = _solve(columns, names, torque, ~out)
        found += float(np.sum((torque - fit)[out] ** 2))
    return found / torque.size
