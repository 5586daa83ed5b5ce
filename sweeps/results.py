"""The labelled result of a sweep, held whole in memory; and the folder to which it is saved."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from jaxmodel.base.errors import MeasurementError, SweepError
from jaxmodel.base.schema import without_schema
from jaxmodel.base.units import split_unit, unit_of
from jaxmodel.model.simulation import Status
from jaxmodel.sweeps.lane import Outcome
from jaxmodel.sweeps.manifest import manifest_of, ranges_of
from jaxmodel.sweeps.places import Folder, Place, place_of
from jaxmodel.sweeps.plan import Chunks
from jaxmodel.sweeps.study import LANE, Study

GRID, TABLE, MANIFEST = "result.zarr", "lanes.csv", "manifest.json"
# What attributes and labels follow: units, long_name, flags (cfconventions.org).
CONVENTIONS = "CF-1.11"
# Variables of a result that are no metric.
NO_METRICS = ("status", "valid_share")
# More lines than this no spreadsheet shows; the Zarr store holds the same numbers.
MOST_LINES = 100_000
# The libraries that read a store, and what each of its arrays states.
_READ_BY = ("xarray", "zarr")
_OF_AN_ARRAY = {"chunk_grid", "codecs", "data_type", "fill_value", "node_type", "shape", "zarr_format"}


@dataclasses.dataclass(frozen=True)
class Variable:
    """What a result holds for each lane: its dimensions, number type, attributes, and where it is in an outcome."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    attributes: dict[str, Any]

    @property
    def bytes_per_lane(self) -> int:
        """The size of one lane's part."""
        return int(np.dtype(self.dtype).itemsize * np.prod(self.shape[1:] or (1,), dtype=np.int64))


def result_bytes_per_lane(study: Study) -> int:
    """Return the size of a lane's results, uncompressed."""
    return sum(variable.bytes_per_lane for variable in variables_of(study).values())


def variables_of(study: Study) -> dict[str, Variable]:
    """Return what the result of a study holds, by name; shapes have one axis of lanes in front."""
    dims, lanes = tuple(study.dims), study.size
    rows = study.prepared.stored_time_s.size
    found = {
        metric.name: Variable(dims, (lanes,), "float64", {"units": metric.unit, "long_name": metric.meaning})
        for metric in study.prepared.metrics
    }
    for name in study.store:
        found[name] = Variable((*dims, "time_s"), (lanes, rows), "float64", about(study, name))
    meanings = " ".join(status.name.lower() for status in Status)
    flags = {"flag_values": np.array([*Status], dtype=np.int8), "flag_meanings": meanings}
    found["status"] = Variable(dims, (lanes,), "int8", {"long_name": "how the run ended", "units": "", **flags})
    return found


def values_of(outcome: Outcome) -> dict[str, Any]:
    """Return the values of an outcome by the names of `variables_of`."""
    return {**outcome.values, **outcome.columns, "status": np.asarray(outcome.status).astype(np.int8)}


def coordinates_of(study: Study, drawn: bool = True) -> xr.Dataset:
    """Return the axes of a study, what was drawn for its lanes unless not wanted, and its stored times, with units."""
    coordinates: dict[str, Any] = {name: (name, values, about(study, name)) for name, values in study.axes.items()}
    for name, values in study.drawn(np.arange(study.dims.get(LANE, 0))).items() if drawn else ():
        coordinates[name] = (LANE, values, about(study, name))
    if study.store:
        coordinates["time_s"] = ("time_s", study.prepared.stored_time_s, {"units": "s", "long_name": "time"})
    return _as_cf(xr.Dataset(coords=coordinates))


def about(study: Study, name: str) -> dict[str, Any]:
    """Return the attributes of what lanes differ in, or of a stored column."""
    info = study.prepared.info.get(name)
    if info is not None:
        return {"units": info.unit, "long_name": info.meaning}
    words, _ = split_unit(name)
    return {"units": unit_of(name), "long_name": words if name in study.store else f"input {words}"}


