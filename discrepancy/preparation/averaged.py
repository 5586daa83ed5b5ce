"""A long case of cells in fewer rows: means over so many successive ones, as a slower logger would have read them.

What a fit costs goes with the rows that are simulated. A cell is driven by its current, and its voltage is all but
linear in it: the mean of the voltage belongs to the mean of the current, R_0 included, to the little by which the
state moves within a block. What is averaged calibrates; all readings judge.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from discrepancy.preparation.held_inputs import noisy_inputs
from jaxmodel.cases import Case, Run

# Rows of a block are as far apart to within this factor; else they stay as they are.
_EVEN = 1.5
# Of a column with more readings missing than this, a block has the mean of those that are there; of others all or none.
_SPARSE = 0.1


def rows_of_a_block(case: Case, most: int) -> int:
    """Return how many successive rows are averaged so that no more than so many calibrate; 1 where none need be.

    Only of cells: what drives a motor or a robot is not linear in it.
    """
    rows = sum(run.measured.time_s.size for run in case.runs if run.split == "fit")
    return max(1, -(-rows // most)) if case.kind == "cell" else 1


def averaged(case: Case, rows: int) -> Case:
    """Return a case with every so many successive rows of each run as one; the first row of a run stays."""
    if rows == 1:
        return case
    quieter = {name: sd / float(np.sqrt(rows)) for name, sd in noisy_inputs(case).items()}
    runs = tuple(_averaged(run, rows) for run in case.runs)
    return dataclasses.replace(case, runs=runs, sensors=case.sensors | quieter)


def _averaged(run: Run, rows: int) -> Run:
    time_s = run.measured.time_s
    steps = np.diff(time_s)
    block, count = [0], 0  # the block of each row
    for first in range(1, time_s.size, rows):
        mine = steps[first - 1 : first - 1 + rows]
        alike = mine.max() <= _EVEN * mine.min()
        block += [count + 1] * mine.size if alike else list(range(count + 1, count + 1 + mine.size))
        count = block[-1]
    of = np.array(block)
    last = np.append(np.flatnonzero(np.diff(of)), of.size - 1)
    held = np.append(0.0, steps)
    held[0] = 1.0
    inputs = {
        name: np.bincount(of, held * values) / np.bincount(of, held) for name, values in run.measured.inputs.items()
    }
    outputs = {name: _means(of, values) for name, values in run.measured.outputs.items()}
    return dataclasses.replace(
        run, measured=dataclasses.replace(run.measured, time_s=time_s[last], inputs=inputs, outputs=outputs)
    )


def _means(of: np.ndarray, values: np.ndarray) -> np.ndarray:
    there = np.isfinite(values)
    found, whole = np.bincount(of, there), np.bincount(of)
    needed = 1 if there.mean() < 1.0 - _SPARSE else whole
    total = np.bincount(of, np.where(there, values, 0.0))
    return np.where(found >= needed, total / np.maximum(found, 1), np.nan)
