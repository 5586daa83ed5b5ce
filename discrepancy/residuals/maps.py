"""Mean residuals for pictures: over one condition run by run, and over two conditions with what is beyond chance."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student
from statsmodels.stats.multitest import multipletests

from discrepancy.residuals.regimes import Bins, cut, regimes
from discrepancy.residuals.table import ChannelResiduals, Floats, Integers

BLOCKS = 30  # of a run: errors hang together within
LEAST_BLOCKS = 4  # of fewer the scatter is no measure
LEAST_READINGS = 5
FALSE_DISCOVERIES = 0.05  # over a map


@dataclass(frozen=True)
class MapCell:
    """The residual under one range of one condition and one of another.

    Attributes:
        x, y: lower and upper value of each condition that was read here.
        count: readings.
        seconds: time spent here.
        mean: time-weighted mean residual, in the channel's unit.
        z: that over its standard error by the scatter of blocks of time; 0 where too few tell it.
        is_biased: whether the mean is beyond chance, at a false discovery rate of 5 % over the map.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    count: int
    seconds: float
    mean: float
    z: float
    is_biased: bool


@dataclass(frozen=True, eq=False)
class Profile:
    """Mean residuals over one condition, run by run.

    Attributes:
        bins: its ranges.
        runs: numbers of the runs.
        mean: (runs, ranges) time-weighted, NaN where a run never was.
        seconds: (runs, ranges) time spent.
    """

    bins: Bins
    runs: tuple[int, ...]
    mean: Floats
    seconds: Floats


def profile(residuals: ChannelResiduals, condition: str) -> Profile:
    """Return the mean residuals of each run over the ranges of a condition."""
    bins = cut(residuals, condition)
    runs = residuals.runs
    place = np.searchsorted(runs, residuals.run) * bins.count + bins.code
    seconds: Floats = np.bincount(place, residuals.weight_s, minlength=len(runs) * bins.count).astype(float)
    total = np.bincount(place, residuals.weight_s * residuals.error, minlength=seconds.size)
    mean = np.where(seconds > 0.0, total / np.where(seconds > 0.0, seconds, 1.0), np.nan)
    shape = (len(runs), bins.count)
    return Profile(bins, tuple(runs), mean.reshape(shape), seconds.reshape(shape))


def maps(residuals: ChannelResiduals) -> dict[tuple[str, str], tuple[MapCell, ...]]:
    """Return the maps over every pair of conditions that take part, by their names."""
    pairs = itertools.combinations(regimes(residuals).names, 2)
    return {(x, y): map_over_two(residuals, cut(residuals, x), cut(residuals, y)) for x, y in pairs}


def map_over_two(residuals: ChannelResiduals, x: Bins, y: Bins) -> tuple[MapCell, ...]:
    """Return the residual in every combination of ranges of two conditions that has at least five readings."""
    block = residuals.time_blocks(BLOCKS)
    place = x.code * y.count + y.code
    found, counts = [], []
    for members in _members(place):
        if members.size < LEAST_READINGS:
            continue
        weight = residuals.weight_s[members]
        mean, error, count = _clustered_mean(residuals.error[members], weight, block[members])
        within = [residuals.conditions[one.name][members] for one in (x, y)]
        across, up = ((float(values.min()), float(values.max())) for values in within)
        z = mean / error if count >= LEAST_BLOCKS and error > 0.0 else 0.0
        found.append(MapCell(across, up, members.size, float(weight.sum()), mean, z, False))
        counts.append(count)
    if not found:
        return ()
    # Few blocks say nothing of their own error; the z is 0, of which the p-value is 1 whatever the freedom.
    p_values = 2.0 * student.sf(np.abs([cell.z for cell in found]), np.maximum(np.array(counts) - 1, 1))
    biased = multipletests(p_values, alpha=FALSE_DISCOVERIES, method="fdr_bh")[0]
    return tuple(replace(cell, is_biased=bool(one)) for cell, one in zip(found, biased, strict=True))


def _members(place: Integers) -> list[Integers]:
    """Return the readings of each place, places ascending."""
    order = np.argsort(place, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(place[order])) + 1) if place.size else []


def _clustered_mean(values: Floats, weight: Floats, cluster: Integers) -> tuple[float, float, int]:
    """Return the weighted mean, its cluster-robust standard error, and the number of clusters."""
    _, label = np.unique(cluster, return_inverse=True)
    count = int(label.max()) + 1
    mean = float(np.average(values, weights=weight))
    if count < 2:
        return mean, float("inf"), count
    sums = np.bincount(label, weight * (values - mean))
    return mean, float(np.sqrt(count / (count - 1.0) * np.sum(sums**2)) / weight.sum()), count
