"""Splitting a log into runs: at restarts of its clock, rests, cycles or steps."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.importing.ambient import THERMOMETERS
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log
from jaxmodel.data.importing.options import Options

# A current below this share of the largest one is a rest.
_REST = 0.01
_FEWEST_ROWS = 10
# A gap lasts so many times as long as the median of so many intervals on each side, and so long at least [s].
_GAP, _AROUND, _LEAST_GAP_S = 100.0, 5, 30.0
# Where the row before it rests, so many times, and so long at least [s].
_GAP_OF_REST, _LEAST_REST_S = 1000.0, 3600.0
# Intervals that are each at most so many times as long as the next shorter one are those of one logger. Assumed.
_NEXT_LONGER = 3.0
# A load goes on over a gap if it changes by this share at most, and was within the second one of it for long before.
_SAME_LOAD, _LIKE_LOAD = 0.2, 0.5
# Over a gap without load a cell's temperature changes by so many kelvins only if that of its surroundings did. Assumed.
_OTHER_SURROUNDINGS_K = 5.0
_LOADS = ("current_A", "pack_current_A", "motor_current_A", "duty")


def split(log: Log, options: Options) -> list[Log]:
    """Return the runs of a log, each from its own time 0, named after the file; a single one has the file's name.

    Args:
        log: with a clock.
        options: `split_at`, `rest_minutes`.

    Raises:
        MeasurementError: every part is shorter than a run.
    """
    where = file_label(log.source)
    gaps = [] if options.split_at == "files" else _after_gaps(log)
    begins = sorted({0, *log.restarts, *_asked(log, options), *gaps})
    pieces = [log.take(slice(a, b)) for a, b in zip(begins, [*begins[1:], log.rows], strict=True)]
    long = [piece for piece in pieces if piece.rows >= min(_FEWEST_ROWS, log.rows)]
    if not long:
        part = {"steps": "step", "rests": "part between rests"}.get(
            options.split_at, "part between restarts of its clock"
        )
        sizes = sorted({piece.rows for piece in pieces})
        rows = f"{sizes[0]} rows" if len(sizes) == 1 else f"at most {sizes[-1]} rows"
        raise MeasurementError(
            f"{where}: each {part} has {rows}, and a run needs {_FEWEST_ROWS}; import it without --split-at."
        )
    found: list[Finding | Decision] = []
    if short := len(pieces) - len(long):
        rows = sum(piece.rows for piece in pieces) - sum(piece.rows for piece in long)
        parts = "1 part" if short == 1 else f"{short} parts"
        sentence = (
            f"{where}: {parts} of fewer than {_FEWEST_ROWS} rows ({rows} {'row' if rows == 1 else 'rows'} in all) "
            f"{'is' if short == 1 else 'are'} left out."
        )
        found.append(Finding("short parts", where, sentence, "warning", numbers={"rows": float(rows)}))
    if gaps:
        found.append(_about_gaps(log, gaps, where))
    if len(long) > 1:
        found.append(Decision("runs", where, f"{len(long)} runs", _why(log, options, gaps), "file"))
    digits = len(str(len(long)))
    named = [
        piece.take(slice(None), log.name if len(long) == 1 else f"{log.name}-{number:0{digits}d}")
        for number, piece in enumerate(long, start=1)
    ]
    runs = [_from_zero(piece) for piece in named]
    # What was found in the file is told once.
    return [
        run.also(*found) if number == 0 else _untold(run) for number, run in enumerate(runs)
    ]  # fmt: skip


def _untold(run: Log) -> Log:
    return dataclasses.replace(run, findings=(), decisions=())


def _from_zero(piece: Log) -> Log:
    start = float(piece.time_s[0])
    return piece if start == 0.0 else dataclasses.replace(piece, time_s=piece.time_s - start)


def _why(log: Log, options: Options, gaps: list[int]) -> str:
    begins = "where its clock begins anew" if log.restarts or not gaps else ""
    begins = {"rests": "at rests", "steps": "at cycles or steps"}.get(options.split_at, begins)
    return " and ".join([*([begins] if begins else []), *(["after gaps"] if gaps else [])])


def _after_gaps(log: Log) -> list[int]:
    """Return the rows that follow gaps a hundred times as long as the rows around them, after which all is unknown.

    With load on both sides, what flowed meanwhile is not known, unless a load was held for longer than the gap and is
    there after it. After a rest it is not what the row after the gap has, if that is loaded and the gap a thousand
    times as long as the rows. Without load, the surroundings are not known, if no column is their temperature and the
    cell has another. A log that is thinned has long intervals side by side, and no gap; one that is written where
    something changes has intervals of every length up to its longest.
    """
    load = next((log.columns[name] for name in _LOADS if name in log.columns), None)
    if load is None or log.rows < 2 * _AROUND:
        return []
    load = np.nan_to_num(load)
    apart = np.diff(log.time_s)
    least = max(_LEAST_GAP_S, _longest_usual(apart))
    size = np.abs(load)
    loaded = size > _REST * float(size.max())
    both, other = loaded[:-1] & loaded[1:], _other_surroundings(log)
    begun = ~loaded[:-1] & loaded[1:] & (apart > _LEAST_REST_S)
    found: list[int] = []
    for row in np.flatnonzero((apart > least) & (both | other | begun)).tolist():
        before, after = apart[max(row - _AROUND, 0) : row], apart[row + 1 : row + 1 + _AROUND]
        usual = max((float(np.median(part)) for part in (before, after) if part.size), default=np.inf)
        if apart[row] < (_GAP if both[row] or other[row] else _GAP_OF_REST) * usual or row + 1 in log.restarts:
            continue
        if other[row] or not both[row] or not _goes_on(log.time_s, load, row, max([0, *found])):
            found.append(row + 1)
    return found


def _longest_usual(apart: np.ndarray) -> float:
    """Return the longest interval that others lead up to, each at most so many times the one below it [s]."""
    lengths = np.sort(apart[apart > 0.0])
    above = lengths[lengths.size // 2 :]
    jumps = np.flatnonzero(above[1:] > _NEXT_LONGER * above[:-1])
    last = int(jumps[0]) if jumps.size else above.size - 1
    return float(above[last]) if above.size else 0.0


def _goes_on(time_s: np.ndarray, load: np.ndarray, row: int, begin: int) -> bool:
    """Return whether a load that is much the same after a gap was held for longer than the gap before it."""
    if abs(load[row + 1] - load[row]) > _SAME_LOAD * abs(load[row]):
        return False
    others = np.flatnonzero(np.abs(load[begin:row] - load[row]) > _LIKE_LOAD * abs(load[row]))
    since = begin + (int(others[-1]) + 1 if others.size else 0)
    return bool(time_s[row] - time_s[since] >= time_s[row + 1] - time_s[row])


def _other_surroundings(log: Log) -> np.ndarray:
    """Return between which rows the surroundings changed, as far as the hardware's own temperature tells."""
    warmth = next((log.columns[name] for name in THERMOMETERS if name in log.columns), None)
    if warmth is None or "ambient_degC" in log.columns:
        return np.zeros(log.rows - 1, dtype=bool)
    return np.abs(np.diff(warmth)) > _OTHER_SURROUNDINGS_K


