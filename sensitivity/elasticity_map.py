"""Elasticities over the axes of a study: how what matters changes with temperature, torque or a parameter."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray
from jaxtyping import Array, Float

from jaxmodel.profile import Profile
from sensitivity.metrics import choose_metrics, has_derivative
from sensitivity.response import SHIFTED_INPUT, Response, make_response
from sweeps.study import Study

# One lane at a time, a step is mostly the dispatch of its operations; many at a time leave the cache.
_AT_ONCE = 32


def elasticity_map(study: Study, names: Sequence[str] | None = None) -> xarray.Dataset:
    """Return the derivatives of a study's metrics by parameters at every combination of its axes.

    Args:
        study: its axes are parameters or inputs; its sample is not looked at.
        names: parameters and inputs to differentiate by; None takes all that enter.

    Returns:
        A data set over the axes, metric and parameter: metric_value, metric_derivative (by an input on an axis in its
        own unit, by any other as a factor, by the ambient in K), and elasticity, NaN where it means nothing.

    Raises:
        ParameterError: an axis is no parameter and no input of the run.
    """
    prepared = study.prepared
    named = [metric for metric in prepared.metrics if has_derivative(metric)] if study.metrics else None
    metrics = choose_metrics(named, prepared.model.kind)
    model, axes = prepared.model, dict(study.axes)
    asked = tuple(names or make_response(model, prepared.profile, None, metrics, (), prepared.cutoff).names)
    # An input on an axis is 1 in the course, the ambient 0 degC: its factor, its shift, is then the input itself.
    inputs = {
        name: np.full_like(column, 0.0 if name == SHIFTED_INPUT else 1.0) if name in axes else column
        for name, column in prepared.profile.inputs.items()
    }
    profile = Profile(prepared.profile.time_s, inputs)
    moved = tuple(dict.fromkeys([*asked, *axes]))
    response = make_response(model, profile, moved, metrics, (), prepared.cutoff)
    grid = np.meshgrid(*axes.values(), indexing="ij")
    at = np.tile(np.asarray(response.values()), (grid[0].size, 1))
    for name, values in zip(axes, grid, strict=True):
        at[:, moved.index(name)] = values.reshape(-1)
    at_once = min(_AT_ONCE, len(at))
    filled = np.concatenate([at, np.repeat(at[-1:], -len(at) % at_once, axis=0)])
    # Batch after batch from here, not by a loop in the program: see jaxmodel.kernel.
    batches = [_of_lanes(response, jnp.asarray(some), len(asked)) for some in np.split(filled, len(filled) // at_once)]
    numbers, slopes = (np.concatenate(parts)[: len(at)] for parts in zip(*batches, strict=True))
    shape = grid[0].shape
    value = numbers.reshape(*shape, -1)
    derivative = np.moveaxis(slopes, 1, 2).reshape(*shape, len(metrics), len(asked))
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


@eqx.filter_jit
def _of_lanes(
    response: Response, at: Float[Array, "lanes moved"], asked: int
) -> tuple[Float[Array, "lanes metric"], Float[Array, "lanes parameter metric"]]:
    def lane(values):
        def push(direction):
            return jax.jvp(lambda x: response(x).metrics, (values,), (direction,))

        return jax.vmap(push, out_axes=(None, 0))(jnp.eye(asked, values.size))

    return jax.vmap(lane)(at)
