"""Limits of the voltage that a cycler turns at again and again: full and empty, whatever the chemistry."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmodel.data.importing.charge import Count, full_discharges

# A voltage at which so many charges, or discharges, of the files end is a limit; so near to it [share of the span
# between both]. Assumed.
TURNS, NEAR = 2, 0.01
# A block moves at least this share of the largest charge that any does: a pulse ends at no limit. Assumed.
LARGE = 0.5


def by_limits(found: Sequence[Count]) -> list[Count]:
    """Return the charge of runs with a full cell at the upper limit and an empty one at the lower; as found without.

    Where charges end at one voltage at least twice and discharges at another, these are the limits of the test. What
    lies between them is the capacity, as nothing else of these files shows a full cell.
    """
    if any(full_discharges(count) for count in found):
        return [*found]
    ends = [_ends(count) for count in found]
    volts = [count.run.columns["voltage_V"] for count in found]
    tops = np.concatenate([v[charged] for v, (charged, _) in zip(volts, ends, strict=True)] or [np.zeros(0)])
    bottoms = np.concatenate([v[emptied] for v, (_, emptied) in zip(volts, ends, strict=True)] or [np.zeros(0)])
    if tops.size < TURNS or bottoms.size < TURNS:
        return [*found]
    high, low = float(np.median(tops)), float(np.median(bottoms))
    near = NEAR * (high - low)
    if not near > 0.0 or np.sum(tops >= high - near) < TURNS or np.sum(bottoms <= low + near) < TURNS:
        return [*found]
    result = []
    for count, volt, (charged, emptied) in zip(found, volts, ends, strict=True):
        full, empty = np.zeros(volt.size, dtype=bool), np.zeros(volt.size, dtype=bool)
        full[charged[volt[charged] >= high - near]] = True
        empty[emptied[volt[emptied] <= low + near]] = True
        result.append(dataclasses.replace(count, full=full, empty=empty, below_full_V=np.nan))
    return result


def _ends(count: Count) -> tuple[np.ndarray, np.ndarray]:
    """Return the last rows of large charges and of large discharges."""
    current = np.where(count.resting, 0.0, np.nan_to_num(count.run.columns["current_A"]))
    sign = np.sign(current)
    # The last row of the file ends nothing: there the logger may have been stopped.
    turns = np.flatnonzero((np.diff(sign) != 0.0) & (sign[:-1] != 0.0))
    begins = np.concatenate([[0], np.flatnonzero(np.diff(sign) != 0.0) + 1])
    moved = np.array([count.out_Ah[end] - count.out_Ah[max(begins[begins <= end][-1] - 1, 0)] for end in turns])
    large = np.abs(moved) >= LARGE * np.abs(moved).max(initial=0.0)
    there = np.isfinite(count.run.columns["voltage_V"][turns])
    return turns[(moved < 0.0) & large & there], turns[(moved > 0.0) & large & there]
