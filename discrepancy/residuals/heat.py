"""Heat that a model lacks or has too much of, seen by a thermometer: an error that follows the square of the drive.

A body with the time constant tau that is given the power c drive^2 beyond what its model gives it is off by c times
q(t) = integral of drive^2 exp(-(t - t') / tau) dt' / tau. One time constant, sought over a grid, serves all runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.stats import t as student

from discrepancy.residuals.runs import BLOCKS
from discrepancy.residuals.table import ChannelResiduals, Floats

TIME_CONSTANTS_S = tuple(float(x) for x in np.geomspace(30.0, 30_000.0, 13))
# Of the channel's mean square: less is not told as heat, which is a strong word for a slow error.
LEAST_SHARE = 0.3
SURE = 1e-3
# Of a run, by time, from its end: over which "the end" is averaged.
END = 0.05
_STEPS = 2000  # of an even grid over a run


@dataclass(frozen=True, eq=False)
class Heat:
    """A thermometer's error that follows what heats.

    Attributes:
        told: (n,) what heat explains of each reading's error.
        rise: by run number, measured above modelled at the run's end, beyond what it was at the beginning.
        share: part of the mean square that it explains.
    """

    told: Floats
    rise: dict[int, float]
    share: float


def heat(residuals: ChannelResiduals, drive: str) -> Heat | None:
    """Return the heat that a thermometer's channel tells of, None where it tells of none.

    Most of its error must follow what heats, in all runs of a size, and at the end of one it must be well above what
    the instrument's noise does to a single reading.
    """
    square = residuals.conditions[drive] ** 2
    if residuals.error.size == 0 or not np.any(square > 0.0):
        return None
    weight, total = residuals.weight_s, np.sum(residuals.weight_s * residuals.error**2)
    best, courses = 0.0, None
    for tau in TIME_CONSTANTS_S:
        course = _smoothed(residuals, square / square.mean(), tau)
        own = np.sum(weight * course**2)
        explained = np.sum(weight * course * residuals.error) ** 2 / (own * total) if own * total > 0.0 else 0.0
        if explained > best:
            best, courses = float(explained), course
    if courses is None or best < LEAST_SHARE:
        return None
    amplitude = np.sum(weight * courses * residuals.error) / np.sum(weight * courses**2)
    rise = {number: _rise(residuals, number) for number in residuals.runs}
    largest = max(rise.values(), key=abs)
    noise = residuals.noise_sd if np.isfinite(residuals.noise_sd) else 0.0
    if largest * amplitude <= 0.0 or abs(largest) < 3.0 * noise or not _is_sure(residuals, courses, float(amplitude)):
        return None
    return Heat(amplitude * courses, rise, best)


def _smoothed(residuals: ChannelResiduals, power: Floats, tau_s: float) -> Floats:
    """Return power as a body of one time constant averages it, from 0 at the beginning of every run."""
    found = np.zeros(power.size)
    for number in residuals.runs:
        mine = residuals.run == number
        time_s = residuals.time_s[mine]
        even = np.linspace(0.0, max(float(time_s[-1]), 1e-9), _STEPS)
        kept = np.exp(-(even[1] - even[0]) / tau_s)
        # Of readings closer than the grid the mean counts.
        until = np.append(0.0, np.cumsum(power[mine] * np.diff(time_s, prepend=0.0)))
        given = np.diff(np.interp(even, np.append(0.0, time_s), until), prepend=0.0) / (even[1] - even[0])
        course = lfilter([1.0 - kept], [1.0, -kept], given)
        found[mine] = np.interp(time_s, even, course)
    return found


def _rise(residuals: ChannelResiduals, run: int) -> float:
    mine = residuals.run == run
    time_s, error, weight = residuals.time_s[mine], residuals.error[mine], residuals.weight_s[mine]
    ends = [time_s >= time_s[-1] - END * (time_s[-1] - time_s[0]), time_s <= time_s[0] + 0.2 * END * time_s[-1]]
    late, early = (float(np.average(error[part], weights=weight[part])) for part in ends)
    return late - early


def _is_sure(residuals: ChannelResiduals, course: Floats, amplitude: float) -> bool:
    """Return whether the amplitude is beyond the scatter of blocks, and of one sign in nearly all runs."""
    weight, left = residuals.weight_s, residuals.error - amplitude * course
    own = np.array([np.sum((weight * course * residuals.error)[residuals.run == n]) for n in residuals.runs])
    size = np.array([np.sum((weight * course**2)[residuals.run == n]) for n in residuals.runs])
    counted = size > 0.02 * size.sum()
    alike = np.sum((own * amplitude > 0.0) & counted)
    if alike < 0.75 * counted.sum() or alike == 0:
        return False
    scores = np.bincount(residuals.time_blocks(BLOCKS), weight * course * left)
    # What is left of the course of a warm body hangs together over a good part of a run.
    blocks = scores.size // 3
    scores = np.add.reduceat(scores, np.arange(0, scores.size, 3))
    sd = np.sqrt(np.sum(scores**2) * blocks / max(blocks - 1, 1)) / np.sum(weight * course**2)
    return bool(sd == 0.0 or 2.0 * student.sf(abs(amplitude) / sd, max(blocks - 1, 1)) < SURE)
