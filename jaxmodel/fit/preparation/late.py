"""A voltage that comes late in one run: its steps follow those of the current by seconds, as in no other run.

A series resistance acts at once. Where one logger of a run had its clock off, or one export held its voltage back, no
effect of all runs is missing. All runs alike have `clock_shift`, which is an effect.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.base.remark import Remark
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import Values

CURRENT, VOLTAGE = "current_A", "voltage_V"
# A step of the current, as a share of its largest size in the run; how many a late run has at least.
STEP, FEWEST = 0.2, 5
# Longest delay that is looked for, in s and in rows; its resolution in rows; steps that are looked at. Assumed.
LONGEST_S, LONGEST_ROWS, FINE, MOST_STEPS = 60.0, 60, 0.25, 60
# A voltage is late by so many rows at least; one is on time within so many.
LATE, ON_TIME = 2.0, 1.0
# Correlation of the steps of voltage and current from which they belong together, and the share of what it lacks of 1
# that the delay leaves at most. Assumed.
TOGETHER, LEFT = 0.7, 0.5
# Of delays nearly as good the shortest is taken: pulses repeat. Assumed.
NEARLY = 0.02


@dataclasses.dataclass(frozen=True)
class Delay:
    """The delay of a run's voltage after its current.

    Attributes:
        seconds: positive where the voltage comes late.
        row_s: time between rows at the steps.
        steps: of the current.
        is_clear: whether a delay is far better than none.
    """

    seconds: float
    row_s: float
    steps: int
    is_clear: bool

    @property
    def rows(self) -> float:
        """Return its size in rows."""
        return abs(self.seconds) / self.row_s


def without_delays(case: Case) -> tuple[Case, tuple[Remark, ...]]:
    """Return a case with voltages on time that come late in their run alone, and a remark on each of these runs."""
    delays = {run.name: found for run in case.runs if (found := delay(run)) is not None}
    if not any(one.rows < ON_TIME for one in delays.values()):
        return case, ()
    runs, remarks = [], []
    for run in case.runs:
        found = delays.get(run.name)
        if found is not None and found.is_clear and found.rows >= LATE and found.steps >= FEWEST:
            runs.append(_on_time(run, found.seconds))
            way = "after" if found.seconds > 0.0 else "before"
            sentence = (
                f"{VOLTAGE} in {run.name} comes {abs(found.seconds):.3g} s {way} its current, by {found.steps} steps, "
                "as in no other run: it was moved to its current; look at the clocks."
            )
            about = f"{VOLTAGE}@{run.name}"
            remarks.append(Remark(sentence, "voltage_late", about, value=found.seconds, steps=float(found.steps)))
        else:
            runs.append(run)
    return dataclasses.replace(case, runs=tuple(runs)), tuple(remarks)


def delay(run: Run) -> Delay | None:
    """Return by how much the steps of a run's voltage follow those of its current; None where that cannot be seen.

    The delay with the largest correlation of the differences of V(t) and -I(t - delay) between rows near steps.
    """
    if VOLTAGE not in run.measured.outputs or CURRENT not in run.measured.inputs:
        return None
    read = np.isfinite(run.measured.outputs[VOLTAGE])
    time_s, voltage, current = (
        one[read] for one in (run.measured.time_s, run.measured.outputs[VOLTAGE], run.measured.inputs[CURRENT])
    )
    if time_s.size < 3:
        return None
    stepping = np.flatnonzero(np.abs(np.diff(current)) > STEP * np.max(np.abs(current))) + 1
    if not stepping.size:
        return None
    row_s = float(np.median(time_s[stepping] - time_s[stepping - 1]))
    longest = min(LONGEST_S, LONGEST_ROWS * row_s, 0.25 * float(time_s[-1] - time_s[0]))
    some = stepping[np.unique(np.linspace(0, stepping.size - 1, MOST_STEPS).round().astype(int))]
    from_row, to_row = (np.searchsorted(time_s, time_s[some] + by) for by in (-longest, longest))
    near = np.unique(np.concatenate([np.arange(*ends) for ends in zip(from_row, to_row, strict=True)]))
    near = near[near > 0]
    jumps = voltage[near] - voltage[near - 1]

    def alike(by: float) -> float:
        now, before = (np.interp(time_s[rows] - by, time_s, current) for rows in (near, near - 1))
        return _correlation(jumps, before - now)

    whole = int(longest / row_s)
    found = {by: alike(by) for by in (row_s * np.arange(-whole, whole + 1)).tolist()}
    about = max(found, key=found.__getitem__)
    found |= {by: alike(by) for by in (about + row_s * np.arange(-1.0, 1.0 + FINE, FINE)).tolist()}
    best, none = max(found.values()), found[0.0]
    if best < TOGETHER:
        return None
    seconds = min((by for by, size in found.items() if size >= best - NEARLY * (1.0 - none)), key=lambda by: abs(by))
    return Delay(seconds, row_s, int(stepping.size), 1.0 - best < LEFT * (1.0 - none))


def _correlation(one: Values, other: Values) -> float:
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0.0 else 0.0


def _on_time(run: Run, seconds: float) -> Run:
    """Return a run with the voltage of so many seconds later at each row; missing beyond the log."""
    time_s, voltage = run.measured.time_s, run.measured.outputs[VOLTAGE]
    read = np.isfinite(voltage)
    moved = np.interp(time_s + seconds, time_s[read], voltage[read], left=np.nan, right=np.nan)
    outputs = run.measured.outputs | {VOLTAGE: moved}
    return dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs))
