"""The runs of a motor as arrays, and its two equations."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.signal import savgol_filter

from jaxmodel.case.load import law_torque
from jaxmodel.case.records import Case, Run

FOLLOWED_S = 0.2  # a longer step between rows does not show the acceleration of a small motor
STILL_SHARE = 0.01  # of the largest speed: below it the motor stands
# Longest dead time as a share of the shortest run, how many are tried, and the largest share of the mean square error
# that one leaves. Assumed.
_MOST_DEAD, _MOST_SHIFTS, _FAR_BETTER = 0.5, 100, 0.5
SMOOTHED_ROWS = 9  # of the Savitzky-Golay filter of second order that gives the acceleration


@dataclasses.dataclass(frozen=True, eq=False)
class MotorRows:
    """One run of a motor; every array has shape (rows,), NaN where nothing was read.

    Attributes:
        name: of the run.
        time_s: increasing times [s].
        voltage_V: at the terminals, measured or what a controller set; None where the run is driven by its current.
        current_A: measured, or the input; None where there is none.
        load_Nm: against the motor.
        ambient_degC: of the surroundings.
        speed_rad_s: None where there is no speed.
        winding_degC: None where there is no thermometer.
        case_degC: the same.
        rate: dw/dt [rad/s^2]; zero where rows are too far apart to show it.
        follows: whether the rows show the acceleration.
        law: torque [N m] for one unit of a free number of the load's law; None without one.
        load_known: whether the load is measured, or follows a law.
    """

    name: str
    time_s: np.ndarray
    voltage_V: np.ndarray | None
    current_A: np.ndarray | None
    load_Nm: np.ndarray
    ambient_degC: np.ndarray
    speed_rad_s: np.ndarray | None
    winding_degC: np.ndarray | None
    case_degC: np.ndarray | None
    rate: np.ndarray
    follows: bool
    law: np.ndarray | None = None
    load_known: bool = True

    @property
    def read(self) -> np.ndarray:
        """Return the mask of the rows in which all that is measured was read."""
        mask = np.ones(self.time_s.size, dtype=bool)
        for column in (self.voltage_V, self.current_A, self.speed_rad_s):
            mask &= True if column is None else np.isfinite(column)
        return mask

    @property
    def moving(self) -> np.ndarray:
        """Return the mask of the rows in which the motor turns; all without a speed."""
        if self.speed_rad_s is None:
            return np.ones(self.time_s.size, dtype=bool)
        return np.abs(self.speed_rad_s) > STILL_SHARE * np.nanmax(np.abs(self.speed_rad_s))

    def hot_degC(self, otherwise: float) -> np.ndarray:
        """Return the temperature of the winding [degC], another one where it was not read."""
        if self.winding_degC is None:
            return np.full(self.time_s.size, otherwise)
        return np.where(np.isfinite(self.winding_degC), self.winding_degC, otherwise)


def motor_rows(case: Case, run: Run, late_s: float = 0.0) -> MotorRows:
    """Return the arrays of a run of a case, whose readings come late by so many seconds."""
    inputs, time_s = run.measured.inputs, run.measured.time_s
    outputs = {name: _earlier(time_s, values, late_s) for name, values in run.measured.outputs.items()}
    current = outputs.get("current_A", inputs.get("current_A"))
    speed = outputs.get("speed_rad_s", inputs.get("speed_rad_s"))
    rate, follows = np.zeros(time_s.size), False
    if speed is not None and np.isfinite(speed).sum() > SMOOTHED_ROWS and np.median(np.diff(time_s)) <= FOLLOWED_S:
        there = np.isfinite(speed)
        filled = np.interp(time_s, time_s[there], speed[there])
        rate, follows = _rate(time_s, filled), True
    load, law = inputs.get("load_torque_Nm", np.zeros(time_s.size)), None
    if speed is not None and (asked := law_torque(case, run, np.nan_to_num(speed), rate)):
        load, law = (load + asked.known, None) if asked.per_unit is None else (load, asked.per_unit)
    return MotorRows(
        run.name,
        time_s,
        inputs.get("voltage_V", outputs.get("voltage_V")),
        current,
        load,
        inputs["ambient_degC"],
        speed,
        outputs.get("winding_temperature_degC"),
        outputs.get("case_temperature_degC"),
        rate,
        follows,
        law,
        "speed_rad_s" not in inputs,
    )


def _earlier(time_s: np.ndarray, values: np.ndarray, late_s: float) -> np.ndarray:
    """Return readings of a later time at each row; NaN where the run had ended by then, or not begun."""
    if not late_s:
        return values
    return np.interp(time_s + late_s, time_s, values, left=np.nan, right=np.nan)


def dead_time(case: Case, runs: Sequence[Run]) -> float:
    """Return by how many seconds the speed of some runs comes after their voltage; 0 where it hardly does.

    Each shift of whole rows, to half of a run, is tried in V = k w + B sgn(w) + C dw/dt by least squares over all rows:
    a motor that neither turns nor speeds up under a voltage fits none of these terms. The shift must be longer than
    half of the local parabola of dw/dt, and leave a far smaller error.
    """
    rows = [one for run in runs if (one := motor_rows(case, run)).follows and one.load_known]
    driven = [one for one in rows if one.voltage_V is not None]
    if not driven:
        return 0.0
    step = float(np.median(np.concatenate([np.diff(one.time_s) for one in driven])))
    most = max(int(_MOST_DEAD * min(one.time_s[-1] - one.time_s[0] for one in driven) / step), 1)

    def best_of(rows: np.ndarray) -> int:
        return min(set(rows.astype(int).tolist()), key=lambda late: _error_of(driven, late * step))

    about = best_of(np.geomspace(1.0, most, _MOST_SHIFTS).round())
    late = best_of(np.linspace(0.9 * about, 1.1 * about, _MOST_SHIFTS).round())
    far_better = _error_of(driven, late * step) < _FAR_BETTER * _error_of(driven, 0.0)
    return late * step if late > SMOOTHED_ROWS // 2 and far_better else 0.0


def _error_of(runs: Sequence[MotorRows], late_s: float) -> float:
    """Return the mean square voltage that the motor's equation leaves with a speed that comes late [V^2]."""
    blocks, targets = [], []
    for rows in runs:
        assert rows.speed_rad_s is not None
        assert rows.voltage_V is not None
        speed, rate = (_earlier(rows.time_s, values, late_s) for values in (rows.speed_rad_s, rows.rate))
        there = np.isfinite(speed) & np.isfinite(rate)
        still = STILL_SHARE * np.nanmax(np.abs(rows.speed_rad_s))
        sign = np.where(np.abs(speed) > still, np.sign(speed), 0.0)
        blocks.append(np.column_stack([speed, sign, rate])[there])
        targets.append(rows.voltage_V[there])
    matrix, volts = np.vstack(blocks), np.concatenate(targets)
    size = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-30
    left = volts - matrix / size @ np.linalg.lstsq(matrix / size, volts, rcond=None)[0]
    return float(np.mean(left**2))


def _rate(time_s: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return dw/dt by a local parabola, on evenly spaced times where rows are not."""
    step = float(np.median(np.diff(time_s)))
    even = np.arange(time_s[0], time_s[-1] + step, step)
    window = min(SMOOTHED_ROWS, even.size - 1 + even.size % 2)
    slope = savgol_filter(np.interp(even, time_s, speed), window, 2, deriv=1, delta=step)
    return np.interp(time_s, even, np.asarray(slope))
