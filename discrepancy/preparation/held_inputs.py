"""Noisy inputs that a bench held: what it held is nearer to the mean of the readings than to each.

A pulse, a rest, a constant load: the readings of an input differ by its sensor's noise alone, which the model would
carry through its resistances, count as charge, and turn into currents where there are none (hysteresis and rate laws
ask for their size). What is averaged is a stretch between two jumps that noise of the stated sd explains, by its
scatter and by its course. Where such stretches are not most of a run (a drive cycle, a ramp) all stays as it was read:
the mean of what moves a little is wrong in a way that no noise is.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from scipy.stats import chi2, kstwobign

from jaxmodel.case import Case

# A difference of neighbours of so many sd is a jump.
_JUMP = 6.0
# How improbable the scatter, or the course, of the readings of a held input may be.
_IMPROBABLE = 1e-3
# Held is what stays for so many rows; a run is one of held inputs where that is this share of it.
LONG, _MOST = 8, 0.8


def noisy_inputs(case: Case) -> dict[str, float]:
    """Return the sd of every measured input that the case states one for."""
    return {name: sd for name, sd in case.sensors.items() if name in case.runs[0].measured.inputs}


def with_held_inputs(case: Case) -> Case:
    """Return a case with its noisy inputs, where they were held, as the means of what was read meanwhile."""
    noisy = noisy_inputs(case)
    runs = []
    for run in case.runs:
        inputs = {n: held(v, noisy[n]) if n in noisy else v for n, v in run.measured.inputs.items()}
        runs.append(run.driven_by(inputs))
    return dataclasses.replace(case, runs=tuple(runs))


def held(values: np.ndarray, sd: float) -> np.ndarray:
    """Return readings (rows,) of an input, those of each stretch in which it was held replaced by their mean."""
    jumps = np.flatnonzero(np.abs(np.diff(values)) > _JUMP * sd) + 1
    edges = np.concatenate([[0], jumps, [values.size]])
    steady = [
        slice(first, last)
        for first, last in itertools.pairwise(edges)
        if last - first >= LONG and _steady(values[first:last], sd)
    ]
    if sum(part.stop - part.start for part in steady) < _MOST * values.size:
        return values
    found = np.array(values, dtype=float)
    for part in steady:
        found[part] = values[part].mean()
    return found


def _steady(readings: np.ndarray, sd: float) -> bool:
    """Return True where the scatter about the mean and the course of its sum are those of noise."""
    away = (readings - readings.mean()) / sd
    scatter = chi2.isf(_IMPROBABLE, away.size - 1)
    drift = kstwobign.isf(_IMPROBABLE) * np.sqrt(away.size)
    return bool(np.sum(away**2) < scatter and np.max(np.abs(np.cumsum(away))) < drift)


def rows_held(values: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return, for each of some steps (steps,), for how many rows the input is held there, its own included.

    Args:
        values: (steps,) the input.
        row: (steps,) the row that each step belongs to, rising.
    """
    level, rows = _levels(values, row)
    return rows[level]


def stretches(values: np.ndarray, row: np.ndarray, most: int) -> np.ndarray:
    """Return the number of the stretch of each step (steps,): of one hold or of none, and of so many rows at most.

    A long hold is several: where it drifted, by less than shows, its mean is not as near as its many rows say.
    """
    level, rows = _levels(values, row)
    is_held = rows[level] >= LONG
    begins = np.append(True, (np.diff(level) > 0) & (is_held[1:] | is_held[:-1]))
    first = row[begins][np.cumsum(begins) - 1]
    piece = (row - first) // most
    return np.cumsum(begins | np.append(False, np.diff(piece) != 0)) - 1


def _levels(values: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of each step's level, and the rows of each level."""
    level = np.cumsum(np.append(0, np.diff(values) != 0.0))
    new_row = np.append(1, (np.diff(row) > 0) | (np.diff(level) > 0))
    return level, np.bincount(level, weights=new_row).astype(int)
