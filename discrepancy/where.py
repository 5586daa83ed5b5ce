"""Where a model fails: in which runs and conditions, one by one, two at a time, and in a sentence.

Everything works on a whitened residual w, which is white noise of unit variance where the model is right; a missing
reading is NaN (not the 0 that whitening leaves). The excess error is E = sum(w^2 - 1), the part of chi-square that
noise does not explain.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t
from statsmodels.stats.multitest import multipletests

from discrepancy.whitening import Bools, Floats, Integers

_THRESHOLDS_PER_REGRESSOR = 60
_COST_OF_A_CONDITION = 0.03  # of the excess error: what a longer sentence must gain
_LEAST_CONTRAST = 0.1
_ROUNDING = 1e-9  # of the largest value


@dataclass(frozen=True)
class Regressor:
    """A condition under which readings were taken.

    Attributes:
        name: what it is, as it should read in a sentence.
        unit: its unit, "" for none.
        values: (n,) its value at every row of the residual, finite.
    """

    name: str
    unit: str
    values: Floats


@dataclass(frozen=True)
class Cell:
    """The residual under one range of one condition.

    Attributes:
        regressor: the condition's name.
        lower: smallest value of it here.
        upper: largest value of it here.
        count: readings.
        excess: sum of w^2 - 1 here.
        share: that over the excess of all readings; NaN where there is no excess to share.
        bias: mean residual, in noise sd.
        bias_se: its standard error from the scatter of the clusters' sums; infinite for a single cluster.
        is_biased: whether the bias is significant at a false discovery rate of 5 % over all cells.
    """

    regressor: str
    lower: float
    upper: float
    count: int
    excess: float
    share: float
    bias: float
    bias_se: float
    is_biased: bool


def split_excess(
    whitened: ArrayLike, regressors: Sequence[Regressor], clusters: ArrayLike, bins: int = 6
) -> tuple[Cell, ...]:
    """Split the excess error by every condition in turn.

    share_b = (n_b bias_b^2 + n_b (var_b - 1)) / E, which adds to 1 over the cells of one condition.

    Args:
        whitened: (n,) whitened residual, NaN where a reading is missing.
        regressors: the conditions; the run is one, as a number.
        clusters: (n,) labels within which errors may be correlated (`whitening.block_labels`).
        bins: cells of equal count for each condition; one with no more different values than that gets a cell for each.

    Returns:
        The cells, condition by condition in ascending order.
    """
    w = np.asarray(whitened, dtype=float)
    read = np.isfinite(w)
    w, cluster = w[read], np.asarray(clusters)[read]
    total = float(np.sum(w**2 - 1.0))
    cells, p_values = [], []
    for regressor in regressors:
        values = _without_rounding(np.asarray(regressor.values, dtype=float)[read])
        for members in _bins(values, bins):
            bias, error, count = _clustered_mean(w[members], cluster[members])
            excess = float(np.sum(w[members] ** 2 - 1.0))
            within = values[members]
            share = excess / total if total > 0.0 else float("nan")
            cells.append(
                Cell(regressor.name, within.min(), within.max(), len(within), excess, share, bias, error, False)
            )
            p_values.append(2.0 * t.sf(abs(_z(bias, error)), count - 1) if count > 1 else 1.0)
    if not cells:
        return ()
    biased = multipletests(p_values, alpha=0.05, method="fdr_bh")[0]
    return tuple(replace(cell, is_biased=bool(is_biased)) for cell, is_biased in zip(cells, biased, strict=True))


@dataclass(frozen=True)
class MapCell:
    """The residual under one range of one condition and one of another.

    Attributes:
        x, y: lower and upper value of each condition here.
        count: readings.
        bias: mean residual, in noise sd.
        z: that over its cluster-robust standard error; 0 for a single cluster.
        excess: sum of w^2 - 1 here.
        is_biased: whether the bias is significant at a false discovery rate of 5 % over the map.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    count: int
    bias: float
    z: float
    excess: float
    is_biased: bool


