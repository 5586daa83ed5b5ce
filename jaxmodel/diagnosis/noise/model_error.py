"""The model error as a process beside the noise: covariance s^2 exp(-dt / tau) for each channel and run, dt in s.

measured = model + delta + epsilon. epsilon is sensor noise (`instrument`), delta an Ornstein-Uhlenbeck process, so that
whitening is a scalar Kalman filter: with the predicted mean m and variance P of delta before a reading y,

    F = h^2 P + R,  K = P h / F,  e = (y - h m) / sqrt(F),
    m' = a (m + K (y - h m)),  P' = a^2 (1 - K h) P + (1 - a^2) s^2

with a = exp(-dt / tau). It is linear in y: the means of all columns come from one bidiagonal solve. If the sensor
noise is AR(1) with correlation w from reading to reading, y is (e_t - w e_s) / sqrt(1 - w^2), which scales slow
deviations by h = sqrt((1 - w) / (1 + w)).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dtbtrs  # type: ignore[attr-defined]

from jaxmodel.diagnosis.settings import SETTINGS, Settings

# One channel of one run; delta is independent between series.
Series = tuple[str, int]
# Model errors that differ by less than this share count as equal.
_NEAR = 0.1
_SIZES = np.concatenate([[0.0], np.geomspace(0.1, 3e4, 23)])


@dataclasses.dataclass(frozen=True)
class ModelError:
    """The model error of every series.

    Attributes:
        sd: s of each series, in the channel's unit; other series have none.
        tau_s: correlation time of each channel that has one.
    """

    sd: Mapping[Series, float] = dataclasses.field(default_factory=dict)
    tau_s: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def of_channel(self, channel: str) -> float:
        """Return the root mean square of s over the runs of a channel, 0 without model error."""
        own = [sd for (name, _), sd in self.sd.items() if name == channel]
        return float(np.sqrt(np.mean(np.square(own)))) if own else 0.0

    def is_near(self, other: ModelError) -> bool:
        """Return True if another model error differs so little that no further fit is needed."""
        if self.sd.keys() != other.sd.keys() or self.tau_s != other.tau_s:
            return False
        return all(abs(np.log(sd / other.sd[series])) < _NEAR for series, sd in self.sd.items())


NONE = ModelError()


@dataclasses.dataclass(frozen=True)
class Chain:
    """The readings of one series in order of time, their noise already made white by differences.

    Attributes:
        series: channel, and index of the run.
        rows: indices in the flat list of readings.
        time_s: of each.
        sd: noise of each, in the channel's unit.
        gain: h of each, the remaining share of slow deviations.
    """

    series: Series
    rows: np.ndarray
    time_s: Float[np.ndarray, " n"]
    sd: Float[np.ndarray, " n"]
    gain: Float[np.ndarray, " n"]


class Whitener:
    """Whitens columns of errors, given the noise and the model error of every series."""

    def __init__(self, chains: Sequence[Chain], error: ModelError, count: int) -> None:
        """Compute the variances of the filter; its means are linear in the values."""
        self._root = np.ones(count)
        self._gain = np.zeros(count)
        self._band = np.zeros((2, count))
        self._band[0] = 1.0
        self._carried = np.zeros(count)
        self._filtered = False
        for chain in chains:
            s, tau = error.sd.get(chain.series, 0.0), error.tau_s.get(chain.series[0], 0.0)
            if s <= 0.0:
                self._root[chain.rows] = chain.sd
                continue
            self._filtered = True
            a, p = _decay(chain.time_s, tau), _variances(chain, s, tau)
            f = chain.gain**2 * p + chain.sd**2
            k = p * chain.gain / f
            self._root[chain.rows] = np.sqrt(f)
            self._gain[chain.rows] = chain.gain
            self._band[1, chain.rows[:-1]] = -(a * (1.0 - k * chain.gain))[:-1]
            self._carried[chain.rows[:-1]] = (a * k)[:-1]

    def __call__(self, values: Float[np.ndarray, "n columns"]) -> Float[np.ndarray, "n columns"]:
        """Return the columns as innovations in units of their sd; rows of a series must be adjacent."""
        if not self._filtered:
            return values / self._root[:, None]
        pushed = np.zeros_like(values, order="F")
        pushed[1:] = self._carried[:-1, None] * values[:-1]
        mean, status = dtbtrs(self._band, pushed, uplo="L", diag="U", overwrite_b=1)
        assert status == 0
        return (values - self._gain[:, None] * mean) / self._root[:, None]


def _decay(time_s: np.ndarray, tau: float) -> np.ndarray:
    """Return exp(-dt / tau) to the next reading; the last has no meaning."""
    return np.exp(-np.append(np.diff(time_s), 0.0) / tau)


def _variances(chain: Chain, s: float, tau: float) -> np.ndarray:
    a2 = (_decay(chain.time_s, tau) ** 2).tolist()
    h2, r = (chain.gain**2).tolist(), (chain.sd**2).tolist()
    p, out, stationary = s * s, [], s * s
    for decay, slow, noise in zip(a2, h2, r, strict=True):
        out.append(p)
        p = decay * p * noise / (slow * p + noise) + (1.0 - decay) * stationary
    return np.array(out)


def estimate(
    chains: Sequence[Chain],
    errors: Float[np.ndarray, " n"],
    tolerance: Mapping[str, float] | None = None,
    settings: Settings = SETTINGS,
) -> ModelError:
    """Return the most probable model error of every series, given the residuals of a model.

    Each channel has one correlation time; each run has its own size, distributed about that of all runs. A channel has
    no model error if the likelihood gains less than `settings.least_error_gain`. A real model error is not an
    Ornstein-Uhlenbeck process but a smooth function of the missing physics. Therefore s is at least the RMS residual,
    and is raised towards a share of the tolerance; otherwise a very precise sensor would decide alone.

    Args:
        chains: all series.
        errors: residuals of the richest model of the round, noise differenced as in `Chain`.
        tolerance: by channel, the largest s, in the channel's unit.
        settings: the constants.
    """
    sd: dict[Series, float] = {}
    tau_s: dict[str, float] = {}
    for channel in dict.fromkeys(chain.series[0] for chain in chains):
        owned = [chain for chain in chains if chain.series[0] == channel]
        scale = float(np.median(np.concatenate([chain.sd for chain in owned])))
        sizes = scale * _SIZES
        taus = _correlation_times(owned, settings)
        tables = _log_likelihoods(owned, errors, sizes, taus)
        prior = -0.5 * (np.log(taus / settings.correlation_time_median_s) / settings.correlation_time_spread) ** 2
        spread = np.log(sizes[1:, None] / sizes[None, 1:]) / settings.error_from_run_to_run
        # For each common size, the best size of every run about it.
        near = tables[:, :, 1:, None] - 0.5 * spread**2
        together = near.max(axis=2).sum(axis=0) + prior[:, None]
        number, common = np.unravel_index(np.argmax(together), together.shape)
        if together[number, common] - tables[:, 0, 0].sum() < settings.least_error_gain:
            continue
        tau_s[channel] = float(taus[number])
        most = max((tolerance or {}).get(channel, np.inf), scale)
        for chain, table in zip(owned, near[:, number, :, common], strict=True):
            probable = _peak(np.log(sizes[1:]), table)
            raised = min(settings.least_error_share * most, settings.largest_raise * probable) if tolerance else 0.0
            sd[chain.series] = min(max(probable, _beyond(errors, chain), raised), most)
    return ModelError(sd, tau_s)


def _beyond(errors: np.ndarray, chain: Chain) -> float:
    """Return the root mean square of a series above its noise."""
    return float(np.sqrt(max(np.mean(errors[chain.rows] ** 2 - chain.sd**2), 0.0)))


def _correlation_times(chains: Sequence[Chain], settings: Settings) -> np.ndarray:
    """Return the correlation times that these series can show: longer than two readings, shorter than a run."""
    between = float(np.median(np.concatenate([np.diff(chain.time_s) for chain in chains])))
    longest = max(float(np.ptp(chain.time_s)) for chain in chains)
    found = [tau for tau in settings.correlation_times_s if 2.0 * between <= tau <= longest]
    return np.array(found or [max(2.0 * between, min(longest, settings.correlation_times_s[0]))])


def _peak(at: np.ndarray, values: np.ndarray) -> float:
    """Return exp of the position of the maximum of values on a uniform grid, by a parabola through three points."""
    best = int(np.clip(np.argmax(values), 1, values.size - 2))
    low, middle, high = values[best - 1 : best + 2]
    bend = low - 2.0 * middle + high
    shift = 0.5 * (low - high) / bend if bend < 0.0 else 0.0
    return float(np.exp(at[best] + np.clip(shift, -1.0, 1.0) * (at[1] - at[0])))


def _log_likelihoods(
    chains: Sequence[Chain], errors: np.ndarray, sizes: np.ndarray, taus: np.ndarray
) -> Float[np.ndarray, "chains tau s"]:
    """Return the log likelihood of every series at every correlation time and size, minus a constant.

    All series go through the filter together; one that has ended has readings without weight.
    """
    noise = _side_by_side([chain.sd**2 for chain in chains], 1.0)
    gain = _side_by_side([chain.gain for chain in chains], 0.0)
    error = _side_by_side([errors[chain.rows] for chain in chains], 0.0)
    steps = _side_by_side([np.append(np.diff(chain.time_s), 0.0) for chain in chains], 0.0)
    step, which = np.unique(steps[..., 0, 0], return_inverse=True)
    decays = np.exp(-step[:, None] / taus)[:, :, None]
    stationary = np.broadcast_to(sizes**2, (len(chains), taus.size, sizes.size))
    variance, mean, total = stationary.copy(), np.zeros(stationary.shape), np.zeros(stationary.shape)
    for one, sd2, h, number in zip(error, noise, gain, which.reshape(steps.shape[:2]), strict=True):
        f = h * h * variance + sd2
        off = one - h * mean
        total -= off * off / f + np.log(f)
        k = variance * h / f
        a = decays[number]
        mean = a * (mean + k * off)
        variance = a * a * (variance * sd2 / f) + (1.0 - a * a) * stationary
    return 0.5 * total


def _side_by_side(columns: Sequence[np.ndarray], fill: float) -> Float[np.ndarray, "n chains 1 1"]:
    """Return columns as one array, the shorter ones filled up."""
    found = np.full((max(map(len, columns)), len(columns), 1, 1), fill)
    for number, column in enumerate(columns):
        found[: len(column), number, 0, 0] = column
    return found
