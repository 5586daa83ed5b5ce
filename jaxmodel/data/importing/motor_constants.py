"""First values of a motor's constants, so that an imported case is that of this motor: V = R i + k w over all rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.charge import Stated
from jaxmodel.data.importing.logs import Log
from jaxmodel.model.parameters import info

# Rows slower than this share of the fastest tell of friction and not of the constant.
_SLOW = 0.2
_MOST_ROWS = 200_000
_SD, _SD_ALONE = 0.1, 0.3


def constants_of(runs: Sequence[Log]) -> dict[str, Stated]:
    """Return k_tau [V s/rad] and R_0 [ohm] of a motor as far as voltage, speed, current and load tell them.

    With voltage V, current i and speed w, least squares of V = R i + k w. Without a current, a load torque T tells it:
    V = (R / k) T + k w; friction is left out. Without both, the median of V / w of the faster rows, which is too large
    by the drop over the winding.
    """
    voltage, speed = (_pooled(runs, name) for name in ("voltage_V", "speed_rad_s"))
    if voltage is None or speed is None:
        return {}
    there = np.isfinite(voltage) & np.isfinite(speed)
    fast = there & (np.abs(speed) > _SLOW * np.nanmax(np.abs(speed), initial=0.0))
    if fast.sum() < 5:
        return {}
    found = _of_rows(runs, voltage, speed, fast)
    largest = (float(np.max(np.abs(voltage[there]))), float(np.max(np.abs(speed[there]))))
    for name, stated in found.items():
        _check(name, stated.value, *largest)
    return found


def _of_rows(runs: Sequence[Log], voltage: np.ndarray, speed: np.ndarray, fast: np.ndarray) -> dict[str, Stated]:
    current, load = _pooled(runs, "current_A"), _pooled(runs, "load_torque_Nm")
    if current is not None and np.isfinite(current[fast]).sum() > 5:
        resistance, constant = slopes(voltage, current, speed)
        if resistance > 0.0 and constant > 0.0:
            return _both(constant, resistance, _SD, "least squares of V = R_0 i + k_tau w over all rows")
    elif load is not None and (loads := load[fast & np.isfinite(load)]).size and np.ptp(loads) > 0.0:
        per_torque, constant = slopes(voltage, load, speed)
        if per_torque > 0.0 and constant > 0.0:
            why = "least squares of V = R_0 T / k_tau + k_tau w over all rows, T the load torque"
            return _both(constant, per_torque * constant, _SD_ALONE, why)
    constant = float(np.median(voltage[fast] / speed[fast]))
    if constant <= 0.0:
        return {}
    return {"k_tau": Stated(constant, _SD_ALONE * constant, "first value: the median of V / w of the faster rows")}


def _check(name: str, value: float, voltage: float, speed: float) -> None:
    range_ = info(name)
    if not range_.lower <= value <= range_.upper:
        unit = "V s/rad" if name == "k_tau" else "ohm"
        raise MeasurementError(
            f"The voltage of at most {voltage:.3g} V and the speed of at most {speed:.3g} rad/s give {name} = "
            f"{value:.2g} {unit}, which no motor has: state the --unit or the --column of one of them."
        )


def slopes(voltage: np.ndarray, carried: np.ndarray, speed: np.ndarray) -> tuple[float, float]:
    """Return a and k of V = a x + k w, x being what the motor carries."""
    rows = np.isfinite(voltage) & np.isfinite(carried) & np.isfinite(speed)
    slopes = np.linalg.lstsq(np.stack([carried[rows], speed[rows]], axis=1), voltage[rows], rcond=None)[0]
    return float(slopes[0]), float(slopes[1])


def _both(constant: float, resistance: float, sd: float, why: str) -> dict[str, Stated]:
    why = f"first value: {why}"
    return {"k_tau": Stated(constant, sd * constant, why), "R_0": Stated(resistance, 3.0 * sd * resistance, why)}


def _pooled(runs: Sequence[Log], name: str) -> np.ndarray | None:
    """Return a column of all runs, NaN for a run without it; None if none has it."""
    if not any(name in run.columns for run in runs):
        return None
    parts = [run.columns.get(name, np.full(run.rows, np.nan)) for run in runs]
    each = max(_MOST_ROWS // len(parts), 1)
    return np.concatenate([part[:: max(part.size // each, 1)] for part in parts])
