"""Size and autocorrelation of sensor noise, and their source.

Noise is AR(1): corr(e_t, e_{t+k}) = rho^k, white at rho = 0. It is estimated in short windows after subtraction of a
fitted parabola, so that slow changes (the signal between jumps of the inputs, or the error of a model) do not count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import fminbound
from scipy.special import chdtr, chdtri

from jaxmodel.case.signals import MAD_OF_NORMAL, detect_quantum
from jaxmodel.fit.settings import SETTINGS, Settings

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]
Integers = NDArray[np.integer]

# Source of noise that is not stated.
BETWEEN_JUMPS = "the readings between jumps of the inputs"

_SHORTEST_WINDOW = 8
_MOST_WINDOWS = 5000  # of a channel; more say no more
_PARABOLA = 3  # columns
_KEPT_PROBABILITY = 0.99
_RHO_BOUNDS = (-0.8, 0.99)
_COLOURED_CHI2 = 10.83  # chi-square(1) at p = 0.001
# A larger one means a correlation time longer than a window: that is the signal (a cell that warms, a voltage that
# relaxes), not the sensor. On 13 of 17 real cases readings give 0.93 to 0.99.
_MOST_RHO = 0.92
_LEAST_RHO_THAT_MATTERS = 0.08  # a smaller one changes the z of the slowest effect by less than 9 %


@dataclass(frozen=True)
class NoiseModel:
    """The noise of one sensor.

    Attributes:
        sd: standard deviation of one reading, quantisation included, in the reading's unit.
        rho: correlation between two consecutive readings, 0 for white noise.
        source: of sd and rho, in words.
        quantum: step to which the readings are rounded, 0 if none was found.
        stated: sd that the case states; None if it states none.
        contradicts: the scatter of the readings contradicts the stated sd, and is used.
        is_filtered: the readings scatter far less than stated: their log was filtered or interpolated.
    """

    sd: float
    rho: float
    source: str
    quantum: float = 0.0
    stated: float | None = None
    contradicts: bool = False
    is_filtered: bool = False


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise estimated from a series.

    Attributes:
        sd: standard deviation of one value; NaN if there are too few values.
        rho: correlation between two consecutive values.
        rho_se: standard error of rho.
        coloured_chi2: twice the log-likelihood ratio of rho against white noise; chi-square with 1 degree of freedom
            for white noise.
        count: number of values used.
    """

    sd: float
    rho: float
    rho_se: float
    coloured_chi2: float
    count: int

    @property
    def is_coloured(self) -> bool:
        """Whether the correlation is significant (p < 0.001), large enough to matter, and within a window."""
        return self.coloured_chi2 > _COLOURED_CHI2 and _LEAST_RHO_THAT_MATTERS < abs(self.rho) < _MOST_RHO

    @property
    def is_signal(self) -> bool:
        """Whether the correlation outlasts a window: `sd` is then what remains from one value to the next."""
        return self.rho >= _MOST_RHO


_NO_ESTIMATE = NoiseEstimate(sd=float("nan"), rho=0.0, rho_se=float("inf"), coloured_chi2=0.0, count=0)


