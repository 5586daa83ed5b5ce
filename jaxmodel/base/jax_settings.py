"""All settings of JAX and its compiler that this project makes, and the variable that disables them.

Importing `jaxmodel` calls `apply`, and imports no JAX itself. The environment variable JAXMODEL_JAX_SETTINGS=off, set
before the import, leaves JAX as it is: float32 unless the user asks for float64, one device for all cores.
"""

from __future__ import annotations

import os
import sys
import tempfile
import warnings
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

from jaxmodel.base.cache import why_not_private

SWITCH = "JAXMODEL_JAX_SETTINGS"
CACHE_VARIABLE = "JAXMODEL_CACHE"
# Compiler options of a sweep. Vectors of 512 bits halve the time of a step on processors that have them, and change
# nothing on others.
SWEEP_OPTIONS: dict[str, str | bool] = {"xla_cpu_prefer_vector_width": "512"}
# Compiler options for CPUs; results are identical bit for bit. This level takes 50 to 60 % of the compile time at the
# same speed; wide vectors reduce both by 10 to 20 %.
QUICK_OPTIONS: dict[str, Any] = {"xla_backend_optimization_level": 1, "xla_cpu_prefer_vector_width": "512"}

_SUMS_TO_A_LIBRARY = "xla_cpu_experimental_ynn_fusion_type"


def apply() -> None:
    """Enable float64, one device per core, and reductions inside kernels, unless the user disables this.

    The accuracy of the model (SOC to 1e-6 over hours) needs float64. JAX determines its devices once, at the first
    array, so that this must happen before that: now, or where JAX has not been imported yet, as soon as it is. So the
    help of a command and the server of the workbench start without JAX.
    """
    if os.environ.get(SWITCH, "").lower() in ("off", "0", "no", "false"):
        return
    _keep_sums_in_kernels()
    if "jax" in sys.modules:
        _configure()
    else:
        sys.meta_path.insert(0, _ConfigureOnImport())


def _configure() -> None:
    import jax

    jax.config.update("jax_enable_x64", True)
    use_all_cores()


class _ConfigureOnImport(MetaPathFinder):
    """Lets the other finders find JAX, and configures it at the end of its import."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "jax":
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        spec = next((found for one in others if (found := one.find_spec(fullname, path, target))), None)
        if spec is None or spec.loader is None:
            return spec
        load = spec.loader.exec_module

        def load_and_configure(module: ModuleType) -> None:
            load(module)
            sys.meta_path.remove(self)
            _configure()

        spec.loader.exec_module = load_and_configure  # type: ignore[method-assign]
        return spec


def use_all_cores() -> None:
    """Give JAX one device per CPU core, unless it is too late or the user chose a number.

    Accelerators are unaffected.
    """
    import jax

    chosen = jax.config.jax_num_cpu_devices >= 0  # type: ignore[attr-defined]
    if chosen or "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", _cores())
    except RuntimeError:  # JAX is already initialised
        return


def _keep_sums_in_kernels() -> None:
    """Prevent XLA from using a library for sums, which it cannot call inside a kernel (`jaxmodel.lanes.xla_kernel`).

    Otherwise, with the tables of a cell in a step over many lanes, jaxlib 0.10 ends compilation with "Fusion kind not
    implemented on CPU". XLA reads the flag when it first compiles, and aborts on unknown flags: it is set only for
    versions that are known to have it.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if version("jaxlib").startswith("0.10.") and _SUMS_TO_A_LIBRARY not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{_SUMS_TO_A_LIBRARY}=".strip()


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder() -> Path:
    """Return the folder of compiled programs: JAXMODEL_CACHE, or `jaxmodel` in the cache folder of the platform."""
    if chosen := os.environ.get(CACHE_VARIABLE):
        return Path(chosen).expanduser()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "jaxmodel"


def keep_compiled_programs() -> str:
    """Store compiled programs on disk, so that the next process loads them in a tenth of the time.

    The command line does this at the start of every command; a notebook may. Small programs are stored too: about a
    hundred of a few milliseconds each would take a second and a half every time. A folder set by JAX's own variable,
    JAX_COMPILATION_CACHE_DIR, is respected.

    Returns:
        A sentence on why the folder cannot be used, "" if it can; without it programs are compiled again.
    """
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return ""
    problem = ""
    reason, private = _why_not(cache_folder())
    if reason:
        problem = (
            f"Compiled programs cannot be stored in {cache_folder()}: {reason}; the next run will compile again. Set "
            f"{CACHE_VARIABLE} to a folder of yours that can be written."
        )
        warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")  # once is enough
    if not private:
        return problem  # what is there may be another user's, and would be run
    import jax

    jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return problem


def _why_not(folder: Path) -> tuple[str, bool]:
    """Return why nothing can be stored in a folder, '' if it can, and whether it is the user's alone.

    It is created if necessary.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if why := why_not_private(folder):
            return why, False
        with tempfile.TemporaryFile(dir=folder):
            return "", True
    except OSError as error:
        return (error.strerror or str(error)).lower(), True
