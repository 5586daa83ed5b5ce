"""Piecewise fit of the mean residuals over one condition: segments of adjacent ranges with one relation each.

In a segment e = a + b drive + c temperature, with only those terms that explain enough. Segments and terms are found
exactly, by dynamic programming over the ranges, and then tested against the scatter of the runs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from jaxmodel.diagnosis.residuals.cells import Cells, Scatter, scatter_of
from jaxmodel.diagnosis.residuals.table import Bools, ChannelResiduals, Floats, Integers

# Share of the sum of squares that another term, and another segment, must explain.
COST_OF_TERM = 0.03
COST_OF_STRETCH = 0.015
DOUBTFUL = 0.05  # p-value above which a second term is dropped
STANDS = 0.4  # part of a value that must remain if any one run is left out
TERMS = ((0,), (1,), (0, 1), (0, 2), (0, 1, 2))


@dataclass(frozen=True)
class Segment:
    """Adjacent ranges of a condition in which one relation holds.

    Attributes:
        first: number of the first range.
        last: number of the last.
        terms: of 0 (constant), 1 (proportional to the drive), 2 (to the temperature).
        value: by term.
        sd: by term, from the scatter of the runs.
        p_value: by term.
    """

    first: int
    last: int
    terms: tuple[int, ...]
    value: tuple[float, ...]
    sd: tuple[float, ...]
    p_value: tuple[float, ...]

    def values_at(self, columns: Floats) -> Floats:
        """Return the explained errors at given columns (1, drive, temperature), (n, 3)."""
        return columns[:, list(self.terms)] @ np.array(self.value)


def segments(residuals: ChannelResiduals, cells: Cells, most_p: float) -> list[Segment]:
    """Return the significant segments of a condition.

    The search is made twice, with the residuals as they are and with a constant and a line in the drive of each run
    removed; the result that explains more is returned.

    Args:
        residuals: of the channel.
        cells: their means.
        most_p: largest p-value of the most significant term of a segment.
    """
    scatters = [scatter_of(residuals, cells, beside_runs) for beside_runs in (False, True)]
    tried = [_segments(cells, scatter, 0.5 * most_p) for scatter in scatters]
    return max(tried, key=lambda found: _explained(cells, found))


def _explained(cells: Cells, found: list[Segment]) -> float:
    """Return the part of the cells' sum of squares that segments explain."""
    explained = np.zeros(cells.mean.size)
    for one in found:
        mine = (cells.bin >= one.first) & (cells.bin <= one.last)
        explained[mine] = one.values_at(cells.columns()[mine])
    return float(np.sum(cells.seconds * (cells.mean**2 - (cells.mean - explained) ** 2)))


def _segments(cells: Cells, scatter: Scatter, most_p: float) -> list[Segment]:
    """Return the segments that are significant against one scatter.

    Values are computed without the part of a run's line that other runs do not share, and tested without the whole
    line.
    """
    if scatter.freedom <= 0.0:
        return []
    common = dataclasses.replace(cells, mean=_without_own_of_runs(cells, scatter))
    found = []
    for first, last, terms in _cheapest(common):
        kept = _tested(common, scatter, first, last, terms)
        while kept is not None and max(kept.p_value) > DOUBTFUL:
            worst = int(np.argmax(kept.p_value))
            fewer = tuple(term for k, term in enumerate(kept.terms) if k != worst)
            kept = _tested(common, scatter, first, last, fewer) if set(fewer) & {0, 1} else None
        if kept is not None and min(kept.p_value) <= most_p:
            found.append(kept)
    return found


def _without_own_of_runs(cells: Cells, scatter: Scatter) -> Floats:
    """Return the cells' means with the line of each run replaced by the common line of all runs."""
    if not scatter.of_run.size:
        return cells.mean
    root = np.sqrt(cells.seconds)
    everywhere = np.arange(cells.mean.size)
    common = root[:, None] * cells.columns()[:, [term for term in cells.spanned(everywhere) if term < 2]]
    own = scatter.of_run @ (scatter.of_run.T @ (root * cells.mean))
    return cells.mean + (common @ np.linalg.lstsq(common, own, rcond=None)[0] - own) / root


