"""What the noise of measured inputs does to the readings: each input moved by its sd, row by row, and simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxmodel.profile import Track

# Rows of one simulation that are moved are so many apart: what a row's noise does to later readings has faded by then.
_APART = 8


def variance_from_inputs(
    predict: Callable[[Track], np.ndarray], courses: Track, input_sd: Mapping[str, float]
) -> np.ndarray:
    """Return the variance that noise of measured inputs adds to each reading, shaped as the predictions.

    Row by row the noise moves a reading at once (a resistance), by what its step does to the state (a relaxation), and
    by the tail of earlier rows; the squares of all are summed, var_k = sum_j (dy_k/du_j)^2 sd^2. Neighbours among the
    rows moved go up and down in turn, so that nothing drifts.

    Args:
        predict: the readings under given steps, shape (runs, rows, ...).
        courses: of all runs, leaves with a leading axis of runs.
        input_sd: by input, the sd of one reading's noise.
    """
    still = predict(courses)
    row = row_of_step(courses)
    variance = np.zeros_like(still)
    for name, sd in input_sd.items():
        values = np.asarray(courses.inputs[name])
        for first in range(_APART):
            turn = np.where((row // _APART) % 2 == 0, 1.0, -1.0)
            moved = jnp.asarray(values + sd * np.where(row % _APART == first, turn, 0.0))
            answer = predict(eqx.tree_at(lambda c, n=name: c.inputs[n], courses, moved)) - still
            variance += np.where(np.isfinite(answer), answer, 0.0) ** 2
    return variance


def row_of_step(courses: Track) -> np.ndarray:
    """Return the row at whose end each step lies, and the first row for the start, shape (runs, 1 + steps)."""
    last_step = np.asarray(courses.last_step)
    steps = np.arange(courses.duration_s.shape[1])
    rows = np.stack([np.append(0, 1 + np.searchsorted(one, steps)) for one in last_step])
    return np.minimum(rows, last_step.shape[1])
