"""Public data sets by name, through pooch: from their repositories at one commit, kept in the cache folder."""

from __future__ import annotations

import dataclasses
import functools
import os
import shutil
import tomllib
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from urllib.parse import quote

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.jax_settings import cache_folder

# Where files are fetched from in place of their own repositories: a mirror of the same layout.
SOURCE_VARIABLE = "JAXMODEL_DATA_SOURCE"
_GITHUB = "https://raw.githubusercontent.com"


@dataclasses.dataclass(frozen=True)
class DataSet:
    """A public data set.

    Attributes:
        name: by which it is fetched.
        title: what was measured.
        by: whom.
        licence: of the measurements.
        repository: on GitHub, owner and name.
        commit: at which the files are.
        start: options of `jaxmodel start` for a first try.
        files: SHA-256 of each, by its path in the repository.
    """

    name: str
    title: str
    by: str
    licence: str
    repository: str
    commit: str
    start: str
    files: Mapping[str, str]

    @property
    def page(self) -> str:
        """Return the address of its page."""
        return f"https://github.com/{self.repository}"

    def address_of(self, path: str) -> str:
        """Return the address of a file."""
        base = os.environ.get(SOURCE_VARIABLE, _GITHUB).rstrip("/")
        return f"{base}/{self.repository}/{self.commit}/{quote(path)}"


@functools.cache
def data_sets() -> dict[str, DataSet]:
    """Return the data sets that are known, by name.

    Example:
        >>> from jaxmodel.data.public import data_sets
        >>> data_sets()["nissan_leaf"].licence
        'MIT'
    """
    text = resources.files("jaxmodel.data.public").joinpath("sets.toml").read_text(encoding="utf-8")
    return {name: DataSet(name, **values) for name, values in tomllib.loads(text).items()}


def fetch(name: str, folder: str | Path, tell: Callable[[str], None] = lambda _: None) -> list[Path]:
    """Fetch a data set, or take it from the cache, and copy it into a folder.

    Args:
        name: of `data_sets`.
        folder: for its files; made if need be.
        tell: is called with what is done next.

    Returns:
        The files.

    Raises:
        MeasurementError: there is no such set, its files cannot be fetched, or one is not what was read here.
    """
    import pooch

    known = data_sets()
    if name not in known:
        raise MeasurementError(f"There is no data set '{name}'; there are {', '.join(known)}.{nearest(name, known)}")
    one, found = known[name], []
    folder = Path(folder)
    pooch.get_logger().setLevel("ERROR")
    for path, checksum in one.files.items():
        address = one.address_of(path)
        tell(f"fetching {Path(path).name}")
        try:
            kept = pooch.retrieve(
                address,
                known_hash=f"sha256:{checksum}",
                fname=Path(path).name,
                path=cache_folder() / "data" / name,
                downloader=pooch.HTTPDownloader(timeout=60.0),  # pyrefly: ignore[bad-argument-type]
            )
        except OSError as error:  # those of requests are such
            raise MeasurementError(
                f"{name}: {address} cannot be fetched ({type(error).__name__}); is there a network? "
                f"{SOURCE_VARIABLE} names a mirror."
            ) from error
        except ValueError as error:  # pooch's word for another checksum
            raise MeasurementError(
                f"{name}: what {address} gives is not the file that was read here: its SHA-256 differs. Its makers may "
                f"have changed it; take it from {one.page} by hand, and look what has changed."
            ) from error
        folder.mkdir(parents=True, exist_ok=True)
        found.append(Path(shutil.copy(kept, folder / Path(path).name)))
    return found