def map_over_two(
    whitened: ArrayLike, x: Regressor, y: Regressor, clusters: ArrayLike, bins: int = 6
) -> tuple[MapCell, ...]:
    """Return the residual in every combination of ranges of two conditions that has at least five readings.

    Args:
        whitened: (n,) whitened residual, NaN where a reading is missing.
        x: one condition.
        y: the other.
        clusters: (n,) labels within which errors may be correlated.
        bins: of equal count for each condition; one with no more different values gets one for each.
    """
    w = np.asarray(whitened, dtype=float)
    read = np.isfinite(w)
    w, cluster = w[read], np.asarray(clusters)[read]
    along = [_without_rounding(np.asarray(one.values, dtype=float)[read]) for one in (x, y)]
    columns, rows = (
        [(part, (float(values[part].min()), float(values[part].max()))) for part in _bins(values, bins)]
        for values in along
    )
    found, counts = [], []
    inside = np.zeros(w.size, dtype=bool)
    for column, across in columns:
        inside[column] = True
        for row, up in rows:
            members = row[inside[row]]
            if members.size < 5:
                continue
            bias, error, count = _clustered_mean(w[members], cluster[members])
            excess = float(np.sum(w[members] ** 2 - 1.0))
            found.append(MapCell(across, up, members.size, bias, _z(bias, error), excess, False))
            counts.append(count)
        inside[column] = False
    if not found:
        return ()
    # A single cluster says nothing of its own error; its z is 0, of which the p-value is 1 whatever the freedom.
    p_values = 2.0 * t.sf(np.abs([cell.z for cell in found]), np.maximum(np.array(counts) - 1, 1))
    biased = multipletests(p_values, alpha=0.05, method="fdr_bh")[0]
    return tuple(replace(cell, is_biased=bool(one)) for cell, one in zip(found, biased, strict=True))


def _z(bias: float, error: float) -> float:
    """Return a mean over its standard error; 0 for a single cluster, and where no reading differs from another."""
    return bias / error if np.isfinite(error) and error > 0.0 else 0.0


def _without_rounding(values: Floats) -> Floats:
    """Return values, zero where they are rounding beside the largest: a motor at rest has one speed, not a range."""
    return np.where(np.abs(values) > _ROUNDING * np.max(np.abs(values), initial=0.0), values, 0.0)


def _bins(values: Floats, bins: int) -> list[Integers]:
    levels = np.unique(values)
    edges = levels if len(levels) <= bins else np.unique(np.quantile(values, np.arange(bins) / bins))
    code = np.searchsorted(edges, values, side="right") - 1
    return [np.flatnonzero(code == own) for own in np.unique(code)]


def _clustered_mean(values: Floats, cluster: ArrayLike) -> tuple[float, float, int]:
    """Mean, cluster-robust standard error, number of clusters."""
    _, label = np.unique(cluster, return_inverse=True)
    count = int(label.max()) + 1
    mean = float(values.mean())
    if count < 2:
        return mean, float("inf"), count
    sums = np.bincount(label, values - mean)
    return mean, float(np.sqrt(count / (count - 1.0) * np.sum(sums**2)) / len(values)), count


@dataclass(frozen=True)
class Condition:
    """One side of one threshold: value < threshold, or value >= threshold."""

    regressor: str
    unit: str
    is_below: bool
    threshold: float


@dataclass(frozen=True)
class Region:
    """Where most of the excess error is.

    Attributes:
        conditions: all of them hold there.
        share: part of the excess error.
        fraction: part of the readings.
        rows: (n,) booleans, True for the rows there.
    """

    conditions: tuple[Condition, ...]
    share: float
    fraction: float
    rows: Bools

    def sentence(self) -> str:
        """Say it, as in '62 % of the excess error is in 4 % of the samples: temperature below 5 degC'."""
        sides: dict[tuple[str, str], dict[bool, float]] = {}
        for condition in self.conditions:
            bounds = sides.setdefault((condition.regressor, condition.unit), {})
            tighter = min if condition.is_below else max
            bounds[condition.is_below] = tighter(
                bounds.get(condition.is_below, condition.threshold), condition.threshold
            )
        phrases = []
        for (name, unit), bounds in sides.items():
            unit = f" {unit}" if unit else ""
            if len(bounds) == 2:
                phrases.append(f"{name} between {bounds[False]:g} and {bounds[True]:g}{unit}")
            else:
                ((is_below, threshold),) = bounds.items()
                phrases.append(f"{name} {'below' if is_below else 'above'} {threshold:g}{unit}")
        share, fraction = 100.0 * min(self.share, 1.0), 100.0 * self.fraction
        where = f"{share:.0f} % of the excess error is in {fraction:.{0 if fraction >= 1.5 else 1}f} % of the samples"
        return f"{where}: {' and '.join(phrases)}"


