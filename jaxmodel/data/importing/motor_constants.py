"""First values of a motor's constants, so that an imported case is that of this motor: V = R i + k w over all rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxmodel.data.importing.charge import Stated
from jaxmodel.data.importing.logs import Log

# Rows slower than this share of the fastest tell of friction and not of the constant.
_SLOW = 0.2
_MOST_ROWS = 200_000
_SD, _SD_ALONE = 0.1, 0.3


def constants_of(runs: Sequence[Log]) -> dict[str, Stated]:
    """Return k_tau [V s/rad] and R_0 [ohm] of a motor as far as voltage, speed and current tell them.

    With voltage V, current i and speed w, least squares of V = R i + k w; without a current, the median of V / w of the
    faster rows, which is too large by the drop over the winding.
    """
    voltage, speed, current = (_pooled(runs, name) for name in ("voltage_V", "speed_rad_s", "current_A"))
    if voltage is None or speed is None:
        return {}
    there = np.isfinite(voltage) & np.isfinite(speed)
    fast = there & (np.abs(speed) > _SLOW * np.nanmax(np.abs(speed), initial=0.0))
    if fast.sum() < 5:
        return {}
    if current is not None and np.isfinite(current[fast]).sum() > 5:
        rows = there & np.isfinite(current)
        design = np.stack([current[rows], speed[rows]], axis=1)
        resistance, constant = np.linalg.lstsq(design, voltage[rows], rcond=None)[0]
        if resistance > 0.0 and constant > 0.0:
            why = "first value: least squares of V = R_0 i + k_tau w over all rows"
            return {
                "k_tau": Stated(float(constant), _SD * float(constant), why),
                "R_0": Stated(float(resistance), 3.0 * _SD * float(resistance), why),
            }
    constant = float(np.median(voltage[fast] / speed[fast]))
    if constant <= 0.0:
        return {}
    return {"k_tau": Stated(constant, _SD_ALONE * constant, "first value: the median of V / w of the faster rows")}


def _pooled(runs: Sequence[Log], name: str) -> np.ndarray | None:
    """Return a column of all runs, NaN for a run without it; None if none has it."""
    if not any(name in run.columns for run in runs):
        return None
    parts = [run.columns.get(name, np.full(run.rows, np.nan)) for run in runs]
    each = max(_MOST_ROWS // len(parts), 1)
    return np.concatenate([part[:: max(part.size // each, 1)] for part in parts])
