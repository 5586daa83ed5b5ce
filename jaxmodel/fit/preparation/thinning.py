"""Long runs, thinned for the fits: few steps where inputs are steady, and windows of all rows where they are not.

A fit simulates a case thousands of times, and rows that are seconds apart tell it little more than the first of them.

Where the inputs are steady a step takes several rows, and ends in a reading (`steady`).

Where the inputs change from row to row (a drive cycle), all rows are kept if there are few. Of many, windows are kept:
half of them spread evenly, the others where the inputs change most (pulses). Between windows an input u with mean m and
standard deviation s over a block is m + s for half of the time and m - s for the other half: its integral and that of
its square are exact, so that charge and ohmic heat are. Towards what follows blocks become shorter, each a quarter of
the time left: what has relaxed by then may be coarse. Readings in blocks are not fitted.

Errors are computed from all readings.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.case.measurements import Measured
from jaxmodel.case.records import Case, Run
from jaxmodel.fit.preparation.steady import Steps, Stretch, finest, stretches
from jaxmodel.fit.settings import Settings

# Rows of a window.
WINDOW = 100
# Share of the steps for restless rows that are in windows.
_IN_WINDOWS = 0.7
# Length of a block as a share of the time to what follows.
_SHRINKS = 0.25
_ABOUT = 1.1  # of the steps asked for: as near as is sought


def thinned(case: Case, settings: Settings) -> Case:
    """Return a case with its fit runs thinned to about `settings.most_steps` rows; itself if they have no more.

    Of check runs only the first rows are kept, which may adjust their start.
    """
    rows = np.array([run.measured.time_s.size for run in case.runs if run.split == "fit"])
    if rows.sum() <= settings.most_steps:
        return case
    most = _level(rows, settings.most_steps)

    def of(run: Run) -> Measured:
        if run.split == "fit":
            return thinned_rows(run.measured, most)
        return _rows(run.measured, slice(0, max(2, start_rows(run, settings).stop)))

    return dataclasses.replace(case, runs=tuple(dataclasses.replace(run, measured=of(run)) for run in case.runs))


def start_rows(run: Run, settings: Settings) -> slice:
    """Return the rows at the start of a run on which it may be adjusted."""
    return slice(0, max(settings.start_readings, int(settings.start_share * run.measured.time_s.size)))


def thinned_rows(measured: Measured, most: int) -> Measured:
    """Return a run of at most about so many rows; itself if it has no more."""
    if measured.time_s.size <= most:
        return measured
    few = _thinned_rows(measured, most)
    # Each gap takes a few steps more than its share, as its blocks become shorter towards what follows.
    return few if few.time_s.size <= _ABOUT * most else _thinned_rows(measured, int(most * most / few.time_s.size))


def _thinned_rows(measured: Measured, most: int) -> Measured:
    found = stretches(measured)
    restless = _restless(measured.time_s.size, found)
    row_s = np.diff(measured.time_s, prepend=measured.time_s[0])
    # All restless rows where the steady ones keep half of the steps, or their share of the time.
    share = float(row_s[~restless].sum() / row_s.sum())
    steps = finest(measured, found, max(most - int(restless.sum()), int(min(0.5, share) * most)))
    if steps is None:  # too many stretches for steps of their own
        restless, steps = np.ones(restless.size, dtype=bool), Steps(np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    left = most - steps.count
    read = restless if restless.sum() <= left else restless & _windows(measured, restless, left)
    if read.all():
        return measured
    return _joined(_parts(measured, read, restless & ~read, steps, left))


def _restless(rows: int, found: Sequence[Stretch]) -> np.ndarray:
    """Return True for rows (rows,) outside all stretches."""
    restless = np.ones(rows, dtype=bool)
    for stretch in found:
        restless[stretch.first : stretch.last + 1] = False
    return restless


def _sums(values: np.ndarray, before: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the sums of values over the rows (before, end]."""
    bounds = np.stack([before + 1, ends + 1], axis=1).ravel()
    return np.add.reduceat(np.append(values, 0.0), bounds)[::2]


def _parts(measured: Measured, read: np.ndarray, gaps: np.ndarray, steps: Steps, most: int) -> list[Measured]:
    """Return the steps of a run, in order of time.

    Args:
        measured: the run.
        read: (rows,) True for rows that are kept.
        gaps: (rows,) True for rows that are in blocks, without readings.
        steps: in steady stretches.
        most: steps for rows that are not steady.
    """
    is_end = read.copy()
    is_end[0] = is_end[steps.read] = is_end[steps.silent] = True
    closes = gaps & ~np.append(gaps[1:], False)  # last row of a gap
    ends = np.flatnonzero(is_end | closes)
    silent = np.isin(ends, steps.silent) | closes[ends]
    row_s = np.diff(measured.time_s, prepend=measured.time_s[0])
    before, single = ends[:-1], np.diff(ends) == 1

    def mean(values: np.ndarray) -> np.ndarray:
        found = values[ends].copy()
        found[1:][~single] = (_sums(values * row_s, before, ends[1:]) / _sums(row_s, before, ends[1:]))[~single]
        return found

    inputs = {name: mean(values) for name, values in measured.inputs.items()}
    outputs = {name: np.where(silent, np.nan, values[ends]) for name, values in measured.outputs.items()}
    whole = Measured(measured.time_s[ends], inputs, outputs)
    longest_s = 2.0 * float(np.sum(row_s[gaps])) / ((1.0 - _IN_WINDOWS) * most)
    limits = {name: (float(values.min()), float(values.max())) for name, values in measured.inputs.items()}
    parts, done = [], 0
    for place in np.flatnonzero(closes[ends]):
        parts.append(_rows(whole, slice(done, int(place))))
        first = int(ends[place - 1]) if place else 0
        parts.append(_blocks(measured, first, int(ends[place]), longest_s, limits))
        done = int(place) + 1
    return [*parts, _rows(whole, slice(done, ends.size))]