def channel_noise(
    readings: ArrayLike,
    estimate: Callable[[float | None], NoiseEstimate],
    *,
    stated_sd: float | None = None,
    settings: Settings = SETTINGS,
) -> NoiseModel:
    """Return one sensor's noise from the stated sd and the fast scatter of its readings.

    A stated sd (before rounding: q^2/12 is added) is used unless the scatter contradicts it; rho is then estimated
    given this sd. Without a stated sd both come from the scatter. Slow deviations count as model error, not as noise.

    Args:
        readings: (n,) readings of this sensor, for their quantum.
        estimate: function from a known sd, or None, to the noise estimated from the scatter.
        stated_sd: stated sd of the white noise before rounding, if any.
        settings: the constants.

    Returns:
        The noise model. If the data show no noise, its sd is that of rounding, at least a share of their range; it is 0
        if all readings are equal: such a channel cannot be used.
    """
    values = np.asarray(readings, dtype=float)
    quantum = detect_quantum(values)
    rounding = quantum / np.sqrt(12.0)
    free = estimate(None)
    rho = free.rho if free.is_coloured else 0.0
    # If the rounding step is far above the noise, equal readings do not mean absence of noise.
    finest = max(rounding, settings.finest_sensor * float(np.nanmax(values) - np.nanmin(values)))
    seen = max(free.sd, finest) if np.isfinite(free.sd) else float("nan")
    if stated_sd is None:
        if not np.isfinite(seen):
            return NoiseModel(finest, 0.0, "not stated, and too few or only equal readings: their resolution", quantum)
        return NoiseModel(seen, rho, f"estimated from {BETWEEN_JUMPS}", quantum)
    sd = float(np.sqrt(stated_sd**2 + rounding**2))
    # Where windows show the signal, they say nothing of the noise.
    ratio = seen / sd if free.count >= settings.fewest_for_noise and not free.is_signal else 1.0
    # For autocorrelated noise, windows give the sd only within a factor of two.
    too_small = ratio > settings.noise_contradiction * (2.0 if free.is_coloured else 1.0)
    # A smaller scatter contradicts the stated sd only if it is white: windows do not see slow autocorrelated noise.
    too_large = 1.0 / settings.filtered < ratio < 1.0 / settings.noise_contradiction and not free.is_coloured
    if too_small or too_large:
        source = f"{BETWEEN_JUMPS} show {seen:.3g}: the stated sd is wrong ({stated_sd:g})"
        return NoiseModel(seen, rho, source, quantum, stated=stated_sd, contradicts=True)
    given = estimate(sd)
    # Given a wrong sd, white noise seems autocorrelated: both estimates must agree.
    rho = given.rho if given.is_coloured and free.is_coloured else 0.0
    source = f"stated ({stated_sd:g})"
    source += f", rounding to {quantum:g} included" if quantum else ""
    source += f"; autocorrelation from {BETWEEN_JUMPS}" if rho else ""
    is_filtered = ratio <= 1.0 / settings.filtered
    source += f"; the readings scatter by {seen:.3g}: filtered or interpolated" if is_filtered else ""
    return NoiseModel(sd, rho, source, quantum, stated=stated_sd, is_filtered=is_filtered)


