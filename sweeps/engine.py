"""Running a study: one compiled program, lanes spread over all devices, chunk by chunk."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxmodel.errors import SweepError
from jaxmodel.jax_settings import SWEEP_OPTIONS
from jaxmodel.kernel import as_one_kernel
from jaxmodel.model import Model
from jaxmodel.names import with_values
from sweeps.devices import lane_mesh, widest_block
from sweeps.lane import Keep, Outcome, SteppedProfile, lay_out, run_lane
from sweeps.plan import DEFAULT_MEMORY, Chunks, bytes_of, calls_of, cut, lanes_per_chunk, size_text
from sweeps.results import InMemory, variables_of
from sweeps.store import Store
from sweeps.study import Study

Progress = Callable[[int, int], None]


def run(
    study: Study,
    progress: Progress | None = None,
    *,
    out: str | Path | None = None,
    resume: bool = False,
    memory: float | int | str | None = None,
    engine: str = "local",
) -> xr.Dataset:
    """Run every lane of a study and return its metrics over its axes.

    Args:
        study: what to run.
        progress: called as progress(lanes done, lanes in all) at the start and then as lanes are done.
        out: a folder to which results are written chunk by chunk, so that they need no memory and a run that was
            stopped can be resumed; without it they are held in memory.
        resume: continues what an earlier run of the same study left in `out`; the results are those of a run that was
            never stopped, to the bit.
        memory: bytes for the chunks in progress, by default 512 MiB; without `out` also the limit of the whole result,
            by default none. Also as text: "2 GiB".
        engine: "local" runs on the devices of this process, "dask" on a cluster of one worker per core, and an address
            such as "tcp://host:8786" on that scheduler's workers. The results are the same to the bit.

    Returns:
        A dataset with the axes as coordinates, each metric and each stored column as a variable, and `status`, a
        `jaxmodel.simulation.Status` per lane. A lane that fails is NaN and harms no other; nothing is raised for it.
        With `out` it is read from the disk as far as it is used.

    Raises:
        SweepError: `out` holds another sweep or a finished one, the disk is full, or the memory does not suffice; what
            is done stays.
    """
    with _executor(engine, study) as executor:
        chunks = executor.chunks(memory, whole=out is None)
        sink = InMemory(study, chunks) if out is None else Store(study, chunks, out, resume)
        try:
            return sink.finish(_fill(sink, executor, study, progress))
        finally:
            sink.close()


def _executor(engine: str, study: Study) -> contextlib.AbstractContextManager[Any]:
    """Return what runs the chunks: a `Runner`, or a cluster with the same methods."""
    if engine == "local":
        return contextlib.nullcontext(Runner(study))
    if engine != "dask" and "://" not in engine:
        raise SweepError(
            f'engine: there is no engine "{engine}"; give "local", "dask", or an address such as "tcp://host:8786".'
        )
    try:
        from sweeps.cluster import cluster
    except ImportError as error:
        raise SweepError(f"engine: {error.name} is not installed; install jaxmodel[cluster].") from error
    return cluster(engine, study)


def _fill(sink: InMemory | Store, executor: Any, study: Study, progress: Progress | None) -> dict[str, Any]:
    """Run and commit the pending chunks; return counts and times for the manifest."""
    began = time.perf_counter()
    pending = sum(sink.chunks.span(number)[1] for number in sink.pending)
    done = study.size - pending

    def count(lanes: int) -> None:
        nonlocal done
        done += lanes
        if progress is not None:
            progress(done, study.size)

    count(0)
    if pending:
        executor.prepare(sink.chunks)
    compiled = time.perf_counter()
    for number, outcome in executor.outcomes(sink.chunks, sink.pending, count):
        sink.commit(number, outcome)
    return {
        "lanes": study.size,
        "lanes_run": pending,
        "steps": executor.steps,
        "devices": executor.device_names,
        "compile_s": compiled - began,
        "run_s": time.perf_counter() - compiled,
    }


class Runner:
    """A study on its devices.

    Attributes:
        steps: of each lane.
    """

    def __init__(self, study: Study, devices: Sequence[Any] | None = None) -> None:
        self._study = study
        prepared = study.prepared
        self._mesh = lane_mesh(devices)
        stepped = lay_out(_stiffest(study), prepared.profile, prepared.stored_rows)
        self.steps = int(stepped.duration_s.size)
        self._keep = Keep(prepared.metrics, tuple(study.store))
        self._shared: tuple[Model, SteppedProfile, Any] = (prepared.model, stepped, prepared.cutoff)

    @property
    def device_names(self) -> str:
        """How many devices of which kind."""
        return f"{self._mesh.size} x {self._mesh.devices.flat[0].device_kind}"

    @property
    def bytes_per_lane(self) -> int:
        """The size of a lane's axes and results."""
        return 8 * len(self._study.lanes(np.zeros(1, dtype=int))) + self.result_bytes_per_lane

    @property
    def result_bytes_per_lane(self) -> int:
        """The size of a lane's results."""
        return sum(variable.bytes_per_lane for variable in variables_of(self._study).values())

    def chunks(self, memory: float | int | str | None, whole: bool, least: int = 1) -> Chunks:
        """Return the cut of the study for so much memory, in some chunks at least.

        `whole` says that the results stay in memory too.

        Raises:
            SweepError: the memory does not suffice.
        """
        lanes, kept = self._study.size, self._study.size * self.result_bytes_per_lane
        allowed = DEFAULT_MEMORY if memory is None else bytes_of(memory)
        if whole and memory is not None and kept > allowed:
            raise SweepError(
                f"memory: the results of {lanes:,} lanes take {size_text(kept)}, more than {size_text(allowed)}; "
                "name a folder with out, or allow more."
            )
        return cut(self._study.shape, lanes_per_chunk(lanes, self.steps, self.bytes_per_lane, allowed, least))

    def prepare(self, chunks: Chunks) -> None:
        """Compile what runs the chunks, and put on the devices what all lanes share."""
        columns = len(self._keep.columns)
        self._calls = calls_of(
            chunks.lanes, self.steps, self._mesh.size, widest_block(self._mesh, self.steps * columns)
        )
        everywhere, self._over_lanes = (NamedSharding(self._mesh, PartitionSpec(*axes)) for axes in ((), ("lanes",)))
        self._shared = jax.device_put(jax.tree.map(jnp.asarray, self._shared), everywhere)
        signature = _signature((*self._shared, self._lanes(0, 1)))
        self._program = _program(self._keep, self._calls.width, self._mesh, signature)

    def outcomes(
        self, chunks: Chunks, numbers: Iterable[int], done: Callable[[int], None] = lambda lanes: None
    ) -> Iterator[tuple[int, Outcome]]:
        """Run chunks and yield each with its number; `done` is called with lanes as they are done."""
        parts: list[Outcome] = []
        for (number, count, ends), started in _one_ahead(self._started(chunks, numbers)):
            parts.append(jax.tree.map(lambda x, n=count: np.asarray(x)[:n], started))
            done(count)
            if ends:
                yield number, jax.tree.map(lambda *each: np.concatenate(each), *parts)
                parts = []

    def call(self, chunks: Chunks) -> int:
        """Run the first call of the first chunk, keep nothing of it, and return its number of lanes."""
        (_, lanes, _), started = next(self._started(chunks, [0]))
        jax.block_until_ready(started)
        return lanes

    def _started(self, chunks: Chunks, numbers: Iterable[int]) -> Iterator[tuple[tuple[int, int, bool], Outcome]]:
        """Start the calls of some chunks one by one; a call returns at once, its results come later."""
        for number in numbers:
            first, count = chunks.span(number)
            at_once = self._calls.blocks * self._calls.width * self._mesh.size
            for start in range(first, first + count, at_once):
                lanes = min(at_once, first + count - start)
                started = self._program(*self._shared, self._lanes(start, lanes))
                yield (number, lanes, start + lanes == first + count), started

    def _lanes(self, first: int, count: int) -> dict[str, jax.Array]:
        """Return the lanes of a call on their devices; the last one is repeated to fill the call."""
        at_once = self._calls.blocks * self._calls.width * self._mesh.size
        numbers = np.minimum(np.arange(first, first + at_once), first + count - 1)
        return jax.device_put(self._study.lanes(numbers), self._over_lanes)


def _one_ahead(items: Iterator[Any]) -> Iterator[Any]:
    """Yield items, each after the next one has been fetched: the devices run while an item is processed."""
    waiting = next(items, None)
    while waiting is not None:
        following = next(items, None)
        yield waiting
        waiting = following


def _stiffest(study: Study) -> Model:
    """Return a model with the extreme time constants of all lanes: steps for it serve them all.

    The least L_a / R_0 is needed, and R_0 J / k_tau^2 of the fastest and of the slowest motor, in this order.
    """
    ends = {"L_a": (min, min), "R_0": (min, max), "J": (min, max), "k_tau": (max, min)}
    varied = {name: [pick(study.range_of(name)) for pick in ends[name]] for name in ends if name in study.varied}
    return with_values(study.prepared.model, {name: jnp.asarray(values) for name, values in varied.items()})


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
