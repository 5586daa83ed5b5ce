"""The processor as JAX sees it: one device per core, so that batches can be spread over all of them."""

from __future__ import annotations

import os
from importlib.metadata import version

import jax

_SUMS_TO_A_LIBRARY = "xla_cpu_experimental_ynn_fusion_type"


def use_all_cores() -> None:
    """Let JAX see one device per core of the processor, unless it is too late or the user chose a number.

    JAX takes the number when it starts its backends, at the first array, so this is called when `jaxmodel` is
    imported. Accelerators stay what they are.
    """
    chosen = jax.config.jax_num_cpu_devices >= 0  # type: ignore[attr-defined]
    if chosen or "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return
    try:
        jax.config.update("jax_num_cpu_devices", _cores())
    except RuntimeError:  # another program of the user's has made arrays before
        return


def keep_sums_in_kernels() -> None:
    """Keep XLA from handing sums to a library, which it cannot call from within a kernel (see `jaxmodel.kernel`).

    With a cell's tables in a step over many lanes, jaxlib 0.10 else ends a compilation with "Fusion kind not
    implemented on CPU". XLA reads the flag when it first compiles, and dies of one that it does not know: it is set for
    the versions that have been seen to know it.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if version("jaxlib").startswith("0.10.") and _SUMS_TO_A_LIBRARY not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{_SUMS_TO_A_LIBRARY}=".strip()


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
