"""The clock of a log: restarts, repeated and late rows, resolution, and elapsed time against time stamps."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log, spans

# A restart of the clock goes on with the same run where the voltage goes on within so much [V] (assumed).
_SAME_VOLTAGE = 0.15
# What the resistance of a cell explains of the voltage's jump where the current steps as well [V], at most (assumed).
_BY_RESISTANCE = 0.3
# Rows that share their time with another, above which the clock is too coarse for the rows.
_COARSE = 0.2
# By how much a row at the time of the row before is moved, at most [s].
_MOVED_S = 1e-3
_ISOLATED = 0.01
# Elapsed time and time stamps may differ by this share and by so many seconds.
_DRIFT, _SLACK_S = 2e-4, 3.0


def with_clock(log: Log, seconds_per_row: float | None) -> Log | None:
    """Return a log whose times increase within each run, or None if it has no clock.

    Args:
        log: as read.
        seconds_per_row: stated time from row to row [s].

    Raises:
        MeasurementError: fewer than two rows have a time.
    """
    where = file_label(log.source)
    if seconds_per_row is not None:
        why = f"{seconds_per_row:g} s from row to row"
        log = dataclasses.replace(log, time_s=np.arange(log.rows) * seconds_per_row, time_is_of_step=False)
        return log.also(Decision("clock", where, why, "stated", "user"))
    if not log.time_s.size:
        if log.stamp_s is None:
            return None
        log = _by_stamps(log, "the file has no elapsed time")
    log = _without_timeless_rows(log, where)
    if log.rows < 2:
        raise MeasurementError(f"{where} has fewer than two rows with a time; a run needs at least two.")
    log = _sorted(_restarts(log, where), where)
    log = _late_rows(log, where)
    return _against_stamps(_repeated_rows(log, where), where)


def _by_stamps(log: Log, why: str) -> Log:
    assert log.stamp_s is not None
    there = log.stamp_s[np.isfinite(log.stamp_s)]
    time_s = log.stamp_s - (there[0] if there.size else 0.0)
    decision = Decision("clock", file_label(log.source), "time stamps", why, "file")
    return dataclasses.replace(log, time_s=time_s, time_is_of_step=False).also(decision)


def _without_timeless_rows(log: Log, where: str) -> Log:
    there = np.isfinite(log.time_s)
    if there.all():
        return log
    lost = int((~there).sum())
    sentence = (
        f"{where}: {lost:,} {'row has' if lost == 1 else 'rows have'} no time and "
        f"{'is' if lost == 1 else 'are'} left out."
    )
    return log.take(there).also(Finding("no time", where, sentence, "warning"))


def _restarts(log: Log, where: str) -> Log:
    """Return a log with the rows at which its clock begins anew: new runs, or steps put one after the other."""
    steps = np.diff(log.time_s)
    back = np.flatnonzero(steps < 0.0) + 1
    if not back.size or back.size > 0.5 * steps.size:  # rows that run backwards begin nothing anew
        return log
    begins = np.isclose(log.time_s[back], log.time_s[0], atol=max(1.0, 0.02 * float(np.nanmax(log.time_s))))
    # A single row that is late goes back as well, and the next one is where it should be.
    stays = log.time_s[np.minimum(back + 1, log.rows - 1)] < log.time_s[back - 1]
    # Parts that lie over each other in time cannot be put in its order: a clock that goes back to a mark between them.
    over = _overlaps(log, back) & stays & ~begins
    if over.any() and _voltage_goes_on(log, back[over]):
        begins |= over
    restarts = back[begins & stays]
    if not restarts.size:
        return log
    stamps = log.stamp_s
    if (
        stamps is not None
        and np.isfinite(stamps).all()
        and np.all(np.diff(stamps) >= 0.0)
        and not _resolution_lost(log)
    ):
        log = _by_stamps(log, f"the elapsed time begins anew {restarts.size} times")
        return log.also(_reset(where, restarts.size, "the time stamps are used instead"))
    cycle = log.marks.get("cycle")
    step = log.marks.get("step")
    new_runs = cycle is not None and np.mean(cycle[restarts] != cycle[restarts - 1]) > 0.9
    of_steps = log.time_is_of_step or (step is not None and np.mean(step[restarts] != step[restarts - 1]) > 0.9)
    if not new_runs and not of_steps:
        new_runs = not _voltage_goes_on(log, restarts)
    if new_runs:
        said = f"{where}: the clock begins anew {restarts.size} times; each time a new run begins."
        found = Finding("reset", where, said, numbers={"resets": float(restarts.size)})
        return dataclasses.replace(log, restarts=tuple(restarts.tolist())).also(found)
    # The time of a step: the next one begins where the last one ended.
    offset = np.zeros(log.rows)
    ends = log.time_s[restarts - 1]
    typical = float(np.median(np.abs(steps)))
    offset[restarts] = ends + np.where(log.time_s[restarts] > 0.0, 0.0, np.minimum(1e-3, typical))
    to_mark = np.isin(restarts, back[over])
    offset[restarts[to_mark]] += typical - log.time_s[restarts[to_mark]]
    time_s = log.time_s + np.cumsum(offset)
    log = dataclasses.replace(log, time_s=time_s, time_is_of_step=False)
    return log.also(
        _reset(where, restarts.size, "the parts are put one after the other, without the time between them")
    )


def _reset(where: str, count: int, done: str) -> Finding:
    times = "once" if count == 1 else f"{count} times"
    return Finding(
        "reset", where, f"{where}: the clock begins anew {times}; {done}.", "warning", numbers={"resets": float(count)}
    )


def _resolution_lost(log: Log) -> bool:
    """Return whether time stamps are coarser than the rows by far."""
    assert log.stamp_s is not None
    return bool(np.mean(np.diff(log.stamp_s) == 0.0) > _COARSE)


def _overlaps(log: Log, back: np.ndarray) -> np.ndarray:
    """Return whether the part that begins at each row lies over the part before it in time, by more than its first row.

    Args:
        log: with its times.
        back: rows at which these go back.
    """
    edges = [0, *back.tolist(), log.rows]
    found = []
    for first, row, last in zip(edges, edges[1:], edges[2:], strict=False):
        before, part = log.time_s[first:row], log.time_s[row:last]
        found.append(np.sum((part >= before[0]) & (part <= before[-1])) > 1)
    return np.array(found, dtype=bool)


def _voltage_goes_on(log: Log, restarts: np.ndarray) -> bool:
    """Return whether the voltage goes on over some rows, but for what the current's steps do to it there."""
    voltage = log.columns.get("voltage_V", log.columns.get("pack_voltage_V"))
    if voltage is None:
        return False
    jumps = voltage[restarts] - voltage[restarts - 1]
    current = log.columns.get("current_A", log.columns.get("pack_current_A"))
    if current is not None:
        steps = current[restarts] - current[restarts - 1]
        there = np.isfinite(jumps) & np.isfinite(steps)
        power = float(steps[there] @ steps[there])
        if np.sum(there) > 2 and power > 0.0:
            most = _BY_RESISTANCE / float(np.max(np.abs(steps[there])))
            resistance = float(np.clip(steps[there] @ jumps[there] / power, -most, most))  # the sign is not settled yet
            jumps = jumps - resistance * np.where(there, steps, 0.0)
    return bool(np.nanmedian(np.abs(jumps)) < _SAME_VOLTAGE) if np.isfinite(jumps).any() else False


