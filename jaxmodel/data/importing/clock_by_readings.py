"""What a clock without a unit counts, by readings beside it that need one: an angle and its speed, a charge counted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jaxmodel.data.importing.roles import Role, target_unit
from jaxmodel.data.tables import RawTable
from jaxmodel.data.tables.units import conversion

# What is counted, and its rate; of both the file states the unit, for a factor between them would be one of the clock.
_PAIRS = (("position_rad", "speed_rad_s"), ("discharged_Ah", "current_A"), ("charged_Ah", "current_A"))
# Blocks of rows over which both are compared, the least of them, the spread of their ratio, and how near one must be to
# a unit or to a number of seconds that somebody would choose. Assumed.
_BLOCKS, _FEWEST, _SPREAD, _NEAR = 50, 8, 0.1, 0.03
_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "ms": 1e-3, "µs": 1e-6}
_CHOSEN = [digit * 10.0**power for power in range(-5, 1) for digit in (1.0, 2.0, 4.0, 5.0, 8.0)] + [10.0, 20.0, 30.0]
# A step of the voltage is so large a share of its range; the speed then goes on for so many rows at least.
_STEP, _AFTER, _FEWEST_STEPS = 0.3, 10, 3


def seconds_of(table: RawTable, chosen: Mapping[str, Role], units: Mapping[str, str], name: str) -> tuple[float, str]:
    """Return how many seconds one count of a clock is, and which two columns tell; 0 and "" where none do.

    The increase of a position or charge over a block of rows, over the mean of its rate and the counts of the block;
    the median of the blocks.

    Args:
        table: of a file.
        chosen: what its columns are.
        units: by column.
        name: of the clock.
    """
    for counted, rate in _PAIRS:
        if counted not in chosen or rate not in chosen or chosen[rate].column not in units:
            continue
        values = [_converted(table, chosen[one], units) for one in (counted, rate)]
        if values[0] is None or values[1] is None:
            continue
        ratio = _ratio(values[0], np.abs(values[1]), table.frame[name].to_numpy(dtype=float), counted == "position_rad")
        ratio *= 1.0 if counted == "position_rad" else 3600.0
        near = min([*_UNITS.values(), *_CHOSEN], key=lambda one: abs(np.log(max(ratio, 1e-30) / one)))
        if abs(ratio / near - 1.0) < _NEAR:
            return near, f"'{chosen[counted].column}' rises by '{chosen[rate].column}' times it"
    return 0.0, ""


def unit_of_size(seconds: float) -> str:
    """Return the unit that lasts so long; "" for none."""
    return next((unit for unit, size in _UNITS.items() if abs(seconds / size - 1.0) < 1e-9), "")


def rows_to_follow(table: RawTable, chosen: Mapping[str, Role]) -> int:
    """Return how many rows the speed of a motor needs after steps of its voltage for half of its change; 0 for unknown.

    Args:
        table: of a file.
        chosen: what its columns are.
    """
    columns = [chosen[one].column for one in ("voltage_V", "speed_rad_s") if one in chosen]
    if len(columns) < 2 or any(table.frame[one].dtype.kind not in "iuf" for one in columns):
        return 0
    volts, speed = (table.frame[one].to_numpy(dtype=float) for one in columns)
    if not np.isfinite(volts).all() or not np.isfinite(speed).all():
        return 0
    steps = np.flatnonzero(np.abs(np.diff(volts)) > _STEP * np.ptp(volts)) + 1 if np.ptp(volts) > 0.0 else []
    ends = [*steps[1:], volts.size]
    needed = []
    for begin, end in zip(steps, ends, strict=False):
        change = speed[begin - 1 : end] - speed[begin - 1]
        if end - begin > _AFTER and abs(change[-1]) > _STEP * np.ptp(speed):
            needed.append(int(np.argmax(np.abs(change) >= 0.5 * abs(change[-1]))))
    return int(np.median(needed)) if len(needed) >= _FEWEST_STEPS else 0


def _converted(table: RawTable, role: Role, units: Mapping[str, str]) -> np.ndarray | None:
    """Return a column in the unit of the case; None where it states none, or holds no numbers."""
    column = table.frame[role.column]
    change = conversion(units.get(role.column, ""), target_unit(role.target)) if role.column in units else None
    return column.to_numpy(dtype=float) * change.factor if change and column.dtype.kind in "iuf" else None


def _ratio(counted: np.ndarray, rate: np.ndarray, clock: np.ndarray, both_ways: bool) -> float:
    """Return the median over blocks of what is counted over rate and counts of the clock; 0 where they differ."""
    there = np.isfinite(counted) & np.isfinite(rate) & np.isfinite(clock)
    counted, rate, clock = counted[there], rate[there], clock[there]
    if clock.size < 4 * _FEWEST:
        return 0.0
    rises, lasts = np.diff(counted), np.diff(clock)
    moved = 0.5 * (rate[1:] + rate[:-1]) * lasts
    rises = np.abs(rises) if both_ways else rises
    size = max(clock.size // _BLOCKS, 2)
    edges = np.arange(0, rises.size, size)
    of_counted, of_rate = np.add.reduceat(rises, edges), np.add.reduceat(moved, edges)
    used = (of_rate > 0.2 * np.max(of_rate, initial=0.0)) & (of_counted > 0.2 * np.max(of_counted, initial=0.0))
    if used.sum() < _FEWEST or np.any(lasts < 0.0):
        return 0.0
    ratios = of_counted[used] / of_rate[used]
    middle = float(np.median(ratios))
    low, high = np.quantile(ratios, [0.25, 0.75])
    return middle if high - low < _SPREAD * middle else 0.0
