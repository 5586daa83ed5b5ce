"""Whether residuals are as small and as forgetful as the sensors' noise: floor ratios and Ljung-Box tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.stats.multitest import multipletests


@dataclass(frozen=True)
class FloorRatio:
    """The residual's size in units of the noise.

    Attributes:
        ratio: sqrt(chi2 / dof), 1 at the floor.
        limit: largest ratio that noise explains, two standard errors above 1.
        dof: readings less the parameters they paid for.
    """

    ratio: float
    limit: float
    dof: float

    @property
    def is_at_floor(self) -> bool:
        """Whether the model is as good as the sensor, as far as the size of its error says."""
        return self.ratio <= self.limit


def floor_ratio(whitened: ArrayLike, parameters: float = 0.0, sd_uncertainty: float = 0.0) -> FloorRatio:
    """Compare a residual with its sensor's noise floor: RF = sqrt(chi2/nu), against 1 + 2 sqrt(1/(2 nu) + u^2).

    Args:
        whitened: (n,) whitened residual of one channel, NaN where a reading is missing.
        parameters: how many parameters this channel paid for (its share of the trace of QQ').
        sd_uncertainty: relative standard error u of the noise's sd, where it was estimated.

    Returns:
        The ratio and its limit.
    """
    w = np.asarray(whitened, dtype=float)
    w = w[np.isfinite(w)]
    dof = max(1.0, len(w) - parameters)
    limit = 1.0 + 2.0 * np.sqrt(0.5 / dof + sd_uncertainty**2)
    return FloorRatio(float(np.sqrt(np.sum(w**2) / dof)), float(limit), dof)


@dataclass(frozen=True)
class LjungBox:
    """Whether a series that should be white still has memory.

    Attributes:
        series: its name.
        lags: lags tested together.
        statistic: Ljung-Box Q.
        p: its p-value.
        p_holm: p-value corrected for the number of series (Holm).
    """

    series: str
    lags: int
    statistic: float
    p: float
    p_holm: float


def ljung_box(whitened: Mapping[str, ArrayLike]) -> tuple[LjungBox, ...]:
    """Test each series of whitened residuals for memory that whitening left, over min(25, n/5) lags.

    Args:
        whitened: whitened residual of one channel in one run, by a name for it; NaN for a missing reading, left out.

    Returns:
        One result for each series of at least 20 readings.
    """
    found = []
    for name, values in whitened.items():
        w = np.asarray(values, dtype=float)
        w = w[np.isfinite(w)]
        if len(w) < 20 or np.ptp(w) == 0.0:
            continue
        lags = min(25, len(w) // 5)
        row = acorr_ljungbox(w, lags=[lags]).iloc[0]
        found.append((name, lags, float(row["lb_stat"]), float(row["lb_pvalue"])))
    if not found:
        return ()
    corrected = np.asarray(multipletests([p for _, _, _, p in found], method="holm")[1])
    return tuple(
        LjungBox(name, lags, statistic, p, float(p_holm))
        for (name, lags, statistic, p), p_holm in zip(found, corrected, strict=True)
    )