def attributes_of(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return what a dataset says of itself, by the names of the CF conventions where they have one."""
    version = manifest["versions"]["jaxmodel"]
    return {
        "Conventions": CONVENTIONS,
        "title": manifest["title"] or f"Sweep of a {manifest['kind']}",
        "source": f"jaxmodel {version}, electro-thermal model of a {manifest['kind']}",
        "history": f"Computed by a sweep of jaxmodel {version}.",
        "kind": manifest["kind"],
        "manifest": json.dumps(manifest),
    }


def _as_cf(dataset: xr.Dataset) -> xr.Dataset:
    """Return a result whose labels have no value for missing ones, and whose flags are numbers of the type of `status`.

    The CF conventions ask for both. A Zarr store holds attributes as JSON, which has one type of numbers.
    """
    for coordinate in dataset.coords.values():
        coordinate.encoding["_FillValue"] = None
    if "status" in dataset:
        attributes = dataset["status"].attrs
        attributes["flag_values"] = np.asarray(attributes["flag_values"], dtype=dataset["status"].dtype)
    return dataset


class InMemory:
    """A result that is held whole in memory."""

    grid: None = None  # no worker can write into it

    def __init__(self, study: Study, chunks: Chunks) -> None:
        self._study = study
        self.chunks = chunks
        self.pending = range(len(chunks))
        self._variables = variables_of(study)
        self._values = {name: np.empty(v.shape, v.dtype) for name, v in self._variables.items()}
        self._program = ""

    def begin(self, program: str) -> None:
        """Note what computes the lanes."""
        self._program = program

    def commit(self, number: int, outcome: Outcome) -> None:
        """Take the outcome of a chunk."""
        first, count = self.chunks.span(number)
        for name, values in values_of(outcome).items():
            self._values[name][first : first + count] = values

    def finish(self, performance: Mapping[str, Any]) -> xr.Dataset:
        """Return the whole."""
        shape = tuple(self._study.dims.values())
        variables = {
            name: (v.dims, self._values[name].reshape(*shape, *v.shape[1:]), v.attributes)
            for name, v in self._variables.items()
        }
        manifest = manifest_of(self._study) | {"program": self._program, "performance": dict(performance)}
        return coordinates_of(self._study).assign(variables).assign_attrs(attributes_of(manifest))

    def close(self) -> None:
        """Hold nothing open."""


def save(dataset: xr.Dataset, directory: str | Path) -> Path:
    """Write a result that is in memory to a folder: result.zarr with labels, lanes.csv, manifest.json.

    What the folder held of an earlier result is replaced.

    Example:
        >>> from jaxmodel import sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = sweeps.save(sweeps.run(study, progress=False), folder)
        ...     print(sweeps.load(folder)["final_soc"].round(4).values)
        [0.7994 0.8663]
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    place = Folder(directory)
    dataset.to_zarr(place.zarr(GRID), mode="w", consolidated=False)
    save_table(dataset, place)
    place.write(MANIFEST, manifest_text(json.loads(dataset.attrs["manifest"])))
    return directory


def save_table(dataset: xr.Dataset, place: Place) -> None:
    """Write lanes.csv with one line per lane, without the columns over time, unless there are too many."""
    place.remove(TABLE)
    if dataset["status"].size > MOST_LINES:
        return
    per_lane = dataset.drop_dims("time_s") if "time_s" in dataset.dims else dataset
    place.write(TABLE, per_lane.to_dataframe().to_csv())


def manifest_text(manifest: Mapping[str, Any]) -> str:
    """Return a manifest as the text of its file."""
    return json.dumps(manifest, indent=2) + "\n"


def load(directory: str | Path | Place) -> xr.Dataset:
    """Return a saved result, read as far as it is used; lanes not run yet are NaN with status -1.

    Values are checked when they are read: one that has changed on the disk raises a ValueError on its checksum. Running
    the sweep again with resume computes such lanes anew.

    Args:
        directory: the folder, or the URL in an object store.

    Raises:
        SweepError: there is no result, one that is damaged, or one that the installed libraries cannot read.

    Example:
        >>> from jaxmodel import sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     dataset = sweeps.run(study, out=f"{folder}/results", progress=False)
        ...     print(sweeps.load(f"{folder}/results")["final_soc"].dims)
        ('capacity_Ah',)
    """
    place = place_of(directory) if isinstance(directory, str | Path) else directory
    if not place.holds(MANIFEST):
        raise SweepError(f"{place} holds no result of a sweep; give the folder that it was written to.")
    try:
        dataset = xr.open_zarr(place.zarr(GRID), consolidated=False, chunks=None)
        manifest = json.loads(place.read(MANIFEST))
        without_schema(manifest, f"{place}, {MANIFEST}")
        # A folder lists them in any order.
        drawn = [name for name in ranges_of(manifest["study"]) if name in dataset.coords]
        ordered = dataset.reset_coords(drawn)[[*drawn, *manifest["variables"]]].set_coords(drawn)
        return _as_cf(ordered.assign_attrs(attributes_of(manifest)))
    except MeasurementError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, OSError, ImportError, NotImplementedError) as error:
        libraries = unfit_libraries(place)
        raise SweepError(
            f"{place}: {libraries} ({type(error).__name__}); install the versions that wrote it, or the newest."
            if libraries
            else f"{place}: its files are damaged ({type(error).__name__}); run the sweep again into another folder."
        ) from error


