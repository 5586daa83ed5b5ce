"""Outliers: one to three readings far from their neighbours while no input changes.

Causes are a loose contact, a lost message, or a converter without a reading. One such reading at 0 V can outweigh
thousands of others in a sum of squares. It has no physical cause, so it is excluded, and a remark says so.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.case.records import Case, Run
from jaxmodel.fit.preparation.signals import (
    Rows,
    after_pauses,
    calm,
    detect_quantum,
    off_the_neighbours,
    robust_sd,
    without_readings,
)

# Distance of an outlier from the readings before and after it, in sd; these differ by less than half of that. It has at
# most so many rows. White noise has none in 1e20 readings.
FAR = 10.0
MOST_ROWS = 3
# If more than this share of a channel's readings, and more than one, qualifies, they are not outliers.
MOST_OF_CHANNEL = 0.005


def without_outliers(case: Case) -> tuple[Case, tuple[str, ...]]:
    """Return a case with outliers of its outputs as missing readings, and a sentence for each channel with some."""
    remarks, runs = [], {run.name: run for run in case.runs}
    channels = dict.fromkeys(name for run in case.runs for name in run.measured.outputs)
    for channel in channels:
        with_it = [run for run in case.runs if channel in run.measured.outputs]
        found = {run.name: outliers(run, channel, case.sensors.get(channel, 0.0)) for run in with_it}
        count = sum(int(rows.sum()) for rows in found.values())
        if not 0 < count <= max(1.0, MOST_OF_CHANNEL * sum(rows.size for rows in found.values())):
            continue
        first = next(run for run in with_it if found[run.name].any())
        row = int(np.argmax(found[first.name]))
        value = first.measured.outputs[channel][row]
        remarks.append(
            f"{count} reading{'s' * (count > 1)} of {channel} excluded as outlier{'s' * (count > 1)}, far from the "
            f"neighbouring readings although no input changed: {value:.4g} at {first.measured.time_s[row]:g} s of "
            f"{first.file}{' and others' * (count > 1)}."
        )
        for name, rows in found.items():
            runs[name] = without_readings(runs[name], channel, rows)
    return dataclasses.replace(case, runs=tuple(runs.values())), tuple(remarks)


def outliers(run: Run, channel: str, stated_sd: float = 0.0) -> Rows:
    """Return which rows of a run are outliers of a channel, (rows,) booleans."""
    values, time_s = run.measured.outputs[channel], run.measured.time_s
    there = np.flatnonzero(np.isfinite(values))
    found = np.zeros(values.size, dtype=bool)
    if there.size < 5:
        return found
    read, quiet = values[there], calm(run)[there]
    off = off_the_neighbours(read)
    off = off[off != 0.0]  # a coarse sensor shows its noise only when it changes
    scale = max(stated_sd, robust_sd(off) / np.sqrt(1.5), detect_quantum(read))
    if not scale:
        return found
    unlikely = ~quiet | after_pauses(time_s[there])
    jumps = np.flatnonzero(np.abs(np.diff(read)) > FAR * scale) + 1
    for length in range(1, MOST_ROWS + 1):
        first = jumps[jumps + length < read.size]
        rows = first[:, None] + np.arange(length)
        away = np.concatenate([read[rows] - read[first - 1, None], read[rows] - read[first + length, None]], axis=1)
        back = np.abs(read[first + length] - read[first - 1]) < 0.5 * np.abs(away).min(axis=1)
        one_way = np.all(away > FAR * scale, axis=1) | np.all(away < -FAR * scale, axis=1)
        around = first[:, None] + np.arange(length + 1)
        together = quiet[first - 1] & ~np.any(unlikely[around], axis=1)
        found[there[rows[back & one_way & together]]] = True
    return found
