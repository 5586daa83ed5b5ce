"""Where the result of a sweep lies: a folder of this machine, or an object store that fsspec reaches by a URL."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Callable, Generator, Iterable
from pathlib import Path
from typing import IO, Any

from jaxmodel.base.atomic_files import flush, write_whole
from jaxmodel.base.errors import SweepError

try:
    import fcntl
except ImportError:  # not a POSIX system: nothing keeps two runs out of one folder
    fcntl = None

LOG = "chunks.done"
# A letter alone is a drive of Windows.
_ONE_SLASH = re.compile(r"[a-z][a-z0-9+]+:/(?!/)")


class Folder:
    """A folder: chunks are noted in a log once their files are flushed, and a lock keeps a second run out."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._log: IO[bytes] | None = None

    def __str__(self) -> str:
        """Return the path."""
        return str(self.path)

    def __getstate__(self) -> dict[str, Any]:
        """Return the path alone, in full as a worker may run elsewhere: the lock stays with this process."""
        return {"path": self.path.absolute(), "_log": None}

    def reached(self) -> contextlib.AbstractContextManager[None]:
        """Return what turns the errors of a store into a sentence: a folder's are plain as they are."""
        return contextlib.nullcontext()

    def free_bytes(self) -> float:
        """Return how much more may be written."""
        whole = self.path.absolute()
        return float(shutil.disk_usage(next(one for one in (whole, *whole.parents) if one.is_dir())).free)

    def holds(self, name: str) -> bool:
        """Return whether there is a file or folder of a name."""
        return (self.path / name).exists()

    def read(self, name: str) -> str:
        """Return the text of a file."""
        return (self.path / name).read_text(encoding="utf-8")

    def write(self, name: str, text: str) -> None:
        """Write a text file whole or not at all; what is there is replaced."""
        self.path.mkdir(parents=True, exist_ok=True)
        write_whole(self.path / name, text)

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        (self.path / name).unlink(missing_ok=True)

    def zarr(self, name: str) -> Any:
        """Return what zarr and xarray open."""
        return self.path / name

    def make(self, name: str, write: Callable[[Any], None], last: str) -> None:
        """Write a store aside and then into its place."""
        aside = self.path / f".{name}.new"
        shutil.rmtree(aside, ignore_errors=True)
        write(aside)
        for path in (*aside.rglob("*"), aside):
            flush(path)
        os.replace(aside, self.path / name)
        flush(self.path)

    def made(self, name: str, last: str) -> bool:
        """Return whether `make` came to its end."""
        return self.holds(name)

    def settle(self, names: Iterable[str]) -> None:
        """Wait until files are on the disk, each with the folders that lead to it."""
        for name in names:
            file = self.path / name
            for path in (file, *file.parents[: len(Path(name).parts) - 1]):
                flush(path)

    def open(self, begin: bool) -> set[int]:
        """Lock the folder and return the chunks that are noted as done: none where a sweep begins.

        Raises:
            SweepError: another run has locked it.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        self._log = (self.path / LOG).open("a+b")
        if fcntl is not None:
            try:
                fcntl.flock(self._log, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise SweepError(f"{self}: another run is writing here; wait for it or stop it.") from error
        if begin:
            self._log.truncate(0)
        self._log.seek(0)
        lines = self._log.read()
        whole = lines[: lines.rfind(b"\n") + 1]  # a kill, or a full disk, may have torn the last line
        self._log.truncate(len(whole))
        return {int(line) for line in whole.split() if line.isdigit()}

    def note(self, *numbers: int) -> None:
        """Note that chunks are done."""
        assert self._log is not None
        self._log.write(b"".join(b"%d\n" % number for number in numbers))
        self._log.flush()
        os.fsync(self._log.fileno())

    def close(self, finished: bool = False) -> None:
        """Let go of the folder; the log goes too where all is done."""
        if self._log is not None:
            with contextlib.suppress(OSError):  # what could not be flushed has been reported already
                self._log.close()
            self._log = None
        if finished:
            self.remove(LOG)


class Bucket:
    """A prefix in an object store. An object is there whole or not at all, so a chunk whose objects are there is done.

    Nothing keeps two runs of one study out of it: they would write the same bits.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self._fs, self._root = self._opened()

    def __str__(self) -> str:
        """Return the URL."""
        return self.url

    def __getstate__(self) -> dict[str, Any]:
        """Return the URL alone: a connection cannot travel."""
        return {"url": self.url}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Connect anew."""
        self.__init__(state["url"])

    def _opened(self) -> tuple[Any, str]:
        try:
            from fsspec.core import url_to_fs  # it finds s3fs, or another store's package, by the URL

            return url_to_fs(self.url)
        except ImportError as error:
            raise SweepError(f"{self.url}: {error}; for s3:// install jaxmodel[s3].") from error
        except ValueError as error:
            raise SweepError(f"{self.url}: {error}; give a folder, or a URL such as s3://bucket/name.") from error

    @contextlib.contextmanager
    def reached(self) -> Generator[None, None, None]:
        """Turn the errors of whatever library reaches the store into a sentence."""
        try:
            yield
        except SweepError:
            raise
        except Exception as error:
            reason = str(error).strip().splitlines()[0:1] or [type(error).__name__]
            raise SweepError(
                f"{self.url}: the object store cannot be used ({reason[0]}); check the name, the address and the keys."
            ) from error

    def free_bytes(self) -> float:
        """Return that an object store has no end."""
        return float("inf")

    def holds(self, name: str) -> bool:
        """Return whether there is an object of a name."""
        with self.reached():
            return bool(self._fs.exists(f"{self._root}/{name}"))

    def read(self, name: str) -> str:
        """Return the text of an object."""
        with self.reached():
            return self._fs.cat_file(f"{self._root}/{name}").decode()

    def write(self, name: str, text: str) -> None:
        """Put an object; what is there is replaced."""
        with self.reached():
            self._fs.pipe_file(f"{self._root}/{name}", text.encode())

    def remove(self, name: str) -> None:
        """Remove an object, if it is there."""
        if self.holds(name):
            with self.reached():
                self._fs.rm_file(f"{self._root}/{name}")

    def zarr(self, name: str) -> Any:
        """Return what zarr and xarray open."""
        from zarr.storage import FsspecStore

        return FsspecStore.from_url(f"{self.url}/{name}")

    def make(self, name: str, write: Callable[[Any], None], last: str) -> None:
        """Write a store; what is written last is `last`."""
        with self.reached():
            write(self.zarr(name))

    def made(self, name: str, last: str) -> bool:
        """Return whether `make` came to its end."""
        return self.holds(f"{name}/{last}/zarr.json")

    def settle(self, names: Iterable[str]) -> None:
        """Do nothing: an object that was put is kept."""

    def open(self, begin: bool) -> None:
        """Return that nothing is noted: what is there is done."""

    def note(self, *numbers: int) -> None:
        """Note nothing."""

    def close(self, finished: bool = False) -> None:
        """Hold nothing open."""


Place = Folder | Bucket


def place_of(out: str | Path) -> Place:
    """Return where results go: a bucket for a URL, else a folder.

    Raises:
        SweepError: a slash of the URL is missing, as in a `Path` made of one.
    """
    if _ONE_SLASH.match(str(out)):
        store, name = str(out).split(":/", 1)
        raise SweepError(
            f"{out}: a slash is missing; write {store}://{name} for an object store, ./{out} for a folder."
        )
    return Bucket(str(out)) if "://" in str(out) else Folder(out)
