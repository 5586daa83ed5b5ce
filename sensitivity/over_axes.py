"""Elasticities over the axes of a study: how what matters changes with temperature, torque or a parameter."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray
from jaxtyping import Array, Float

from jaxmodel.base.errors import SweepError
from jaxmodel.base.jax_settings import SWEEP_OPTIONS
from jaxmodel.base.progress import counted
from jaxmodel.lanes import NotNative
from jaxmodel.model.profile import Profile
from jaxmodel.sensitivity import by_vectors
from jaxmodel.sensitivity.labels import labelled
from jaxmodel.sensitivity.metrics import choose_metrics, has_derivative
from jaxmodel.sensitivity.response import SHIFTED_INPUT, Response, make_response
from jaxmodel.sweeps.engine import Progress
from jaxmodel.sweeps.results import about
from jaxmodel.sweeps.study import Study

# Few lanes at a time, a step is mostly the dispatch of its operations; many at a time leave the cache.
_AT_ONCE = 64


def elasticity_map(
    study: Study, names: Sequence[str] | None = None, progress: bool | Progress = True
) -> xarray.Dataset:
    """Return the derivatives of a study's metrics by parameters at every combination of its axes.

    Args:
        study: its axes, two or more, are parameters or inputs; its sample is left aside.
        names: parameters and inputs to differentiate by; None takes all that enter.
        progress: as in `jaxmodel.sweeps.run`.

    Returns:
        A data set over the axes, metric and parameter: metric_value, metric_derivative (by an input on an axis in its
        own unit, by any other as a factor, by the ambient in K), and elasticity, NaN where it means nothing.

    Raises:
        SweepError: the study has fewer than two axes.
        ParameterError: an axis is no parameter and no input of the run.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0], "ambient_degC": [0.0, 20.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> sensitivity.elasticity_map(study, progress=False)["elasticity"].dims
        ('capacity_Ah', 'ambient_degC', 'metric', 'parameter')
    """
    if len(study.axes) < 2:
        raise SweepError("axes: two axes make a map; add them to the study's [axes].")
    prepared = study.prepared
    named = [metric for metric in prepared.metrics if has_derivative(metric)] if study.metrics else None
    metrics = choose_metrics(named, prepared.model.kind)
    model, axes = prepared.model, dict(study.axes)
    asked = tuple(names or make_response(model, prepared.profile, None, metrics, (), prepared.cutoff).names)
    # An input on an axis is 1 in the profile, the ambient 0 degC: its factor, its shift, is then the input itself.
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
    with counted(progress, study.title or "elasticity map", "lanes") as tell:
        numbers, slopes = _at_lanes(response, at, len(asked), tell)
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
    data = xarray.Dataset(
        {
            "metric_value": (dims[:-1], value),
            "metric_derivative": (dims, derivative),
            "elasticity": (dims, elasticity),
        },
        {name: values for name, values in axes.items()}
        | {"metric": [metric.name for metric in metrics], "parameter": list(asked)},
        {"title": study.title, "analysis": "elasticity_map"},
    )
    # The unit of each metric and parameter, to which those of the variables refer.
    units = {
        "metric_unit": ("metric", [metric.unit for metric in metrics]),
        "unit": ("parameter", [one.unit for one in info]),
    }
    return labelled(data.assign_coords(units), {name: about(study, name) for name in axes})


def _at_lanes(response: Response, at: np.ndarray, asked: int, report: Progress) -> tuple[np.ndarray, np.ndarray]:
    """Return the metrics of all lanes and their derivatives, shapes (lanes, metric) and (lanes, parameter, metric)."""
    lanes, finished = len(at), 0
    report(0, lanes)

    def done(some: int) -> None:
        nonlocal finished
        finished += some
        report(finished, lanes)

    with contextlib.suppress(NotNative):
        answer, slopes = by_vectors.slopes(response, at, asked, done)
        return np.asarray(answer.metrics), np.asarray(slopes.metrics)
    return _in_batches(response, at, asked, done)


def _in_batches(
    response: Response, at: np.ndarray, asked: int, done: Callable[[int], None]
) -> tuple[np.ndarray, np.ndarray]:
    """Return what `_at_lanes` does, through XLA."""
    lanes, at_once = len(at), min(_AT_ONCE, len(at))
    filled = np.concatenate([at, np.repeat(at[-1:], -lanes % at_once, axis=0)])
    batches = np.split(filled, len(filled) // at_once)
    program = _compiled(response, batches[0], asked)
    parts = []
    # Batch after batch from here, not by a loop in the program: see jaxmodel.lanes.xla_kernel. A batch fills one core.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for part in pool.map(program, batches):
            parts.append(part)
            done(min(at_once, lanes - (len(parts) - 1) * at_once))
    numbers, slopes = (np.concatenate(each)[:lanes] for each in zip(*parts, strict=True))
    return numbers, slopes


def _compiled(
    response: Response, batch: np.ndarray, asked: int
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return the compiled program from a batch of lanes to its metrics and derivatives.

    Lanes outside, tangents inside: the inner loop then reads what all tangents share of a step. The other way round
    XLA computes it anew for every tangent.
    """
    arrays, rest = eqx.partition(response, eqx.is_array)

    def of_lanes(
        arrays: Response, at: Float[Array, "lanes moved"]
    ) -> tuple[Float[Array, "lanes metric"], Float[Array, "lanes parameter metric"]]:
        def lane(values: Array) -> tuple[Array, Array]:
            def push(direction: Array) -> tuple[Array, Array]:
                return jax.jvp(lambda x: eqx.combine(arrays, rest)(x).metrics, (values,), (direction,))

            return jax.vmap(push, out_axes=(None, 0))(jnp.eye(asked, values.size))

        return jax.vmap(lane)(at)

    options = SWEEP_OPTIONS if jax.default_backend() == "cpu" else None
    program = jax.jit(of_lanes).lower(arrays, jnp.asarray(batch)).compile(options)

    def run(some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        numbers, slopes = program(arrays, jnp.asarray(some))
        return np.asarray(numbers), np.asarray(slopes)

    return run
