"""Where the lanes run: every core or accelerator, as one row of devices."""

from __future__ import annotations

import os

import jax
from jax.sharding import Mesh

# Lanes of one block on a processor: the values of a step then stay in its nearest caches.
CPU_BLOCK = 128
ACCELERATOR_BLOCK = 65_536
# Vectors of 512 bits halve the time of a step where the processor has them, and change nothing where it has not.
CPU_COMPILER_OPTIONS: dict[str, str | bool] = {"xla_cpu_prefer_vector_width": "512"}


def use_all_cores() -> bool:
    """Let JAX see one device per core of the processor; return False where it is too late to ask.

    Accelerators stay what they are. JAX takes the number when it starts its backends, at the first array, so this is
    called when `sweeps` is imported. A number that the user chose, by JAX's own options, is left alone.
    """
    chosen = jax.config.jax_num_cpu_devices >= 0  # type: ignore[attr-defined]
    if chosen or "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return True
    try:
        jax.config.update("jax_num_cpu_devices", _cores())
    except RuntimeError:
        return False
    return True


def lane_mesh() -> Mesh:
    """Return all devices as a mesh with the one axis 'lanes'."""
    return jax.make_mesh((jax.device_count(),), ("lanes",), axis_types=(jax.sharding.AxisType.Auto,))


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
