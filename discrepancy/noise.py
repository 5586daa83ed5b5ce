"""How large a sensor's noise is, how correlated, and who says so: the contract every test of the model rests on.

Noise is AR(1): corr(e_t, e_{t+k}) = rho^k, white at rho = 0. Two estimators, and the caller chooses: `local_noise` looks only
at short windows and removes a parabola from each, so that whatever is slow (the signal itself between two jumps of the
inputs, or the misfit of a wrong model) is not taken for noise; `residual_noise` uses a residual whole, which is sharper and
takes the misfit of a wrong model for correlated noise: give it the residual of the richest model there is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from discrepancy.whitening import Bools, Floats, whiten

_MEDIAN_ABSOLUTE_DEVIATION_OF_NORMAL = 0.6745
_SHORTEST_WINDOW = 8
_KEPT_PROBABILITY = 0.99
_RHO_BOUNDS = (-0.8, 0.99)
_COLOURED_CHI2 = 10.83  # chi-square(1) at p = 0.001
_LEAST_RHO_THAT_MATTERS = 0.08  # a correlation below it changes the z of the slowest effect by less than 9 %
_CONTRADICTED = 1.25  # a stated sd this factor off what the series shows is worth a word


@dataclass(frozen=True)
class NoiseModel:
    """The noise of one sensor.

    Attributes:
        sd: standard deviation of one reading, quantisation included, in the reading's unit.
        rho: correlation between two consecutive readings, 0 for white noise.
        source: where the two numbers come from, in words for a report.
        quantum: step to which the readings are rounded, 0 if none was seen.
    """

    sd: float
    rho: float
    source: str
    quantum: float = 0.0


@dataclass(frozen=True)
class NoiseEstimate:
    """What a series says of its noise.

    Attributes:
        sd: standard deviation of one value.
        rho: correlation between two consecutive values.
        rho_se: standard error of rho; infinite where rho was given.
        coloured_chi2: twice the log-likelihood ratio of rho against white noise; chi-square with 1 degree of freedom when the
            noise is white.
        values: number of values that it rests on.
    """

    sd: float
    rho: float
    rho_se: float
    coloured_chi2: float
    windows: int


def detect_quantum(readings: ArrayLike) -> float:
    """Find the step to which readings are rounded.

    The coarsest of 5, 2 and 1 x 10^k of which all readings are multiples; where they are also whole multiples, within that
    rounding, of a coarser step that is no round number (a converter's bit), that step.

    Args:
        readings: (n,) readings; NaN is a missing one.

    Returns:
        The step in the readings' unit; 0 if fewer than three different values were read or none repeats.
    """
    values = np.asarray(readings, dtype=float)
    values = values[np.isfinite(values)]
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) == len(values):
        return 0.0
    decimal = _decimal_step(levels)
    gaps = np.diff(levels)
    bit = gaps.min()
    if decimal == 0.0 or bit < 4.0 * decimal:
        return decimal
    # The shortest gaps fix the bit well enough to count the bits in longer ones, which fix it better.
    for reach in (3.0, 10.0, 30.0, np.inf):
        short = gaps[gaps <= reach * bit]
        bit = short.sum() / np.round(short / bit).sum()
    off_grid = (levels - levels[0]) / bit
    off_grid = np.abs(off_grid - np.round(off_grid)) * bit
    return float(bit) if off_grid.max() <= 1.1 * decimal else decimal


def _decimal_step(levels: Floats) -> float:
    largest = np.abs(levels).max()
    top = int(np.floor(np.log10(np.diff(levels).min()))) + 1
    for exponent in range(top, -13, -1):
        for digit in (5.0, 2.0, 1.0):
            step = digit * 10.0**exponent
            multiples = levels / step
            if np.abs(multiples - np.round(multiples)).max() <= 1e-9 * max(1.0, largest / step):
                return step
    return 0.0


def break_at_jumps(starts: ArrayLike, inputs: ArrayLike, settling_rows: int = 1) -> Bools:
    """Begin a new chain wherever an input jumps, so that no window of readings spans a jump.

    A jump is a step of more than 8 robust standard deviations of the input's own steps (an input may be measured, and noisy)
    and of more than 2 % of its range.

    Args:
        starts: (n,) booleans, True where a chain begins.
        inputs: (n,) or (n, m) inputs; row k holds over the step that ends at row k. NaN is a missing value.
        settling_rows: rows after a jump that are left alone, as chains of their own.

    Returns:
        (n,) booleans, True where a chain begins.
    """
    result = np.asarray(starts, dtype=bool).copy()
    columns = np.asarray(inputs, dtype=float).reshape(len(result), -1)
    chain = np.cumsum(result)
    for column in columns.T:
        read = np.flatnonzero(np.isfinite(column))
        if len(read) < 2:
            continue
        step = np.where(np.diff(chain[read]) == 0, np.abs(np.diff(column[read])), 0.0)
        noise = np.median(step) / (_MEDIAN_ABSOLUTE_DEVIATION_OF_NORMAL * np.sqrt(2.0))
        jumped = read[1:][step > max(8.0 * np.sqrt(2.0) * noise, 0.02 * np.ptp(column[read]))]
        after = np.unique(jumped[:, None] + np.arange(settling_rows + 1))
        result[after[after < len(result)]] = True
    return result


def local_noise(
    values: ArrayLike,
    starts: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    known_sd: float | None = None,
    rho: float | None = None,
    window: int = 24,
) -> NoiseEstimate:
    """Estimate the sd and AR(1) correlation of noise from the fast content of a series alone.

    Restricted maximum likelihood over windows of about `window` rows, with a parabola in time free in each; windows that fit
    badly (the worst of them hold a jump) are rejected at the 99 % point and the truncation is corrected for. It works on
    readings cut at the jumps of the inputs (`break_at_jumps`), with no model at all, and on residuals of a wrong model.

    Simulated, 2,000 rows, windows of 24, mean and sd of the estimates: rho 0, 0.3, 0.6, 0.9 gives 0.00, 0.29, 0.61, 0.90
    with sd 0.03, 0.02, 0.04, 0.04, and the sd within 1, 2, 4, 60 %: at 0.9 a window is shorter than the noise's memory. With
    the sd known, rho comes with sd 0.03, 0.02, 0.01, 0.003. A misfit of ten noise sd with a period of 300 rows changes none of
    that; relaxations of five sd over 20 rows, not cut at their jumps, add 0.08 to rho at 0 and 0.04 at 0.6, and cut at the
    jumps add nothing. On readings of systems with time constants of 20 rows or less, a window of 12 is safer.

    Args:
        values: (n,) readings or residuals; NaN is a missing one.
        starts: (n,) booleans, True where a chain begins: no window crosses one.
        time_s: (n,) times in seconds, for the parabola where steps are unequal. The correlation counts rows, not seconds.
        known_sd: the sd, where it is known; rho is then estimated given it, which is far more precise at high rho.
        rho: the correlation, where it is known; only the sd is then estimated.
        window: rows in a window.

    Returns:
        The estimate; its sd is NaN where no chain is as long as eight rows.
    """
    groups = _contrasts(np.asarray(values, dtype=float), np.asarray(starts, dtype=bool), time_s, window)
    if not groups:
        return NoiseEstimate(float("nan"), 0.0, float("inf"), 0.0, 0)
    size = np.concatenate([np.full(len(group.contrast), group.contrast.shape[1]) for group in groups])
    cutoff = chi2.ppf(_KEPT_PROBABILITY, size)

    def fit(kept: Bools | None) -> tuple[float, _Likelihood]:
        likelihood = _Likelihood(groups, size, kept, known_sd)
        if rho is not None:
            return rho, likelihood
        best = minimize_scalar(likelihood.deviance, bounds=_RHO_BOUNDS, method="bounded", options={"xatol": 1e-3})
        return float(best.x), likelihood

    estimate, likelihood = fit(None)
    kept = np.ones(len(size), dtype=bool)
    for _ in range(3):
        distance, _ = likelihood.distances(estimate)
        kept = distance <= cutoff * np.median(distance / chi2.median(size))
        estimate, likelihood = fit(kept)
    step = 0.02
    centre = min(max(estimate, _RHO_BOUNDS[0] + step), _RHO_BOUNDS[1] - step)
    below, middle, above = (likelihood.deviance(centre + offset) for offset in (-step, 0.0, step))
    curvature = (below - 2.0 * middle + above) / step**2
    return NoiseEstimate(
        sd=known_sd or float(np.sqrt(likelihood.variance(estimate))),
        rho=estimate,
        rho_se=float(np.sqrt(2.0 / curvature)) if rho is None and curvature > 0.0 else float("inf"),
        coloured_chi2=max(0.0, likelihood.deviance(0.0) - likelihood.deviance(estimate)),
        values=int((size + 3)[kept].sum()),
    )


def residual_noise(
    residual: ArrayLike, starts: ArrayLike, elapsed: ArrayLike | None = None, *, known_sd: float | None = None
) -> NoiseEstimate:
    """Estimate sd and AR(1) correlation of a residual by maximum likelihood, every frequency counted.

    Args:
        residual: (n,) measured minus modelled, NaN where the reading is missing.
        starts: (n,) booleans, True where a chain begins.
        elapsed: (n,) noise clock, as in `whitening.whiten`; rows are counted when not given.
        known_sd: the sd, where it is known.

    Returns:
        The estimate.
    """
    values = np.asarray(residual, dtype=float)
    present = np.isfinite(values)
    impulse = np.ones(len(values))

    def deviance(rho: float, variance: float | None = None) -> tuple[float, float]:
        white = whiten(values, starts, rho, 1.0, present, elapsed)
        variance = variance or (known_sd**2 if known_sd else float(np.mean(white[present] ** 2)))
        # A constant's whitening is (1 - w) / sqrt(1 - w^2), which gives the weight w, and so each row's variance, back.
        ratio = whiten(impulse, starts, rho, 1.0, present, elapsed)[present] ** 2
        weight = (1.0 - ratio) / (1.0 + ratio)
        terms = np.log(variance * (1.0 - weight**2)) + white[present] ** 2 / variance
        return float(np.sum(terms)), variance

    lowest = _RHO_BOUNDS[0] if elapsed is None else 0.0
    best = minimize_scalar(
        lambda rho: deviance(rho)[0], bounds=(lowest, _RHO_BOUNDS[1]), method="bounded", options={"xatol": 1e-5}
    )
    rho = float(best.x)
    return _estimate(lambda at: deviance(at)[0], rho, deviance(rho)[1], known_sd, int(present.sum()))


@dataclass(frozen=True)
class _Group:
    """Windows of one length: contrasts free of any parabola, and how to get their covariance from rho."""

    contrast: Floats  # (windows, k)
    basis: Floats  # (windows or 1, length, k), orthonormal columns orthogonal to 1, t, t^2
    lag: Floats  # (windows or 1, length, length), rows between two values


class _Likelihood:
    """Deviance (-2 log restricted likelihood) of rho with the variance profiled out or known."""

    def __init__(self, groups: Sequence[_Group], size: NDArray[np.int64], kept: Bools | None, known_sd: float | None):
        self.groups = groups
        self.size = size
        self.kept = kept
        self.known_sd = known_sd

    def distances(self, rho: float) -> tuple[Floats, Floats]:
        """Squared Mahalanobis length of each window's contrasts at unit variance, and their log-determinant."""
        squared, log_determinant = [], []
        for group in self.groups:
            covariance = np.swapaxes(group.basis, 1, 2) @ (np.float64(rho) ** group.lag @ group.basis)
            factor = np.linalg.cholesky(covariance)
            white = np.linalg.solve(factor, group.contrast[:, :, None])[:, :, 0]
            squared.append(np.sum(white**2, axis=1))
            diagonal = np.diagonal(factor, axis1=1, axis2=2)
            log_determinant.append(np.broadcast_to(2.0 * np.log(diagonal).sum(axis=1), len(white)))
        return np.concatenate(squared), np.concatenate(log_determinant)

    def variance(self, rho: float) -> float:
        """Variance of one value, given rho."""
        return self._variance(self.distances(rho)[0])

    def _variance(self, squared: Floats) -> float:
        if self.kept is None:
            return float(np.median(squared / chi2.median(self.size)))
        cutoff = chi2.ppf(_KEPT_PROBABILITY, self.size)
        mean_of_kept = self.size * chi2.cdf(cutoff, self.size + 2) / _KEPT_PROBABILITY
        return float(squared[self.kept].sum() / mean_of_kept[self.kept].sum())

    def deviance(self, rho: float) -> float:
        """-2 log-likelihood up to a constant: of a multivariate t before windows are rejected, of a normal after."""
        squared, log_determinant = self.distances(rho)
        variance = self.known_sd**2 if self.known_sd else self._variance(squared)
        if self.kept is None:
            freedom = 5.0
            fit = (freedom + self.size) * np.log1p(squared / (freedom * variance))
            return float(np.sum(log_determinant + self.size * np.log(variance) + fit))
        fit = log_determinant + self.size * np.log(variance) + squared / variance
        return float(np.sum(fit[self.kept]))


def _contrasts(values: Floats, starts: Bools, time_s: ArrayLike | None, window: int) -> list[_Group]:
    clock = np.arange(len(values), dtype=float) if time_s is None else np.asarray(time_s, dtype=float)
    rows = np.flatnonzero(np.isfinite(values))
    chain = np.cumsum(starts)[rows]
    # Windows of equal steps share one covariance, so they are kept apart from those with a missing reading.
    parts_of: dict[tuple[int, bool], list[NDArray[np.int64]]] = {}
    for members in np.split(rows, np.flatnonzero(np.diff(chain)) + 1):
        for part in np.array_split(members, max(1, round(len(members) / window))):
            if len(part) >= _SHORTEST_WINDOW:
                even = np.diff(part).max() == 1 and np.ptp(np.diff(clock[part])) < 1e-6 * np.ptp(clock[part])
                parts_of.setdefault((len(part), bool(even)), []).append(part)
    groups = []
    for (_, even), parts in parts_of.items():
        index = np.array(parts)
        shape_from = index[:1] if even else index
        lag = np.abs(shape_from[:, :, None] - shape_from[:, None, :]).astype(float)
        when = clock[shape_from] - clock[shape_from[:, :1]]
        centred = when / when[:, -1:] - 0.5
        parabola = np.stack([np.ones_like(centred), centred, centred**2], axis=-1)
        basis = np.linalg.qr(parabola, mode="complete")[0][:, :, 3:]
        contrast = (np.swapaxes(basis, 1, 2) @ values[index][:, :, None])[:, :, 0]
        groups.append(_Group(contrast, basis, lag))
    return groups
