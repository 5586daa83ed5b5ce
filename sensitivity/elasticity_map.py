"""Elasticities over the axes of a study: how what matters changes with temperature, torque or a parameter."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray
from jaxtyping import Array, Float

from jaxmodel.errors import SweepError
from sensitivity.metrics import choose_metrics, has_derivative
from sensitivity.response import SHIFTED_INPUT, Answer, Response, make_response
from sweeps.study import Study


def elasticity_map(study: Study, names: Sequence[str] | None = None) -> xarray.Dataset:
    """Return the derivatives of a study's metrics by parameters at every combination of its axes.

    Args:
        study: its axes are parameters or inputs, an input's axis without zero as its first value; its sample is not
            looked at.
        names: parameters and inputs to differentiate by; None takes all that enter.

    Returns:
        A data set over the axes, metric and parameter: metric_value, metric_derivative (by an input as a factor, by the
        ambient as a shift), and elasticity, NaN where it means nothing.

    Raises:
        SweepError: an axis is no parameter and no input, or an input's first value is zero.
    """
    prepared = study.prepared
    named = [metric for metric in prepared.metrics if has_derivative(metric)] if study.metrics else None
    metrics = choose_metrics(named, prepared.model.kind)
    model, profile, axes = prepared.model, prepared.profile, dict(study.axes)
    asked = tuple(names or make_response(model, profile, None, metrics, (), prepared.cutoff).names)
    moved = tuple(dict.fromkeys([*asked, *axes]))
    response = make_response(model, profile, moved, metrics, (), prepared.cutoff)
    grid = np.meshgrid(*axes.values(), indexing="ij")
    at = np.tile(np.asarray(response.values()), (grid[0].size, 1))
    for name, values in zip(axes, grid, strict=True):
        at[:, moved.index(name)] = _in_coordinates(name, values.reshape(-1), profile.inputs.get(name))
    answer, slopes = _over_lanes(response, jnp.asarray(at), len(asked))
    shape = grid[0].shape
    value = np.asarray(answer.metrics).reshape(*shape, -1)
    derivative = np.moveaxis(np.asarray(slopes.metrics), 1, 2).reshape(*shape, len(metrics), len(asked))
    parameter = at[:, : len(asked)].reshape(*shape, 1, len(asked))
    info = response.table()[: len(asked)]
    means = np.array([one.unit != "degC" and one.name != SHIFTED_INPUT for one in info])
    proportional = np.array([metric.unit != "degC" for metric in metrics])[:, None] & means & (parameter != 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticity = np.where(
            proportional & (value[..., None] != 0.0), parameter * derivative / value[..., None], np.nan
        )
    dims = (*axes, "metric", "parameter")
    return xarray.Dataset(
        {
            "metric_value": (dims[:-1], value),
            "metric_derivative": (dims, derivative),
            "elasticity": (dims, elasticity),
        },
        {name: values for name, values in axes.items()}
        | {"metric": [metric.name for metric in metrics], "parameter": list(asked)},
        {"title": study.title},
    )


def _in_coordinates(name: str, values: np.ndarray, course: np.ndarray | None) -> np.ndarray:
    """Return values of an axis as a response takes them: of an input a factor on its course, the ambient's as a shift.

    The study's own course has the first value of the axis.
    """
    if course is None:
        return values
    first = float(np.asarray(course).reshape(-1)[0])
    if name == SHIFTED_INPUT:
        return values - first
    if first == 0.0:
        raise SweepError(f"axes.{name}: begin with a value that is not 0, of which all others are multiples.")
    return values / first


@eqx.filter_jit
def _over_lanes(response: Response, at: Float[Array, "lanes moved"], asked: int) -> tuple[Answer, Answer]:
    def lane(values):
        def push(direction):
            return jax.jvp(response, (values,), (direction,))

        return jax.vmap(push, out_axes=(None, 0))(jnp.eye(asked, values.size))

    return jax.lax.map(lane, at)