def _rows(measured: Measured, rows: slice) -> Measured:
    return Measured(
        measured.time_s[rows],
        {name: values[rows] for name, values in measured.inputs.items()},
        {name: values[rows] for name, values in measured.outputs.items()},
    )


def _joined(parts: list[Measured]) -> Measured:
    def of(field: str, name: str) -> np.ndarray:
        return np.concatenate([getattr(part, field)[name] for part in parts])

    return Measured(
        np.concatenate([part.time_s for part in parts]),
        {name: of("inputs", name) for name in parts[0].inputs},
        {name: of("outputs", name) for name in parts[0].outputs},
    )


def _level(rows: np.ndarray, most: int) -> int:
    """Return the number of rows to which the longest runs are thinned, so that all together have at most so many."""
    ordered, left = np.sort(rows), float(most)
    for place, count in enumerate(ordered):
        share = left / (ordered.size - place)
        if count > share:
            return int(share)
        left -= count
    return int(ordered[-1])


def _windows(measured: Measured, restless: np.ndarray, most: int) -> np.ndarray:
    """Return True for rows (rows,) in windows: half of them evenly spread, half the liveliest.

    Args:
        measured: the run.
        restless: (rows,) True for the rows of which windows are chosen.
        most: steps for these rows, of which a share is in windows.
    """
    number = np.arange(restless.size) // WINDOW
    count = np.bincount(number, restless)
    there = np.flatnonzero(count)
    kept = min(there.size, max(3, int(_IN_WINDOWS * most / np.mean(count[there]))))
    chosen = np.zeros(count.size, dtype=bool)
    chosen[there[np.linspace(0, there.size - 1, -(-kept // 2)).round().astype(int)]] = True
    changes = np.bincount(number, _changes(measured))
    changes[chosen | (count == 0)] = -np.inf
    liveliest = np.argsort(changes, kind="stable")[::-1]
    chosen[liveliest[: kept - int(chosen.sum())]] = True
    return chosen[number]


def _changes(measured: Measured) -> np.ndarray:
    """Return how much the inputs change at each row (rows,), each in units of its standard deviation."""
    changes = np.zeros(measured.time_s.size)
    for values in measured.inputs.values():
        if spread := float(np.std(values)):
            changes += np.abs(np.diff(values, prepend=values[0])) / spread
    return changes


def _blocks(
    measured: Measured, first: int, last: int, longest_s: float, within: Mapping[str, tuple[float, float]]
) -> Measured:
    """Return the rows (first, last] as blocks of two steps at most, without readings.

    Args:
        measured: the run.
        first: the row before.
        last: the last row.
        longest_s: length of the longest block.
        within: lowest and highest value of each input in the run: a duty does not exceed 1.
    """
    time = measured.time_s
    ends, end = [last], last
    while end > first:
        length = min(longest_s, _SHRINKS * (time[last] - time[end]))
        end = min(end - 1, max(first, int(np.searchsorted(time, time[end] - length))))
        ends.append(end)
    edges = np.array(ends[::-1])
    row_s = np.diff(time[first : last + 1])
    steps = {
        name: _two_levels(values[first + 1 : last + 1], row_s, edges - first, within[name])
        for name, values in measured.inputs.items()
    }
    one_step = np.diff(edges) == 1
    for each in steps.values():
        each[one_step] = each[one_step].mean(axis=1, keepdims=True)
    single = one_step | np.all([each[:, 0] == each[:, 1] for each in steps.values()], axis=0)
    kept = np.stack([~single, np.ones_like(single)], axis=1).ravel()
    times = np.stack([0.5 * (time[edges[:-1]] + time[edges[1:]]), time[edges[1:]]], axis=1).ravel()[kept]
    nothing = np.full(times.size, np.nan)
    return Measured(
        times,
        {name: each.ravel()[kept] for name, each in steps.items()},
        dict.fromkeys(measured.outputs, nothing),
    )


def _two_levels(of_rows: np.ndarray, row_s: np.ndarray, edges: np.ndarray, within: tuple[float, float]) -> np.ndarray:
    """Return the two levels (blocks, 2) of an input in each block between rows `edges`, in the order of its halves."""
    begins = edges[:-1]

    def mean(of: np.ndarray) -> np.ndarray:
        return np.add.reduceat(of * row_s, begins) / np.add.reduceat(row_s, begins)

    block = np.repeat(np.arange(begins.size), np.diff(edges))
    middle = mean(of_rows)
    away = of_rows - middle[block]
    spread = np.sqrt(mean(away**2))
    spread = np.minimum(spread, np.minimum(within[1] - middle, middle - within[0]))
    order = np.arange(of_rows.size) - begins[block]
    falls = mean(away * (order - mean(order.astype(float))[block])) < 0.0
    sign = np.where(falls, 1.0, -1.0)
    return middle[:, None] + np.stack([sign * spread, -sign * spread], axis=1)
