"""Pulses and steps of a run: spans of a held load, each seen from just before the load comes to the end of its rest.

A load is held where its drive (current, voltage or duty) stays within a tenth of its range in the run. A drive cycle,
in which it does not for most of the time, has no pulses.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.case.records import Run

# What drives a run, the first that it has.
DRIVES = ("current_A", "pack_current_A", "voltage_V", "V_set", "duty", "load_torque_Nm")
# A change by more than this share of the drive's range is another level; a level below it is a rest.
LEVEL = 0.1
# A held span has so many rows at least, and such spans are so much of a run's time.
LEAST_ROWS, LEAST_SHARE = 3, 0.8
# A rest is shown for so many times the load before it.
REST_SHOWN = 3.0
# A run has pulses or steps from so many on.
LEAST = 2


@dataclasses.dataclass(frozen=True)
class Pulse:
    """One load and what follows it.

    Attributes:
        before: the last row before the load comes.
        last: the last row that is shown: the end of the load, or a part of the rest after it.
        off: the first row after the load.
        level: mean of the drive under the load.
        drive: the column that drives the run.
    """

    before: int
    last: int
    off: int
    level: float
    drive: str

    @property
    def rows(self) -> slice:
        """Return the rows that are shown."""
        return slice(self.before, self.last + 1)


@dataclasses.dataclass(frozen=True)
class _Span:
    """Rows [first, after) at one level."""

    first: int
    after: int
    level: float


def pulses(run: Run) -> tuple[Pulse, ...]:
    """Return the pulses and steps of a run in their order; none of a drive cycle, a ramp, or a single load."""
    for drive in DRIVES:
        if drive in run.measured.inputs and (found := _of_drive(run, drive)):
            return found
    return ()


def _of_drive(run: Run, drive: str) -> tuple[Pulse, ...]:
    values, time_s = run.measured.inputs[drive], run.measured.time_s
    spread = float(np.ptp(values))
    if not spread > 0.0:
        return ()
    spans = _held(values, LEVEL * spread)
    # A row's input holds over the interval that ends at its time.
    seconds = [float(time_s[one.after - 1] - time_s[max(one.first - 1, 0)]) for one in spans]
    if sum(seconds) < LEAST_SHARE * float(time_s[-1] - time_s[0]):
        return ()
    rest = LEVEL * float(np.max(np.abs(values)))
    found = []
    for place, (span, length_s) in enumerate(zip(spans, seconds, strict=True)):
        if span.first == 0 or abs(span.level) <= rest:
            continue
        last = span.after - 1
        following = spans[place + 1] if place + 1 < len(spans) else None
        if following is not None and abs(following.level) <= rest:
            until = time_s[last] + REST_SHOWN * length_s
            last = min(following.after - 1, int(np.searchsorted(time_s, until, side="right")) - 1)
        found.append(Pulse(span.first - 1, max(last, span.after - 1), span.after, span.level, drive))
    return tuple(found) if len(found) >= LEAST else ()


def _held(values: np.ndarray, change: float) -> list[_Span]:
    """Return the spans in which a drive stays at one level, without those of few rows."""
    begins = np.append(0, np.flatnonzero(np.abs(np.diff(values)) > change) + 1)
    ends = np.append(begins[1:], values.size)
    found = []
    for first, after in zip(begins.tolist(), ends.tolist(), strict=True):
        part = values[first:after]
        if after - first >= LEAST_ROWS and float(np.ptp(part)) <= 2.0 * change:
            found.append(_Span(first, after, float(np.mean(part))))
    return found
