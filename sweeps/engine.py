"""Running a study, chunk by chunk, in this process or on a cluster."""

from __future__ import annotations

import contextlib
import time
import warnings
from pathlib import Path
from typing import Any

import xarray as xr

from jaxmodel.base.errors import RemarkWarning, SweepError
from jaxmodel.base.progress import Count, counted
from jaxmodel.sweeps.idle import warn_of_idle
from jaxmodel.sweeps.plausible import warn_of_odd_values
from jaxmodel.sweeps.results import InMemory
from jaxmodel.sweeps.room import refuse_what_cannot_be_kept
from jaxmodel.sweeps.runner import Runner
from jaxmodel.sweeps.store import Store
from jaxmodel.sweeps.study import Study

Progress = Count
"""Called with the lanes that are done and all lanes, as a sweep goes on."""


def run(
    study: Study,
    progress: bool | Progress = True,
    *,
    out: str | Path | None = None,
    resume: bool = False,
    memory: float | int | str | None = None,
    engine: str = "local",
) -> xr.Dataset:
    """Run every lane of a study and return its metrics over its axes.

    Args:
        study: what to run.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called as
            progress(lanes done, lanes in all) at the start and then as lanes are done.
        out: a folder, or a URL in an object store such as "s3://bucket/name", to which results are written chunk by
            chunk, so that they need no memory and a run that was stopped can be resumed; without it they are held in
            memory.
        resume: continues what an earlier run of the same study left in `out`; the results are those of a run that was
            never stopped, to the bit.
        memory: bytes for the chunks in progress, by default 512 MiB; without `out` also the limit of the whole result,
            by default none. Also as text: "2 GiB".
        engine: "local" runs on the devices of this process, "dask" on a cluster of one worker per core, and an address
            such as "tcp://host:8786" on that scheduler's workers. The results are the same to the bit. "xla" runs in
            this process through XLA also where a lane can be vector instructions of the processor: slower, and equal
            but for rounding.

    Returns:
        A dataset with the axes as coordinates, each metric and each stored column as a variable, and `status`, a
        `jaxmodel.model.simulation.Status` per lane. A lane that fails is NaN and harms no other; nothing is raised for
        it. With `out` it is read from the disk as far as it is used.

    Raises:
        SweepError: `out` holds another sweep or a finished one, the disk is full or too small, the memory does not
            suffice, or the lanes cannot be computed in the study's precision; what is done stays.

    Warns:
        RemarkWarning: a lane has an operation without vector instructions, and the sweep runs through XLA; no result
            can depend on an axis; or a number looks like one in another unit.

    Example:
        >>> from jaxmodel import sweeps
        >>> study = sweeps.Study(
        ...     kind="cell",
        ...     profile={"duration_s": 600.0, "step_s": 10.0, "ambient_degC": 20.0},
        ...     axes={"current_A": [2.6, 5.2]},
        ...     metrics=["final_soc"],
        ... )
        >>> sweeps.run(study)["final_soc"].round(2).values.tolist()
        [0.9, 0.8]
    """
    warn_of_odd_values(study)
    warn_of_idle(study)
    if not resume:
        refuse_what_cannot_be_kept(study, out)
    with _executor(engine, study) as executor:
        chunks = executor.chunks(memory, whole=out is None)
        sink = InMemory(study, chunks) if out is None else Store(study, chunks, out, resume)
        try:
            with counted(progress, study.title or "sweep", "lanes") as tell:
                return sink.finish(_fill(sink, executor, study, tell))
        finally:
            sink.close()


def _executor(engine: str, study: Study) -> contextlib.AbstractContextManager[Any]:
    """Return what runs the chunks: a `Runner`, or a cluster with the same methods."""
    if engine in ("local", "xla"):
        return contextlib.nullcontext(Runner(study, through_xla=engine == "xla"))
    if engine != "dask" and "://" not in engine:
        raise SweepError(
            f'engine: there is no engine "{engine}"; give "local", "xla", "dask", or an address such as '
            '"tcp://host:8786".'
        )
    try:
        from jaxmodel.sweeps.cluster import cluster
    except ImportError as error:
        raise SweepError(f"engine: {error.name} is not installed; install jaxmodel[cluster].") from error
    return cluster(engine, study)


def _fill(sink: InMemory | Store, executor: Any, study: Study, progress: Progress) -> dict[str, Any]:
    """Run and commit the pending chunks; return counts and times for the manifest."""
    began = time.perf_counter()
    pending = sum(sink.chunks.span(number)[1] for number in sink.pending)
    done = study.size - pending

    def count(lanes: int) -> None:
        nonlocal done
        done += lanes
        progress(done, study.size)

    count(0)
    if pending:
        executor.prepare(sink.chunks, sink.grid)
        if executor.remark:
            warnings.warn(executor.remark, RemarkWarning, stacklevel=3)
        sink.begin(executor.program)
    compiled = time.perf_counter()
    for number, outcome in executor.outcomes(sink.chunks, sink.pending, count) if pending else ():
        sink.commit(number, outcome)
    return {
        "lanes": study.size,
        "lanes_run": pending,
        "steps": executor.steps,
        "devices": executor.device_names,
        "compile_s": compiled - began,
        "run_s": time.perf_counter() - compiled,
    }
