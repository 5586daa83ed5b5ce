"""The processor as JAX sees it: one device per core, so that batches can be spread over all of them."""

from __future__ import annotations

import os

import jax


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


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
