"""How errors are weighted: least squares, one weight for each channel, tempered by the autocorrelation of its errors.

    Q = sum_c |e_c|^2 / (s_c^2 m_c) + prior,   s_c^2 = max(noise_c^2, |e_c|^2 / (n_c - m_c df_c)),
    m_c = 1 + 2 sum of the autocorrelation of e_c

The loss is the error that is reported, so that a calibrated model is never worse on fitted runs than the stated one.
n_c / m_c is the number of independent readings: an error that lasts minutes says as much as one reading in minutes. One
weight for all runs: with a weight for each, a run that the model misses would count for two readings and stay missed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.fit.data import FitData

# An autocorrelation below this, or below so many of its sd for white errors, counts as none. Assumed: twice the sd is
# the usual bound in a correlogram.
_NO_CORRELATION, _SD_OF_WHITE = 0.05, 2.0
# Lags beyond this share of a run are not estimated. Assumed.
_LONGEST_LAG = 1.0 / 3.0
# Least share of the independent readings that is left for the sd when many degrees of freedom were used. Assumed.
_LEAST_LEFT = 0.2


@dataclasses.dataclass(frozen=True)
class ChannelWeight:
    """The weight of one channel.

    Attributes:
        sd: s of an error, in the channel's unit.
        inflation: m, readings for each independent one.
        count: readings.
    """

    sd: float
    inflation: float
    count: int

    @property
    def root(self) -> float:
        """Return what errors are multiplied by, 1 / (s sqrt(m))."""
        return 1.0 / (self.sd * np.sqrt(self.inflation))

    @property
    def independent(self) -> float:
        """Return the number of independent readings."""
        return self.count / self.inflation


@dataclasses.dataclass(frozen=True)
class Likelihood:
    """The weight of each channel, by its name."""

    channels: Mapping[str, ChannelWeight]

    def roots(self, data: FitData) -> np.ndarray:
        """Return what the error of each reading is multiplied by, (n,)."""
        root = np.zeros(data.count)
        for name, slices in data.by_channel.items():
            for rows in slices:
                root[rows] = self.channels[name].root
        return root

    def towards(self, other: Likelihood) -> Likelihood:
        """Return the weights half way to others, in their logarithms."""
        return Likelihood(
            {
                name: ChannelWeight(
                    float(np.sqrt(one.sd * other.channels[name].sd)),
                    float(np.sqrt(one.inflation * other.channels[name].inflation)),
                    one.count,
                )
                for name, one in self.channels.items()
            }
        )

    def distance(self, other: Likelihood) -> float:
        """Return the largest change of a logarithm of a weight."""
        return max(
            (abs(np.log(one.root / other.channels[name].root)) for name, one in self.channels.items()), default=0.0
        )


def from_tolerances(data: FitData, tolerances: Mapping[str, float], inflation: float = 20.0) -> Likelihood:
    """Return the weights with which a fit begins, before its errors are known: those of errors of a tolerance.

    Args:
        data: the readings.
        tolerances: by channel, in its unit.
        inflation: assumed; errors of a model last longer than a reading.
    """
    count = {name: sum(rows.stop - rows.start for rows in slices) for name, slices in data.by_channel.items()}
    return Likelihood({name: ChannelWeight(max(tolerances[name], 1e-12), inflation, n) for name, n in count.items()})


def from_errors(data: FitData, errors: np.ndarray, used: Mapping[str, float] | None = None) -> Likelihood:
    """Return the weights that the errors of a model ask for.

    Args:
        data: the readings.
        errors: (n,) measured minus predicted.
        used: by channel, degrees of freedom that the unknowns took of its independent readings; none if not given.
            Without it an overfitted model would raise its own weight from round to round.
    """
    found = {}
    for name, slices in data.by_channel.items():
        series = [errors[rows] for rows in slices]
        count, noise = sum(one.size for one in series), data.noise[name]
        mean_square = sum(float(one @ one) for one in series) / count
        inflation = autocorrelation_time(series)
        if mean_square <= noise**2:
            inflation = min(inflation, max(1.0, inflation * mean_square / noise**2))
        independent = count / inflation
        left = max(independent - (used or {}).get(name, 0.0), _LEAST_LEFT * independent)
        spread = mean_square * independent / left
        found[name] = ChannelWeight(float(np.sqrt(max(spread, noise**2))), inflation, count)
    return Likelihood(found)


def autocorrelation_time(series: Sequence[np.ndarray]) -> float:
    """Return m = 1 + 2 sum of the autocorrelation of errors about zero, pooled over runs; 1 for white ones.

    The sum ends at the first lag at which the autocorrelation is not told from that of white errors.

    Args:
        series: errors of one channel in each run.
    """
    count, longest = sum(one.size for one in series), int(max(one.size for one in series) * _LONGEST_LAG)
    power = sum(float(one @ one) for one in series)
    if longest < 2 or power <= 0.0:
        return 1.0
    sums = np.zeros(longest)
    for one in series:
        length = 1 << int(np.ceil(np.log2(2 * one.size)))
        spectrum = np.fft.rfft(one, length)
        of_lags = np.fft.irfft(spectrum * spectrum.conj(), length)[: min(longest, one.size)]
        sums[: of_lags.size] += of_lags
    shares = sums / power
    least = max(_NO_CORRELATION, _SD_OF_WHITE / np.sqrt(count))
    small = np.flatnonzero(shares <= least)
    last = int(small[0]) if small.size else longest
    return float(max(1.0 + 2.0 * np.sum(shares[1:last]), 1.0))