def _runs_of(log: Log) -> list[slice]:
    edges = [0, *log.restarts, log.rows]
    return [slice(begin, end) for begin, end in itertools.pairwise(edges)]


def _sorted(log: Log, where: str) -> Log:
    """Return a log in the order of its clock where more than single rows are out of it and no two parts overlap."""
    steps = np.diff(log.time_s)
    back = int(np.sum(steps < 0.0))
    if log.restarts or not back:
        return log
    late = log.time_s < np.maximum.accumulate(log.time_s)
    ahead = log.time_s > np.minimum.accumulate(log.time_s[::-1])[::-1]
    if min(late.mean(), ahead.mean()) <= _ISOLATED:
        return log
    order = np.argsort(log.time_s, kind="stable")
    what = "run backwards in time" if back == steps.size else f"are out of order in time in {back} places"
    sentence = f"{where}: its rows {what}; they are put in the order of the clock."
    return log.take(order).also(Finding("out of order", where, sentence, "warning", numbers={"places": float(back)}))


def _late_rows(log: Log, where: str) -> Log:
    """Return a log without single rows whose time lies before that of a row above them."""
    keep = np.ones(log.rows, dtype=bool)
    for part in _runs_of(log):
        time_s = log.time_s[part]
        if not np.any(np.diff(time_s) < 0.0):
            continue
        late = time_s < np.maximum.accumulate(time_s)
        if late.mean() > _ISOLATED:  # one stray time far ahead makes all others late
            ahead = time_s > np.minimum.accumulate(time_s[::-1])[::-1]
            late = ahead if ahead.sum() < late.sum() else late
        keep[part] = ~late
    if keep.all():
        return log
    lost = int((~keep).sum())
    share = lost / keep.size
    row = int(np.argmin(keep))
    sentence = (
        f"{where}: {lost:,} {'row is' if lost == 1 else 'rows are'} out of order in time and left out, the first at "
        f"{log.time_s[row]:g} s (row {row + 1})."
    )
    found = Finding("out of order", where, sentence, "warning", numbers={"share": share})
    starts = np.zeros(log.rows, dtype=bool)
    starts[list(log.restarts)] = True
    moved = np.cumsum(keep)[np.flatnonzero(starts)] - keep[np.flatnonzero(starts)]
    return dataclasses.replace(log.take(keep), restarts=tuple(moved.tolist())).also(found)


