"""`jaxmodel sweep`: every combination of a study's axes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from jaxmodel import sweeps
from jaxmodel.app import terminal
from jaxmodel.app.commands.start import own_effects, start
from jaxmodel.app.meanwhile import import_meanwhile
from jaxmodel.base.jax_settings import keep_compiled_programs
from jaxmodel.model.simulation import Status
from jaxmodel.sweeps.places import Folder, place_of
from jaxmodel.sweeps.plan import size_text
from jaxmodel.sweeps.results import GRID, MANIFEST, NO_METRICS, TABLE

_PERCENTS = (0, 5, 50, 95, 100)


def sweep(
    path: Path,
    out: str,
    effects: Sequence[str],
    *,
    dry_run: bool = False,
    memory: str | None = None,
    precision: str | None = None,
    pictures: bool = True,
    **how: Any,
) -> xr.Dataset | None:
    """Run a study; write its result (Zarr, CSV, manifest) and a picture for each metric to `out`.

    Args:
        path: the study file.
        out: the folder, or a URL in an object store, where no pictures are drawn.
        effects: of the user's own, as `file.py:Class`.
        dry_run: reports what the sweep would take, and writes nothing.
        memory: as `jaxmodel.sweeps.run` takes it.
        precision: instead of the study's.
        pictures: whether to draw.
        how: `resume` and `engine`, as `jaxmodel.sweeps.run` takes them.

    Raises:
        UserError: the study cannot be run.
    """
    study = sweeps.read_study(path, own_effects=own_effects(effects))
    if precision is not None:
        study = study.replace(precision=precision)  # type: ignore[arg-type]  # checked as that of a file
    if dry_run:
        keep_compiled_programs()
        print_forecast(study.title or path.name, sweeps.forecast(study, memory))
        return None
    place = place_of(out)
    start(place.path if isinstance(place, Folder) else None)
    pictures &= isinstance(place, Folder)
    if pictures:
        import_meanwhile("jaxmodel.plots.datasets")
    dataset = run_study(study, out=out, memory=memory, **how)
    if pictures:
        from jaxmodel.plots.datasets import save_pictures

        save_pictures(dataset, out)
    print_sweep(dataset)
    table = f"{TABLE}, " if place.holds(TABLE) else ""
    terminal.say(f"{GRID}, {table}{MANIFEST}{' and pictures' if pictures else ''} are in {out}.")
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
    """Run a study with progress, as `jaxmodel.sweeps.run` does."""
    with terminal.counted("sweep", "lanes") as progress:
        return sweeps.run(study, progress, **how)


def print_sweep(dataset: xr.Dataset) -> None:
    """Print percentiles of every metric over lanes, lanes per second, and how the lanes ended."""
    found = sweeps.percentiles(dataset, _PERCENTS)
    rows = [
        (name, str(dataset[name].attrs.get("units", "")), *(f"{n:.5g}" for n in found[name].to_numpy()))
        for name in map(str, found.data_vars)
        if name not in NO_METRICS and np.isfinite(found[name]).all()
    ]
    columns = ("metric", "unit", "least", *(f"{percent:g} %" for percent in _PERCENTS[1:-1]), "greatest")
    terminal.table(dataset.attrs["title"], columns, rows, right=range(2, len(columns)))
    lanes = dataset["status"].size
    terminal.say(f"{lanes:,} lanes, {sweeps.lanes_per_second(dataset):,.0f} lanes/s.")
    for status, what in (
        (Status.REACHED_CUTOFF, "reached their cut-off"),
        (Status.NOT_FINITE, "ran into numbers that are not finite"),
        (
            Status.IMPOSSIBLE,
            "reached an impossible state (a winding above the melting point of copper, a cell that gives twice its "
            "charge): do not use their numbers; check the values and units of the study",
        ),
    ):
        if count := int((dataset["status"] == int(status)).sum()):
            terminal.say(f"{count:,} of {lanes:,} lanes {what}.")
    if "valid_share" in dataset and (count := int((dataset["valid_share"] < 1.0).sum())):
        terminal.say(
            f"{count:,} of {lanes:,} lanes left the range in which the cell's equations make sense for part of the run."
        )
