"""The result of a sweep on disk, written chunk by chunk: a run may be killed at any moment and continued.

A chunk's files are written and flushed, then its number is added to a log, and that is flushed. A chunk whose number is
not in the log is not done, whatever its files hold, and is run again; so is one whose files are gone or do not fit
their checksums when a run is continued. `manifest.json` says what the result is made from
and by; it is written first, and once more when all is done.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import xarray as xr
import zarr
from zarr.codecs import Crc32cCodec, ZstdCodec

from jaxmodel.errors import SweepError
from jaxmodel.whole_files import flush, write_whole
from sweeps.lane import Outcome
from sweeps.manifest import difference, manifest_of
from sweeps.plan import Chunks, size_text
from sweeps.results import (
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
from sweeps.study import LANE, Study

try:
    import fcntl
except ImportError:  # not a POSIX system: nothing keeps two runs out of one folder
    fcntl = None

LOG = "chunks.done"
# Lanes whose drawn values are in memory at a time.
_DRAWN_AT_ONCE = 2**20
_FULL = (errno.ENOSPC, errno.EDQUOT)
_CHECKED = (ZstdCodec(), Crc32cCodec())
_NOT_RUN = {"float64": float("nan"), "int8": -1}


class Store:
    """A folder to which the chunks of one study are written.

    Attributes:
        chunks: the cut of the study; that of the first run where this one continues it.
        pending: the numbers of the chunks that are not done.
    """

    def __init__(self, study: Study, chunks: Chunks, folder: str | Path, resume: bool) -> None:
        self.folder = Path(folder)
        self.chunks = chunks
        self.pending: list[int] = []
        self._study = study
        self._variables = variables_of(study)
        self._log: IO[bytes] | None = None
        self._arrays: dict[str, zarr.Array] = {}
        self._done = 0
        self._manifest = manifest_of(study) | {"chunks": {"lanes": list(chunks.box), "number": len(chunks)}}
        try:
            with self._plain_errors():
                self.folder.mkdir(parents=True, exist_ok=True)
                found = self._found(resume)
                if self._finished:
                    self._check_finished()
                if not self._finished:
                    self._open(begin=not found)
        except BaseException:
            self.close()
            raise

    @property
    def _finished(self) -> bool:
        return "performance" in self._manifest

    def _found(self, resume: bool) -> bool:
        """Return True where the folder holds a result to continue, and take over its manifest."""
        path = self.folder / MANIFEST
        if not path.exists():
            if (self.folder / GRID).exists():
                raise SweepError(f"{self.folder}: there is a {GRID} without a {MANIFEST}; give another folder.")
            return False
        try:
            old = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise self._damaged(MANIFEST) from error
        if not resume:
            stopped = "a sweep that was stopped; continue it with --resume, or"
            state = "a finished sweep;" if "performance" in old else stopped
            raise SweepError(f"{self.folder} holds {state} give another folder or remove what is there.")
        if any(type(old.get(key)) is not type(value) for key, value in self._manifest.items()):
            raise SweepError(f"{self.folder} holds no sweep that can be continued; give another folder.")
        if what := difference(old, self._manifest):
            raise SweepError(f"{self.folder} cannot be continued: {what} since it was begun; give another folder.")
        box = old["chunks"].get("lanes")
        if not isinstance(box, list) or [type(part) for part in box] != [int] * len(self._study.shape) or min(box) < 1:
            raise self._damaged(MANIFEST)
        self._manifest = old
        self.chunks = Chunks(self._study.shape, tuple(box))
        return (self.folder / GRID).exists()

    def _open(self, begin: bool) -> None:
        self._log = (self.folder / LOG).open("a+b")
        if fcntl is not None:
            try:
                fcntl.flock(self._log, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise SweepError(f"{self.folder}: another run is writing here; wait for it or stop it.") from error
        if begin:
            self._log.truncate(0)
            write_whole(self.folder / MANIFEST, manifest_text(self._manifest))
            self._create()
        self._log.seek(0)
        lines = self._log.read()
        whole = lines[: lines.rfind(b"\n") + 1]  # a kill, or a full disk, may have torn the last line
        self._log.truncate(len(whole))
        self._arrays = self._opened()
        noted = {int(line) for line in whole.split() if line.isdigit()}
        self.pending = [n for n in range(len(self.chunks)) if n not in noted or not self._is_whole(n)]
        self._done = len(self.chunks) - len(self.pending)

    def _opened(self) -> dict[str, zarr.Array]:
        try:
            group = zarr.open_group(self.folder / GRID, mode="r+", use_consolidated=False)
            return {
                name: group[name].with_config({"write_empty_chunks": True})  # type: ignore[union-attr]
                for name in self._variables
            }
        except (ValueError, KeyError, FileNotFoundError) as error:
            raise self._damaged(GRID) from error

    def _check_finished(self) -> None:
        """Take a finished result for one that was stopped if some of its chunks are no longer as they were written."""
        self._arrays = self._opened()
        whole = [number for number in range(len(self.chunks)) if self._is_whole(number)]
        if len(whole) == len(self.chunks):
            return
        del self._manifest["performance"]
        (self.folder / LOG).write_bytes(b"".join(b"%d\n" % number for number in whole))
        write_whole(self.folder / MANIFEST, manifest_text(self._manifest))

    def _is_whole(self, number: int) -> bool:
        """Return whether all files of a chunk are there and as they were written."""
        region = self.chunks.region(number)
        if not all(self._file(name, region).is_file() for name in self._arrays):
            return False
        try:
            return all(np.asarray(array[region]).size for array in self._arrays.values())
        except ValueError:  # a checksum
            return False

    def _file(self, name: str, region: tuple[slice, ...]) -> Path:
        """Return the file of a variable that holds a chunk."""
        place = [part.start // size for part, size in zip(region, self.chunks.box, strict=True)]
        further = len(self._arrays[name].shape) - len(region)
        return self.folder.joinpath(GRID, name, "c", *map(str, place), *["0"] * further)

    def _damaged(self, name: str) -> SweepError:
        return SweepError(f"{self.folder}: {name} is damaged; give another folder, or remove what is there.")

    def _create(self) -> None:
        """Make the store with its labels and without a lane, aside, and put it in place."""
        aside = self.folder / f".{GRID}.new"
        shutil.rmtree(aside, ignore_errors=True)
        coordinates = coordinates_of(self._study, drawn=False).assign_attrs(attributes_of(self._manifest))
        coordinates.to_zarr(aside, mode="w", consolidated=False)
        group = zarr.open_group(aside, mode="r+", use_consolidated=False)
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
                attributes=variable.attributes,
            )
        for path in (*aside.rglob("*"), aside):
            flush(path)
        os.replace(aside, self.folder / GRID)
        flush(self.folder)

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
                f"{self.folder} cannot be continued: it was begun with {was}, and would go on with {program}, which "
                "rounds otherwise; give another folder, or the engine that began it."
            )
        with self._plain_errors():
            write_whole(self.folder / MANIFEST, manifest_text(self._manifest))

    def commit(self, number: int, outcome: Outcome) -> None:
        """Write a chunk, then note that it is done.

        Raises:
            SweepError: the disk is full; what was done stays.
        """
        assert self._log is not None
        region = self.chunks.region(number)
        shape = tuple(part.stop - part.start for part in region)
        with self._plain_errors():
            for name, values in values_of(outcome).items():
                self._arrays[name][region] = values.reshape(*shape, *values.shape[1:])
                file = self._file(name, region)
                for path in (file, *file.parents[: len(file.relative_to(self.folder / GRID).parts) - 1]):
                    flush(path)
            self._log.write(b"%d\n" % number)
            self._log.flush()
            os.fsync(self._log.fileno())
        self._done += 1

    def finish(self, performance: Mapping[str, Any]) -> xr.Dataset:
        """Return the result, once all chunks are done, to be read from the disk as far as it is used."""
        if not self._finished:
            with self._plain_errors():
                save_table(load(self.folder), self.folder)
                self._manifest = self._manifest | {"performance": dict(performance)}
                write_whole(self.folder / MANIFEST, manifest_text(self._manifest))
                self.close()
                (self.folder / LOG).unlink(missing_ok=True)
        return load(self.folder)

    def close(self) -> None:
        """Let go of the folder."""
        if self._log is not None:
            with contextlib.suppress(OSError):  # what could not be flushed has been reported already
                self._log.close()
            self._log = None

    @contextlib.contextmanager
    def _plain_errors(self) -> Generator[None, None, None]:
        try:
            yield
        except OSError as error:
            if error.errno not in _FULL:
                raise
            left = result_bytes_per_lane(self._study) * self._study.size * (1.0 - self._done / len(self.chunks))
            raise SweepError(
                f"{self.folder}: the disk is full after {self._done} of {len(self.chunks)} chunks, which are kept; "
                f"free {size_text(left)} and continue with --resume."
            ) from error
