"""Compiled programs on disk: in a folder of the user alone, each with the hash of its content.

What is kept here is run when it is read: machine code and text of a compiler. So nothing is read from a folder that
another user owns or may write to. The hash finds what was cut off or has changed on the disk.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import threading
import warnings
from pathlib import Path

from jaxmodel.base.errors import RemarkWarning

_HASH_BYTES = hashlib.sha256().digest_size


def kept(name: str) -> bytes | None:
    """Return what was kept under a name if it is there and whole."""
    folder = _folder()
    try:
        content = b"" if folder is None else (folder / name).read_bytes()
    except OSError:
        return None
    whole = hashlib.sha256(content[_HASH_BYTES:]).digest() == content[:_HASH_BYTES]
    return content[_HASH_BYTES:] if whole else None


def keep(name: str, content: bytes) -> None:
    """Keep something; whoever reads finds all of it or nothing. Nothing is kept where it cannot be."""
    folder = _folder()
    if folder is None:
        return
    partial = folder / f"{name}.{os.getpid()}-{threading.get_ident()}"
    try:
        partial.write_bytes(hashlib.sha256(content).digest() + content)
        partial.replace(folder / name)
    except OSError:
        with contextlib.suppress(OSError):  # a folder that is read-only
            partial.unlink(missing_ok=True)


def why_not_private(folder: Path) -> str:
    """Return why a folder may hold what another user has put there, "" if it is the user's alone.

    Others lose the right to read in a folder that is the user's own.

    Raises:
        OSError: there is no such folder, or its rights cannot be changed.
    """
    if not hasattr(os, "getuid"):  # Windows: folders of a user are private unless they are shared
        return ""
    state = folder.stat()
    if state.st_uid != os.getuid():
        return "it belongs to another user"
    if state.st_mode & 0o022:
        return "other users may write to it"
    if state.st_mode & 0o077:
        folder.chmod(0o700)
    return ""


def _folder() -> Path | None:
    """Return the folder, beside the programs that JAX keeps (`jaxmodel.base.jax_settings`); None if there is none."""
    import jax  # here, so that the help of a command starts without it

    beside = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    if not beside:
        return None
    folder = Path(beside) / "programs"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        why = why_not_private(folder)
    except OSError:
        return None
    if why:
        warnings.warn(
            RemarkWarning(
                f"Compiled programs in {folder} are not used, because {why}; remove the folder, or choose another."
            ),
            stacklevel=1,  # the same place each time, so that it is said once
        )
        return None
    return folder
