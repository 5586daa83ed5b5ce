"""Steps of several rows where the inputs of a run are steady: a rest, a constant current, a motor at one voltage.

A step takes more rows the longer the inputs have been steady, and ends in a reading, so that no part of a run goes
unread: the last minutes of a discharge may hold half of the error. Where a channel moves by more than a small share of
its range such a step is several, of which the last is read: more readings there would count for more than they do in
the error of the run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from jaxmodel.case.measurements import Measured

# Rows from which inputs that do not change are steady.
_STEADY_ROWS = 20
# An input changes where it differs from the row before by this share of its range, beside the most that is noise: so
# many sd, of at most a share of its range.
_CHANGE, _OF_NOISE, _MOST_NOISE = 0.02, 5.0, 0.01
# Steps of steady inputs: the share of its range by which a channel may move in one; the length as a share of the time
# for which the inputs have been steady, and of the run. Times a factor, the least that gives few enough steps; beyond 5
# a step is no longer a small part of what it follows. Runs keep readings as they have rows: each counts in an error.
_MOVES, _GROWS, _LONGEST = 0.005, 0.1, 1.0 / 500.0
_FACTORS = 1.3 ** np.arange(-16, 7)
# Share of its range over which an input may vary within a step, beyond its noise: a ramp is not steady.
_HELD = 0.002
# Share of its range by which the input of a reading may differ from that of the step that ends in it.
_ALIKE = 0.001


@dataclasses.dataclass(frozen=True)
class Signal:
    """A load or a channel of a run.

    Attributes:
        values: (rows,) without gaps.
        span: largest minus smallest value.
        read: (rows,) True where it was read.
        held: share of its span over which it may vary within a step, beyond its noise.
    """

    values: np.ndarray
    span: float
    read: np.ndarray
    held: float = 0.0

    def noise(self, first: int, last: int) -> float:
        """Return the sd from reading to reading within some rows."""
        rows = slice(first, last + 1)
        differences = np.diff(self.values[rows][self.read[rows]], 2)
        return float(np.median(np.abs(differences))) / (0.6745 * np.sqrt(6.0)) if differences.size else 0.0


@dataclasses.dataclass(frozen=True)
class Stretch:
    """Adjacent rows in which no load changes from one to the next.

    Attributes:
        first: row.
        last: row.
        loads: values of each (rows,), and by how much they may vary within a step.
        channels: values of each (rows,), by how much they may move within one, times its factor, and beside it.
    """

    first: int
    last: int
    loads: tuple[tuple[np.ndarray, float], ...]
    channels: tuple[tuple[np.ndarray, float, float], ...]


@dataclasses.dataclass(frozen=True)
class Steps:
    """Steps in steady stretches.

    Attributes:
        read: last rows of steps that end in a reading.
        silent: of the others.
    """

    read: np.ndarray
    silent: np.ndarray

    @property
    def count(self) -> int:
        """Return how many steps there are."""
        return self.read.size + self.silent.size


def stretches(measured: Measured) -> list[Stretch]:
    """Return the stretches of a run whose inputs are steady, in order of time."""
    loads, changes = _loads(measured), np.zeros(measured.time_s.size, dtype=bool)
    changes[:2] = True
    for load in loads:
        least = _CHANGE + _OF_NOISE * _MOST_NOISE if load.held else 0.0
        changes[1:] |= np.abs(np.diff(load.values)) > least * load.span
    begins = np.flatnonzero(changes)
    ends = np.append(begins[1:], changes.size) - 1
    long = ends - begins + 1 >= _STEADY_ROWS
    channels = [_signal(values) for values in measured.outputs.values()]
    return [_stretch(int(at), int(to), loads, channels) for at, to in zip(begins[long], ends[long], strict=True)]


def _stretch(first: int, last: int, loads: Sequence[Signal], channels: Sequence[Signal]) -> Stretch:
    held = (
        (one.values, one.held * one.span + 2.0 * _OF_NOISE * min(one.noise(first, last), _MOST_NOISE * one.span))
        for one in loads
    )
    move = ((one.values, _MOVES * one.span, _OF_NOISE * one.noise(first, last)) for one in channels)
    return Stretch(first, last, tuple(held), tuple(move))


def finest(measured: Measured, found: Sequence[Stretch], most: int) -> Steps | None:
    """Return the finest steps in stretches of which there are at most so many; None if there are none.

    Args:
        measured: the run.
        found: its stretches.
        most: number of steps.
    """
    loads = _loads(measured)
    readings = np.sum([np.isfinite(values) for values in measured.outputs.values()], axis=0)
    chosen, low, high = None, 0, _FACTORS.size - 1
    while found and low <= high:
        middle = (low + high) // 2
        steps = _steps(measured.time_s, readings, loads, found, float(_FACTORS[middle]), most)
        if steps is not None and steps.count <= most:
            chosen, high = steps, middle - 1
        else:
            low = middle + 1
    return chosen


def _steps(
    time_s: np.ndarray,
    readings: np.ndarray,
    loads: Sequence[Signal],
    found: Sequence[Stretch],
    factor: float,
    most: int,
) -> Steps | None:
    """Return the steps in stretches; None if they are too many.

    Args:
        time_s: (rows,) of the run.
        readings: (rows,) how many channels are read at a row.
        loads: of the run.
        found: its stretches.
        factor: on the length of steps, and on what may move within one.
        most: number of steps.
    """
    read: list[int] = []
    silent: list[int] = []
    for stretch in found:
        for first, until in _intervals(time_s, readings, stretch, factor):
            ends = _ends(stretch, first, until, factor)
            before = ends[-2] if len(ends) > 1 else first
            silent += ends[:-1]
            if until > before + 1 and not all(_is_mean(load, time_s, before, until) for load in loads):
                silent.append(until - 1)  # the reading has a step of its own
            read.append(until)
            if len(read) + len(silent) > most:
                return None
    return Steps(np.array(read, dtype=int), np.array(silent, dtype=int))


def _intervals(
    time_s: np.ndarray, readings: np.ndarray, stretch: Stretch, factor: float
) -> Iterator[tuple[int, int]]:  # fmt: skip
    """Give the row before each reading's interval, and the row that is read."""
    longest_s = factor * _LONGEST * float(time_s[-1] - time_s[0])
    begin = first = stretch.first - 1
    while first < stretch.last:
        length_s = min(longest_s, factor * _GROWS * float(time_s[first] - time_s[begin]))
        until = int(np.searchsorted(time_s, time_s[first] + length_s, side="right")) - 1
        until = min(stretch.last, max(first + 1, until))
        if until > first + 1:  # the last of the rows in which most channels are read
            until -= int(np.argmax(readings[first + 1 : until + 1][::-1]))
        yield first, until
        first = until


