"""Sensors at the end of their range: readings that repeat the largest, or the smallest, again and again.

A current probe of 5 A reads 5.00 A of all currents beyond. What it says there is a bound, not a reading, so it is left
out, and told. A noise that is seen elsewhere, and not at the rail, tells such readings from a quantity that is limited
itself; a voltage is limited by whoever charges or feeds, so of voltages nothing is said.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from discrepancy.preparation.signals import detect_quantum, without_readings
from discrepancy.preparation.stuck import Stretch, stretches
from jaxmodel.case import Case, Run
from jaxmodel.units import unit_of

# Rows of one stretch at the rail, stretches, and rows in all, from which on there is a rail.
LEAST_ROWS, LEAST_STRETCHES, LEAST_READINGS = 4, 2, 20
# How many times as often the rail is read as what lies within three steps of it.
PILED_UP = 5.0
# Share of the movements off the rail that go back at once: its noise is seen.
GOES_BACK = 0.15


def without_saturated(case: Case) -> tuple[Case, tuple[str, ...]]:
    """Return a case with readings at a sensor's rail as missing, and a sentence for each channel that has one."""
    remarks, runs = [], {run.name: run for run in case.runs}
    for channel in dict.fromkeys(name for run in case.runs for name in run.measured.outputs):
        for rail in rails(case, channel):
            count, names = 0, []
            for run in case.runs:
                found = _at(run, channel, rail)
                rows = np.zeros(run.measured.time_s.size, dtype=bool)
                for one in found:
                    rows[one.first : one.last + 1] = True
                if found:
                    count += sum(one.rows for one in found)
                    names.append(run.name)
                    runs[run.name] = without_readings(runs[run.name], channel, rows)
            remarks.append(
                f"{channel} repeats {rail:g} {unit_of(channel)}".rstrip()
                + f" in {count} readings of {', '.join(names)} and never goes beyond: the sensor is saturated; these "
                "readings are excluded."
            )
    return dataclasses.replace(case, runs=tuple(runs.values())), tuple(remarks)


def rails(case: Case, channel: str) -> list[float]:
    """Return the readings, smallest or largest, at which a channel's sensor has its end; none of a voltage."""
    runs = [run for run in case.runs if channel in run.measured.outputs]
    if not runs or unit_of(channel) == "V":
        return []
    readings = np.concatenate([run.measured.outputs[channel] for run in runs])
    readings = readings[np.isfinite(readings)]
    if np.unique(readings).size < 10:
        return []
    quantum = detect_quantum(readings)
    found = []
    for rail in (float(readings.min()), float(readings.max())):
        at = [one for run in runs for one in _at(run, channel, rail)]
        near = np.sum((np.abs(readings - rail) <= 3.0 * quantum) & (readings != rail))
        count = sum(one.rows for one in at)
        enough = len(at) >= LEAST_STRETCHES and count >= max(LEAST_READINGS, PILED_UP * near)
        if rail != 0.0 and enough and _goes_back(runs, channel, rail) > GOES_BACK:
            found.append(rail)
    return found


def _at(run: Run, channel: str, rail: float) -> list[Stretch]:
    if channel not in run.measured.outputs:
        return []
    return [one for one in stretches(run, channel, least_rows=LEAST_ROWS) if one.value == rail]


def _goes_back(runs: list[Run], channel: str, rail: float) -> float:
    """Return the share of movements between neighbouring rows off the rail that go back at the next row."""
    back, moves = 0, 0
    for run in runs:
        values = run.measured.outputs[channel]
        step = np.diff(np.where(values == rail, np.nan, values))
        pairs = step[1:] * step[:-1]
        back += int(np.sum(pairs < 0.0))
        moves += int(np.sum(np.isfinite(pairs)))
    return back / moves if moves else 0.0