def worst_region(
    whitened: ArrayLike, regressors: Sequence[Regressor], depth: int = 3, least_fraction: float = 0.01
) -> Region | None:
    """Find the few conditions under which most of the excess error arises, by a shallow greedy tree on w^2 - 1.

    A split maximises the variance between its sides; of all nodes the region is the one whose share of the excess error
    most exceeds its fraction of the samples. Thresholds are round numbers near quantiles, so that the sentence is
    exact.

    Args:
        whitened: (n,) whitened residual, NaN where a reading is missing.
        regressors: the conditions.
        depth: most conditions.
        least_fraction: smallest part of the samples on a side of a split.

    Returns:
        The region; None where the excess error is insignificant (E < 3 sqrt(2n)) or spread evenly.

    Raises:
        ValueError: a regressor is not finite.
    """
    w = np.asarray(whitened, dtype=float)
    read = np.isfinite(w)
    excess = np.where(read, w, 1.0) ** 2 - 1.0
    total, count = float(excess.sum()), int(read.sum())
    if not regressors or total < 3.0 * np.sqrt(2.0 * count):
        return None
    for regressor in regressors:
        if not np.all(np.isfinite(np.asarray(regressor.values)[read])):
            raise ValueError(f"The regressor {regressor.name} must be finite wherever there is a reading.")
    thresholds = [_round_thresholds(np.asarray(regressor.values, dtype=float)[read]) for regressor in regressors]
    codes = [
        np.searchsorted(own, regressor.values, side="right")
        for own, regressor in zip(thresholds, regressors, strict=True)
    ]
    least = max(1, int(np.ceil(least_fraction * count)))

    nodes: list[tuple[tuple[Condition, ...], Integers]] = [((), np.flatnonzero(read))]
    for conditions, rows in nodes:  # grows while it is walked: children are nodes too
        split = _best_split(excess[rows], [code[rows] for code in codes], least) if len(conditions) < depth else None
        if split is None:
            continue
        which, place = split
        regressor, is_below = regressors[which], codes[which][rows] <= place
        for side in (True, False):
            condition = Condition(regressor.name, regressor.unit, side, float(thresholds[which][place]))
            nodes.append(((*conditions, condition), rows[is_below == side]))

    def contrast(node: tuple[tuple[Condition, ...], Integers]) -> float:
        conditions, rows = node
        return float(excess[rows].sum() / total - len(rows) / count - _COST_OF_A_CONDITION * len(conditions))

    conditions, rows = max(nodes, key=contrast)
    if contrast((conditions, rows)) < _LEAST_CONTRAST:
        return None
    inside = np.zeros(len(w), dtype=bool)
    inside[rows] = True
    return Region(conditions, float(excess[rows].sum() / total), len(rows) / count, inside)


def _best_split(excess: Floats, codes: Sequence[Integers], least: int) -> tuple[int, int] | None:
    """The regressor and threshold whose two sides differ most, both with at least `least` rows."""
    best, gain_of_best = None, 1e-9 * float(np.sum(excess**2))
    mean = excess.mean()
    for which, code in enumerate(codes):
        size = np.cumsum(np.bincount(code))[:-1]
        below = np.cumsum(np.bincount(code, excess - mean))[:-1]
        allowed = (size >= least) & (len(excess) - size >= least)
        if not allowed.any():
            continue
        above_size = np.maximum(len(excess) - size, 1)
        gain = np.where(allowed, below**2 / np.maximum(size, 1) + below**2 / above_size, -np.inf)
        place = int(np.argmax(gain))
        if gain[place] > gain_of_best:
            best, gain_of_best = (which, place), float(gain[place])
    return best


def _round_thresholds(values: Floats) -> Floats:
    """Thresholds near quantiles, each the roundest number on its side of the neighbours."""
    levels = np.unique(values)
    if len(levels) > _THRESHOLDS_PER_REGRESSOR:
        levels = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _THRESHOLDS_PER_REGRESSOR + 1)))
    return np.array([_roundest(low, high) for low, high in itertools.pairwise(levels)])


def _roundest(low: float, high: float) -> float:
    """The roundest number strictly between two."""
    if low < 0.0 < high:
        return 0.0
    step = 10.0 ** (np.floor(np.log10(max(abs(low), abs(high)))) + 1.0)
    while step > 0.1 * (high - low):
        for digit in (1.0, 0.5, 0.2):
            multiple = np.ceil(high / (digit * step)) - 1.0
            number = float(f"{multiple * digit * step:.12g}")
            if low < number < high:
                return number
        step /= 10.0
    return 0.5 * (low + high)
