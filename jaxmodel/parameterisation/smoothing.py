"""Linear least squares with smooth curves: hat functions, first-order lags and penalties.

Residuals of a model of a cell are correlated over many rows: in the covariance each row counts 1 / inflation, with the
inflation measured on the residuals.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_banded
from scipy.optimize import lsq_linear

READINGS, VOLT = 100.0, 0.01  # what all rows together count as beside a penalty; its size is searched
RIDGE = 1e-9  # of a value's size: makes a penalty invertible


def hats(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Return the weights of linear interpolation between knots, held at the ends, shape (rows, knots)."""
    weights = np.zeros((x.size, knots.size))
    if knots.size == 1:
        return weights + 1.0
    left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    share = np.clip((x - knots[left]) / np.diff(knots)[left], 0.0, 1.0)
    rows = np.arange(x.size)
    weights[rows, left], weights[rows, left + 1] = 1.0 - share, share
    return weights


def products(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the products of two sets of weights row by row, shape (rows, first x second), the second running fast."""
    return (first[:, :, None] * second[:, None, :]).reshape(len(first), -1)


def lagged(time_s: np.ndarray, drive: np.ndarray, tau_s: float | np.ndarray, first: float = 0.0) -> np.ndarray:
    """Return the first-order response to drives that hold over the step that ends at their row.

    y_k = a_k y_(k-1) + (1 - a_k) u_k with a_k = exp(-dt_k / tau_k), y_0 = first.

    Args:
        time_s: shape (rows,) [s].
        drive: shape (rows,) or (rows, any).
        tau_s: time constant [s], one or one for each row.
        first: response at the first row.
    """
    kept = np.exp(-np.diff(time_s) / (tau_s if np.ndim(tau_s) == 0 else np.asarray(tau_s)[1:]))
    bands = np.ones((2, time_s.size))
    bands[1, :-1] = -kept
    right = drive * np.append(0.0, 1.0 - kept).reshape(-1, *[1] * (drive.ndim - 1))
    right[0] = first
    return np.asarray(solve_banded((1, 0), bands, right, overwrite_b=True, check_finite=False))


def roughness(size: int, order: int) -> np.ndarray:
    """Return the penalty of the squares of differences of an order between neighbouring knots, shape (knots, knots).

    By number of the knot: knots stand close where curves bend, and a curve may bend there as much as elsewhere.
    """
    if size <= order:
        return np.zeros((size, size))
    steps = np.diff(np.eye(size), order, axis=0)
    return steps.T @ steps


@dataclasses.dataclass(frozen=True, eq=False)
class Penalty:
    """A quadratic penalty on some values: values' matrix values.

    Attributes:
        at: the values it acts on.
        matrix: positive semi-definite, shape (at, at), in 1 / sd^2.
    """

    at: slice
    matrix: np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class Solution:
    """Values of a regularised least-squares problem.

    Attributes:
        values: shape (values,).
        covariance: of the values, model misfit included by the inflation.
        variance: of a residual.
    """

    values: np.ndarray
    covariance: np.ndarray
    variance: float


def data_scale(count: float) -> float:
    """Return what a sum of weighted squares [V^2] is multiplied with: all rows are `READINGS` readings of `VOLT`."""
    return READINGS / (count * VOLT**2)


def penalty_matrix(size: int, penalties: Sequence[Penalty]) -> np.ndarray:
    """Return the sum of the penalties."""
    total = np.zeros((size, size))
    for penalty in penalties:
        total[penalty.at, penalty.at] += penalty.matrix
    return total


def solve(
    square: np.ndarray,
    aim: np.ndarray,
    energy: float,
    count: float,
    prior: np.ndarray,
    positive: np.ndarray,
    inflation: Callable[[np.ndarray], float],
) -> tuple[Solution, float]:
    """Return the values of least penalised squares, and how many rows count as one.

    Args:
        square: A'WA, shape (values, values).
        aim: A'Wy.
        energy: y'Wy.
        count: sum of the weights.
        prior: sum of the penalties.
        positive: mask of values that are not negative.
        inflation: gives rows that count as one, for values.
    """
    scale = data_scale(count)
    precision, target = scale * square + prior, scale * aim
    values = quick(precision, target)
    if np.any(values[positive] < 0.0):
        values = _not_negative(precision, target, positive)
    correlated = inflation(values)
    variance = max(energy - 2.0 * values @ aim + values @ square @ values, 1e-18) / count
    covariance = inverse(precision) * (scale * variance * correlated)
    return Solution(values, covariance, float(variance)), correlated


def quick(precision: np.ndarray, aim: np.ndarray) -> np.ndarray:
    """Return the solution of a positive definite system, whose rows are first brought to one size."""
    size = 1.0 / np.sqrt(np.diag(precision))
    scaled = precision * size[:, None] * size
    scaled[np.diag_indices_from(scaled)] += RIDGE
    factor = cho_factor(scaled, lower=True, check_finite=False)
    return size * np.asarray(cho_solve(factor, size * aim, check_finite=False))


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a positive definite matrix, whose rows are first brought to one size."""
    size = 1.0 / np.sqrt(np.diag(matrix))
    factor = cho_factor(matrix * size[:, None] * size, lower=True, check_finite=False)
    return np.asarray(cho_solve(factor, np.eye(size.size), check_finite=False)) * size[:, None] * size


def _not_negative(precision: np.ndarray, aim: np.ndarray, positive: np.ndarray) -> np.ndarray:
    """Return the minimum of the quadratic form with some values not negative.

    By bounded least squares on the Cholesky factor.
    """
    size = 1.0 / np.sqrt(np.diag(precision))
    root = np.linalg.cholesky(precision * size[:, None] * size).T
    bounds = (np.where(positive, 0.0, -np.inf), np.full(aim.size, np.inf))
    return lsq_linear(root, np.linalg.solve(root.T, aim * size), bounds, method="bvls").x * size


def inflation_of(residuals: Sequence[np.ndarray]) -> float:
    """Return how many rows count as one: 1 + 2 sum of the autocorrelation over the lags before it first vanishes.

    Args:
        residuals: of each run in the order of time.
    """
    power, longest = 0.0, max((r.size for r in residuals), default=0) // 3
    sums = np.zeros(max(longest, 1))
    for one in residuals:
        length = 1 << int(np.ceil(np.log2(max(2 * one.size, 2))))
        spectrum = np.fft.rfft(one, length)
        correlation = np.fft.irfft(spectrum * spectrum.conj(), length)[: min(sums.size, one.size)]
        sums[: correlation.size] += correlation
        power += float(one @ one)
    if power <= 0.0 or longest < 2:
        return 1.0
    shares = sums / power
    below = np.flatnonzero(shares <= 0.05)
    last = int(below[0]) if below.size else shares.size
    return float(max(1.0 + 2.0 * np.sum(shares[1:last]), 1.0))
