"""A motor's load torque held against its current: both show how the torque changes, the current through k_tau."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jaxmodel.case.plausible.finding import Mend

# Rows slower than this share of the fastest tell of friction and not of the load.
_SLOW = 0.2
_FEWEST, _MOST = 20, 20_000
# The current explains the load where it predicts it with a correlation of this or more, its other causes left aside.
_LEAST_CORRELATION = 0.9
# By how much the torque by the current may exceed the load or fall below it: a gear between the two shafts wastes up to
# half of it (assumed), and an angle that is not the motor's turns it into as many times more.
CAN = (0.2, 5.0)
MENDS = (
    Mend("load_torque_Nm", 1e-3, "it is in mN m"),
    Mend("load_torque_Nm", 1e-2, "it is in N cm"),
    Mend("load_torque_Nm", 0.0980665, "it is in kgf cm"),
    Mend("load_torque_Nm", 1e2, "it is a hundred times too small"),
    Mend("load_torque_Nm", 1e3, "it is a thousand times too small"),
)
# A mend fits where what is left is within this factor of 1.
_FITS = 2.0


class Steady(NamedTuple):
    """Readings of one run of a motor, (rows,) each."""

    time_s: np.ndarray
    voltage_V: np.ndarray
    current_A: np.ndarray
    speed_rad_s: np.ndarray
    load_torque_Nm: np.ndarray


@dataclasses.dataclass(frozen=True)
class Load:
    """What the current says of a load torque.

    Attributes:
        ratio: how many times the stated load the torque is that goes with it by the current.
        k_tau: the torque constant that voltage, current and speed give [N m/A].
    """

    ratio: float
    k_tau: float

    @property
    def possible(self) -> bool:
        """Whether the two torques are of one size."""
        return CAN[0] <= self.ratio <= CAN[1]

    @property
    def mend(self) -> Mend | None:
        """The mistake that brings the two together; None if none does."""
        off = {mend: abs(np.log(self.ratio / mend.factor)) for mend in MENDS}
        best = min(off, key=off.__getitem__)
        return best if off[best] < np.log(_FITS) else None

    def sentence(self) -> str:
        """Say how the two torques differ."""
        return (
            f"where it changes, k_tau times the current changes {number_of_times(self.ratio)} times as much (k_tau = "
            f"{self.k_tau:.3g} N m/A by voltage, current and speed)"
        )


def number_of_times(factor: float) -> str:
    """Return a factor in digits that a person reads: 0.0123, 98, 1,020."""
    return f"{factor:,.0f}" if factor >= 100.0 else f"{factor:.3g}"


def load_of(runs: Iterable[Steady]) -> Load | None:
    """Return what the current says of the load torque of some runs of one motor; None where it tells nothing.

    Least squares over the faster rows: V = R i + k w gives k; k i = r load + friction + drag w + J dw/dt gives the
    ratio r.
    """
    rows = [run for run in map(_usable, runs) if run is not None]
    if not rows:
        return None
    voltage, current, speed, load, change = (np.concatenate(columns) for columns in zip(*rows, strict=True))
    fast = np.abs(speed) > _SLOW * np.max(np.abs(speed), initial=0.0)
    voltage, current, speed, load, change = (x[fast] for x in (voltage, current, speed, load, change))
    if speed.size < _FEWEST or np.ptp(load) <= 1e-6 * np.max(np.abs(load)):
        return None
    resistance, k_tau = np.linalg.lstsq(np.stack([current, speed], axis=1), voltage, rcond=None)[0]
    if resistance <= 0.0 or k_tau <= 0.0:
        return None
    others = np.stack([np.sign(speed), speed, change], axis=1)
    others = others / np.maximum(np.max(np.abs(others), axis=0), 1e-30)
    asked, given = (_without(x, others) for x in (k_tau * current, load))
    if not np.any(given) or not np.any(asked):
        return None
    correlation = float(asked @ given / np.sqrt((asked @ asked) * (given @ given)))
    if correlation < _LEAST_CORRELATION:
        return None
    return Load(float(asked @ given / (given @ given)), float(k_tau))


def _without(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    return values - others @ np.linalg.lstsq(others, values, rcond=None)[0]


def _usable(run: Steady) -> tuple[np.ndarray, ...] | None:
    there = np.all(np.isfinite(np.stack(run)), axis=0)
    rows = np.flatnonzero(there)
    if rows.size < 3:
        return None
    time_s, voltage, current, speed, load = (column[rows] for column in run)
    change = np.gradient(speed, time_s)
    thin = slice(None, None, max(rows.size // _MOST, 1))
    return voltage[thin], current[thin], speed[thin], load[thin], change[thin]
