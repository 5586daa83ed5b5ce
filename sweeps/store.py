"""The result of a sweep in a folder or object store, written chunk by chunk: a run may be killed and continued.

A chunk's files are written and flushed, then its number is noted. A chunk whose number is
not noted is not done, whatever its files hold, and is run again; so is one whose files are gone or do not fit
their checksums when a run is continued. `manifest.json` says what the result is made from
and by; it is written first, and once more when all is done.
"""

from __future__ import annotations

import contextlib
import errno
import json
import secrets
from collections.abc import Generator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from zarr.codecs import Crc32cCodec, ZstdCodec

from jaxmodel.base.errors import SweepError
from jaxmodel.base.schema import with_schema, without_schema
from jaxmodel.sweeps.lane import Outcome
from jaxmodel.sweeps.manifest import difference, manifest_of
from jaxmodel.sweeps.places import Place, place_of
from jaxmodel.sweeps.plan import Chunks, size_text
from jaxmodel.sweeps.results import (
    GRID,
    MANIFEST,
    about,
    attributes_of,
    coordinates_of,
    load,
    manifest_text,
    result_bytes_per_lane,
    save_table,
    values_of,
    variables_of,
)
from jaxmodel.sweeps.study import LANE, Study

# Lanes whose drawn values are in memory at a time.
_DRAWN_AT_ONCE = 2**20
# Holds a number drawn for the run that is writing: a worker on another machine may find an older copy under this name.
RUN = "run.id"
_FULL = (errno.ENOSPC, errno.EDQUOT)
_CHECKED = (ZstdCodec(), Crc32cCodec())
_NOT_RUN = {"float64": float("nan"), "int8": -1}


