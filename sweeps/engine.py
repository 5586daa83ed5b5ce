"""Running a study: one compiled program, lanes spread over all devices, chunk by chunk."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxmodel.kernel import as_one_kernel
from jaxmodel.model import Model
from jaxmodel.names import with_values
from sweeps.devices import ACCELERATOR_BLOCK, CPU_BLOCK, CPU_COMPILER_OPTIONS, lane_mesh
from sweeps.lane import Keep, lay_out, run_lane
from sweeps.results import label
from sweeps.study import Study

Progress = Callable[[int, int], None]

# Steps of lanes that a device takes in one call: some tenths of a second, so that progress moves and calls cost little.
LANE_STEPS_PER_CALL = 4_000_000
# Narrower loops than this are unrolled by the compiler and run slower than a wider block padded.
NARROWEST_BLOCK = 64


def run(study: Study, progress: Progress | None = None) -> xr.Dataset:
    """Run every lane of a study and return its metrics over its axes.

    Args:
        study: what to run.
        progress: called as progress(lanes done, lanes in all) after each chunk.

    Returns:
        A dataset with the axes as coordinates, each metric and each stored column as a variable, and `status`, a
        `jaxmodel.simulate.Status` per lane. A lane that fails is NaN and harms no other; nothing is raised for it.
    """
    began = time.perf_counter()
    prepared = study.prepared
    mesh = lane_mesh()
    everywhere, over_lanes = (NamedSharding(mesh, PartitionSpec(*axes)) for axes in ((), ("lanes",)))

    rows = np.arange(0, prepared.profile.time_s.size, study.store_every)
    course = lay_out(_stiffest(study), prepared.profile, rows)
    width, blocks = _chunk(study.size, course.duration_s.size, mesh)
    chunk = width * blocks * mesh.size
    keep = Keep(prepared.metrics, tuple(study.store))
    shared = jax.device_put(jax.tree.map(jnp.asarray, (prepared.model, course, prepared.cutoff)), everywhere)

    def lanes(first: int):
        """Return a chunk's lanes on their devices; the last lane fills what is left over."""
        return jax.device_put(study.lanes(np.minimum(np.arange(first, first + chunk), study.size - 1)), over_lanes)

    program = _program(keep, width, mesh, _signature((*shared, lanes(0))))
    compiled = time.perf_counter()
    outcomes, waiting = [], None
    for first in range(0, study.size, chunk):
        started = program(*shared, lanes(first))  # returns at once: the devices never wait for this loop
        if waiting is not None:
            outcomes.append(jax.tree.map(np.asarray, waiting))
            if progress is not None:
                progress(first, study.size)
        waiting = started
    outcomes.append(jax.tree.map(np.asarray, waiting))
    if progress is not None:
        progress(study.size, study.size)
    outcome = jax.tree.map(lambda *parts: np.concatenate(parts)[: study.size], *outcomes)
    return label(
        study,
        outcome,
        time_s=prepared.profile.time_s[rows],
        performance={
            "lanes": study.size,
            "steps": int(course.duration_s.size),
            "devices": f"{mesh.size} x {mesh.devices.flat[0].device_kind}",
            "compile_s": compiled - began,
            "run_s": time.perf_counter() - compiled,
        },
    )


def _stiffest(study: Study) -> Model:
    """Return the model with the shortest electrical time constant L_a / R_0 of all lanes: its steps serve them all."""
    extremes = {name: pick(study.axes[name]) for name, pick in (("L_a", min), ("R_0", max)) if name in study.axes}
    return with_values(study.prepared.model, {name: jnp.asarray(value) for name, value in extremes.items()})


def _chunk(lanes: int, steps: int, mesh: Mesh) -> tuple[int, int]:
    """Return the width of a block of lanes, and the number of blocks that a device runs in one call."""
    widest = CPU_BLOCK if mesh.devices.flat[0].platform == "cpu" else ACCELERATOR_BLOCK
    per_device = math.ceil(lanes / mesh.size)
    width = min(widest, NARROWEST_BLOCK * math.ceil(per_device / NARROWEST_BLOCK))
    blocks = math.ceil(per_device / width)
    calls = math.ceil(blocks / max(1, LANE_STEPS_PER_CALL // (steps * width)))
    return width, math.ceil(blocks / calls)


def _signature(arguments: Any):
    """Return what a compiled program depends on: structure, shapes, types and places of its arguments."""
    leaves, structure = jax.tree.flatten(arguments)
    return structure, tuple(jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=x.sharding) for x in leaves)


@functools.lru_cache(maxsize=32)
def _program(keep: Keep, width: int, mesh: Mesh, signature: Any):
    """Return the compiled program (model, course, cutoff, lanes) -> outcomes, kept for the next sweep of its like."""
    options = CPU_COMPILER_OPTIONS if mesh.devices.flat[0].platform == "cpu" else None

    def run_share(model, course, cutoff, own):
        """Run one device's share of the lanes, block after block."""

        def run_blocks(blocks):
            return jax.lax.map(jax.vmap(functools.partial(run_lane, keep, model, course, cutoff)), blocks)

        blocks = jax.tree.map(lambda x: x.reshape(-1, width), own)
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), as_one_kernel(run_blocks, blocks))

    whole, lanes = PartitionSpec(), PartitionSpec("lanes")
    program = jax.jit(
        jax.shard_map(run_share, mesh=mesh, in_specs=(whole, whole, whole, lanes), out_specs=lanes, check_vma=False)
    )
    return program.lower(*jax.tree.unflatten(*signature)).compile(options)