def _about_gaps(log: Log, gaps: list[int], where: str) -> Finding:
    apart = np.diff(log.time_s)
    longest = max(gaps, key=lambda row: apart[row - 1])
    many = len(gaps) > 1
    moved = _other_surroundings(log)[np.array(gaps) - 1]
    what = {0: "before a load", len(gaps): "after which the temperature is another"}
    sentence = (
        f"{where}: {len(gaps)} {'gaps' if many else 'gap'} in time "
        f"{what.get(int(moved.sum()), 'before a load, or after which the temperature is another')}, "
        f"{'the longest ' if many else ''}of {apart[longest - 1]:.5g} s from {log.time_s[longest - 1]:.6g} s (rows "
        f"are usually {np.median(apart):.3g} s apart); {'each' if many else 'it'} ends a run, and no charge is counted "
        "over it. --split-at files keeps one run."
    )
    places = tuple((float(log.time_s[row - 1]), float(log.time_s[row])) for row in gaps[:50])
    return Finding("gap", where, sentence, "warning", "time_s", places, {"gaps": float(len(gaps))})


def _asked(log: Log, options: Options) -> list[int]:
    if options.split_at == "rests":
        return _after_rests(log, 60.0 * options.rest_minutes)
    if options.split_at == "steps":
        return _at_marks(log)
    return []


def _after_rests(log: Log, least_s: float) -> list[int]:
    """Return the rows at which load begins after long rests; the last row of the rest belongs to what follows."""
    current = log.columns.get("current_A", log.columns.get("pack_current_A"))
    if current is None:
        return []
    largest = float(np.nanmax(np.abs(current))) if np.isfinite(current).any() else 0.0
    rest = np.nan_to_num(np.abs(current)) <= _REST * largest
    edges = np.flatnonzero(np.diff(rest.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    long = [
        (a, b) for a, b in edges.tolist() if b < log.rows and log.time_s[b - 1] - log.time_s[max(a - 1, 0)] >= least_s
    ]
    return [end - 1 for begin, end in long if begin > 0]


def _at_marks(log: Log) -> list[int]:
    """Return the rows at which the cycle changes, or the step where the file counts no cycles."""
    for key in ("cycle", "step"):
        marks = log.marks.get(key)
        if marks is not None and np.unique(marks[np.isfinite(marks)]).size > 1:
            filled = np.nan_to_num(marks)
            return (np.flatnonzero(np.diff(filled) != 0.0) + 1).tolist()
    return []
