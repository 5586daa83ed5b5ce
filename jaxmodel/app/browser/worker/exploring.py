"""Beside the path: a sweep with its heat map as chunks land, and sensitivities at a point of it."""

from __future__ import annotations

import shutil
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from jaxmodel import sensitivity as analyses
from jaxmodel import sweeps
from jaxmodel.app.browser.files import GRID, SENSITIVITY, SWEEP, write_json
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress
from jaxmodel.app.browser.worker.words import channel_words, finite
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import SweepError
from jaxmodel.sweeps.plan import COPIES, NARROWEST_BLOCK
from jaxmodel.sweeps.results import GRID as STORE
from jaxmodel.sweeps.results import NO_METRICS

# Seconds between two looks at the chunks that have landed, and the share of the time that they may take.
_LOOK_S, _LOOKING = 0.4, 0.1
# A sweep lands in about so many chunks: its map grows while it is watched, and files do not slow it down.
_CHUNKS = 200
# Values of an axis of the map that are drawn; of more, every k-th.
_MOST_OF_AN_AXIS = 250
_MOST_BARS = 14
# Along an axis, against the mean: what varies less does not vary to the eye.
_LEAST_VARIATION = 0.005


def study_of(place: Place, progress: Progress, run: str, axes: Mapping[str, Any]) -> sweeps.Study:
    """Return the study that drives the present model with a run's inputs over some axes.

    Raises:
        UserError: a name, a range or the run cannot be used.
    """
    case = place.investigation(progress).extended_case()
    own = next((one for one in case.runs if one.name == run), None)
    if own is None:
        raise SweepError(f"There is no run '{run}'; choose one of {', '.join(one.name for one in case.runs)}.")
    folder = place.folder / SWEEP
    folder.mkdir(mode=0o700, exist_ok=True)
    profile = folder / "profile.csv"
    write_whole(profile, own.to_dataframe().to_csv(index=False))
    return sweeps.Study(
        title=f"{case.title}: {run}",
        case=case,
        profile={"csv": profile.name},
        axes=axes,
        folder=folder,
    )


