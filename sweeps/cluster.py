"""Running chunks on a cluster of dask.distributed: the study goes to each worker once, then only numbers of chunks.

A worker writes a chunk's results itself where it finds the folder or object store; else it sends them back, and they
are committed as those of a local run are. The chunks that a worker was running when it was lost are run by another. A
task runs on one device, with the program of a local run: the bits are the same.

dask.distributed is imported where it is used: it brings a web server along, which a local sweep does without.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import pickle
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any

import jax
import llvmlite

from jaxmodel.base.errors import SweepError
from jaxmodel.base.jax_settings import use_all_cores
from jaxmodel.sweeps import manifest
from jaxmodel.sweeps.lane import Outcome
from jaxmodel.sweeps.plan import Chunks
from jaxmodel.sweeps.runner import Runner
from jaxmodel.sweeps.store import Grid
from jaxmodel.sweeps.study import Study

# Chunks per thread: enough that a slow worker at the end delays little.
CHUNKS_PER_THREAD = 4
# Chunks in the queue of a thread, so that it never waits for the next.
AHEAD = 2
_PATIENCE_S = 30


class Cluster:
    """The workers of a scheduler, in the place of a local `Runner`.

    Attributes:
        steps: of each lane.
        remark: as that of a `Runner`.
    """

    def __init__(self, study: Study, client: Any) -> None:
        self._study, self._client = study, client
        self._layout = Runner(study)
        self.steps, self.remark = self._layout.steps, ""
        self._name = f"sweep-{study.digest[:16]}"

    @property
    def _threads(self) -> int:
        return max(1, sum(self._client.nthreads().values()))

    @property
    def device_names(self) -> str:
        """How many threads of how many workers."""
        return f"{self._threads} threads of {len(self._client.nthreads())} workers"

    def chunks(self, memory: float | int | str | None, whole: bool) -> Chunks:
        """Return the cut of the study; see `Runner.chunks`. The memory is that of one task."""
        return self._layout.chunks(memory, whole, least=CHUNKS_PER_THREAD * self._threads)

    def prepare(self, chunks: Chunks, grid: Grid | None = None) -> None:
        """Give the study, and what results are written into, to every worker, those that join later too.

        Whether lanes can be vector instructions is found out here, so that the user hears of it and all workers do the
        same.
        """
        through_xla = not self._layout.as_kernel()
        self.remark = self._layout.remark
        given = _given(_packed(self._study, chunks, through_xla, grid), _fingerprint())
        self._client.register_plugin(given, name=self._name)

    @property
    def program(self) -> str:
        """What computes the lanes, as that of a `Runner`."""
        return self._layout.program

    def outcomes(
        self, chunks: Chunks, numbers: Iterable[int], done: Callable[[int], None] = lambda lanes: None
    ) -> Iterator[tuple[int, Outcome | None]]:
        """Run chunks and yield each with its number, in the order in which they end; None for one that a worker wrote.

        Raises:
            SweepError: a chunk has ended several workers, a worker has other code, or the scheduler is lost.
        """
        from distributed import as_completed
        from distributed.comm.core import CommClosedError

        left, running = iter(numbers), as_completed([])
        number_of: dict[Any, int] = {}

        def submit() -> None:
            while len(number_of) < AHEAD * self._threads:
                number = next(left, None)
                if number is None:
                    return
                future = self._client.submit(_run, self._name, number, key=f"{self._name}-{number}", pure=False)
                number_of[future] = number
                running.add(future)

        submit()
        try:
            for future in running:
                number = number_of.pop(future)
                outcome = _result(future, number)
                submit()
                done(chunks.span(number)[1])
                yield number, outcome
        finally:
            with contextlib.suppress(OSError, CommClosedError):
                self._client.cancel(list(number_of))
                self._client.unregister_worker_plugin(self._name)


def _result(future: Any, number: int) -> Outcome | None:
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    go_on = "completed chunks are kept; continue with --resume."
    try:
        return future.result()
    except KilledWorker as error:
        raise SweepError(
            f"engine: chunk {number} has ended several workers, most likely by lack of memory; allow chunks less, "
            f"as in --memory 100MB, in a new folder, or give the workers more; {go_on}"
        ) from error
    except (OSError, CommClosedError, TimeoutError) as error:
        raise SweepError(f"engine: the scheduler or its workers are lost ({error}); {go_on}") from error
    except ImportError as error:
        raise SweepError(f"engine: a worker cannot run this ({error}); install the same packages there.") from error


@contextlib.contextmanager
def cluster(engine: str, study: Study) -> Generator[Cluster, None, None]:
    """Connect to a scheduler, or start a cluster of one worker per core for "dask".

    Raises:
        SweepError: no scheduler answers, or it has no workers.
    """
    from distributed import Client, LocalCluster

    with contextlib.ExitStack() as open_until_end:
        if engine == "dask":
            folder = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
            own = LocalCluster(
                n_workers=_cores(),
                threads_per_worker=1,
                dashboard_address=None,  # type: ignore[arg-type]
                silence_logs=logging.ERROR,
                env={"JAX_COMPILATION_CACHE_DIR": folder} if folder else {},
            )
            open_until_end.enter_context(own)
            client = Client(own)
        else:
            try:
                client = Client(engine, timeout=_PATIENCE_S)
            except (OSError, ValueError) as error:
                raise SweepError(f"engine: no scheduler answers at {engine}; start one, or correct it.") from error
        open_until_end.enter_context(client)
        try:
            client.wait_for_workers(1, timeout=_PATIENCE_S)
        except TimeoutError as error:
            raise SweepError(f"engine: the scheduler at {engine} has no workers; start some.") from error
        yield Cluster(study, client)


def _cores() -> int:
    use_all_cores()
    return len(jax.devices("cpu"))


def _fingerprint() -> str:
    """Return what must be the same on a worker, so that its bits are ours."""
    return f"{manifest.sources_digest()[:12]}, jax {jax.__version__}, llvmlite {llvmlite.__version__}"


def _packed(study: Study, chunks: Chunks, through_xla: bool, grid: Grid | None) -> bytes:
    """Return a study ready to travel, the user's own effects and metrics with their code: no worker can import them."""
    import cloudpickle

    classes = [type(part) for part in (*study.prepared.model.effects, *study.prepared.metrics)]
    classes += study.own_effects
    names = {cls.__module__ for cls in classes if cls.__module__.partition(".")[0] not in ("jaxmodel", "sweeps")}
    modules = [sys.modules[name] for name in names - {"__main__"} if name in sys.modules]
    for module in modules:
        cloudpickle.register_pickle_by_value(module)
    try:
        return cloudpickle.dumps((study, chunks, through_xla, grid))
    finally:
        for module in modules:
            cloudpickle.unregister_pickle_by_value(module)


