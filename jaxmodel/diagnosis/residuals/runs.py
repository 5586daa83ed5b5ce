"""A constant and a line in the drive for each run; a run that differs from all others; dependence on a condition.

The sd of a run's line comes from the scatter of its blocks of time. A run is odd if it differs from the others by far
more than these differ among themselves. Runs are in order if their lines follow a condition of the runs (an ambient
temperature, an age).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import chdtrc, stdtr

from jaxmodel.diagnosis.residuals.regimes import least_span, weighted_quantiles
from jaxmodel.diagnosis.residuals.table import Bools, ChannelResiduals, Floats, Integers

BLOCKS = 12  # of a run: errors are correlated within each
# How far a run must be from the others, in their sd, by their number; more for few, whose sd is uncertain.
FAR_OFF = {2: 12.0, 3: 7.0, 4: 5.0}
FAR_OFF_OF_MANY = 4.0
SURE = 1e-3
ODD = 0.01
BY_CHANCE = 1e-3
# Part of a line's slope that must remain if any one run is left out.
STANDS = 0.3
# Share of the differences between runs that a line over a condition must explain.
IN_ORDER, IN_ORDER_OF_THREE = 0.8, 0.95


@dataclass(frozen=True, eq=False)
class RunLines:
    """The time-weighted line of each run, e = value[:, 0] + value[:, 1] (drive - middle).

    Attributes:
        runs: their numbers.
        middle: mean drive of all readings; 0 where no line has a slope.
        value: (runs, terms); one term unless the drive varies in every run.
        sd: (runs, terms) by the scatter of a run's blocks.
        freedom: (runs,) degrees of freedom of those.
    """

    runs: list[int]
    middle: float
    value: Floats
    sd: Floats
    freedom: Floats


@dataclass(frozen=True)
class OddRun:
    """One run that differs from all others in one term.

    Attributes:
        run: its number.
        term: 0 for a constant, 1 for a slope over the drive.
        value: difference from the mean of the others.
        others: mean of the others.
    """

    run: int
    term: int
    value: float
    others: float


@dataclass(frozen=True, eq=False)
class Order:
    """Runs that follow a condition.

    Attributes:
        condition: its name.
        terms: which terms follow it.
        at: (runs,) the condition in each run.
        intercept: by term, of the line over the condition.
        slope: by term.
    """

    condition: str
    terms: tuple[int, ...]
    at: Floats
    intercept: tuple[float, ...]
    slope: tuple[float, ...]


def run_lines(residuals: ChannelResiduals, drive: str | None) -> RunLines:
    """Return each run's line; with a slope if the drive varies materially in every run."""
    columns: list[Floats] = [np.ones(residuals.error.size)]
    middle = 0.0
    if drive and all(_spans(residuals, drive, number) for number in residuals.runs):
        values = residuals.conditions[drive]
        middle = float(np.average(values, weights=residuals.weight_s))
        columns.append(values - middle)
    design = np.stack(columns, axis=1)
    label = residuals.time_blocks(BLOCKS)
    found = [_line(residuals, design, label, residuals.run == number) for number in residuals.runs]
    value, sd, freedom = (np.array(part) for part in zip(*found, strict=True))
    return RunLines(residuals.runs, middle, value, sd, freedom)


def _spans(residuals: ChannelResiduals, name: str, run: int) -> bool:
    """Return whether a condition varies materially in a run, short moments excluded."""
    mine = residuals.run == run
    low, high = weighted_quantiles(residuals.conditions[name][mine], residuals.weight_s[mine], (0.02, 0.98))
    return bool(high - low >= least_span(residuals, name))


def _line(residuals: ChannelResiduals, design: Floats, label: Integers, mine: Bools) -> tuple[Floats, Floats, float]:
    """Return one run's line, its sd from blocks, corrected for their correlation, and the degrees of freedom."""
    x, e, weight = design[mine], residuals.error[mine], residuals.weight_s[mine]
    bread = np.linalg.pinv(x.T @ (weight[:, None] * x))
    value = bread @ (x.T @ (weight * e))
    block = np.unique(label[mine], return_inverse=True)[1]
    scores = np.stack([np.bincount(block, weight * column * (e - x @ value)) for column in x.T], axis=1)
    count = scores.shape[0]
    if count < 4:
        return value, np.full(value.size, np.inf), 1.0
    # The correlation of neighbours, corrected for the bias of a short series.
    square = np.sum(scores[:, 0] ** 2)
    shared = np.sum(scores[1:, 0] * scores[:-1, 0]) / square if square > 0.0 else 0.0
    shared = float(np.clip(shared + (1.0 + 3.0 * shared) / count, 0.0, 0.9))
    widened = (1.0 + shared) / (1.0 - shared)
    variance = np.diag(bread @ (scores.T @ scores) @ bread) * widened * count / max(count - value.size, 1)
    return value, np.sqrt(variance), max(1.0, count / widened - value.size)


