"""Which conditions can locate the errors of a model, and into which ranges they are cut.

A condition takes part only if it varies materially within two runs or between runs, and is not a function of a
condition before it: with one ambient temperature nothing can be said about temperature.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxmodel.base.units import unit_of
from jaxmodel.diagnosis.residuals.table import Bools, ChannelResiduals, Floats, Integers

# Conditions in order of preference. Time takes no part: an error over time is described by what changed with it.
PREFERENCE = (
    "soc",
    "current",
    "temperature",
    "ambient",
    "speed",
    "torque",
    "duty",
    "cycles",
    "time_since_load_changed",
)
_CLOCK = ("time_s", "run")


@dataclass(frozen=True)
class MaterialSpan:
    """How far a condition must vary before it is used, and how it is cut.

    Attributes:
        span: the least, in its unit, or as a share of the largest value seen.
        of_range: whether it is such a share.
        edges: fixed edges of its ranges; None for levels, where it has few, or ranges of a round width.
        width: width of its ranges where it has no levels; 0 for a sixth of its range, rounded.
        source: of these numbers.
    """

    span: float
    of_range: bool
    edges: tuple[float, ...] | None
    width: float
    source: str


_TENTHS = tuple(round(0.1 * k, 1) for k in range(1, 10))
_SHARE = MaterialSpan(0.2, True, None, 0.0, "design: a fifth of the range")
MATERIAL_SPANS: dict[str, MaterialSpan] = {
    "soc": MaterialSpan(0.15, False, _TENTHS, 0.0, "design"),
    "degC": MaterialSpan(10.0, False, None, 10.0, "design"),
    "A": _SHARE,
    "N m": _SHARE,
    "rad/s": _SHARE,
    "duty": MaterialSpan(0.2, False, None, 0.0, "design: a fifth of the range"),
    "cycles": MaterialSpan(30.0, False, None, 0.0, "assumed: resistance and capacity change by some percent"),
    "s": MaterialSpan(60.0, False, (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0), 0.0, "assumed: minutes of relaxation"),
}
SAME = 0.98  # correlation, or share of variance explained by another, from which two conditions are equivalent
MOST_LEVELS = 6
LEAST_TIME = 0.01  # share of the time from which a value is a level
_LEVEL = 0.05  # of the range (K: in 10 K): values nearer than this are one level
_RESTS = 0.03  # share of the time at zero from which rest is a level


# Ranges in which dependence on another condition is tested, and the share of them that counts.
_FINE, _MOST_FINE = 30, 0.85


@dataclass(frozen=True, eq=False)
class Bins:
    """A condition cut into ranges.

    Attributes:
        name: the condition.
        unit: its unit, "" for none.
        lower: (bins,) where each range begins: -inf for the first, unless the ranges are levels.
        upper: (bins,) where it ends: inf for the last, unless the ranges are levels.
        middle: (bins,) time-weighted mean of the condition in each.
        code: (n,) the range of each reading.
        are_levels: whether the condition has few different values, of which each range holds one.
    """

    name: str
    unit: str
    lower: Floats
    upper: Floats
    middle: Floats
    code: Integers
    are_levels: bool

    @property
    def count(self) -> int:
        """Return the number of ranges."""
        return self.lower.size


@dataclass(frozen=True)
class Regimes:
    """The conditions that take part.

    Attributes:
        names: in order of preference.
        alias_of: conditions left out as equivalent, each with the one that is kept.
        idle: conditions that do not vary materially.
    """

    names: tuple[str, ...]
    alias_of: dict[str, str]
    idle: tuple[str, ...]


def regimes(residuals: ChannelResiduals) -> Regimes:
    """Return which conditions of a channel's residuals take part; never the channel itself, nor the clock."""
    given = [n for n in residuals.conditions if n not in (*_CLOCK, residuals.channel)]
    spanned = {name: _is_spanned(residuals, name) for name in given}
    kept: list[str] = []
    alias_of: dict[str, str] = {}
    for name in sorted((n for n in given if spanned[n]), key=_rank):
        same = next((other for other in kept if _says_the_same(residuals, other, name)), None)
        if same is None and abs(_correlation(residuals.conditions[name], residuals.time_s, residuals.weight_s)) > SAME:
            same = "time_s"
        if same is None:
            kept.append(name)
        else:
            alias_of[name] = same
    return Regimes(tuple(kept), alias_of, tuple(n for n in given if not spanned[n]))