def unfit_libraries(place: Place) -> str:
    """Return which libraries do not read a result that others wrote and whose files are whole; "" for a damaged one."""
    try:
        manifest = json.loads(place.read(MANIFEST))
        written = {name: manifest["versions"][name] for name in _READ_BY}
        for name in manifest["variables"]:
            array = json.loads(place.read(f"{GRID}/{name}/zarr.json"))
            if not _OF_AN_ARRAY <= array.keys():
                return ""
        if json.loads(place.read(f"{GRID}/zarr.json"))["node_type"] != "group":
            return ""
    except (ValueError, KeyError, TypeError, AttributeError, OSError):
        return ""
    others = {name: now for name in _READ_BY if (now := importlib.metadata.version(name)) != written[name]}
    if not others:
        return ""
    here = " and ".join(f"{name} {version}" for name, version in others.items())
    wrote = " and ".join(f"{name} {written[name]}" for name in others)
    return f"{here} cannot read what {wrote} wrote"


def lanes_per_second(dataset: xr.Dataset) -> float:
    """Return how many lanes of a result were run per second, compilation not counted.

    Example:
        >>> from jaxmodel import sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> sweeps.lanes_per_second(sweeps.run(study, progress=False)) > 0.0
        True
    """
    performance = json.loads(dataset.attrs["manifest"])["performance"]
    return performance["lanes_run"] / performance["run_s"]


def percentiles(dataset: xr.Dataset, percents: Sequence[float | int] = (5.0, 50.0, 95.0)) -> xr.Dataset:
    """Return percentiles of each metric over all lanes that have a value, along a dimension `percentile`.

    Example:
        >>> from jaxmodel import sweeps
        >>> study = sweeps.Study(
        ...     kind="cell",
        ...     profile={"duration_s": 60.0, "step_s": 10.0, "current_A": 5.2, "ambient_degC": 20.0},
        ...     sample={"count": 8, "ranges": {"capacity_Ah": (5.0, 5.4)}},
        ...     metrics=["final_soc"],
        ... )
        >>> sweeps.percentiles(sweeps.run(study), [50.0])["final_soc"].round(2).values.tolist()
        [0.98]
    """
    metrics = [str(n) for n, v in dataset.data_vars.items() if n != "status" and "time_s" not in v.dims]
    found = {}
    for name in metrics:  # one at a time: of a result on disk no more is in memory
        values = dataset[name].to_numpy()
        values = values[np.isfinite(values)]
        numbers = np.percentile(values, percents) if values.size else np.full(len(percents), np.nan)
        found[name] = ("percentile", numbers, dataset[name].attrs)
    return xr.Dataset(
        found, {"percentile": ("percentile", list(percents), {"units": "%", "long_name": "share of the lanes below"})}
    )
