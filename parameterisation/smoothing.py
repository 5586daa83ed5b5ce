"""Linear least squares with smooth curves: hat functions, first-order lags, penalties and their strengths.

The strengths of the penalties are those of the largest restricted likelihood (REML), by the update of Fellner and
Schall (Wood and Fasiolo, Biometrics 73, 2017). Residuals of a model of a cell are correlated over many rows: the
likelihood is tempered, each row counting 1 / inflation, with the inflation measured on the residuals.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_banded
from scipy.optimize import lsq_linear

ROUNDS = 40  # of the strengths
SETTLED = 0.02  # largest change of the logarithm of a strength at which they are settled
WEAKEST, STRONGEST = 1e-7, 1e4  # of a strength, in units of what the data say
RIDGE = 1e-8  # of a curve's size: makes a penalty invertible


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
    return solve_banded((1, 0), bands, right, overwrite_b=True, check_finite=False)


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
    """A quadratic penalty on some values: strength x values' matrix values.

    Attributes:
        at: the values it acts on.
        matrix: positive semi-definite, shape (at, at).
        fixed: a precision that is known (1 / sd^2, in the values' unit); None: the strength is estimated.
    """

    at: slice
    matrix: np.ndarray
    fixed: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Solution:
    """Values of a regularised least-squares problem.

    Attributes:
        values: shape (values,).
        covariance: of the values, model misfit included by the inflation.
        strengths: of the penalties that are not fixed.
        variance: of a residual.
        freedom: the effective number of values.
    """

    values: np.ndarray
    covariance: np.ndarray
    strengths: np.ndarray
    variance: float
    freedom: float


def penalty_matrix(size: int, penalties: Sequence[Penalty], strengths: np.ndarray) -> np.ndarray:
    """Return the sum of the penalties, with known strengths and the given ones in their order."""
    total, free = np.zeros((size, size)), iter(strengths)
    for penalty in penalties:
        total[penalty.at, penalty.at] += (next(free) if penalty.fixed is None else penalty.fixed) * penalty.matrix
    return total


def solve(
    square: np.ndarray,
    aim: np.ndarray,
    energy: float,
    rows: float,
    penalties: Sequence[Penalty],
    inflation: float,
    strengths: np.ndarray | None = None,
    positive: np.ndarray | None = None,
) -> Solution:
    """Return the values of least penalised squares, with the strengths of largest restricted likelihood.

    Args:
        square: A'A, shape (values, values).
        aim: A'y.
        energy: y'y.
        rows: number of rows, by weight.
        penalties: on the values; every value that the rows do not determine has one.
        inflation: rows that count as one.
        strengths: known strengths; None estimates them.
        positive: mask of values that are not negative.
    """
    size = aim.size
    free = [p for p in penalties if p.fixed is None]
    estimate = strengths is None
    variance = max(energy / max(rows, 1.0) * 1e-4, 1e-12)
    # The information of the data on the values of a penalty, in units of its matrix: bounds of its strength.
    largest = np.max(np.diag(square))
    data = np.array([_size(square[p.at, p.at], 1e-9 * largest) / _size(p.matrix, 1e-300) for p in free]) / inflation
    current = 0.01 * data / variance if strengths is None else np.asarray(strengths, dtype=float)
    tiny = RIDGE * np.maximum(np.diag(square), 1e-9 * largest) / inflation
    values, spread, freedom = np.zeros(size), np.zeros((size, size)), 0.0
    for _ in range(ROUNDS if estimate else 3):
        prior = penalty_matrix(size, penalties, current) + np.diag(tiny / variance)
        spread = inverse(square / (inflation * variance) + prior)
        values = spread @ (aim / (inflation * variance))
        squares = max(energy - 2.0 * values @ aim + values @ square @ values, 1e-18)
        freedom = float(np.sum(spread * square) / (inflation * variance))
        if not estimate:
            variance = squares / max(rows - inflation * freedom, 0.1 * rows)
            continue
        within = inverse(prior)
        new = current.copy()
        for number, penalty in enumerate(free):
            at, matrix = penalty.at, penalty.matrix
            gained = np.sum(within[at, at] * matrix) - np.sum(spread[at, at] * matrix)
            bent = values[at] @ matrix @ values[at]
            new[number] = current[number] * max(gained, 1e-8) / max(bent, 1e-30)
        variance = squares / max(rows - inflation * freedom, 0.1 * rows)
        new = np.clip(
            np.clip(new, current / 100.0, current * 100.0), WEAKEST * data / variance, STRONGEST * data / variance
        )
        moved = float(np.max(np.abs(np.log(new / current)), initial=0.0))
        current = new
        if moved < SETTLED:
            break
    precision = square / (inflation * variance) + penalty_matrix(size, penalties, current) + np.diag(tiny / variance)
    covariance = inverse(precision)
    target = aim / (inflation * variance)
    values = covariance @ target
    if positive is not None and np.any(values[positive] < 0.0):
        values = _not_negative(precision, target, positive)
    return Solution(values, covariance, current, float(variance), freedom)


def _size(matrix: np.ndarray, least: float) -> float:
    return max(float(np.mean(np.diag(matrix))), least)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a positive definite matrix, whose rows are first brought to one size."""
    size = 1.0 / np.sqrt(np.diag(matrix))
    factor = cho_factor(matrix * size[:, None] * size, lower=True, check_finite=False)
    return cho_solve(factor, np.eye(size.size), check_finite=False) * size[:, None] * size


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