def _cheapest(cells: Cells) -> Iterator[tuple[int, int, tuple[int, ...]]]:
    """Give the segments and terms with the least remaining sum of squares, costs included."""
    total = float(np.sum(cells.seconds * cells.mean**2))
    if total == 0.0:
        return
    cost = [0.0] + [np.inf] * cells.bins
    made: list[tuple[int, tuple[int, ...]]] = [(0, ())] * (cells.bins + 1)
    for end in range(1, cells.bins + 1):
        for begin in range(end):
            mine = np.flatnonzero((cells.bin >= begin) & (cells.bin < end))
            for terms, left in _options(cells, mine):
                price = total * (COST_OF_TERM * len(terms) + COST_OF_STRETCH * bool(terms))
                if cost[begin] + left + price < cost[end] - 1e-12 * total:
                    cost[end], made[end] = cost[begin] + left + price, (begin, terms)
    found, end = [], cells.bins
    while end > 0:
        begin, terms = made[end]
        if terms:
            found.append((begin, end - 1, terms))
        end = begin
    yield from reversed(found)


def _options(cells: Cells, mine: Integers) -> Iterator[tuple[tuple[int, ...], float]]:
    """Give each set of terms that vary over some cells, and the sum of squares that it leaves."""
    root = np.sqrt(cells.seconds[mine])
    mean = root * cells.mean[mine]
    yield (), float(mean @ mean)
    if mine.size == 0:
        return
    spanned = cells.spanned(mine)
    columns = root[:, None] * cells.columns()[mine]
    for terms in TERMS:
        if set(terms) <= set(spanned) and len(terms) < mine.size + (len(terms) == 1):
            design = columns[:, list(terms)]
            left = mean - design @ np.linalg.lstsq(design, mean, rcond=None)[0]
            yield terms, float(left @ left)


def _tested(cells: Cells, scatter: Scatter, first: int, last: int, terms: tuple[int, ...]) -> Segment | None:
    """Return a segment with its values, sd and p-values; None if too few runs cover it."""
    mine = np.flatnonzero((cells.bin >= first) & (cells.bin <= last))
    root = np.sqrt(cells.seconds)
    solve = _solve(cells, mine, terms)
    value = solve @ cells.mean
    # Tested without the lines of runs: the same sums of cells, minus their projection on these lines.
    contrast = solve - (solve / root @ scatter.of_run) @ scatter.of_run.T * root
    variance, freedom = scatter.variance(cells, contrast)
    if not np.all(variance > 0.0):
        return None
    sd = np.sqrt(variance)
    p_value = np.where(
        _in_all_but_any(cells, mine, terms, value), 2.0 * stdtr(freedom, -np.abs(contrast @ cells.mean) / sd), 1.0
    )
    return Segment(first, last, terms, tuple(value.tolist()), tuple(sd.tolist()), tuple(p_value.tolist()))


def _solve(cells: Cells, mine: Integers, terms: tuple[int, ...]) -> Floats:
    """Return the weights (terms, cells) whose sums over cells are the least-squares values of the terms."""
    root = np.sqrt(cells.seconds[mine])
    found = np.zeros((len(terms), cells.mean.size))
    found[:, mine] = np.linalg.pinv(root[:, None] * cells.columns()[mine][:, list(terms)]) * root
    return found


def _in_all_but_any(cells: Cells, mine: Integers, terms: tuple[int, ...], value: Floats) -> Bools:
    """Return for each term whether it keeps its sign and a good part of its size if any one run is left out."""
    runs = np.unique(cells.run[mine])
    if runs.size < 2:
        return np.zeros(value.size, dtype=bool)
    stands = np.ones(value.size, dtype=bool)
    for run in runs:
        rest = mine[cells.run[mine] != run]
        stands &= _solve(cells, rest, terms) @ cells.mean * np.sign(value) > STANDS * np.abs(value)
    return stands
