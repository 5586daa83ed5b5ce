"""Where the lanes run: every core or accelerator, as one row of devices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
from jax.sharding import Mesh

# Lanes of one block on a processor: the values of a step then stay in its nearest caches.
CPU_BLOCK = 128
# Measured on an H200, a robot over 1,048,576 lanes: 465 ps per step in blocks of 65,536 lanes, 386 in one block.
ACCELERATOR_BLOCK = 1_048_576
# Of a block's stored columns, which an accelerator holds at every step before the stored rows are picked.
ACCELERATOR_STORED_BYTES = 2 * 2**30


def lane_mesh(devices: Sequence[Any] | None = None) -> Mesh:
    """Return all devices, or those given, as a mesh with the one axis 'lanes'."""
    used = tuple(devices or jax.devices())
    return jax.make_mesh((len(used),), ("lanes",), axis_types=(jax.sharding.AxisType.Auto,), devices=used)


def widest_block(mesh: Mesh, numbers_per_lane: int) -> int:
    """Return the most lanes of one block, each of which holds so many numbers of stored columns."""
    if mesh.devices.flat[0].platform == "cpu":
        return CPU_BLOCK
    fitting = ACCELERATOR_STORED_BYTES // (8 * max(1, numbers_per_lane))
    return max(64, min(ACCELERATOR_BLOCK, fitting // 64 * 64))
