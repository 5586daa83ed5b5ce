"""All pictures of a data set: of a sweep, or of any analysis of `jaxmodel.sensitivity`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from jaxmodel.base.errors import SweepError
from jaxmodel.plots.global_indices import bars, convergence, effects_plane, metrics_that_vary, pairs
from jaxmodel.plots.lanes import panels, parallel, points, varied_in
from jaxmodel.plots.sensitivities import (
    doubling_beside_gradient,
    elasticities,
    elasticity_maps,
    interaction_matrix,
    over_time,
)
from jaxmodel.plots.style import save
from jaxmodel.plots.sweeps import axes_by_influence, family, heat_map, metric_curves, metrics_in, stored_in
from jaxmodel.plots.uncertainty import bands_over_time, metric_intervals
from jaxmodel.sweeps.study import LANE

# Lanes that a picture is made of; more cannot be distinguished.
MOST_DRAWN = 50_000
_FEWEST_OF_MATRIX = 3  # names from which on a matrix says more than the table


def pictures_of(dataset: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    """Yield the pictures of a data set one by one, each with a name for its file.

    Of a sweep: each metric over the two axes that change it most, with panels for the next two, a sample's as points;
    each stored column over time; and where lanes differ in more than two names, all lanes as parallel lines. Of more
    than 50,000 lanes a part is drawn. Of a sensitivity analysis: its pictures for every metric and reading that varies.

    Args:
        dataset: of `jaxmodel.sweeps.run`, or of an analysis of `jaxmodel.sensitivity`.

    Raises:
        SweepError: the data set comes from neither.

    Example:
        >>> from jaxmodel import plots, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0], "current_A": [1.0, 2.0, 3.0]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> dataset = sweeps.run(study, progress=False)
        >>> [name for name, figure in plots.pictures_of(dataset)]
        ['final_soc', 'final_soc-curves', 'voltage_V-over-time']
    """
    analysis = dataset.attrs.get("analysis")
    if analysis is None and "status" in dataset:
        return _of_sweep(thinned(dataset).load())
    if analysis not in _PICTURES:
        raise SweepError("pictures_of: this data set is neither of sweeps.run nor of a sensitivity analysis.")
    return _PICTURES[analysis](dataset)


def save_pictures(dataset: xr.Dataset, directory: str | Path) -> list[Path]:
    """Write the pictures of a data set to a folder as PNG files and return their paths; see `pictures_of`.

    Example:
        >>> from jaxmodel import plots, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0], "current_A": [1.0, 2.0, 3.0]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> dataset = sweeps.run(study, progress=False)
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(plots.save_pictures(dataset, folder)[0].name)
        final_soc.png
    """
    return save(pictures_of(dataset), directory)


def thinned(dataset: xr.Dataset) -> xr.Dataset:
    """Return a sweep with at most 50,000 lanes: of its longest axes every second value, and again."""
    sizes = {str(name): size for name, size in dataset.sizes.items() if name != "time_s"}
    strides = dict.fromkeys(sizes, 1)
    while math.prod(-(-size // strides[name]) for name, size in sizes.items()) > MOST_DRAWN:
        longest = max(sizes, key=lambda name: sizes[name] / strides[name])
        strides[longest] *= 2
    return dataset.isel({name: slice(None, None, stride) for name, stride in strides.items() if stride > 1})


def _of_sweep(dataset: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    metrics, varied = metrics_in(dataset), varied_in(dataset)
    if len(varied) > 2 and metrics:
        yield "parallel", parallel(dataset)
    for metric in metrics:
        if LANE in dataset.dims:
            if varied:
                yield metric, points(dataset, metric)
            continue
        axes = len(axes_by_influence(dataset, metric))
        if axes == 1:
            yield metric, metric_curves(dataset, metric)
        elif axes > 1:
            yield metric, heat_map(dataset, metric) if axes == 2 else panels(dataset, metric)
            yield f"{metric}-curves", metric_curves(dataset, metric)
    for column in stored_in(dataset):
        if axes_by_influence(dataset, column):
            yield f"{column}-over-time", family(dataset, column)


def _of_local(data: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    yield "elasticities", elasticities(data)
    if "effect" in data:
        for metric in _changing(data["linear_change"], "metric"):
            yield f"doubling-{metric}", doubling_beside_gradient(data, metric)
    for output in _changing(data["output_change"].where(data["doubles"]), "output"):
        yield f"over-time-{output}", over_time(data, output)


def _of_interactions(data: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    if data.sizes["parameter"] >= _FEWEST_OF_MATRIX:
        for metric in _changing(data["predicted_joint"], "metric"):
            yield f"interactions-{metric}", interaction_matrix(data, metric)


def _of_uncertainty(data: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    yield "uncertainty", metric_intervals(data)
    for output in _changing(data["output_sd_gradient"], "output"):
        yield f"uncertainty-{output}", bands_over_time(data, output)


def _of_global_indices(data: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    method = data.attrs["method"]
    for metric in metrics_that_vary(data):
        yield f"{method}-{metric}", effects_plane(data, metric) if method == "morris" else bars(data, metric)
        if "second" in data:
            yield f"pairs-{metric}", pairs(data, metric)
        if data.sizes["blocks"] > 1:
            yield f"convergence-{metric}", convergence(data, metric)


def _of_elasticity_map(data: xr.Dataset) -> Iterator[tuple[str, Figure]]:
    for metric in map(str, data["metric"].to_numpy()):
        if bool(np.any(np.isfinite(data["elasticity"].sel(metric=metric)))):
            yield f"elasticity-map-{metric}", elasticity_maps(data, metric)


_PICTURES = {
    "local": _of_local,
    "interactions": _of_interactions,
    "uncertainty": _of_uncertainty,
    "global_indices": _of_global_indices,
    "elasticity_map": _of_elasticity_map,
}


def _changing(values: xr.DataArray, dimension: str) -> list[str]:
    """Return the metrics or outputs of which any value is not zero."""
    largest = abs(values).max([dim for dim in values.dims if dim != dimension])
    return [str(name) for name in values[dimension].to_numpy() if float(largest.sel({dimension: name})) > 0.0]
