"""Long runs, thinned for the fits: windows at full resolution, and between them steps that keep charge and heat.

A fit simulates a case thousands of times, and rows that are seconds apart tell it little more than the first of them.
Half of the windows are spread evenly over a run; the others are where its inputs change most (pulses). Between windows
an input u with mean m and standard deviation s over a block is m + s for half of the time and m - s for the other half:
its integral and that of its square are exact, so that charge and ohmic heat are. Towards the next window blocks become
shorter, each a quarter of the time left: what has relaxed by then may be coarse. Readings between windows are not
fitted; errors are computed from all readings.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from jaxmodel.case.measurements import Measured
from jaxmodel.case.records import Case, Run
from jaxmodel.fit.settings import Settings

# Rows of a window.
WINDOW = 100
# Share of a run's steps that are in windows.
_IN_WINDOWS = 0.7
# Length of a block as a share of the time to the next window.
_SHRINKS = 0.25


def thinned(case: Case, settings: Settings) -> Case:
    """Return a case with its fit runs thinned to `settings.most_steps` rows together; itself if they have no more.

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
    """Return a run of at most about so many rows, with readings in windows only; itself if it has no more."""
    if measured.time_s.size <= most:
        return measured
    in_window = _windows(measured, most)
    edges = np.flatnonzero(np.diff(in_window.astype(int)))
    if not edges.size:  # windows so close that they are the whole run
        return measured
    parts = [_rows(measured, slice(0, edges[0] + 1))]
    gaps_s = float(np.sum(np.diff(measured.time_s)[~in_window[1:]]))
    longest_s = 2.0 * gaps_s / ((1.0 - _IN_WINDOWS) * most)
    ends = {name: (float(values.min()), float(values.max())) for name, values in measured.inputs.items()}
    # Row 0 and the last row are in windows, so that edges alternate between the last row of a window and of a gap.
    for last, end in zip(edges[::2], edges[1::2], strict=True):
        following = edges[edges > end]
        stop = int(following[0]) + 1 if following.size else measured.time_s.size
        parts += [
            _blocks(measured, int(last), int(end), longest_s, ends),
            _rows(measured, slice(int(end) + 1, stop)),
        ]
    return _joined(parts)


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


def _windows(measured: Measured, most: int) -> np.ndarray:
    """Return True for rows (rows,) in windows: of the first and the last, half evenly spread, half the liveliest."""
    rows = measured.time_s.size
    count = -(-rows // WINDOW)
    kept = max(3, int(_IN_WINDOWS * most) // WINDOW)
    number = np.arange(rows) // WINDOW
    chosen = np.zeros(count, dtype=bool)
    chosen[np.linspace(0, count - 1, -(-kept // 2)).round().astype(int)] = True
    changes = np.bincount(number, _changes(measured), minlength=count)
    liveliest = np.argsort(np.where(chosen, -np.inf, changes), kind="stable")[::-1]
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
