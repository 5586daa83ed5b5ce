"""Where a result comes from: files by their SHA-256, versions of what computed it, settings, the date."""

from __future__ import annotations

import dataclasses
import datetime
import hashlib
import importlib.metadata
import platform
from collections.abc import Iterable, Sequence
from pathlib import Path

_PACKAGES = ("jaxmodel", "jax", "jaxlib", "equinox", "optimistix", "numpy", "scipy")


@dataclasses.dataclass(frozen=True)
class Provenance:
    """What a reader needs to repeat a result.

    Attributes:
        date: of the result, UTC.
        files: each file's name and SHA-256.
        versions: of Python and the packages that computed it.
        machine: operating system and processor.
        settings: what else it hangs on, in words: the seed of its random numbers, what the user ordered.
    """

    date: str
    files: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    machine: str
    settings: tuple[str, ...]


def provenance(files: Iterable[Path], settings: Sequence[str] = ()) -> Provenance:
    """Return the provenance of a result made now from some files, with some settings."""
    installed = [("python", platform.python_version())]
    installed += [(package, importlib.metadata.version(package)) for package in _PACKAGES]
    return Provenance(
        date=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        files=tuple((file.name, digest_of(file)) for file in files),
        versions=tuple(installed),
        machine=f"{platform.system()} {platform.machine()}",
        settings=tuple(settings),
    )


def digest_of(file: Path) -> str:
    """Return the SHA-256 of a file."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
