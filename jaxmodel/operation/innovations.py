"""Whether a filter errs as much as it expects to: the test of its normalised innovations."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.stats import chi2

from jaxmodel.base.in_short import InShort

TWO_SIDED = (0.025, 0.975)
CONSISTENT, CAUTIOUS, OVERCONFIDENT = "consistent", "cautious", "overconfident"


@dataclasses.dataclass(frozen=True, repr=False)
class Consistency(InShort):
    """The mean of the normalised innovations squared, and where it would lie if the filter were right.

    Attributes:
        nis: mean of the innovations squared by the variances that the filter expects; 1 if these are right.
        low: lower end of the interval that holds it in 95 % of runs of a filter that is right.
        high: upper end of it.
        verdict: "consistent", "cautious" (below: readings are nearer than the filter expects) or "overconfident".
    """

    nis: float
    low: float
    high: float
    verdict: str


def consistency(innovation: np.ndarray) -> Consistency:
    """Test the normalised innovations of a filter.

    With white innovations n NIS is chi-square with n degrees of freedom. Correlated ones count as
    n = N (1 - r^2)/(1 + r^2) independent squares, r the correlation of one with the next (a first-order process).

    Args:
        innovation: of each reading, by its expected sd, shape (rows,); NaN without a reading.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), section 5.4.

    Example:
        >>> import numpy as np
        >>> from jaxmodel import operation
        >>> operation.consistency(np.random.default_rng(0).normal(0.0, 1.0, 1000)).verdict
        'consistent'
    """
    there = np.asarray(innovation)[np.isfinite(innovation)]
    if there.size == 0:
        return Consistency(np.nan, np.nan, np.nan, "")
    nis = float(np.mean(there**2))
    r = float(np.sum(there[1:] * there[:-1]) / np.sum(there**2)) if nis > 0.0 else 0.0
    independent = max(1.0, there.size * (1.0 - r * r) / (1.0 + r * r))
    low, high = (float(chi2.ppf(share, independent) / independent) for share in TWO_SIDED)
    return Consistency(nis, low, high, CAUTIOUS if nis < low else OVERCONFIDENT if nis > high else CONSISTENT)