def span_of(name: str) -> MaterialSpan:
    """Return what counts as a material span of a condition: by its name, else by its unit."""
    return MATERIAL_SPANS.get(name) or MATERIAL_SPANS.get(unit_of(name)) or _SHARE


def is_of_runs(residuals: ChannelResiduals, name: str) -> bool:
    """Return whether a condition varies between runs and hardly within them."""
    values, weight = residuals.conditions[name], residuals.weight_s
    labels = np.searchsorted(residuals.runs, residuals.run)
    means = _group_means(values, weight, labels)
    between = np.average((means[labels] - np.average(values, weights=weight)) ** 2, weights=weight)
    within = np.average((values - means[labels]) ** 2, weights=weight)
    return bool(within <= 0.02 * between)


def _rank(name: str) -> tuple[int, str]:
    """Return a condition's place in the order of preference: by how its name begins, else by a word in it."""
    place = next((k for k, word in enumerate(PREFERENCE) if name.startswith(word)), None)
    if place is None:
        place = next((k for k, word in enumerate(PREFERENCE) if word in name), len(PREFERENCE))
    return place, name


def least_span(residuals: ChannelResiduals, name: str) -> float:
    """Return the span of a condition that is material in these data, in its unit."""
    material = span_of(name)
    largest = float(np.abs(residuals.conditions[name]).max(initial=0.0))
    return material.span * (largest if material.of_range else 1.0)


def _is_spanned(residuals: ChannelResiduals, name: str) -> bool:
    """Return whether a condition varies materially within two runs, or from one run to another."""
    least = least_span(residuals, name)
    if residuals.error.size == 0 or least <= 0.0 or len(residuals.runs) < 2:
        return False
    low, middle, high = np.array([_quantiles(residuals, name, residuals.run == number) for number in residuals.runs]).T
    return bool(np.sum(high - low >= least) >= 2 or np.ptp(middle) >= least)


def _quantiles(residuals: ChannelResiduals, name: str, chosen: Bools) -> Floats:
    """Return the values below which 2, 50 and 98 % of the time were spent."""
    return weighted_quantiles(residuals.conditions[name][chosen], residuals.weight_s[chosen], (0.02, 0.5, 0.98))


def weighted_quantiles(values: Floats, weight: Floats, shares: Sequence[float] | Floats) -> Floats:
    """Return the values below which given shares of the weight lie."""
    order = np.argsort(values)
    until = np.cumsum(weight[order])
    return values[order][np.searchsorted(until, np.asarray(shares) * until[-1]).clip(0, values.size - 1)]


def _says_the_same(residuals: ChannelResiduals, first: str, other: str) -> bool:
    """Return whether one condition is a line in, or any function of, another.

    Two conditions that vary only between runs are functions of each other as soon as all runs differ; of these only the
    correlation counts.
    """
    x, y, weight = residuals.conditions[first], residuals.conditions[other], residuals.weight_s
    both_of_runs = is_of_runs(residuals, first) and is_of_runs(residuals, other)
    if abs(_correlation(x, y, weight)) > SAME:
        return True
    if both_of_runs:
        return False
    code = np.searchsorted(np.unique(weighted_quantiles(x, weight, np.arange(1, _FINE) / _FINE)), x, side="right")
    left = np.sort(_group_means((y - _group_means(y, weight, code)[code]) ** 2, weight, code))
    # The few fine ranges that span two levels of a condition are ignored.
    left = left[: max(1, round(_MOST_FINE * left.size))].mean()
    return bool(left <= (1.0 - SAME) * np.average((y - np.average(y, weights=weight)) ** 2, weights=weight))


