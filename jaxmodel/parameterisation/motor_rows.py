"""The runs of a motor as arrays, and its two equations."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.signal import savgol_filter

from jaxmodel.case.records import Run

FOLLOWED_S = 0.2  # a longer step between rows does not show the acceleration of a small motor
STILL_SHARE = 0.01  # of the largest speed: below it the motor stands
SMOOTHED_ROWS = 9  # of the Savitzky-Golay filter of second order that gives the acceleration


@dataclasses.dataclass(frozen=True, eq=False)
class MotorRows:
    """One run of a motor; every array has shape (rows,), NaN where nothing was read.

    Attributes:
        name: of the run.
        time_s: increasing times [s].
        voltage_V: at the terminals; None where the run is driven by its current.
        current_A: measured, or the input; None where there is none.
        load_Nm: against the motor.
        ambient_degC: of the surroundings.
        speed_rad_s: None where there is no speed.
        winding_degC: None where there is no thermometer.
        case_degC: the same.
        rate: dw/dt [rad/s^2]; zero where rows are too far apart to show it.
        follows: whether the rows show the acceleration.
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


def motor_rows(run: Run) -> MotorRows:
    """Return the arrays of a run."""
    inputs, outputs, time_s = run.measured.inputs, run.measured.outputs, run.measured.time_s
    current = outputs.get("current_A", inputs.get("current_A"))
    speed = outputs.get("speed_rad_s")
    rate, follows = np.zeros(time_s.size), False
    if speed is not None and np.isfinite(speed).sum() > SMOOTHED_ROWS and np.median(np.diff(time_s)) <= FOLLOWED_S:
        there = np.isfinite(speed)
        filled = np.interp(time_s, time_s[there], speed[there])
        rate, follows = _rate(time_s, filled), True
    return MotorRows(
        run.name,
        time_s,
        inputs.get("voltage_V"),
        current,
        inputs.get("load_torque_Nm", np.zeros(time_s.size)),
        inputs["ambient_degC"],
        speed,
        outputs.get("winding_temperature_degC"),
        outputs.get("case_temperature_degC"),
        rate,
        follows,
    )


def _rate(time_s: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return dw/dt by a local parabola, on evenly spaced times where rows are not."""
    step = float(np.median(np.diff(time_s)))
    even = np.arange(time_s[0], time_s[-1] + step, step)
    window = min(SMOOTHED_ROWS, even.size - 1 + even.size % 2)
    slope = savgol_filter(np.interp(even, time_s, speed), window, 2, deriv=1, delta=step)
    return np.interp(time_s, even, np.asarray(slope))
