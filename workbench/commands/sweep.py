"""`jaxmodel sweep`: every combination of a study's axes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import sweeps
from jaxmodel.simulate import Status
from sweeps.results import save_table
from workbench import terminal
from workbench.commands.start import in_catalogue, own_effects, start
from workbench.pictures.style import png
from workbench.pictures.sweeps import family, heat_map, label_of, metric_curves

_NO_METRIC = ("status", "valid_share")
_PERCENTS = (0, 5, 50, 95, 100)


def sweep(
    path: Path, out: Path, effects: Sequence[str], *, resume: bool = False, memory: str | None = None
) -> xr.Dataset:
    """Run a study; write its result (Zarr, CSV, manifest) and a picture for each metric to `out`.

    Raises:
        UserError: the study cannot be run.
    """
    with in_catalogue(own_effects(effects)):
        study = sweeps.read_study(path)
    start(out)
    dataset = run_study(study, out=out, resume=resume, memory=memory)
    table = save_table(dataset, out)
    for name, picture in pictures_of(dataset):
        (out / f"{name}.png").write_bytes(picture)
    print_sweep(dataset)
    terminal.say(f"result.zarr, {'lanes.csv, ' if table else ''}manifest.json and pictures are in {out}.")
    return dataset


def run_study(study: sweeps.Study, **how: Any) -> xr.Dataset:
    """Run a study with progress, as `sweeps.run` does."""
    with terminal.counted("sweep", "lanes") as progress:
        return sweeps.run(study, progress, **how)


def lanes_per_second(dataset: xr.Dataset) -> float:
    """Return how fast the lanes of a sweep ran, compilation apart."""
    performance = json.loads(dataset.attrs["manifest"])["performance"]
    return performance["lanes_run"] / performance["run_s"]


def metrics_in(dataset: xr.Dataset) -> list[str]:
    """Return the metrics of a result that have a value anywhere."""
    names = [
        str(name)
        for name, values in dataset.data_vars.items()
        if name not in _NO_METRIC and "time_s" not in values.dims
    ]
    return [name for name in names if np.isfinite(dataset[name]).any()]


def pictures_of(dataset: xr.Dataset) -> Iterator[tuple[str, bytes]]:
    """Yield a picture of each metric, over the two axes that matter most to it, and of each stored column."""
    for metric in metrics_in(dataset):
        axes = _by_influence(dataset, metric)
        if not axes:
            continue
        at, title = middle(dataset, axes[2:])
        if len(axes) == 1:
            yield metric, png(metric_curves(dataset, metric, axes[0]))
        else:
            yield metric, png(heat_map(dataset.isel(at), metric, axes[0], axes[1], title))
            yield f"{metric}-curves", png(metric_curves(dataset.isel(at), metric, axes[0], axes[1], title))
    for column in [str(name) for name, values in dataset.data_vars.items() if "time_s" in values.dims]:
        axes = _by_influence(dataset, column)
        if axes:
            at, title = middle(dataset, axes[1:])
            yield f"{column}-over-time", png(family(dataset.isel(at), column, axes[0], title))


def _by_influence(dataset: xr.Dataset, name: str) -> list[str]:
    """Return the axes of a variable with two values or more, those along which its mean varies most first."""
    values = dataset[name]
    axes = [str(axis) for axis in values.dims if axis != "time_s" and values.sizes[axis] > 1]

    def spread(axis: str) -> float:
        means = values.mean([other for other in values.dims if other != axis])
        return float(means.max() - means.min())

    return sorted(axes, key=spread, reverse=True)


def middle(dataset: xr.Dataset, axes: Sequence[str]) -> tuple[dict[str, int], str]:
    """Return the middle place of some axes, and that of every axis of one value, with a title that says so."""
    places = {axis: dataset.sizes[axis] // 2 for axis in axes}
    places |= {str(axis): 0 for axis, size in dataset.sizes.items() if size == 1 and axis != "time_s"}
    said = [f"{label_of(dataset, axis)} = {float(dataset[axis][place]):g}" for axis, place in places.items()]
    return places, ", ".join(said)


def print_sweep(dataset: xr.Dataset) -> None:
    """Print percentiles of every metric over lanes, how fast it went and how the lanes ended."""
    found = sweeps.percentiles(dataset, _PERCENTS)
    rows = [
        (name, str(dataset[name].attrs.get("units", "")), *(f"{n:.5g}" for n in found[name].to_numpy()))
        for name in map(str, found.data_vars)
        if name not in _NO_METRIC and np.isfinite(found[name]).all()
    ]
    columns = ("metric", "unit", "least", *(f"{percent:g} %" for percent in _PERCENTS[1:-1]), "greatest")
    terminal.table(dataset.attrs["title"] or "Sweep", columns, rows, right=range(2, len(columns)))
    lanes = dataset["status"].size
    terminal.say(f"{lanes:,} lanes, {lanes_per_second(dataset):,.0f} lanes/s.")
    for status, what in (
        (Status.REACHED_CUTOFF, "reached their cut-off"),
        (Status.NOT_FINITE, "ran into numbers that are not finite"),
    ):
        if count := int((dataset["status"] == int(status)).sum()):
            terminal.say(f"{count:,} of {lanes:,} lanes {what}.")
    if "valid_share" in dataset and (count := int((dataset["valid_share"] < 1.0).sum())):
        terminal.say(f"{count:,} of {lanes:,} lanes left the range in which the cell's equations make sense at times.")