def _repeated_rows(log: Log, where: str) -> Log:
    """Return a log in which no two rows of a run have the same time; every reading is kept."""
    same = np.diff(log.time_s, prepend=np.nan) == 0.0
    same[list(log.restarts)] = False
    if not same.any():
        return log
    copies = same.copy()
    for values in (*log.columns.values(), *log.marks.values()):
        equal = np.empty(log.rows, dtype=bool)
        equal[0] = False
        equal[1:] = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        copies &= equal
    if copies.any() and same.mean() < _COARSE:
        lost = int(copies.sum())
        starts = np.zeros(log.rows, dtype=bool)
        starts[list(log.restarts)] = True
        log = dataclasses.replace(log.take(~copies), restarts=tuple(np.flatnonzero(starts[~copies]).tolist()))
        sentence = (
            f"{where}: {lost:,} {'row repeats the one' if lost == 1 else 'rows repeat the ones'} "
            f"above, time and all, and {'is' if lost == 1 else 'are'} left out."
        )
        log = log.also(Finding("repeated rows", where, sentence, numbers={"rows": float(lost)}))
        same = same[~copies]
    if not same.any():
        return log
    return _spread(log, same, where)


def _spread(log: Log, same: np.ndarray, where: str) -> Log:
    """Return a log whose rows of one time follow each other: within 1 ms, or evenly where the clock is coarse."""
    position = np.arange(log.rows)
    first = np.maximum.accumulate(np.where(same, 0, position))
    behind = position - first
    group = np.cumsum(~same) - 1
    count = np.bincount(group)[group]
    starts = np.flatnonzero(~same)
    following = np.append(log.time_s[starts[1:]], np.inf) - log.time_s[starts]
    typical = following[np.isfinite(following) & (following > 0.0)]
    usual = float(np.median(typical)) if typical.size else 1.0
    following = np.where(np.isfinite(following) & (following > 0.0), following, usual)[group]
    coarse = float(same.mean()) > _COARSE
    step = following / count if coarse else np.minimum(_MOVED_S, following / (count + 1))
    time_s = log.time_s + behind * step
    number = int(same.sum())
    if coarse:
        sentence = (
            f"{where}: the clock counts in {usual:g} s and {same.mean():.0%} of the rows share their time with the row "
            "above; they are spread evenly."
        )
    else:
        sentence = (
            f"{where}: {number:,} {'row has' if number == 1 else 'rows have'} the time of the row above "
            "and other readings, "
            f"as at the start of a step; each is kept, at most {1e3 * _MOVED_S:g} ms later."
        )
    found = Finding(
        "same time", where, sentence, "warning" if coarse else "note", "time_s", numbers={"rows": float(number)}
    )
    return dataclasses.replace(log, time_s=time_s).also(found)


def _against_stamps(log: Log, where: str) -> Log:
    """Return a log with what its elapsed time and its time stamps say of each other."""
    stamps = log.stamp_s
    if stamps is None or log.restarts or np.isfinite(stamps).sum() < 3:
        return log
    there = np.isfinite(stamps)
    if log.time_s.size and np.array_equal(log.time_s[there], stamps[there] - stamps[there][0]):
        return log
    elapsed, read = log.time_s[there], stamps[there]
    off = (read - read[0]) - (elapsed - elapsed[0])
    resolution = float(np.median(np.diff(np.unique(read)))) if np.ptp(read) > 0.0 else 1.0
    # Stamps that repeat are rounded, to the hundredth of a day in some files; others are late by no more than a minute.
    rounded = float(np.mean(np.diff(read) == 0.0)) > _COARSE
    jumps = np.abs(np.diff(off)) > max(_SLACK_S, 2.0 * (resolution if rounded else min(resolution, 60.0)))
    found: list[Finding | Decision] = []
    if jumps.any():
        places = np.flatnonzero(jumps)
        largest = places[int(np.argmax(np.abs(np.diff(off)[places])))]
        by = float(np.diff(off)[largest])
        hour = " (a change of summer time)" if abs(abs(by) - 3600.0) < max(5.0, resolution) else ""
        often = "once," if places.size == 1 else f"{places.size} times, most"
        sentence = (
            f"{where}: time stamps and elapsed time part {often} by {by:.6g} s at "
            f"{elapsed[largest]:.6g} s"
            f"{hour}; the elapsed time is used."
        )
        found.append(
            Finding("clock jump", where, sentence, "warning", "time_s", spans(np.append(jumps, False), elapsed),
                    {"largest_s": by, "jumps": float(places.size)})
        )  # fmt: skip
    steady = off - np.concatenate([[0.0], np.cumsum(np.where(jumps, np.diff(off), 0.0))])
    length = float(elapsed[-1] - elapsed[0])
    drift = float(steady[-1] - steady[0])
    if length > 0.0 and abs(drift) > max(_DRIFT * length, _SLACK_S, 2.0 * resolution):
        sentence = (
            f"{where}: the elapsed time runs {1e6 * drift / length:+.0f} ppm against the time "
            f"stamps ({drift:+.3g} s in all)."
        )
        found.append(Finding("clock drift", where, sentence, "warning", "time_s", numbers={"drift_s": drift}))
    return log.also(*found)
