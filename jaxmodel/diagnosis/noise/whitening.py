"""Whitening of AR(1) noise, chain by chain.

A *chain* is a stretch of consecutive rows of one run over which the noise is one AR(1) process. Rows of all runs are
stacked; a boolean array `starts` is True where a new chain begins: at the first row of every run and after every pause.
Without whitening a nominal 5 % false-alarm rate becomes nearly 100 % at rho = 0.9.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxmodel.diagnosis.preparation.signals import after_pauses

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]
Integers = NDArray[np.integer]


def chain_starts(times: Iterable[ArrayLike]) -> Bools:
    """Mark where chains begin in the stacked rows of all runs.

    Args:
        times: of each run, (rows,) times in seconds, increasing.

    Returns:
        (n,) booleans, n the sum of the rows: True at the first row of a run and at the first after a pause. A pause is
        an interval many times as long as those on both sides; a slower sampling rate is none.
    """
    return np.concatenate(
        [np.zeros(0, dtype=bool), *(after_pauses(np.asarray(time_s, dtype=float)) for time_s in times)]
    )


def chain_weights(starts: ArrayLike, rho: float, present: ArrayLike) -> tuple[Integers, Floats]:
    """Return the rows that were read, and the correlation of the noise of each with that of the previous one.

    Args:
        starts: (n,) booleans, True where a chain begins.
        rho: correlation of the noise between consecutive rows; |rho| < 1.
        present: (n,) booleans, False for a missing reading.

    Returns:
        Row numbers (k,), and weights (k,): rho^(rows since the previous reading), 0 at the first of a chain.

    Raises:
        ValueError: |rho| >= 1.
    """
    if not abs(rho) < 1.0:
        raise ValueError(f"rho must lie between -1 and 1, not {rho}.")
    rows = np.flatnonzero(np.asarray(present, dtype=bool))
    weight = np.zeros(len(rows))
    if len(rows) > 1 and rho != 0.0:
        chain = np.cumsum(np.asarray(starts, dtype=bool))[rows]
        weight[1:] = np.where(np.diff(chain) == 0, np.float64(rho) ** np.diff(rows), 0.0)
    return rows, weight


def whiten(
    values: ArrayLike,
    starts: ArrayLike,
    rho: float,
    sd: float | ArrayLike,
    present: ArrayLike | None = None,
) -> Floats:
    """Whiten columns of readings whose noise is AR(1).

    With u = e / sd and w the correlation with the last reading present in the chain, a row becomes (u_t - w u_s) /
    sqrt(1 - w^2), and u_t at the start of a chain. This is the exact inverse square root of the noise covariance, also
    across missing readings, with w = rho^(t-s).

    Args:
        values: (n,) or (n, m); all columns are whitened in the same way (residuals, sensitivities). Missing rows may
            have any value, including NaN.
        starts: (n,) booleans, True where a chain begins.
        rho: correlation of the noise between consecutive rows; |rho| < 1.
        sd: standard deviation of one reading's noise in the unit of the readings: one number, or (n,) where it varies.
        present: (n,) booleans, False for a missing reading; all present by default. Use that of the residual for the
            sensitivities too.

    Returns:
        The whitened values, same shape; missing rows are 0 (weight 0).

    Raises:
        ValueError: |rho| >= 1, or an sd that is not positive.
    """
    shaped = np.asarray(values, dtype=float)
    columns = shaped.reshape(len(shaped), -1)
    rows, weight = chain_weights(starts, rho, np.ones(len(columns)) if present is None else present)
    scale = np.broadcast_to(np.asarray(sd, dtype=float), len(columns))[rows]
    if not np.all(scale > 0.0):
        raise ValueError("Every noise sd must be positive.")
    whitened = np.zeros_like(columns)
    whitened[rows] = innovations((columns[rows] / scale[:, None]).T, weight).T
    return whitened.reshape(shaped.shape)


def innovations(values: Floats, weight: Floats) -> Floats:
    """Return the innovations of (..., n) values, in their sd: (u_t - w u_s) / sqrt(1 - w^2).

    Args:
        values: in units of their sd, in the order of their chains.
        weight: (n,) w, the correlation of each with the previous one; 0 at the first of a chain.
    """
    new = values.copy()
    new[..., 1:] -= weight[1:] * values[..., :-1]
    return new / np.sqrt(1.0 - weight**2)
