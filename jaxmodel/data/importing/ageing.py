"""Runs over the life of a cell: how many cycles it had done in each, and what capacity it had left.

A joint model of a young and an old cell needs both: without them what ages is taken for errors of the tables.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from jaxmodel.case.plausible.ranges import USUAL_OHM_AH
from jaxmodel.data.importing.balance import comparable
from jaxmodel.data.importing.charge import Count, Stated, full_discharges
from jaxmodel.data.importing.findings import Decision
from jaxmodel.data.importing.logs import Log
from jaxmodel.model.cell import cycle_resistance

# Fewer cycles do not age a cell by what a log shows; of capacities so far apart an older cell has less. Assumed.
_LEAST_CYCLES, _FADED = 20.0, 0.03
# sd of a capacity that was counted, as a share of it: as of a slow discharge. Assumed.
_COUNTED_SD = 0.02
# What a column that counts cycles is called: one of runs or tests counts no ageing.
_NAME = re.compile(r"cyc|zykl|循环", re.IGNORECASE)
# Loads within this factor leave alike charge in a cell, and temperatures within so much [K]. Assumed.
_SAME_RATE, _SAME_K = 1.5, 8.0


def cycles_of(runs: Sequence[Log]) -> list[float | None]:
    """Return the number of cycles that the cell had done in each run; None for all where the files do not count them.

    Each run is of one cycle, and first and last are so far apart that the cell may have aged.
    """
    found: list[float] = []
    for run in runs:
        column = next((name for name, target in run.header.items() if target == "cycle"), "")
        marks = run.marks.get("cycle", np.empty(0))
        marks = np.unique(marks[np.isfinite(marks)])
        if marks.size != 1 or not _NAME.search(column):
            return [None] * len(runs)
        found.append(float(marks[0]))
    apart = max(found, default=0.0) - min(found, default=0.0)
    return list(found) if apart >= _LEAST_CYCLES and min(found) >= 0.0 else [None] * len(runs)


def capacities_of(
    counts: Sequence[Count], cycles: Sequence[float | None], splits: Sequence[str]
) -> tuple[list[Stated | None], list[Decision]]:
    """Return the capacity that the cell had left in each run, if its full discharges show that it fades; else None.

    That of a run that is held out, or that is no full discharge, lies between those of younger and older fitted runs:
    a prediction does not know how long the run will last.

    Args:
        counts: the charge of each run.
        cycles: that the cell had done in each.
        splits: "fit" or "check" of each.
    """
    nothing: tuple[list[Stated | None], list[Decision]] = ([None] * len(counts), [])
    ages = np.array([np.nan if number is None else number for number in cycles])
    whole = [max((charge for _, charge in full_discharges(count)), default=np.nan) for count in counts]
    measured = np.where([split == "fit" for split in splits], whole, np.nan)
    there = np.flatnonzero(np.isfinite(measured) & np.isfinite(ages))
    if there.size < 2 or not _alike([counts[place] for place in there], float(measured[there].max())):
        return nothing
    there = there[np.argsort(ages[there], kind="stable")]
    if measured[there].max() - measured[there].min() < _FADED * measured[there].max():
        return nothing
    left = np.where(np.isfinite(measured), measured, np.interp(ages, ages[there], measured[there]))
    own, between = "its full discharge", "between those of younger and older runs"
    found = [
        Stated(value, _COUNTED_SD * value, own if np.isfinite(one) else between)
        for value, one in zip(left.tolist(), measured, strict=True)
    ]
    first, last = there[0], there[-1]
    decision = Decision(
        "capacity of each run",
        "",
        f"{left[first]:.4g} to {left[last]:.4g} A h over {ages[first]:g} to {ages[last]:g} cycles",
        "by its own full discharge; of check runs, between those of fit runs",
        "file",
    )
    return [*found], [decision]


def _alike(counts: Sequence[Count], largest_Ah: float) -> bool:
    """Return whether the charges of some runs may be held against each other: alike in load and temperature."""
    rates = [one.rate_A for one in counts]
    warmth = [one.ambient_degC for one in counts if one.ambient_degC is not None]
    loads = all(comparable(one, largest_Ah) for one in counts) and max(rates) <= _SAME_RATE * min(rates)
    return loads and bool(np.ptp(warmth or [0.0]) <= _SAME_K)


def has_law(cycles: Sequence[float | None], capacity_Ah: float) -> bool:
    """Return whether the resistance that cycles add by eq. 7 can be that of a cell of this capacity."""
    most = max((number for number in cycles if number is not None), default=0.0)
    return float(cycle_resistance(jnp.asarray(most))) < USUAL_OHM_AH / capacity_Ah


def told(cycles: Sequence[float | None], stated: Sequence[float | None]) -> list[Decision]:
    """Return what is decided on the age of the cell.

    Args:
        cycles: that the files count.
        stated: that the case states.
    """
    known = [number for number in cycles if number is not None]
    if not known:
        return []
    span = f"{min(known):g} to {max(known):g}"
    if all(number is None for number in stated):
        why = f"the files count {span}, and the resistance that these add by eq. 7 is more than a cell of this size has"
        return [Decision("cycles of each run", "", "not stated", why, "physics")]
    return [Decision("cycles of each run", "", span, "a column counts them; a diagnosis tells what ages", "file")]


def as_aged(capacity: Stated, left: Sequence[Stated | None]) -> Stated:
    """Return the capacity of the cell that was least aged, where the runs state how it fades."""
    known = [one for one in left if one is not None]
    if not known or capacity.why == "stated":
        return capacity
    largest = max(known, key=lambda one: one.value)
    return dataclasses.replace(capacity, value=largest.value, sd=largest.sd)
