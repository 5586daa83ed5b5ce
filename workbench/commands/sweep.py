"""`jaxmodel sweep`: every combination of a study's axes."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import sweeps
from jaxmodel.jax_settings import keep_compiled_programs
from jaxmodel.simulation import Status
from plots.lanes import panels, parallel, points, varied_in
from plots.style import png
from plots.sweeps import family, heat_map, label_of, metric_curves
from sweeps.plan import size_text
from sweeps.results import save_table
from sweeps.study import LANE
from workbench import terminal
from workbench.commands.start import in_catalogue, own_effects, start

_NO_METRIC = ("status", "valid_share")
# Lanes that a picture is made of; more cannot be told apart.
MOST_DRAWN = 50_000
_PERCENTS = (0, 5, 50, 95, 100)


def sweep(
    path: Path,
    out: Path,
    effects: Sequence[str],
    *,
    dry_run: bool = False,
    memory: str | None = None,
    pictures: bool = True,
    **how: Any,
) -> xr.Dataset | None:
    """Run a study; write its result (Zarr, CSV, manifest) and a picture for each metric to `out`.

    Args:
        path: the study file.
        out: the folder.
        effects: of the user's own, as `file.py:Class`.
        dry_run: says what the sweep would take, and writes nothing.
        memory: as `sweeps.run` takes it.
        pictures: whether to draw.
        how: `resume` and `engine`, as `sweeps.run` takes them.

    Raises:
        UserError: the study cannot be run.
    """
    with in_catalogue(own_effects(effects)):
        study = sweeps.read_study(path)
    if dry_run:
        keep_compiled_programs()
        print_forecast(study.title or path.name, sweeps.forecast(study, memory))
        return None
    start(out)
    dataset = run_study(study, out=out, memory=memory, **how)
    table = save_table(dataset, out)
    for name, picture in pictures_of(dataset) if pictures else ():
        (out / f"{name}.png").write_bytes(picture)
    print_sweep(dataset)
    terminal.say(
        f"result.zarr, {'lanes.csv, ' if table else ''}manifest.json{' and pictures' if pictures else ''} are in {out}."
    )
    return dataset


def print_forecast(title: str, plan: sweeps.Forecast) -> None:
    """Print what a sweep would take."""
    rows = (
        ("lanes", f"{plan.lanes:,}"),
        ("steps of each", f"{plan.steps:,}"),
        ("chunks", f"{plan.chunks:,} of at most {plan.lanes_per_chunk:,} lanes"),
        ("memory", f"{size_text(plan.memory_bytes)} beside the program's own 0.5 GB"),
        ("disk", f"{size_text(plan.disk_bytes)} at most"),
        ("speed", f"{plan.lanes_per_s:,.0f} lanes/s on {plan.devices}"),
        ("time", f"{terminal.duration(plan.run_s)} after {terminal.duration(plan.compile_s)} of compiling"),
    )
    terminal.table(title, ("what it would take", ""), rows)
    terminal.say("Nothing was run but the lanes that were timed, and nothing was written.")


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


def thinned(dataset: xr.Dataset) -> xr.Dataset:
    """Return a result with at most some 50,000 lanes: of its longest dimensions every second value, and again."""
    sizes = {str(name): size for name, size in dataset.sizes.items() if name != "time_s"}
    strides = dict.fromkeys(sizes, 1)
    while math.prod(-(-size // strides[name]) for name, size in sizes.items()) > MOST_DRAWN:
        longest = max(sizes, key=lambda name: sizes[name] / strides[name])
        strides[longest] *= 2
    return dataset.isel({name: slice(None, None, stride) for name, stride in strides.items() if stride > 1})


def pictures_of(dataset: xr.Dataset) -> Iterator[tuple[str, bytes]]:
    """Yield pictures of each metric and of each stored column, of large results of a part of their lanes.

    A metric is drawn over the two axes that matter most to it, with panels for the next two; a sample's as points over
    what it follows most. Where lanes differ in more than two things, one more picture draws each as a line through all.
    """
    dataset = thinned(dataset).load()
    metrics, varied = metrics_in(dataset), varied_in(dataset)
    if len(varied) > 2 and metrics:
        yield "parallel", png(parallel(dataset, varied, metrics))
    for metric in metrics:
        if LANE in dataset.dims:
            if varied:
                yield metric, png(points(dataset, metric, varied))
            continue
        axes = _by_influence(dataset, metric)
        if not axes:
            continue
        at, title = middle(dataset, axes[2:])
        if len(axes) == 1:
            yield metric, png(metric_curves(dataset, metric, axes[0]))
            continue
        if len(axes) == 2:
            yield metric, png(heat_map(dataset.isel(at), metric, axes[0], axes[1], title))
        else:
            rest, held = middle(dataset, axes[4:])
            yield metric, png(panels(dataset.isel(rest), metric, axes[:2], axes[2:4], held))
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
    named = {axis: place for axis, place in places.items() if axis in dataset.coords}
    said = [f"{label_of(dataset, axis)} = {float(dataset[axis][place]):g}" for axis, place in named.items()]
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
