"""Input profiles of bench and drive tests: blocks of constant load with rests, from a seed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.independent.effects import Columns


class Pattern(NamedTuple):
    """How long loads last, and the rests between them, in seconds (shortest, longest)."""

    load_s: tuple[float, float]
    rest_s: tuple[float, float] | None


PATTERNS = {
    "constant load": Pattern((np.inf, np.inf), None),
    "load steps": Pattern((100.0, 300.0), None),
    "varying load": Pattern((6.0, 45.0), None),
    "pulse train": Pattern((10.0, 80.0), (30.0, 60.0)),
    "rests with pulses": Pattern((35.0, 60.0), (120.0, 350.0)),
}


def make_profile(
    kind: str,
    pattern: str,
    seed: int,
    *,
    duration_s: float = 1800.0,
    step_s: float = 1.0,
    time_s: np.ndarray | None = None,
    ambient_degC: float | np.ndarray = 20.0,
    largest_drive: float = 6.0,
    largest_load_Nm: float = 0.2,
    least: float = 0.2,
    reversing: bool = False,
) -> Columns:
    """Return time_s and the inputs of `kind`, each of shape (rows,), at rest for the first half minute.

    Args:
        kind: "cell" (drive is current_A), "motor" (voltage_V) or "robot" (duty).
        pattern: a name of PATTERNS.
        seed: the same seed gives the same profile.
        duration_s: time of the last row.
        step_s: time between rows.
        time_s: the rows' times from 0, in place of those: loads last as long whatever the rows.
        ambient_degC: one temperature, or one per row.
        largest_drive: of blocks, in A, V, or a duty.
        largest_load_Nm: of load torques, against the motion.
        least: blocks and load torques are drawn between this share of the largest and all of it.
        reversing: one block in four charges the cell (at half the current) or runs the motor backwards.
    """
    rng = np.random.default_rng(seed)
    if time_s is None:
        time_s = np.arange(0.0, duration_s + 0.5 * step_s, step_s)
    else:
        duration_s = float(time_s[-1])
    drive, load = np.zeros_like(time_s), np.zeros_like(time_s)
    shape, start = PATTERNS[pattern], min(30.0, 0.1 * duration_s)
    while start < duration_s:
        end = start + rng.uniform(*shape.load_s) if np.isfinite(shape.load_s[0]) else np.inf
        direction = -1.0 if reversing and rng.uniform() < 0.25 else 1.0
        # A row's inputs hold over the interval that ends at it.
        block = (time_s > start) & (time_s <= end)
        gentler = 0.5 if kind == "cell" and direction < 0.0 else 1.0
        drive[block] = largest_drive * rng.uniform(least, 1.0) * direction * gentler
        load[block] = largest_load_Nm * rng.uniform(least, 1.0) * direction
        start = end + (rng.uniform(*shape.rest_s) if shape.rest_s else 0.0)
    name = {"cell": "current_A", "motor": "voltage_V", "robot": "duty"}[kind]
    columns = {"time_s": time_s, name: np.round(drive, 3)}
    if kind != "cell":
        columns["load_torque_Nm"] = np.round(load, 4)
    return columns | {"ambient_degC": np.broadcast_to(np.asarray(ambient_degC, dtype=float), time_s.shape).copy()}