class Grid:
    """The arrays of a result, to write chunks into; it can travel to the workers of a cluster.

    Attributes:
        place: where the result lies.
    """

    def __init__(self, place: Place, names: list[str], chunks: Chunks, run: str) -> None:
        self.place = place
        self._names, self._chunks, self._run = names, chunks, run

    def __getstate__(self) -> dict[str, Any]:
        """Return what may travel: arrays are opened anew."""
        return {name: value for name, value in vars(self).items() if name not in ("arrays", "is_reached")}

    @cached_property
    def arrays(self) -> dict[str, zarr.Array]:
        """The variables by name.

        Raises:
            SweepError: they are damaged.
        """
        try:
            group = zarr.open_group(self.place.zarr(GRID), mode="r+", use_consolidated=False)
            with zarr.config.set({"array.write_empty_chunks": True}):  # an array keeps what holds when it is opened
                return {name: group[name] for name in self._names}  # type: ignore[misc]
        except (ValueError, KeyError, FileNotFoundError) as error:
            raise damaged(self.place, GRID) from error

    @cached_property
    def is_reached(self) -> bool:
        """Whether this process, on whatever machine, finds there what the run is writing, and no copy of it."""
        try:
            return self.place.read(RUN) == self._run and bool(self.arrays)
        except (OSError, ValueError, SweepError):
            return False

    def write(self, number: int, outcome: Outcome) -> None:
        """Write a chunk, and wait until it is kept."""
        region = self._chunks.region(number)
        shape = tuple(part.stop - part.start for part in region)
        with self.place.reached():
            for name, values in values_of(outcome).items():
                self.arrays[name][region] = values.reshape(*shape, *values.shape[1:])
        self.place.settle(self._file(name, region) for name in self._names)

    def is_whole(self, number: int) -> bool:
        """Return whether all files of a chunk are there and as they were written."""
        region = self._chunks.region(number)
        if not all(self.place.holds(self._file(name, region)) for name in self._names):
            return False
        with self.place.reached():
            try:
                return all(np.asarray(array[region]).size for array in self.arrays.values())
            except ValueError:  # a checksum
                return False

    def _file(self, name: str, region: tuple[slice, ...]) -> str:
        """Return the file of a variable that holds a chunk."""
        place = [part.start // size for part, size in zip(region, self._chunks.box, strict=True)]
        further = len(self.arrays[name].shape) - len(region)
        return "/".join([GRID, name, "c", *map(str, place), *["0"] * further])


def _json(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def damaged(place: Place, name: str) -> SweepError:
    """Return the error of a file that is not as it was written."""
    return SweepError(f"{place}: {name} is damaged; give another folder, or remove what is there.")


class Store:
    """Where the chunks of one study are written.

    Attributes:
        place: the folder or object store.
        grid: what chunks are written into.
        chunks: the cut of the study; that of the first run where this one continues it.
        pending: the numbers of the chunks that are not done.
    """

    def __init__(self, study: Study, chunks: Chunks, out: str | Path, resume: bool) -> None:
        self.place = place_of(out)
        self.chunks = chunks
        self.pending: list[int] = []
        self._study = study
        self._variables = variables_of(study)
        self._done = 0
        self._run = secrets.token_hex()
        self._manifest = manifest_of(study) | {"chunks": {"lanes": list(chunks.box), "number": len(chunks)}}
        try:
            with self._plain_errors():
                found = self._found(resume)
                self.grid = Grid(self.place, list(self._variables), self.chunks, self._run)
                if not self._finished or self._is_damaged():
                    self._open(begin=not found)
        except BaseException:
            self.close()
            raise

    @property
    def _finished(self) -> bool:
        return "performance" in self._manifest

    def _found(self, resume: bool) -> bool:
        """Return True where the place holds a result to continue, and take over its manifest."""
        if not self.place.holds(MANIFEST):
            if self.place.holds(f"{GRID}/zarr.json"):
                raise SweepError(f"{self.place}: there is a {GRID} without a {MANIFEST}; give another folder.")
            return False
        try:
            old = json.loads(self.place.read(MANIFEST))
        except ValueError as error:
            raise damaged(self.place, MANIFEST) from error
        if isinstance(old, dict):
            old = with_schema(without_schema(old, f"{self.place}, {MANIFEST}"))
        if not resume:
            stopped = "a sweep that was stopped; continue it with --resume, or"
            state = "a finished sweep;" if "performance" in old else stopped
            raise SweepError(f"{self.place} holds {state} give another folder or remove what is there.")
        if any(type(old.get(key)) is not type(value) for key, value in self._manifest.items()):
            raise SweepError(f"{self.place} holds no sweep that can be continued; give another folder.")
        if what := difference(old, self._manifest):
            raise SweepError(f"{self.place} cannot be continued: {what} since it was begun; give another folder.")
        box = old["chunks"].get("lanes")
        if not isinstance(box, list) or [type(part) for part in box] != [int] * len(self._study.shape) or min(box) < 1:
            raise damaged(self.place, MANIFEST)
        self._manifest = old
        self.chunks = Chunks(self._study.shape, tuple(box))
        return self.place.made(GRID, list(self._variables)[-1])

    def _open(self, begin: bool) -> None:
        """Lock the place, make what is missing, and find which chunks are not done."""
        noted = self.place.open(begin)
        self.place.write(RUN, self._run)
        if begin:
            self.place.write(MANIFEST, manifest_text(self._manifest))
            self.place.make(GRID, self._create, list(self._variables)[-1])
        assert self.grid.arrays  # or the error that they are damaged, before a lane is run
        candidates = range(len(self.chunks)) if noted is None or self._finished else noted
        done = {number for number in candidates if not begin and self.grid.is_whole(number)}
        if self._finished:  # and damaged: it becomes one that was stopped
            del self._manifest["performance"]
            self.place.note(*done)
            self.place.write(MANIFEST, manifest_text(self._manifest))
        self.pending = [number for number in range(len(self.chunks)) if number not in done]
        self._done = len(done)

    def _create(self, store: Any) -> None:
        """Make the result with its labels and without a lane."""
        coordinates = coordinates_of(self._study, drawn=False).assign_attrs(attributes_of(self._manifest))
        coordinates.to_zarr(store, mode="w", consolidated=False)
        group = zarr.open_group(store, mode="r+", use_consolidated=False)
        self._create_drawn(group)
        for name, variable in self._variables.items():
            group.create_array(
                name,
                shape=(*self.chunks.shape, *variable.shape[1:]),
                chunks=(*self.chunks.box, *variable.shape[1:]),
                dtype=variable.dtype,
                compressors=_CHECKED,
                fill_value=_NOT_RUN[variable.dtype],
                dimension_names=variable.dims,
                attributes={name: _json(value) for name, value in variable.attributes.items()},
            )

    def _is_damaged(self) -> bool:
        """Return whether some chunks of a finished result are no longer as they were written."""
        return not all(self.grid.is_whole(number) for number in range(len(self.chunks)))

    def _create_drawn(self, group: zarr.Group) -> None:
        """Write what is drawn for the lanes, block by block: there may be more of it than memory."""
        sample = self._study.sample
        if sample is None:
            return
        arrays = {
            name: group.create_array(
                name,
                shape=(sample.count,),
                chunks=(min(sample.count, _DRAWN_AT_ONCE),),
                dtype="float64",
                compressors=_CHECKED,
                dimension_names=(LANE,),
                attributes=about(self._study, name),
            )
            for name in sample.ranges
        }
        group.attrs["coordinates"] = " ".join(arrays)  # where xarray looks for those that are no axis
        for first in range(0, sample.count, _DRAWN_AT_ONCE):
            lanes = np.arange(first, min(first + _DRAWN_AT_ONCE, sample.count))
            for name, values in self._study.drawn(lanes).items():
                arrays[name][lanes[0] : lanes[-1] + 1] = values

    def begin(self, program: str) -> None:
        """Note what computes the lanes, before the first of them is.

        Raises:
            SweepError: those that are done were computed by another program.
        """
        was = self._manifest.setdefault("program", program)
        if was != program:
            raise SweepError(
                f"{self.place} cannot be continued: it was begun with {was}, and would go on with {program}, which "
                "rounds otherwise; give another folder, or the engine that began it."
            )
        with self._plain_errors():
            self.place.write(MANIFEST, manifest_text(self._manifest))

    def commit(self, number: int, outcome: Outcome | None) -> None:
        """Write a chunk, unless a worker has (None), then note that it is done.

        Raises:
            SweepError: the disk is full; what was done stays.
        """
        with self._plain_errors():
            if outcome is not None:
                self.grid.write(number, outcome)
            self.place.note(number)
        self._done += 1

    def finish(self, performance: Mapping[str, Any]) -> xr.Dataset:
        """Return the result, once all chunks are done, to be read as far as it is used."""
        if not self._finished:
            with self._plain_errors():
                save_table(load(self.place), self.place)
                self._manifest = self._manifest | {"performance": dict(performance)}
                self.place.write(MANIFEST, manifest_text(self._manifest))
                self.place.remove(RUN)
                self.place.close(finished=True)
        return load(self.place)

    def close(self) -> None:
        """Let go of the place."""
        self.place.close()

    @contextlib.contextmanager
    def _plain_errors(self) -> Generator[None, None, None]:
        try:
            yield
        except OSError as error:
            if error.errno not in _FULL:
                raise
            left = result_bytes_per_lane(self._study) * self._study.size * (1.0 - self._done / len(self.chunks))
            raise SweepError(
                f"{self.place}: the disk is full after {self._done} of {len(self.chunks)} chunks, which are kept; "
                f"free {size_text(left)} and continue with --resume."
            ) from error
