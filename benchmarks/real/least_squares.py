"""What the reference is made of: hat functions, first-order lags, ridge regression that leaves out a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_banded

# Points of a curve between the least and the largest state of charge that was fitted, as fractions of the span.
FINE = np.array([0, 0.01, 0.025, 0.05, 0.075, 0.1, *np.arange(0.15, 0.91, 0.05), 0.925, 0.95, 0.975, 0.99, 1.0])
COARSE = np.array([0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0])


def hats(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Return the weights of linear interpolation between knots, held at the ends, shape (rows, knots)."""
    return np.column_stack([np.interp(x, knots, unit) for unit in np.eye(len(knots))])


def relaxed(time_s: np.ndarray, drive: np.ndarray, tau_s: float, first: float = 0.0) -> np.ndarray:
    """Return the first-order response to drives (rows, any) that hold over the step that ends at their row.

    y_k = a_k y_(k-1) + (1 - a_k) u_k with a_k = exp(-dt_k / tau), and y_0 = `first`.
    """
    kept = np.exp(-np.diff(time_s) / tau_s)
    bands = np.ones((2, time_s.size))
    bands[1, :-1] = -kept
    right = drive * np.append(0.0, 1.0 - kept).reshape(-1, *[1] * (drive.ndim - 1))
    right[0] = first
    return solve_banded((1, 0), bands, right, check_finite=False)


def differences(order: int, count: int) -> np.ndarray:
    """Return the differences of an order between neighbouring points, shape (count - order, count)."""
    return np.diff(np.eye(count), order, axis=0)


@dataclasses.dataclass(frozen=True, eq=False)
class Sums:
    """The normal equations of one run: A'A, A'y, y'y and the rows."""

    square: np.ndarray
    aim: np.ndarray
    energy: float
    rows: int

    @classmethod
    def of(cls, matrix: np.ndarray, target: np.ndarray) -> Sums:
        """Return those of a design (rows, values) and what it is to give (rows,)."""
        return cls(matrix.T @ matrix, matrix.T @ target, float(target @ target), target.size)

    def mean_square(self, values: np.ndarray) -> float:
        """Return the mean square of what values leave."""
        return float(self.energy - 2.0 * values @ self.aim + values @ self.square @ values) / self.rows


def ridge(sums: Sequence[Sums], penalty: np.ndarray) -> np.ndarray:
    """Return the values of least mean square, over all rows, plus values' penalty (values, values)."""
    rows = sum(part.rows for part in sums)
    square = np.sum([part.square for part in sums], axis=0) / rows
    # A value that nothing asks for is zero.
    tiny = 1e-12 * (np.trace(square) / len(square) + 1e-30) * np.eye(len(square))
    return np.linalg.solve(square + penalty + tiny, np.sum([part.aim for part in sums], axis=0) / rows)


def left_out(sums: Sequence[Sums], penalty: np.ndarray) -> float:
    """Return how badly the other runs foretell each run: the mean logarithm of the mean square, as rows count.

    The logarithm, lest one run that no other can foretell decides alone.
    """
    found, rows = 0.0, 0
    for number, part in enumerate(sums):
        others = [other for place, other in enumerate(sums) if place != number]
        found += part.rows * float(np.log(max(part.mean_square(ridge(others, penalty)), 1e-30)))
        rows += part.rows
    return found / rows
