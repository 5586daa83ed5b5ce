"""Compiled programs kept between runs of the command: what was compiled once is read back in a tenth of the time."""

from __future__ import annotations

import os
import sys
from pathlib import Path

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
    """
    import jax

    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