def _correlation(x: Floats, y: Floats, weight: Floats) -> float:
    x, y = x - np.average(x, weights=weight), y - np.average(y, weights=weight)
    square = np.sum(weight * x**2) * np.sum(weight * y**2)
    return float(np.sum(weight * x * y) / np.sqrt(square)) if square > 0.0 else 0.0


def _group_means(values: Floats, weight: Floats, label: Integers) -> Floats:
    total = np.bincount(label, weight)
    return np.bincount(label, weight * values) / np.where(total > 0.0, total, 1.0)


def cut(residuals: ChannelResiduals, name: str) -> Bins:
    """Cut a condition: tenths of SOC, levels if it has few, else ranges of a round width."""
    values, weight, material = residuals.conditions[name], residuals.weight_s, span_of(name)
    near = 0.3 * material.span if unit_of(name) == "degC" else _LEVEL * float(np.ptp(values))
    levels = None if material.edges else _levels(values, weight, near, MOST_LEVELS)
    if levels is not None:
        return _of_code(residuals, name, levels[0], None)
    edges = np.array(material.edges or _round_edges(values, weight, material.width))
    return _of_code(residuals, name, np.searchsorted(edges, values, side="right"), edges)


def _of_code(residuals: ChannelResiduals, name: str, code: Integers, edges: Floats | None) -> Bins:
    """Return the ranges that contain readings."""
    values, weight = residuals.conditions[name], residuals.weight_s
    used, code = np.unique(code, return_inverse=True)
    middle = _group_means(values, weight, code)
    if edges is None:
        low, high = middle, middle
    else:
        bounds = np.concatenate([[-np.inf], edges, [np.inf]])
        low, high = bounds[used], bounds[used + 1]
        low, high = np.where(np.arange(used.size) == 0, -np.inf, low), np.where(used == used[-1], np.inf, high)
    return Bins(name, unit_of(name), low, high, middle, code, edges is None)


def _levels(values: Floats, weight: Floats, near: float, most: int) -> tuple[Integers, Floats] | None:
    """Return the level of each value, and the levels, if there are few, separated by gaps; else None.

    A level with hardly any time, as during a transition, is merged into the nearest.
    """
    order = np.argsort(values)
    ordered, time = values[order], weight[order]
    first = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > near)
    if first.size > 50 * most:
        return None
    spent = np.add.reduceat(time, first)
    real = [k for k in range(first.size) if spent[k] >= LEAST_TIME * spent.sum()]
    last = np.append(first[1:], ordered.size)
    if not 0 < len(real) <= most:
        return None
    pieces = [(ordered[first[k] : last[k]], time[first[k] : last[k]]) for k in real]
    spread = [np.subtract(*weighted_quantiles(v, w, (0.98, 0.02))) for v, w in pieces]
    if max(spread) > 1.5 * near:
        return None
    centres = np.array([np.average(v, weights=w) for v, w in pieces])
    between = 0.5 * (centres[1:] + centres[:-1])
    return np.searchsorted(between, values, side="right"), centres


def _round_edges(values: Floats, weight: Floats, width: float) -> list[float]:
    """Return edges a round width apart: the given width, or about a sixth of the range.

    They are multiples of the width; if the condition rests at zero for a while, zero is the middle of a range.
    """
    low, high = weighted_quantiles(values, weight, (0.005, 0.995))
    if not width:
        sixth = max((high - low) / MOST_LEVELS, 1e-300)
        power = 10.0 ** np.floor(np.log10(sixth))
        width = power * min((1.0, 2.0, 2.5, 5.0, 10.0), key=lambda digit: abs(np.log(digit * power / sixth)))
    at_rest = np.average(np.abs(values) < 0.01 * np.abs(values).max(), weights=weight) > _RESTS
    offset = 0.5 if at_rest else 0.0
    first, last = int(np.floor(low / width - offset)) + 1, int(np.ceil(high / width - offset))
    edges = [round((k + offset) * width, 12) for k in itertools.islice(range(first, last), 60)]
    # Very narrow ranges at either end are dropped.
    return [edge for edge in edges if low + 0.1 * width < edge < high - 0.1 * width]
