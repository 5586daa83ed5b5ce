"""What the mean residuals over one condition say together: adjacent ranges with one story, told in as few as explain.

In a stretch of the condition e = a + b drive + c warmth, with those terms alone that pay for a longer sentence. Which
stretches and which terms is found exactly, by dynamic programming over the ranges; what is found is then held against
the scatter of the runs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from discrepancy.residuals.cells import Cells, Scatter, scatter_of
from discrepancy.residuals.table import Bools, ChannelResiduals, Floats, Integers

# Of what all cells explain: what one more term of one more stretch must explain to be worth its words.
COST_OF_TERM = 0.03
COST_OF_STRETCH = 0.015
DOUBTFUL = 0.05  # p-value from which on a term beside one that is sure is dropped
STANDS = 0.4  # of a value: what must be left of it without any one of the runs
TERMS = ((0,), (1,), (0, 1), (0, 2), (0, 1, 2))


@dataclass(frozen=True)
class Stretch:
    """Adjacent ranges of a condition in which one story holds.

    Attributes:
        first: number of the first range.
        last: number of the last.
        terms: of 0 (a constant), 1 (in proportion to the drive), 2 (to the warmth).
        value: by term.
        sd: by term, the standard deviation of the value as the runs scatter.
        p_value: by term, of so large a value by chance.
    """

    first: int
    last: int
    terms: tuple[int, ...]
    value: tuple[float, ...]
    sd: tuple[float, ...]
    p_value: tuple[float, ...]

    def told(self, columns: Floats) -> Floats:
        """Return what the story says where the columns (1, drive, warmth) are these, (n, 3)."""
        return columns[:, list(self.terms)] @ np.array(self.value)


def stretches(residuals: ChannelResiduals, cells: Cells, most_p: float) -> list[Stretch]:
    """Return the stretches of a condition with a story that the scatter of the runs does not make by chance.

    They are sought twice, in what was left as it is, and beside what each run has all through, a constant and a line in
    the drive; what explains more is told.

    Args:
        residuals: of the channel.
        cells: their means.
        most_p: largest p-value of the surest term of a story.
    """
    scatters = [scatter_of(residuals, cells, beside_runs) for beside_runs in (False, True)]
    tried = [_stretches(cells, scatter, 0.5 * most_p) for scatter in scatters]
    return max(tried, key=lambda found: _explained(cells, found))


def _explained(cells: Cells, found: list[Stretch]) -> float:
    """Return what stories explain of the cells' sum of squares."""
    told = np.zeros(cells.mean.size)
    for one in found:
        mine = (cells.bin >= one.first) & (cells.bin <= one.last)
        told[mine] = one.told(cells.columns()[mine])
    return float(np.sum(cells.seconds * (cells.mean**2 - (cells.mean - told) ** 2)))


def _stretches(cells: Cells, scatter: Scatter, most_p: float) -> list[Stretch]:
    """Return the stretches that hold against one scatter.

    Values are told without the part of what a run has all through that other runs do not share, and tested without all
    of it.
    """
    if scatter.freedom <= 0.0:
        return []
    alike = dataclasses.replace(cells, mean=_without_own_of_runs(cells, scatter))
    found = []
    for first, last, terms in _cheapest(alike):
        kept = _tested(alike, scatter, first, last, terms)
        while kept is not None and max(kept.p_value) > DOUBTFUL:
            worst = int(np.argmax(kept.p_value))
            fewer = tuple(term for k, term in enumerate(kept.terms) if k != worst)
            kept = _tested(alike, scatter, first, last, fewer) if set(fewer) & {0, 1} else None
        if kept is not None and min(kept.p_value) <= most_p:
            found.append(kept)
    return found


def _without_own_of_runs(cells: Cells, scatter: Scatter) -> Floats:
    """Return the cells' means with what each run has all through replaced by what all have all through."""
    if not scatter.of_run.size:
        return cells.mean
    root = np.sqrt(cells.seconds)
    everywhere = np.arange(cells.mean.size)
    common = root[:, None] * cells.columns()[:, [term for term in cells.spanned(everywhere) if term < 2]]
    own = scatter.of_run @ (scatter.of_run.T @ (root * cells.mean))
    return cells.mean + (common @ np.linalg.lstsq(common, own, rcond=None)[0] - own) / root


def _cheapest(cells: Cells) -> Iterator[tuple[int, int, tuple[int, ...]]]:
    """Give the stretches and their terms that leave least of the cells' sum of squares, costs included."""
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
    """Give each set of terms that some cells span, and what it leaves of their sum of squares."""
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


def _tested(cells: Cells, scatter: Scatter, first: int, last: int, terms: tuple[int, ...]) -> Stretch | None:
    """Return a story with its values and how sure each is; None where too few runs carry it."""
    mine = np.flatnonzero((cells.bin >= first) & (cells.bin <= last))
    root = np.sqrt(cells.seconds)
    solve = _solve(cells, mine, terms)
    value = solve @ cells.mean
    # Held against what the run has beside: the same sums of cells, less what lines of runs make of them.
    contrast = solve - (solve / root @ scatter.of_run) @ scatter.of_run.T * root
    variance, freedom = scatter.variance(cells, contrast)
    if not np.all(variance > 0.0):
        return None
    sd = np.sqrt(variance)
    p_value = np.where(
        _in_all_but_any(cells, mine, terms, value), 2.0 * student.sf(np.abs(contrast @ cells.mean) / sd, freedom), 1.0
    )
    return Stretch(first, last, terms, tuple(value.tolist()), tuple(sd.tolist()), tuple(p_value.tolist()))


def _solve(cells: Cells, mine: Integers, terms: tuple[int, ...]) -> Floats:
    """Return the sums of cells, (terms, cells), that are the least-squares values of terms in some cells."""
    root = np.sqrt(cells.seconds[mine])
    found = np.zeros((len(terms), cells.mean.size))
    found[:, mine] = np.linalg.pinv(root[:, None] * cells.columns()[mine][:, list(terms)]) * root
    return found


def _in_all_but_any(cells: Cells, mine: Integers, terms: tuple[int, ...], value: Floats) -> Bools:
    """Return for each term whether it keeps its sign and a good part of its size without any one of the runs."""
    runs = np.unique(cells.run[mine])
    if runs.size < 2:
        return np.zeros(value.size, dtype=bool)
    stands = np.ones(value.size, dtype=bool)
    for run in runs:
        rest = mine[cells.run[mine] != run]
        stands &= _solve(cells, rest, terms) @ cells.mean * np.sign(value) > STANDS * np.abs(value)
    return stands