def _ends(stretch: Stretch, first: int, until: int, factor: float) -> list[int]:
    """Return the last rows of the steps from one row to another, within which nothing moves."""
    most_off = [(values, factor * share + noise) for values, share, noise in stretch.channels]
    ends: list[int] = []
    while first < until:
        last = until
        while last > first + 1 and (
            any(abs(values[last] - values[first]) > most for values, most in most_off)
            or any(np.ptp(values[first + 1 : last + 1]) > most for values, most in stretch.loads)
        ):
            last = first + (last - first) // 2
        ends.append(last)
        first = last
    return ends


def _is_mean(load: Signal, time_s: np.ndarray, first: int, last: int) -> bool:
    """Return whether a load at a row is its mean over the rows (first, last]."""
    mean = np.average(load.values[first + 1 : last + 1], weights=np.diff(time_s[first : last + 1]))
    return bool(abs(load.values[last] - mean) <= _ALIKE * load.span)


def _signal(values: np.ndarray, held: float = 0.0) -> Signal:
    """Return a load or channel, without gaps."""
    read = np.isfinite(values)
    if not read.any():
        return Signal(np.zeros(values.size), 0.0, read, held)
    filled = values[np.maximum.accumulate(np.where(read, np.arange(values.size), np.argmax(read)))]
    return Signal(filled, float(np.ptp(filled)), read, held)


def _loads(measured: Measured) -> list[Signal]:
    """Return the inputs but for temperatures, which act slowly, and where they change hardly count.

    What a controller follows counts by how far it is from what is reached: it must not vary at all.
    """
    found = [
        _signal(values, 0.0 if name.startswith("reference_") else _HELD)
        for name, values in measured.inputs.items()
        if not name.endswith("degC")
    ]
    # A current that is the same all along varies by its noise alone.
    return [dataclasses.replace(one, span=max(one.span, float(np.abs(one.values).max()))) for one in found]
