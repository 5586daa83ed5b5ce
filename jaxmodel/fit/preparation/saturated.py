"""Saturated sensors: readings that repeat the largest or smallest value many times.

A 5 A current probe reads 5.00 A for all larger currents. Such a reading is only a bound, so it is excluded, and a
remark says so. The sensor's noise, absent at the limit and present elsewhere, distinguishes saturation from a quantity
that is itself limited. Voltages are not tested, because chargers and supplies limit them.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.base.remark import Remark
from jaxmodel.base.units import unit_of
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import detect_quantum, without_readings
from jaxmodel.fit.preparation.stuck import Stretch, stretches

# Smallest number of rows of one stretch at the limit, of stretches, and of rows in total.
LEAST_ROWS, LEAST_STRETCHES, LEAST_READINGS = 4, 2, 20
# Ratio of readings at the limit to readings within three steps of it.
PILED_UP = 5.0
# Share of changes away from the limit that reverse at once: the noise of the sensor is visible.
GOES_BACK = 0.15


def without_saturated(case: Case) -> tuple[Case, tuple[Remark, ...]]:
    """Return a case with saturated readings as missing, and a remark on each channel with some."""
    remarks, runs = [], {run.name: run for run in case.runs}
    for channel in dict.fromkeys(name for run in case.runs for name in run.measured.outputs):
        for limit in limits(case, channel):
            count, names = 0, []
            for run in case.runs:
                found = _at(run, channel, limit)
                rows = np.zeros(run.measured.time_s.size, dtype=bool)
                for one in found:
                    rows[one.first : one.last + 1] = True
                if found:
                    count += sum(one.rows for one in found)
                    names.append(run.name)
                    runs[run.name] = without_readings(runs[run.name], channel, rows)
            remarks.append(
                Remark(
                    f"{channel} repeats {limit:g} {unit_of(channel)}".rstrip()
                    + f" in {count} readings of {', '.join(names)} and never goes beyond: the sensor is saturated; "
                    "these readings are excluded.",
                    "sensor_saturated",
                    channel,
                    limit=limit,
                    readings=float(count),
                )
            )
    return dataclasses.replace(case, runs=tuple(runs.values())), tuple(remarks)


def limits(case: Case, channel: str) -> list[float]:
    """Return the readings, smallest or largest, at which a channel's sensor saturates; none for a voltage."""
    runs = [run for run in case.runs if channel in run.measured.outputs]
    if not runs or unit_of(channel) == "V":
        return []
    readings = np.concatenate([run.measured.outputs[channel] for run in runs])
    readings = readings[np.isfinite(readings)]
    if np.unique(readings).size < 10:
        return []
    quantum = detect_quantum(readings)
    found = []
    for limit in (float(readings.min()), float(readings.max())):
        at = [one for run in runs for one in _at(run, channel, limit)]
        near = np.sum((np.abs(readings - limit) <= 3.0 * quantum) & (readings != limit))
        count = sum(one.rows for one in at)
        enough = len(at) >= LEAST_STRETCHES and count >= max(LEAST_READINGS, PILED_UP * near)
        if limit != 0.0 and enough and _goes_back(runs, channel, limit) > GOES_BACK:
            found.append(limit)
    return found


def _at(run: Run, channel: str, limit: float) -> list[Stretch]:
    if channel not in run.measured.outputs:
        return []
    return [one for one in stretches(run, channel, least_rows=LEAST_ROWS) if one.value == limit]


def _goes_back(runs: list[Run], channel: str, limit: float) -> float:
    """Return the share of changes between neighbouring rows, away from the limit, that reverse at the next row."""
    back, moves = 0, 0
    for run in runs:
        values = run.measured.outputs[channel]
        step = np.diff(np.where(values == limit, np.nan, values))
        pairs = step[1:] * step[:-1]
        back += int(np.sum(pairs < 0.0))
        moves += int(np.sum(np.isfinite(pairs)))
    return back / moves if moves else 0.0
