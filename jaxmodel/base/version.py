"""The version of this package."""

from __future__ import annotations

from importlib import metadata


def _version() -> str:
    try:
        return metadata.version("jaxmodel")
    except metadata.PackageNotFoundError:  # a copy of the source on the path
        return "unknown: not installed"


__version__ = _version()
