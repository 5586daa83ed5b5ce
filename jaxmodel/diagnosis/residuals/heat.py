"""Missing or excess heat of a model: a temperature error that follows the square of the drive.

If a body with the time constant tau receives the power c drive^2 more than its model states, its temperature error is c
times q(t) = integral of drive^2 exp(-(t - t') / tau) dt' / tau. One time constant, found on a grid, serves all runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.special import stdtr

from jaxmodel.diagnosis.residuals.runs import BLOCKS
from jaxmodel.diagnosis.residuals.table import ChannelResiduals, Floats

TIME_CONSTANTS_S = tuple(float(x) for x in np.geomspace(30.0, 30_000.0, 13))
# Share of the channel's mean square from which a slow error is called heat.
LEAST_SHARE = 0.3
SURE = 1e-3
# Share of a run, by time, over which its end is averaged.
END = 0.05
_STEPS = 2000  # of a uniform grid over a run


@dataclass(frozen=True, eq=False)
class Heat:
    """A temperature error that follows the square of the drive.

    Attributes:
        explained: (n,) part of each reading's error that heat explains.
        rise: by run number, measured minus modelled at the end of the run, minus the same at its beginning.
        share: part of the mean square that it explains.
    """

    explained: Floats
    rise: dict[int, float]
    share: float


def heat(residuals: ChannelResiduals, drive: str) -> Heat | None:
    """Return the missing or excess heat that a temperature channel shows; None if it shows none.

    Most of the error must follow the square of the drive, with one sign in nearly all runs, and the largest error at
    the end of a run must be at least three times the sensor noise.
    """
    square = residuals.conditions[drive] ** 2
    if residuals.error.size == 0 or not np.any(square > 0.0):
        return None
    weight, total = residuals.weight_s, np.sum(residuals.weight_s * residuals.error**2)
    best, strongest = 0.0, None
    for tau in TIME_CONSTANTS_S:
        response = _smoothed(residuals, square / square.mean(), tau)
        own = np.sum(weight * response**2)
        explained = np.sum(weight * response * residuals.error) ** 2 / (own * total) if own * total > 0.0 else 0.0
        if explained > best:
            best, strongest = float(explained), response
    if strongest is None or best < LEAST_SHARE:
        return None
    amplitude = np.sum(weight * strongest * residuals.error) / np.sum(weight * strongest**2)
    rise = {number: _rise(residuals, number) for number in residuals.runs}
    largest = max(rise.values(), key=abs)
    noise = residuals.noise_sd if np.isfinite(residuals.noise_sd) else 0.0
    if largest * amplitude <= 0.0 or abs(largest) < 3.0 * noise or not _is_sure(residuals, strongest, float(amplitude)):
        return None
    return Heat(amplitude * strongest, rise, best)


def _smoothed(residuals: ChannelResiduals, power: Floats, tau_s: float) -> Floats:
    """Return the power filtered by a first-order lag, from 0 at the beginning of every run."""
    found = np.zeros(power.size)
    for number in residuals.runs:
        mine = residuals.run == number
        time_s = residuals.time_s[mine]
        even = np.linspace(0.0, max(float(time_s[-1]), 1e-9), _STEPS)
        kept = np.exp(-(even[1] - even[0]) / tau_s)
        # Readings closer than the grid are averaged.
        until = np.append(0.0, np.cumsum(power[mine] * np.diff(time_s, prepend=0.0)))
        given = np.diff(np.interp(even, np.append(0.0, time_s), until), prepend=0.0) / (even[1] - even[0])
        # The filter y_k = kept y_(k-1) + (1 - kept) x_k, as a system of two diagonals.
        diagonals = np.array([np.ones(_STEPS), np.full(_STEPS, -kept)])
        response = solve_banded((1, 0), diagonals, (1.0 - kept) * given, overwrite_ab=True, check_finite=False)
        found[mine] = np.interp(time_s, even, response)
    return found


def _rise(residuals: ChannelResiduals, run: int) -> float:
    mine = residuals.run == run
    time_s, error, weight = residuals.time_s[mine], residuals.error[mine], residuals.weight_s[mine]
    ends = [time_s >= time_s[-1] - END * (time_s[-1] - time_s[0]), time_s <= time_s[0] + 0.2 * END * time_s[-1]]
    late, early = (float(np.average(error[part], weights=weight[part])) for part in ends)
    return late - early


def _is_sure(residuals: ChannelResiduals, response: Floats, amplitude: float) -> bool:
    """Return whether the amplitude is significant against the scatter of blocks and of one sign in nearly all runs."""
    weight, left = residuals.weight_s, residuals.error - amplitude * response
    own = np.array([np.sum((weight * response * residuals.error)[residuals.run == n]) for n in residuals.runs])
    size = np.array([np.sum((weight * response**2)[residuals.run == n]) for n in residuals.runs])
    counted = size > 0.02 * size.sum()
    same_sign = np.sum((own * amplitude > 0.0) & counted)
    if same_sign < 0.75 * counted.sum() or same_sign == 0:
        return False
    scores = np.bincount(residuals.time_blocks(BLOCKS), weight * response * left)
    # Residuals of a temperature are correlated over a large part of a run.
    blocks = scores.size // 3
    scores = np.add.reduceat(scores, np.arange(0, scores.size, 3))
    sd = np.sqrt(np.sum(scores**2) * blocks / max(blocks - 1, 1)) / np.sum(weight * response**2)
    return bool(sd == 0.0 or 2.0 * stdtr(max(blocks - 1, 1), -abs(amplitude) / sd) < SURE)