def odd_run(lines: RunLines) -> OddRun | None:
    """Return the run that differs most from the others, if exactly one does.

    It must be significant in a t-test of its value against theirs, corrected for all runs and terms; or differ by a
    multiple of their sd and be significant against the scatter of its own blocks.
    """
    best, size = None, 0.0
    count = len(lines.runs)
    if count < 3:
        return None
    limit = FAR_OFF.get(count - 1, FAR_OFF_OF_MANY)
    for place, run in enumerate(lines.runs):
        others = np.arange(count) != place
        for term in range(lines.value.shape[1]):
            rest, scatter = lines.value[others, term], lines.sd[others, term]
            off = float(lines.value[place, term] - rest.mean())
            # The sd of the others is at least half of what the scatter of their blocks implies: they may agree by
            # chance.
            spread = np.hypot(rest.std(ddof=1), 0.5 * np.sqrt(np.mean(scatter**2))) * np.sqrt(count / (count - 1.0))
            own = np.hypot(lines.sd[place, term], np.sqrt(np.sum(scatter**2)) / (count - 1))
            if not (np.isfinite(own) and spread > 0.0 and own > 0.0):
                continue
            by_others = 2.0 * stdtr(count - 2, -abs(off) / spread) * lines.value.size
            by_itself = 2.0 * stdtr(lines.freedom[place], -abs(off) / own) * lines.value.size
            sure = by_others < ODD or (abs(off) > limit * spread and by_itself < SURE)
            if sure and abs(off) / spread > size:
                best, size = OddRun(run, term, off, float(rest.mean())), abs(off) / spread
    return best


def standing_out(residuals: ChannelResiduals, run: int, names: list[str]) -> list[str]:
    """Return the conditions in which a run's mean is outside those of all others by a material span."""
    found = []
    for name in names:
        means = {number: _mean(residuals, name, number) for number in residuals.runs}
        own = means.pop(run)
        beyond = max(own - max(means.values()), min(means.values()) - own)
        if beyond >= least_span(residuals, name) and mostly_of_runs(residuals, name):
            found.append(name)
    return found


def _mean(residuals: ChannelResiduals, name: str, run: int) -> float:
    mine = residuals.run == run
    return float(np.average(residuals.conditions[name][mine], weights=residuals.weight_s[mine]))


def order(residuals: ChannelResiduals, lines: RunLines, names: list[str]) -> Order | None:
    """Return the condition that the runs follow, the first of those that explain as much; None if there is none.

    It needs at least three levels of the condition, significant differences between runs, and a line over the condition
    that explains most of them.
    """
    best, most = None, 0.0
    for name in names:
        if not mostly_of_runs(residuals, name):
            continue
        at = np.array([_mean(residuals, name, number) for number in lines.runs])
        levels = np.sort(at)
        apart = levels[np.diff(levels, prepend=-np.inf) > 0.3 * least_span(residuals, name)]
        if apart.size < 3:
            continue
        terms, share = _terms_in_order(lines, at)
        if terms and share > 1.05 * most:
            fits = [np.polyfit(at, lines.value[:, term], 1) for term in terms]
            best = Order(name, terms, at, tuple(float(f[1]) for f in fits), tuple(float(f[0]) for f in fits))
            most = share
    return best


def mostly_of_runs(residuals: ChannelResiduals, name: str) -> bool:
    """Return whether a condition differs more between runs than it changes within them."""
    values, weight = residuals.conditions[name], residuals.weight_s
    means = np.zeros(values.size)
    for number in residuals.runs:
        means[residuals.run == number] = _mean(residuals, name, number)
    within = np.average((values - means) ** 2, weights=weight)
    return bool(within <= 0.3 * np.average((means - np.average(means, weights=weight)) ** 2, weights=weight))


def _terms_in_order(lines: RunLines, at: Floats) -> tuple[tuple[int, ...], float]:
    """Return the terms of runs that follow a condition, and the share that the best explains."""
    found, shares = [], [0.0]
    for term in range(lines.value.shape[1]):
        value, sd = lines.value[:, term], lines.sd[:, term]
        if not np.all(np.isfinite(sd)) or not np.all(sd > 0.0):
            continue
        weight = 1.0 / sd**2
        # The differences are significant against the scatter of blocks, or the correlation is.
        differ = np.sum(weight * (value - np.average(value, weights=weight)) ** 2)
        slope, intercept = np.polyfit(at, value, 1)
        total = np.sum((value - value.mean()) ** 2)
        share = 1.0 - np.sum((value - intercept - slope * at) ** 2) / total if total > 0.0 else 0.0
        ranks = abs(np.corrcoef(pd.Series(at).rank(), pd.Series(value).rank())[0, 1])
        quotient = np.sqrt(max(share, 0.0) / max(1.0 - share, 1e-12) * (value.size - 2))
        chance = stdtr(max(value.size - 2, 1), -quotient)
        sure = chdtrc(value.size - 1, differ) < SURE or chance < BY_CHANCE
        without = [np.polyfit(np.delete(at, k), np.delete(value, k), 1)[0] for k in range(value.size)]
        sure &= bool(np.min(np.array(without) / slope) > STANDS)
        if sure and min(share, ranks) > (IN_ORDER if value.size > 3 else IN_ORDER_OF_THREE):
            found.append(term)
            shares.append(share)
    return tuple(found), max(shares)
