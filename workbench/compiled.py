"""Compiled programs kept between runs of the command: what was compiled once is read back in a tenth of the time."""

from __future__ import annotations

import os
import sys
import tempfile
import warnings
from pathlib import Path

from workbench.terminal import complain

CACHE_VARIABLE = "JAXMODEL_CACHE"


def cache_folder() -> Path:
    """Return where compiled programs are kept: JAXMODEL_CACHE, or `jaxmodel` in the platform's folder for caches."""
    if chosen := os.environ.get(CACHE_VARIABLE):
        return Path(chosen).expanduser()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "jaxmodel"


def keep_compiled_programs() -> None:
    """Switch JAX's persistent cache on; a folder that the user chose by JAX's own variable is left alone.

    The smallest programs are kept too: a hundred of a few milliseconds each would take a second and a half every time.
    A folder that cannot be written is told once, and costs nothing but time.
    """
    import jax

    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    if reason := _not_writable(cache_folder()):
        complain(
            f"Compiled programs cannot be kept in {cache_folder()}: {reason}; the next run will compile again. Set "
            f"{CACHE_VARIABLE} to a folder that can be written."
        )
        warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")  # once is enough
    jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _not_writable(folder: Path) -> str:
    """Return why no file can be written into a folder, which is made if need be; "" where one can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return (error.strerror or str(error)).lower()
