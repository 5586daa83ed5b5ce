"""A sigma-point filter beside the extended Kalman filter: the same states, errors and first reading, no linearisation.

It is the square-root cubature Kalman filter (Arasaratnam and Haykin, IEEE Trans. Automatic Control 54 (2009) 1254), of
the sigma-point filters that Plett (J. Power Sources 161 (2006) 1369) proposes for cells the one with equal weights. It
is a peer in evaluations; its steps are dearer.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmodel.model.declaration import Scalar
from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.kalman import (
    FilterOutput,
    Measured,
    Row,
    Tuning,
    added_variance,
    expected_voltage,
    first_corrected,
    moved,
    output_of,
    state_names,
    within_range,
)


def cubature_filter(
    model: Model, tuning: Tuning, measured: Measured, start_soc: Scalar, pairs_sd_V: Scalar
) -> FilterOutput:
    """Run one filter over a run; arguments and output are those of `ekf`.

    x = mean of f(x_j), x_j = x +- sqrt(n) S_j, S the square root of the covariance, carried on by QR decompositions.
    """
    begin, first_output, rows = first_corrected(model, tuning, measured, start_soc, pairs_sd_V)
    mean, covariance = begin
    variances, axes = jnp.linalg.eigh(covariance)
    root = axes * jnp.sqrt(jnp.maximum(variances, 0.0))

    def advance(carry: tuple[Array, Array], row: tuple[Array, Row]) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
        return _corrected(model, tuning, *_predicted(model, tuning, *carry, *row), row[1])

    outputs = jax.lax.scan(advance, (mean, root), rows)[1]
    return FilterOutput(*(jnp.concatenate([one[None], rest]) for one, rest in zip(first_output, outputs, strict=True)))


def _points(mean: Array, root: Array) -> Array:
    """Return the 2 n points of equal weight, shape (2 n, n)."""
    away = jnp.sqrt(1.0 * mean.size) * root.T
    return mean + jnp.concatenate([away, -away])


def _root(columns: Array) -> Array:
    """Return the triangular square root of the sum of squares of columns, shape (n, any)."""
    return jnp.linalg.qr(columns.T, mode="r").T


def _predicted(
    model: Model, tuning: Tuning, mean: Array, root: Array, duration: Array, row: Row
) -> tuple[Array, Array]:
    ends = jax.vmap(lambda x: moved(model, tuning, x, duration, row))(_points(mean, root))
    end = jnp.mean(ends, axis=0)
    added = jnp.sqrt(added_variance(model, tuning, end, duration, row))
    off = (ends - end) / jnp.sqrt(1.0 * ends.shape[0])
    return end, _root(jnp.concatenate([off.T, jnp.diag(added)], axis=1))


def _corrected(
    model: Model, tuning: Tuning, mean: Array, root: Array, row: Row
) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
    points = _points(mean, root)
    volts = jax.vmap(lambda x: expected_voltage(model, x, row))(points)
    share = 1.0 / jnp.sqrt(1.0 * volts.size)
    off, off_V = share * (points - mean), share * (volts - jnp.mean(volts))
    spread = jnp.sum(off_V**2) + tuning.voltage_sd_V**2
    seen = jnp.isfinite(row[2])
    gain = jnp.where(seen, off_V @ off / spread, 0.0)
    innovation = jnp.where(seen, row[2] - jnp.mean(volts), 0.0)
    columns = jnp.concatenate([(off - off_V[:, None] * gain).T, (gain * tuning.voltage_sd_V)[:, None]], axis=1)
    left, soc = _root(columns), state_names(model).index("soc")
    corrected = within_range(mean + gain * innovation, left @ left[soc], soc)
    normalised = jnp.where(seen, innovation / jnp.sqrt(spread), jnp.nan)
    return (corrected, left), output_of(model, corrected, left @ left.T, normalised)
