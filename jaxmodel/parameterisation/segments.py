"""What a run of a cell is made of: rests, steps of the current, slow discharges and charges."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.parameterisation.rows import Rows

STEP_SHARE = 0.05  # of the largest current: a larger change from one row to the next is a step
STEP_S = 3.0  # longest time between the rows on both sides of a step
LEAST_REST_S = 60.0
SLOW_RATE = 1.0 / 8.0  # per hour, of the capacity: at or below it a discharge is slow
SLOW_SHARE = 0.5  # of the capacity that a slow discharge passes at least


@dataclasses.dataclass(frozen=True)
class Span:
    """Rows from `first` to `last`, both included."""

    first: int
    last: int


def _spans(mask: np.ndarray) -> list[Span]:
    """Return the longest spans of rows for which a mask holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [Span(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def rests(rows: Rows, least_s: float = LEAST_REST_S) -> list[Span]:
    """Return the spans in which the cell rests for `least_s` or longer; each begins with the last row under load."""
    found = []
    for span in _spans(np.abs(rows.current_A) <= rows.resting_A):
        first = max(span.first - 1, 0)
        if rows.time_s[span.last] - rows.time_s[first] >= least_s and span.last > first:
            found.append(Span(first, span.last))
    return found


def steps(rows: Rows) -> np.ndarray:
    """Return the numbers of the rows k at which the current has stepped since row k - 1, shortly before."""
    change = np.abs(np.diff(rows.current_A)) > STEP_SHARE * float(np.max(np.abs(rows.current_A)))
    return np.flatnonzero(change & (np.diff(rows.time_s) <= STEP_S)) + 1


def slow(rows: Rows, capacity_Ah: float) -> list[Span]:
    """Return slow discharges and charges: one sign, at most a C/8, half of the capacity or more."""
    found = []
    limit = SLOW_RATE * capacity_Ah
    for sign in (1.0, -1.0):
        mask = (sign * rows.current_A > rows.resting_A) & (np.abs(rows.current_A) <= limit)
        for span in _spans(mask):
            if abs(rows.drawn_Ah[span.last] - rows.drawn_Ah[span.first]) >= SLOW_SHARE * capacity_Ah:
                found.append(span)
    return found