def _given(payload: bytes, fingerprint: str) -> Any:
    """Return what each worker is given of a sweep; the scheduler gives it to workers that join later as well."""
    from distributed import WorkerPlugin

    given: Any = WorkerPlugin()
    given.payload, given.fingerprint = payload, fingerprint
    return given


_slots = threading.local()
_next_slot = itertools.count()


def _run(name: str, number: int) -> Outcome | None:
    """Run one chunk on a worker, on the device of this thread; return its results unless they could be written."""
    from distributed import get_worker

    given: Any = get_worker().plugins[name]
    if given.fingerprint != _fingerprint():
        raise SweepError(
            f"engine: a worker has other code ({_fingerprint()}) than this ({given.fingerprint}); install the same."
        )
    if not hasattr(_slots, "own"):
        _slots.own = next(_next_slot)
    runner, chunks, grid = _ready(given.payload, _slots.own % jax.local_device_count())
    ((_, outcome),) = runner.outcomes(chunks, [number])
    if grid is None or not grid.is_reached:
        return outcome
    try:
        grid.write(number, outcome)
    except OSError as error:
        raise SweepError(
            f"engine: a worker could not write chunk {number} to {grid.place} ({error}); completed chunks are kept; "
            "free some space there, and continue with --resume."
        ) from error
    return None


@functools.lru_cache(maxsize=32)
def _ready(payload: bytes, device: int) -> tuple[Runner, Chunks, Grid | None]:
    study, chunks, through_xla, grid = pickle.loads(payload)
    runner = Runner(study, [jax.local_devices()[device]], through_xla)
    runner.prepare(chunks)
    return runner, chunks, grid
