"""Every setting of JAX and its compiler that this project makes, and the switch that leaves them alone.

Importing `jaxmodel` calls `apply`. The environment variable JAXMODEL_JAX_SETTINGS=off, set before the import, leaves
JAX as it is: float32 unless the user asks for float64, one device for all cores.
"""

from __future__ import annotations

import os
import sys
import tempfile
import warnings
from importlib.metadata import version
from pathlib import Path

import jax

SWITCH = "JAXMODEL_JAX_SETTINGS"
CACHE_VARIABLE = "JAXMODEL_CACHE"
# Of a sweep's program. Vectors of 512 bits halve the time of a step where the processor has them, and change nothing
# where it has not.
SWEEP_OPTIONS: dict[str, str | bool] = {"xla_cpu_prefer_vector_width": "512"}

_SUMS_TO_A_LIBRARY = "xla_cpu_experimental_ynn_fusion_type"


def apply() -> None:
    """Switch on float64, one device per core, and kernels that hold their sums; nothing where the user says so.

    The model's accuracy (SOC to 1e-6 over hours) is out of reach of float32, and JAX counts its devices once, at the
    first array: there is no later moment to ask.
    """
    if os.environ.get(SWITCH, "").lower() in ("off", "0", "no", "false"):
        return
    jax.config.update("jax_enable_x64", True)
    use_all_cores()
    _keep_sums_in_kernels()


def use_all_cores() -> None:
    """Let JAX see one device per core of the processor, unless it is too late or the user chose a number.

    Accelerators stay what they are.
    """
    chosen = jax.config.jax_num_cpu_devices >= 0  # type: ignore[attr-defined]
    if chosen or "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", _cores())
    except RuntimeError:  # another program of the user's has made arrays before
        return


def _keep_sums_in_kernels() -> None:
    """Keep XLA from handing sums to a library, which it cannot call from within a kernel (see `jaxmodel.kernel`).

    With a cell's tables in a step over many lanes, jaxlib 0.10 else ends a compilation with "Fusion kind not
    implemented on CPU". XLA reads the flag when it first compiles, and aborts on one that it does not know: it is set
    for the versions that have been seen to know it.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if version("jaxlib").startswith("0.10.") and _SUMS_TO_A_LIBRARY not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{_SUMS_TO_A_LIBRARY}=".strip()


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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


def keep_compiled_programs() -> str:
    """Keep compiled programs on disk, so that the next process reads them back in a tenth of the time.

    The command line does this at the start of every command; a notebook may. The smallest programs are kept too: a
    hundred of a few milliseconds each would take a second and a half every time. A folder that the user chose by JAX's
    own variable, JAX_COMPILATION_CACHE_DIR, is left alone.

    Returns:
        Why the folder cannot be used, as a sentence; "" where it can. Nothing is lost then but time.
    """
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return ""
    problem = ""
    if reason := _not_writable(cache_folder()):
        problem = (
            f"Compiled programs cannot be kept in {cache_folder()}: {reason}; the next run will compile again. Set "
            f"{CACHE_VARIABLE} to a folder that can be written."
        )
        warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")  # once is enough
    jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return problem


def _not_writable(folder: Path) -> str:
    """Return why no file can be written into a folder, which is made if need be; "" where one can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return (error.strerror or str(error)).lower()
