"""Where most of an error is: a range of one condition that holds most of the squares in little of the time.

The other statements are about means, over the levels of the load. Where a model fails badly for a short while, as at
the end of a discharge, the error has no one mean; that it is there, and hardly elsewhere, is what a reader needs first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jaxmodel.diagnosis.residuals import wording
from jaxmodel.diagnosis.residuals.regimes import Bins, cut, regimes
from jaxmodel.diagnosis.residuals.statement import Statement, View, in_runs, make
from jaxmodel.diagnosis.residuals.table import Bools

# Least share of the squares, in at most this share of the time, and how many times the error is larger there. Assumed.
MOST_SQUARES, LITTLE_TIME, TIMES = 0.5, 0.2, 4.0
# A run shows it where its own error is so many times larger there; of the runs that cover the range so many must.
_SEEN, _OF_RUNS, _COVERS = 2.0, 2.0 / 3.0, 0.03


@dataclass(frozen=True)
class Concentration:
    """A range that holds most of an error.

    Attributes:
        where: the range in words.
        statement: on the error there and elsewhere.
        over: what it has more of the squares than of the time.
    """

    where: str
    statement: Statement
    over: float


def concentration(view: View, of: float) -> Concentration | None:
    """Return the range that holds most of the squares; None if none does.

    Args:
        view: what is not explained.
        of: mean square of all that was missed.
    """
    if len(view.residuals.runs) < 2:
        return None
    # Where the charge falls with the clock no cause can be told from it; where the error is can.
    with_clock = [name for name, same in regimes(view.residuals).alias_of.items() if same == "time_s"]
    cuts = [*view.cuts.values(), *(cut(view.residuals, name) for name in with_clock)]
    found = [one for bins in cuts if (one := _range(view, bins, of)) is not None]
    return max(found, key=lambda one: one.over, default=None)


def _range(view: View, bins: Bins, of: float) -> Concentration | None:
    """Return the range of adjacent bins that has most more of the squares than of the time."""
    r = view.residuals
    seconds = np.bincount(bins.code, r.weight_s, minlength=bins.count)
    squares = np.bincount(bins.code, r.weight_s * r.error**2, minlength=bins.count)
    time, square = seconds / seconds.sum(), squares / squares.sum()
    best = None
    for first in range(bins.count):
        for last in range(first, bins.count):
            of_time, of_square = time[first : last + 1].sum(), square[first : last + 1].sum()
            if of_square * r.mean_square < MOST_SQUARES * of or of_time > LITTLE_TIME:
                continue
            if of_square / of_time < TIMES**2 * (1.0 - of_square) / (1.0 - of_time):
                continue
            if best is None or of_square - of_time > best[0]:
                best = (float(of_square - of_time), first, last)
    if best is None:
        return None
    over, first, last = best
    rows = (bins.code >= first) & (bins.code <= last)
    seen, present = _seen(view, rows)
    if seen < max(2.0, _OF_RUNS * present):
        return None
    inside, outside = _size(view, rows), _size(view, ~rows)
    limit = max(r.tolerance or 0.0, 2.0 * (r.noise_sd if np.isfinite(r.noise_sd) else 0.0))
    if inside <= limit:
        return None
    texts, unit = wording.numbers([inside, outside], r.unit)
    within = r.tolerance is not None and outside <= r.tolerance < np.sqrt(r.mean_square)
    where = wording.within(bins, first, last)
    text = wording.sentence(
        where,
        f"the RMS error is {texts[0]} {unit} ({in_runs(seen, present, len(r.runs))}); elsewhere it is {texts[1]} {unit}"
        f"{', within the tolerance' if within else ''}.",
    )
    statement, _ = make(
        view,
        np.where(rows, r.error, 0.0),
        rows,
        condition=bins.name,
        lower=float(bins.lower[first]),
        upper=float(bins.upper[last]),
        text=text,
        cause="",
        value=inside,
        unit=r.unit,
        runs_seen=seen,
    )
    return Concentration(where, statement, over)


def _size(view: View, rows: Bools) -> float:
    """Return the root mean square error over some rows."""
    r = view.residuals
    return float(np.sqrt(np.average(r.error[rows] ** 2, weights=r.weight_s[rows])))


def _seen(view: View, rows: Bools) -> tuple[int, int]:
    """Return in how many runs the error is larger in some rows than elsewhere, and how many runs cover them."""
    r = view.residuals
    spent = np.array([r.weight_s[rows & (r.run == run)].sum() for run in r.runs])
    there = [run for run, time in zip(r.runs, spent, strict=True) if time >= _COVERS * spent.sum()]
    seen = 0
    for run in there:
        mine = r.run == run
        rest = mine & ~rows
        seen += not rest.any() or _size(view, mine & rows) > _SEEN * _size(view, rest)
    return seen, len(there)