def _grid(axes: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the axes of the form as a study has them."""
    return {name: {"start": a["low"], "stop": a["high"], "count": int(a["count"])} for name, a in axes.items()}


def forecast(place: Place, progress: Progress, run: str, axes: Mapping[str, Mapping[str, float]]) -> None:
    """Show what a sweep would take."""
    study = study_of(place, progress, run, _grid(axes))
    progress("timing some lanes")
    plan = sweeps.forecast(study)
    seconds = {"lanes": plan.lanes, "run_s": plan.run_s, "compile_s": plan.compile_s, "lanes_per_s": plan.lanes_per_s}
    place.show(sweep={"run": run, "axes": dict(axes), "forecast": seconds, "state": "planned"})


def sweep(place: Place, progress: Progress, run: str, axes: Mapping[str, Mapping[str, float]], resume: bool) -> None:
    """Run a sweep, and show its map as chunks land; one that was stopped goes on where it was.

    Raises:
        UserError: the study cannot be run.
    """
    study = study_of(place, progress, run, _grid(axes))
    folder = place.folder / SWEEP / "result"
    if not resume:
        shutil.rmtree(folder, ignore_errors=True)
        (place.folder / GRID).unlink(missing_ok=True)
    place.show(sweep={"run": run, "axes": dict(axes), "state": "running"})
    progress("compiling the model for this sweep", 0.0)
    next_look = 0.0
    tell = progress.counted("sweep", "lanes")

    def landed(done: int, total: int) -> None:
        nonlocal next_look
        tell(done, total)
        began = time.monotonic()
        if began > next_look and (folder / STORE).exists():
            _write_grid(place.folder, xr.open_zarr(folder / STORE, consolidated=False, chunks=None))
            next_look = time.monotonic() + max(_LOOK_S, (time.monotonic() - began) / _LOOKING)

    try:
        dataset = sweeps.run(study, landed, out=folder, resume=resume, memory=_memory_of_chunks(study))
    except BaseException:
        place.show(sweep={"run": run, "axes": dict(axes), "state": "stopped"})
        raise
    _write_grid(place.folder, dataset)
    place.show(sweep={"run": run, "axes": dict(axes), "state": "done"})


def _memory_of_chunks(study: sweeps.Study) -> int:
    """Return the memory with which the sweep has about `_CHUNKS` chunks."""
    plan = sweeps.forecast(study)
    of_lane = plan.memory_bytes / max(plan.lanes_per_chunk, 1)
    lanes = max(NARROWEST_BLOCK, -(-plan.lanes // _CHUNKS))
    return int(1.05 * lanes * max(of_lane, 1.0)) + COPIES * 1024


def _write_grid(folder: Path, dataset: xr.Dataset) -> None:
    """Write every metric over both axes, thinned to what can be drawn; what has not landed is null."""
    names = [str(n) for n, v in dataset.data_vars.items() if n not in NO_METRICS and "time_s" not in v.dims]
    axes = [str(axis) for axis in dataset[names[0]].dims]
    status = dataset["status"].to_numpy()
    every = {axis: -(-dataset.sizes[axis] // _MOST_OF_AN_AXIS) for axis in axes}
    dataset = dataset.isel({axis: slice(None, None, step) for axis, step in every.items()})
    landed = dataset["status"].to_numpy() >= 0
    grid = {
        "every": list(every.values()),
        "liveliest": _liveliest(dataset[names].where(landed)),
        "axes": [{"name": axis, "title": _title(axis), "values": dataset[axis].to_numpy().tolist()} for axis in axes],
        "done": int(np.sum(status >= 0)),
        "of": int(status.size),
        "metrics": [
            {
                "name": name,
                "unit": str(dataset[name].attrs.get("units", "")),
                "title": _title(name, str(dataset[name].attrs.get("units", ""))),
                "values": _nulls(np.where(landed, dataset[name].to_numpy(), np.nan)),
            }
            for name in names
        ],
    }
    write_json(folder / GRID, grid)


def _liveliest(metrics: xr.Dataset) -> str:
    """Return the metric whose map is the first one shown: of what has landed, it varies most against its mean.

    One that varies along both axes comes before one that only one of them changes.
    """

    def variation(one: xr.DataArray) -> tuple[bool, float]:
        size = abs(float(one.mean()))
        if not size > 0.0:
            return False, 0.0
        along = [float(one.std(str(axis)).mean()) / size for axis in one.dims]
        return min(along) > _LEAST_VARIATION, float(one.std()) / size

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of a row of which nothing has landed there is no sd
        return max(map(str, metrics.data_vars), key=lambda name: variation(metrics[name]))


def _title(name: str, unit: str = "") -> str:
    """Return a name in words with its unit."""
    words = channel_words(name)
    unit = words["unit"] or unit
    return f"{words['quantity']} [{unit}]" if unit else words["quantity"]


def _nulls(values: np.ndarray) -> list[Any]:
    return [_nulls(row) for row in values] if values.ndim > 1 else [finite(value) for value in values]


def sensitivity(place: Place, progress: Progress, run: str, point: Mapping[str, float]) -> None:
    """Show by how much every metric and reading changes with each parameter, at a point of the sweep.

    Raises:
        UserError: the point cannot be used.
    """
    study = study_of(place, progress, run, {name: [value] for name, value in point.items()})
    progress("differentiating the run by every parameter")
    data = analyses.local(study, doubling=False, progress=False)
    progress("writing the tables")
    words = {name: channel_words(name) for name in point}
    at = ", ".join(f"{words[name]['quantity']} {value:.4g} {words[name]['unit']}" for name, value in point.items())
    write_json(place.folder / SENSITIVITY, {"at": at, "run": run, **_bars(data), **_courses(data)})
    place.show(sensitivity=time.time())


def _bars(data: xr.Dataset) -> dict[str, Any]:
    """Return the elasticities of each metric, the largest first."""
    table = data["elasticity"].transpose("metric", "parameter")
    metrics = []
    for metric in map(str, table["metric"].to_numpy()):
        values = table.sel(metric=metric).to_numpy()
        order = [int(i) for i in np.argsort(-np.abs(np.nan_to_num(values))) if np.isfinite(values[i]) and values[i]]
        names = data["parameter"].to_numpy()
        bars = [{"name": str(names[i]), "value": float(values[i])} for i in order[:_MOST_BARS]]
        if bars:
            metrics.append({"name": metric, "title": _title(metric), "bars": bars})
    return {"metrics": sorted(metrics, key=lambda metric: -len(metric["bars"]))}


def _courses(data: xr.Dataset) -> dict[str, Any]:
    """Return the change of each reading over time for a percent of each parameter that can be doubled."""
    change = 0.01 * data["output_change"].isel(parameter=np.flatnonzero(data["doubles"].to_numpy()))
    time_s = data["time_s"].to_numpy()
    every = max(1, -(-time_s.size // 600))
    outputs = []
    for output in map(str, data["output"].to_numpy()):
        one = change.sel(output=output).transpose("parameter", "time_s").to_numpy()
        size = np.nanmax(np.abs(np.nan_to_num(one)), axis=1, initial=0.0)
        order = [int(i) for i in np.argsort(-size)[:6] if size[i] > 1e-3 * size.max(initial=0.0)]
        names = change["parameter"].to_numpy()
        lines = [{"name": str(names[i]), "values": [finite(v) for v in one[i, ::every]]} for i in order]
        if lines:
            outputs.append({**channel_words(output), "lines": lines})
    return {"time_s": time_s[::every].tolist(), "outputs": sorted(outputs, key=lambda one: one["name"] == "soc")}
