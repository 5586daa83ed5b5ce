"""Lanes through XLA: one compiled program, blocks of lanes spread over all devices."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxmodel.base.jax_settings import SWEEP_OPTIONS
from jaxmodel.lanes.xla_kernel import as_one_kernel
from jaxmodel.model.electrothermal import Model
from jaxmodel.sweeps.devices import widest_block
from jaxmodel.sweeps.lane import Keep, Outcome, SteppedProfile, run_lane
from jaxmodel.sweeps.plan import ACCELERATOR, calls_of


class ByXla:
    """A sweep's program on a mesh of devices."""

    def __init__(
        self,
        keep: Keep,
        shared: tuple[Model, SteppedProfile, Any],
        lanes: Callable[[np.ndarray], dict[str, Any]],
        mesh: Mesh,
        steps: int,
        most: int,
    ) -> None:
        """Compile it.

        Args:
            keep: what is kept of each lane.
            shared: by all lanes.
            lanes: from the numbers of lanes to what is their own.
            mesh: of devices.
            steps: of each lane.
            most: lanes of a chunk.
        """
        self._lanes_of, self._mesh = lanes, mesh
        times = 1 if mesh.devices.flat[0].platform == "cpu" else ACCELERATOR
        self._calls = calls_of(most, steps, mesh.size, widest_block(mesh, steps * len(keep.columns)), times)
        everywhere, self._over_lanes = (NamedSharding(mesh, PartitionSpec(*axes)) for axes in ((), ("lanes",)))
        self._shared = jax.device_put(shared, everywhere)
        signature = _signature((*self._shared, self._lanes(0, 1)))
        self._program = _program(keep, self._calls.width, mesh, signature)

    def outcomes(
        self, spans: Iterable[tuple[int, int, int]], done: Callable[[int], None]
    ) -> Iterator[tuple[int, Outcome]]:
        """Run spans (number, first lane, lanes) and yield the outcome of each with its number."""
        parts: list[Outcome] = []
        for (number, count, ends), started in _one_ahead(self._started(spans)):
            parts.append(jax.tree.map(lambda x, n=count: np.asarray(x)[:n], started))
            done(count)
            if ends:
                yield number, jax.tree.map(lambda *each: np.concatenate(each), *parts)
                parts = []

    def call(self, first: int, count: int) -> int:
        """Run the first call of a span, keep nothing of it, and return its number of lanes."""
        (_, lanes, _), started = next(self._started([(0, first, count)]))
        jax.block_until_ready(started)
        return lanes

    def _started(self, spans: Iterable[tuple[int, int, int]]) -> Iterator[tuple[tuple[int, int, bool], Outcome]]:
        """Start the calls of some spans one by one; a call returns at once, its results come later."""
        at_once = self._calls.blocks * self._calls.width * self._mesh.size
        for number, first, count in spans:
            for start in range(first, first + count, at_once):
                lanes = min(at_once, first + count - start)
                started = self._program(*self._shared, self._lanes(start, lanes))
                yield (number, lanes, start + lanes == first + count), started

    def _lanes(self, first: int, count: int) -> dict[str, jax.Array]:
        """Return the lanes of a call on their devices; the last one is repeated to fill the call."""
        at_once = self._calls.blocks * self._calls.width * self._mesh.size
        numbers = np.minimum(np.arange(first, first + at_once), first + count - 1)
        return jax.device_put(self._lanes_of(numbers), self._over_lanes)


def _one_ahead(items: Iterator[Any]) -> Iterator[Any]:
    """Yield items, each after the next one has been fetched: the devices run while an item is processed."""
    waiting = next(items, None)
    while waiting is not None:
        following = next(items, None)
        yield waiting
        waiting = following


def _signature(arguments: Any) -> tuple[Any, tuple[jax.ShapeDtypeStruct, ...]]:
    """Return what a compiled program depends on: structure, shapes, types and places of its arguments."""
    leaves, structure = jax.tree.flatten(arguments)
    return structure, tuple(jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=x.sharding) for x in leaves)


@functools.lru_cache(maxsize=32)
def _program(keep: Keep, width: int, mesh: Mesh, signature: Any) -> Any:
    """Return the compiled program (model, stepped profile, cutoff, lanes) -> outcomes, cached for like sweeps."""
    options = SWEEP_OPTIONS if mesh.devices.flat[0].platform == "cpu" else None

    def run_share(model: Model, stepped: SteppedProfile, cutoff: Any, own: dict[str, jax.Array]) -> Outcome:
        """Run one device's share of the lanes, block after block."""

        def run_blocks(blocks: dict[str, jax.Array]) -> Any:
            return jax.lax.map(jax.vmap(functools.partial(run_lane, keep, model, stepped, cutoff)), blocks)

        blocks = jax.tree.map(lambda x: x.reshape(-1, width), own)
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), as_one_kernel(run_blocks, blocks))

    whole, lanes = PartitionSpec(), PartitionSpec("lanes")
    program = jax.jit(
        jax.shard_map(run_share, mesh=mesh, in_specs=(whole, whole, whole, lanes), out_specs=lanes, check_vma=False)
    )
    return program.lower(*jax.tree.unflatten(*signature)).compile(options)
