"""The cost of a sweep in lanes, chunks, memory, disk and time, from one call that is run and timed."""

from __future__ import annotations

import dataclasses
import time

from jaxmodel.base.in_short import InShort
from jaxmodel.sweeps.idle import warn_of_idle
from jaxmodel.sweeps.plan import COPIES
from jaxmodel.sweeps.plausible import warn_of_odd_values
from jaxmodel.sweeps.runner import Runner
from jaxmodel.sweeps.study import Study


@dataclasses.dataclass(frozen=True)
class Forecast(InShort):
    """The cost of a sweep on this machine.

    Attributes:
        lanes: of the sweep.
        steps: of each lane.
        chunks: committed one by one.
        lanes_per_chunk: of a whole one.
        memory_bytes: of the chunks in progress, beside the program itself.
        disk_bytes: of the results, uncompressed.
        devices: on which it was measured.
        compile_s: before the first lane.
        lanes_per_s: measured.

    Example:
        >>> from jaxmodel import sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> plan = sweeps.forecast(study)
        >>> plan.lanes, plan.disk_bytes > 0
        (2, True)
    """

    lanes: int
    steps: int
    chunks: int
    lanes_per_chunk: int
    memory_bytes: int
    disk_bytes: int
    devices: str
    compile_s: float
    lanes_per_s: float

    @property
    def run_s(self) -> float:
        """How long all lanes will take."""
        return self.lanes / self.lanes_per_s


def forecast(study: Study, memory: float | int | str | None = None) -> Forecast:
    """Return the cost of a sweep, after running some of its lanes; their results are not kept.

    Args:
        study: what would be run.
        memory: as `jaxmodel.sweeps.run` takes it.

    Raises:
        SweepError: the memory does not suffice.

    Warns:
        RemarkWarning: no result can depend on an axis; or a number looks like one in another unit.

    Example:
        >>> from jaxmodel import sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> plan = sweeps.forecast(study)
        >>> plan.lanes, plan.steps
        (2, 10)
    """
    warn_of_odd_values(study)
    warn_of_idle(study)
    began = time.perf_counter()
    runner = Runner(study)
    chunks = runner.chunks(memory, whole=False)
    runner.prepare(chunks)
    compiled = time.perf_counter()
    runner.call(chunks)  # the first call also wakes the devices
    started = time.perf_counter()
    lanes = runner.call(chunks)
    ended = time.perf_counter()
    return Forecast(
        lanes=study.size,
        steps=runner.steps,
        chunks=len(chunks),
        lanes_per_chunk=chunks.lanes,
        memory_bytes=COPIES * chunks.lanes * runner.bytes_per_lane,
        disk_bytes=study.size * runner.result_bytes_per_lane,
        devices=runner.device_names,
        compile_s=compiled - began,
        lanes_per_s=lanes / (ended - started),
    )
