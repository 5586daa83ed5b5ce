"""Autocorrelation of the residuals of an explanation, and its effect on the variance of the cells' means.

A run is cut into short stretches of equal time. The residuals have the covariance s^2 exp(-dt / tau) between stretches
(an Ornstein-Uhlenbeck process) plus white noise; s, tau and the noise are fitted to the sample autocovariances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import toeplitz

from jaxmodel.diagnosis.residuals.table import Bools, ChannelResiduals, Floats, Integers

STRETCHES = 300  # of a run
_LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
_LEAST_FREEDOM = 4.0  # of a variance that is widened for the numbers fitted


@dataclass(frozen=True, eq=False)
class StretchCovariance:
    """Covariance of residuals between stretches of time.

    Attributes:
        shares: (cells, stretches) sparse: the share of each cell's time that is in each stretch.
        covariance: of the stretches of each run, in the order of the runs.
        freedom: degrees of freedom.
    """

    shares: sparse.csr_array
    covariance: tuple[Floats, ...]
    freedom: float

    def variance(self, sums: Floats) -> Floats:
        """Return the variance of weighted sums of the cells' means, (sums, cells)."""
        of_stretches = (self.shares.T @ sums.T).T.reshape(len(sums), len(self.covariance), STRETCHES)
        parts = [np.sum(of_stretches[:, k] @ one * of_stretches[:, k], axis=1) for k, one in enumerate(self.covariance)]
        return np.sum(parts, axis=0)


def stretch_covariance(residuals: ChannelResiduals, cell: Integers, fitted: Floats, numbers: int) -> StretchCovariance:
    """Return the covariance, by stretches, of a channel's residuals minus fitted lines.

    Args:
        residuals: of the channel.
        cell: (n,) the cell of each reading; -1 for none.
        fitted: (cells,) values of the lines.
        numbers: number of fitted parameters of the lines.
    """
    kept = cell >= 0
    stretch = residuals.time_blocks(STRETCHES)[kept]
    weight, cell = residuals.weight_s[kept], cell[kept]
    left = residuals.error[kept] - fitted[cell]
    runs = len(residuals.runs)
    seconds = np.bincount(stretch, weight, minlength=runs * STRETCHES)
    mean = np.bincount(stretch, weight * left, minlength=seconds.size) / np.where(seconds > 0.0, seconds, 1.0)
    spent = np.bincount(cell, weight, minlength=fitted.size)
    shares = sparse.csr_array((weight / spent[cell], (cell, stretch)), shape=(fitted.size, seconds.size))
    lengths = np.array([np.ptp(residuals.time_s[residuals.run == number]) for number in residuals.runs])
    step = max(float(lengths.mean()), 1e-9) / STRETCHES
    slow, tau, white = _process(mean.reshape(runs, -1), seconds.reshape(runs, -1) > 0.0, step)
    independent = max(float(lengths.sum()) / max(2.0 * tau, step), 1.0)
    # Fitted lines absorb part of the residuals, which biases the variance low.
    widened = 1.0 / (1.0 - min(numbers / independent, 1.0 - 1.0 / 3.0))
    apart = np.arange(STRETCHES)
    covariance = tuple(
        toeplitz(widened * slow * np.exp(-apart * length / STRETCHES / tau)) + white * np.eye(STRETCHES)
        for length in lengths
    )
    return StretchCovariance(shares, covariance, max(_LEAST_FREEDOM, independent - numbers))


def _process(mean: Floats, there: Bools, step: float) -> tuple[float, float, float]:
    """Return s^2, tau in seconds, and the noise variance of a stretch, from the autocovariance at a few lags."""
    products = np.array(
        [
            np.sum(mean[:, lag:] * mean[:, : STRETCHES - lag]) / max(np.sum(there[:, lag:] & there[:, :-lag]), 1)
            for lag in _LAGS
        ]
    )
    square = float(np.sum(mean**2) / max(np.sum(there), 1))
    best = (np.inf, 0.0, step)
    for tau in step * np.geomspace(0.5, STRETCHES, 40):
        decay = np.exp(-np.array(_LAGS) * step / tau)
        size = max(0.0, float(products @ decay / (decay @ decay)))
        miss = float(np.sum((products - size * decay) ** 2))
        if miss < best[0]:
            best = (miss, min(size, square), float(tau))
    return best[1], best[2], max(square - best[1], 0.0)