def break_at_jumps(starts: ArrayLike, inputs: ArrayLike, settling_rows: int = 1) -> Bools:
    """Start a new chain wherever an input jumps, so that no window spans a jump.

    A jump is a step of more than 8 robust sd of the input's noise and of more than 2 % of its range.

    Args:
        starts: (n,) booleans, True where a chain begins.
        inputs: (n,) or (n, m) inputs; row k holds over the step that ends at row k. NaN is a missing value.
        settling_rows: rows after a jump, each of which becomes its own chain.

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
        sd_of_steps = np.median(step) / MAD_OF_NORMAL
        jumped = read[1:][step > max(8.0 * sd_of_steps, 0.02 * np.ptp(column[read]))]
        after = np.unique(jumped[:, None] + np.arange(settling_rows + 1))
        result[after[after < len(result)]] = True
    return result


def local_noise(
    values: ArrayLike,
    starts: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    known_sd: float | None = None,
    window: int = 12,
) -> NoiseEstimate:
    """Estimate sd and AR(1) correlation of noise from the fast content of a series alone.

    Restricted maximum likelihood over windows of about `window` rows, each with a free parabola in time. Windows that
    fit badly (they contain a jump) are rejected at the 99 % point, and the variance is corrected for this. It works for
    readings cut at jumps of the inputs (`break_at_jumps`) without any model, and for residuals of a wrong model.

    Simulations with 2,000 rows and rho 0, 0.3, 0.6, 0.9: with windows of 12, rho has no bias and an sd of 0.03, 0.04,
    0.06, 0.09; the sd is correct within 2, 3, 7 % and, at 0.9, only within a factor of 2, because a window is then no
    longer than the correlation length. With windows of 24 the sd of rho is 0.03, 0.03, 0.03, 0.05. If the sd is known,
    rho is correct within 0.03, 0.025, 0.015, 0.003. A model error of ten noise sd with a period of 300 rows changes
    nothing. Relaxations over 20 rows of five noise sd have no effect with windows of 12; with windows of 24 they add
    0.08 to rho at 0 unless chains break at the jumps.

    Args:
        values: (n,) readings or residuals; NaN is a missing one.
        starts: (n,) booleans, True where a chain begins: no window crosses one.
        time_s: (n,) times in seconds, for the parabola with unequal steps. The correlation counts rows, not seconds.
        known_sd: the sd, if known; rho is then estimated given it.
        window: rows in a window.

    Returns:
        The estimate; its sd is NaN if no chain has eight rows, or most windows have equal readings.
    """
    windows = _windows(np.asarray(values, dtype=float), np.asarray(starts, dtype=bool), time_s, window)
    if windows is None:
        return _NO_ESTIMATE
    size = (windows.length - _PARABOLA).astype(float)
    cutoff = chdtri(size, 1.0 - _KEPT_PROBABILITY)
    size_of_kept = size * chdtr(size + 2, cutoff) / _KEPT_PROBABILITY  # mean of a chi-square cut off there
    median = chdtri(size, 0.5)
    if np.median(_distances(windows, 0.0)[0]) <= 1e-20 * np.nanmax(np.abs(values)) ** 2:
        return _NO_ESTIMATE

    def robust_likelihood(rho: float) -> tuple[float, float]:
        squared, log_determinant = _distances(windows, rho)
        variance = known_sd**2 if known_sd else float(np.median(squared / median))
        freedom = 5.0  # of the multivariate t
        fit = (freedom + size) * np.log1p(squared / (freedom * variance))
        return float(np.sum(log_determinant + size * np.log(variance) + fit)), variance

    result = _maximise(robust_likelihood, _RHO_BOUNDS, 0)
    for _ in range(3):
        squared, _ = _distances(windows, result.rho)
        kept = squared <= cutoff * np.median(squared / median)

        def likelihood(rho: float, kept: Bools = kept) -> tuple[float, float]:
            squared, log_determinant = _distances(windows, rho)
            variance = known_sd**2 if known_sd else float(squared[kept].sum() / size_of_kept[kept].sum())
            fit = log_determinant + size * np.log(variance) + squared / variance
            return float(np.sum(fit[kept])), variance

        result = _maximise(likelihood, _RHO_BOUNDS, int(windows.length[kept].sum()))
    return result


def _maximise(
    likelihood: Callable[[float], tuple[float, float]], bounds: tuple[float, float], count: int
) -> NoiseEstimate:
    """Minimise a deviance (-2 log-likelihood) over rho, together with its variance at each rho."""
    rho = float(np.asarray(fminbound(lambda at: likelihood(at)[0], *bounds, xtol=1e-4)))
    deviance, variance = likelihood(rho)
    white_deviance, white_variance = likelihood(0.0)
    step = 0.1 * (1.0 - rho)
    centre = max(rho, bounds[0] + step)
    curvature = (likelihood(centre - step)[0] - 2.0 * likelihood(centre)[0] + likelihood(centre + step)[0]) / step**2
    result = NoiseEstimate(
        sd=float(np.sqrt(variance)),
        rho=rho,
        rho_se=float(np.sqrt(2.0 / curvature)) if curvature > 0.0 else float("inf"),
        coloured_chi2=max(0.0, white_deviance - deviance),
        count=count,
    )
    if result.is_signal:
        return replace(result, sd=float(np.sqrt(variance * (1.0 - rho**2))))
    return result if result.is_coloured else replace(result, sd=float(np.sqrt(white_variance)))


@dataclass(frozen=True)
class _Windows:
    """Windows of a series, one after another: n readings in w windows.

    Attributes:
        columns: (4, n) three columns of a parabola in time, orthonormal in each window, then the readings without it.
        lag: (n,) rows since the previous reading; infinite at the first of a window.
        first: (w,) indices of the first readings.
        length: (w,) numbers of readings.
    """

    columns: Floats
    lag: Floats
    first: Integers
    length: Integers


def _windows(values: Floats, starts: Bools, time_s: ArrayLike | None, window: int) -> _Windows | None:
    clock = np.arange(len(values), dtype=float) if time_s is None else np.asarray(time_s, dtype=float)
    rows = np.flatnonzero(np.isfinite(values))
    chain = np.cumsum(starts)[rows]
    first = np.flatnonzero(np.diff(chain, prepend=-1))
    length = np.diff(np.append(first, rows.size))
    long = length >= _SHORTEST_WINDOW
    every = max(1, int(length[long].sum()) // (window * _MOST_WINDOWS))
    chains = [rows[begin : begin + count] for begin, count in zip(first[long], length[long], strict=True)]
    parts = [part for one in chains for part in _cut(one, window, every)]
    parts = [part for part in parts if len(part) >= _SHORTEST_WINDOW]
    if not parts:
        return None
    index, length = np.concatenate(parts), np.array([len(part) for part in parts])
    first = np.cumsum(length) - length
    lag = np.diff(index, prepend=0).astype(float)
    lag[first] = np.inf
    since = clock[index] - np.repeat(clock[index[first]], length)
    centred = since / np.repeat(since[first + length - 1], length) - 0.5
    columns = [np.ones_like(centred), centred, centred**2, values[index]]
    for number, column in enumerate(columns):
        for before in [*columns[:number]] * 2:  # twice, against rounding errors
            column -= before * np.repeat(np.add.reduceat(before * column, first), length)
        if number < _PARABOLA:
            column /= np.repeat(np.sqrt(np.add.reduceat(column**2, first)), length)
    return _Windows(np.stack(columns), lag, first, length)


def _cut(rows: Integers, window: int, every: int) -> list[Integers]:
    """Return each `every`-th of the windows of about equal length into which rows are cut."""
    count = max(1, round(len(rows) / window))
    if every == 1:
        return np.array_split(rows, count)
    edges = np.arange(count + 1) * len(rows) // count
    return [rows[edges[k] : edges[k + 1]] for k in range(0, count, every)]


def _distances(windows: _Windows, rho: float) -> tuple[Floats, Floats]:
    """Return the squared Mahalanobis length of each window's readings without a parabola, and the log-determinant.

    These are the terms of the restricted likelihood at unit variance.
    """
    weight = np.float64(rho) ** windows.lag
    white = _innovations(windows.columns, weight)
    log_determinant = np.add.reduceat(np.log1p(-(weight**2)), windows.first)
    products = np.add.reduceat(white[:, None] * white[None], windows.first, axis=2)
    for column in range(_PARABOLA):  # Gauss's elimination
        pivot, beside = products[column, column].copy(), products[column, column + 1 :].copy()
        products[column + 1 :, column + 1 :] -= beside[:, None] * beside / pivot
        log_determinant += np.log(pivot)
    return products[-1, -1], log_determinant


def _innovations(values: Floats, weight: Floats) -> Floats:
    """Return the innovations of (..., n) values, in their sd: (u_t - w u_s) / sqrt(1 - w^2).

    Args:
        values: in units of their sd, in the order of their chains.
        weight: (n,) w, the correlation of each with the previous one; 0 at the first of a chain.
    """
    new = values.copy()
    new[..., 1:] -= weight[1:] * values[..., :-1]
    return new / np.sqrt(1.0 - weight**2)
