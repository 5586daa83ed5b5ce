"""Files that are there whole or not at all, whenever the process that writes them is killed."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, content: str | bytes, *, lasting: bool = True, mode: int | None = None) -> None:
    """Write a file aside and then into its place.

    Args:
        path: of the file; what is there is replaced.
        content: text, written in UTF-8 with its line ends as they are, or bytes.
        lasting: wait until it is on the disk, so that it outlives a loss of power too.
        mode: of the file, such as 0o600; by default as the system makes it.
    """
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with aside.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            if lasting:
                file.flush()
                os.fsync(file.fileno())
        if mode is not None:
            aside.chmod(mode)
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
    if lasting:
        flush(path.parent)


def flush(path: Path) -> None:
    """Wait until what a file or folder holds is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
