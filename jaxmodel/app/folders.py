"""The folders that a running command writes its results to: they can be used, and no other command writes there."""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such locks
    fcntl = None  # type: ignore[assignment]

# Below this a result is not begun: what cannot be written should not be computed first. Assumed.
_LEAST_FREE_BYTES = 2**20
# What this process holds, by device and number of the folder.
_held: dict[tuple[int, int], int] = {}


def take(folder: Path) -> None:
    """Make a folder and hold it until `let_go`.

    Raises:
        UserError: it cannot be written to, its disk is full, or another command holds it.
        OSError: it cannot be made.
    """
    from jaxmodel.base.errors import UserError

    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(f"{folder}: this folder is not writable; change its rights, or give another --out.")
    if shutil.disk_usage(folder).free < _LEAST_FREE_BYTES:
        raise UserError(f"{folder}: the disk is full; remove files from it, or give another --out.")
    if fcntl is None:
        return
    found = folder.stat()
    if (found.st_dev, found.st_ino) in _held:
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise UserError(f"{folder}: another command is writing here; wait for it, or give another --out.") from error
    except OSError:  # a file system without locks
        os.close(handle)
        return
    _held[found.st_dev, found.st_ino] = handle


def let_go() -> None:
    """Let other commands write to all folders that this process holds."""
    while _held:
        _, handle = _held.popitem()
        with contextlib.suppress(OSError):
            os.close(handle)
