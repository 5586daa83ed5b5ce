"""The labelled result of a sweep, and its folder on disk."""

from __future__ import annotations

import importlib.metadata
import json
import platform
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from jaxmodel.simulate import Status
from sweeps.lane import Outcome
from sweeps.study import Study

GRID, TABLE, MANIFEST = "result.zarr", "lanes.csv", "manifest.json"
_VERSIONS_OF = ("jaxmodel", "jax", "jaxlib", "equinox", "numpy", "xarray", "zarr")
# The end of a column's name, and its unit; the longer endings first.
_UNITS = {"m_s2": "m/s2", "rad_s": "rad/s", "degC": "degC", "deg": "deg", "Nm": "N m", "set": "V", "V": "V", "A": "A"}


def label(study: Study, outcome: Outcome, time_s: np.ndarray, performance: dict[str, Any]) -> xr.Dataset:
    """Return outcomes of lanes, shape (lanes, ...), as a dataset over the study's axes.

    Args:
        study: what was run.
        outcome: of every lane, the last axis running fastest.
        time_s: of the stored rows.
        performance: how the run went, for the manifest.
    """
    axes = tuple(study.axes)
    info = study.prepared.info

    def grid(values: Any) -> np.ndarray:
        return np.asarray(values).reshape(*study.shape, *values.shape[1:])

    coordinates: dict[str, Any] = {}
    for name, values in study.axes.items():
        unit, meaning = (info[name].unit, info[name].meaning) if name in info else (unit_of(name), f"input {name}")
        coordinates[name] = (name, values, {"units": unit, "long_name": meaning})
    if study.store:
        coordinates["time_s"] = ("time_s", time_s, {"units": "s", "long_name": "time"})
    variables: dict[str, Any] = {
        metric.name: (axes, grid(outcome.values[metric.name]), {"units": metric.unit, "long_name": metric.meaning})
        for metric in study.prepared.metrics
    }
    for name, values in outcome.columns.items():
        variables[name] = ((*axes, "time_s"), grid(values), {"units": unit_of(name), "long_name": name})
    meanings = " ".join(status.name.lower() for status in Status)
    variables["status"] = (
        axes,
        grid(outcome.status).astype(np.int8),
        {"long_name": "how the run ended", "flag_values": [int(s) for s in Status], "flag_meanings": meanings},
    )
    manifest = {
        "title": study.title,
        "kind": study.prepared.model.kind,
        "study": study.model_dump(mode="json"),
        "study_sha256": study.digest,
        "versions": {"python": platform.python_version()}
        | {package: importlib.metadata.version(package) for package in _VERSIONS_OF},
        "performance": performance,
    }
    attributes = {"title": study.title, "kind": manifest["kind"], "manifest": json.dumps(manifest)}
    return xr.Dataset(variables, coordinates, attributes)


def save(dataset: xr.Dataset, directory: str | Path) -> Path:
    """Write a result to a folder: result.zarr with labels, lanes.csv with one line per lane, manifest.json.

    Stored columns are in the Zarr store only. What the folder held of an earlier result is replaced.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    dataset.to_zarr(directory / GRID, mode="w", consolidated=False)
    per_lane = dataset.drop_dims("time_s") if "time_s" in dataset.dims else dataset
    per_lane.to_dataframe().to_csv(directory / TABLE)
    manifest = json.loads(dataset.attrs["manifest"])
    (directory / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return directory


def load(directory: str | Path) -> xr.Dataset:
    """Return a saved result, read as far as it is used."""
    return xr.open_zarr(Path(directory) / GRID, consolidated=False, chunks=None)


def unit_of(column: str) -> str:
    """Return the unit that a column's name ends with, "" for a pure number."""
    return next((unit for ending, unit in _UNITS.items() if column.endswith(f"_{ending}")), "")
