"""Columns of linear least squares: hat functions and first-order lags."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded


def hats(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Return the weights of linear interpolation between knots, held at the ends, shape (rows, knots)."""
    weights = np.zeros((x.size, knots.size))
    left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    share = np.clip((x - knots[left]) / np.diff(knots)[left], 0.0, 1.0)
    rows = np.arange(x.size)
    weights[rows, left], weights[rows, left + 1] = 1.0 - share, share
    return weights


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
