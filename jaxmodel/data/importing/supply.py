"""A run of a motor at another voltage than the one that is stated: what V = R i + k w of the other runs asks for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from jaxmodel.data.importing.findings import Finding
from jaxmodel.data.importing.logs import Log
from jaxmodel.data.importing.motor_constants import slopes
from jaxmodel.data.importing.options import Options

# Runs from which the others may tell one, and steady rows that each needs. Assumed.
_FEWEST, _ROWS = 4, 5
# A voltage that asks for so much more or less than stated is another, if the other runs are so many times nearer to
# what they state. Assumed: meters are within a few percent.
_OFF, _TIMES = 0.15, 3.0
_STEADY = 0.02  # of a constant voltage, how far its rows are off its median
_WHITE_V = 0.02  # scale of usual errors of the voltage, as a share of it, for the robust fit. Assumed.


def odd_voltages(runs: Sequence[Log], options: Options) -> list[Finding]:
    """Return the runs at constant voltage whose current and speed ask for another, by the constants of the other runs.

    Args:
        runs: of one motor; those with voltage, current and speed count.
        options: which column the user chose.
    """
    rows = [found for run in runs if (found := _steady(run)) is not None]
    if len(rows) < _FEWEST:
        return []
    shares = []
    for number, (_, volts, current, speed) in enumerate(rows):
        ohm, constant = _constants([one for place, one in enumerate(rows) if place != number])
        if ohm <= 0.0 or constant <= 0.0:
            return []
        shares.append((float(np.median(ohm * current + constant * speed)) / volts, ohm, constant))
    off = np.array([abs(share - 1.0) for share, *_ in shares])
    worst = int(off.argmax())
    if off[worst] <= max(_OFF, _TIMES * float(np.delete(off, worst).max())):
        return []
    run, volts, *_ = rows[worst]
    share, ohm, constant = shares[worst]
    own = next((name for name, target in run.header.items() if target == "voltage_V"), "voltage_V")
    column = options.columns.get("voltage_V", own)
    sentence = (
        f"{run.name}: its {volts:.3g} V do not fit its current and speed, which ask for {share * volts:.3g} V with "
        f"R_0 = {ohm:.3g} ohm and k_tau = {constant:.3g} V s/rad of the other {len(rows) - 1} runs (they fit within "
        f'{np.delete(off, worst).max():.0%}): correct it in the file, or leave the run out (--rows "{column} != '
        f'{volts:g}").'
    )
    return [Finding("another voltage", run.name, sentence, "warning", "voltage_V", numbers={"asked_V": share * volts})]


class _Steady(NamedTuple):
    """A run at a constant voltage [V], with its current [A] and speed [rad/s] by row."""

    run: Log
    volts: float
    current: np.ndarray
    speed: np.ndarray


def _steady(run: Log) -> _Steady | None:
    """Return a run at constant voltage; None for another one."""
    if not {"voltage_V", "current_A", "speed_rad_s"} <= run.columns.keys():
        return None
    voltage, current, speed = (run.columns[name] for name in ("voltage_V", "current_A", "speed_rad_s"))
    there = np.isfinite(voltage) & np.isfinite(current) & np.isfinite(speed)
    if there.sum() < _ROWS:
        return None
    volts = float(np.median(voltage[there]))
    if not volts or np.any(np.abs(voltage[there] - volts) > _STEADY * abs(volts)):
        return None
    return _Steady(run, volts, current[there], speed[there])


def _constants(rows: Sequence[_Steady]) -> tuple[float, float]:
    """Return R [ohm] and k [V s/rad] of some runs, by least squares that single bad rows do not move."""
    voltage = np.concatenate([np.full(one.current.size, one.volts) for one in rows])
    current, speed = np.concatenate([one.current for one in rows]), np.concatenate([one.speed for one in rows])
    scale = _WHITE_V * float(np.median(np.abs(voltage)))
    found = least_squares(
        lambda x: x[0] * current + x[1] * speed - voltage,
        slopes(voltage, current, speed),
        loss="cauchy",
        f_scale=scale,
        x_scale="jac",
    )
    return float(found.x[0]), float(found.x[1])
