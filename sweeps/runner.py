"""A study on the devices of this process."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import SweepError
from jaxmodel.lanes import CudaError, CudaKernel, Kernel, NotNative, Written
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.sweeps.by_cuda import ByCuda, is_cuda
from jaxmodel.sweeps.by_vectors import ByVectors
from jaxmodel.sweeps.by_xla import ByXla
from jaxmodel.sweeps.devices import lane_mesh
from jaxmodel.sweeps.lane import Keep, Outcome, lay_out
from jaxmodel.sweeps.lane_kernel import kernel_of_a_lane
from jaxmodel.sweeps.plan import ACCELERATOR, DEFAULT_MEMORY, Chunks, bytes_of, cut, lanes_per_chunk, size_text
from jaxmodel.sweeps.results import result_bytes_per_lane
from jaxmodel.sweeps.study import Study

_Kind = TypeVar("_Kind", bound=Written)

BY_VECTORS, BY_CUDA, BY_XLA = "vector instructions", "CUDA kernel", "XLA"


class Runner:
    """A study on its devices: as vector instructions of processors, as a CUDA kernel, or, where both fail, through XLA.

    Attributes:
        steps: of each lane.
        remark: why a study is run through XLA that was not meant to be, known once it is prepared; else "".
    """

    def __init__(self, study: Study, devices: Sequence[Any] | None = None, through_xla: bool = False) -> None:
        self._study = study
        self._mesh = lane_mesh(devices)
        device = self._mesh.devices.flat[0]
        self._on_processor = device.platform == "cpu"
        self._through_xla = through_xla or not (self._on_processor or is_cuda(device))
        self._program: ByVectors | ByCuda | ByXla | None = None
        self.remark = ""
        prepared = study.prepared
        stepped = lay_out(_stiffest(study), prepared.profile, prepared.stored_rows)
        self.steps = int(stepped.duration_s.size)
        self._keep = Keep(prepared.metrics, tuple(study.store))
        self.shared = (prepared.model, stepped, prepared.cutoff)

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
        return result_bytes_per_lane(self._study)

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
        times = 1 if self._on_processor else ACCELERATOR
        most = lanes_per_chunk(lanes, self.steps, self.bytes_per_lane, allowed, least, times)
        return cut(self._study.shape, most)

    def prepare(self, chunks: Chunks, grid: Any = None) -> None:
        """Compile what runs the chunks, and put on the devices what all lanes share; the caller writes the results.

        Raises:
            SweepError: the lanes cannot be computed in float32.
        """
        if not self.as_kernel():
            shared = jax.tree.map(jnp.asarray, self.shared)
            self._program = ByXla(self._keep, shared, self._study.lanes, self._mesh, self.steps, chunks.lanes)

    def as_kernel(self) -> bool:
        """Compile the lanes as a kernel of ours, and return whether that is possible and wanted.

        Raises:
            SweepError: it is not, and the lanes are to be computed in float32.
        """
        single = self._study.precision == "float32"
        if self._through_xla:
            if single:
                raise SweepError(
                    'precision: "float32" needs the vector instructions of a processor or a GPU of NVIDIA; through XLA '
                    'a sweep computes in "float64".'
                )
            return False
        values = jax.tree.map(np.asarray, self.shared)
        run_by = (values, self._study.lanes, tuple(self._mesh.devices.flat), self.steps)
        try:
            if self._on_processor:
                self._program = ByVectors(self._kernel(Kernel, values, single), *run_by)
            else:
                self._program = ByCuda(self._kernel(CudaKernel, values, single), *run_by)
            return True
        except NotNative as reason:
            why = f"{reason} has no vector instructions yet"
        except CudaError as reason:
            why = f"the GPU takes no kernel ({reason})"
        if single:
            raise SweepError(f'precision: {why}, which "float32" needs; give "float64".')
        self._through_xla = True
        self.remark = f"The sweep runs through XLA: {why}."
        return False

    def _kernel(self, kind: type[_Kind], shared: Any, single: bool) -> _Kind:
        return kernel_of_a_lane(kind, self._keep, shared, self._study.lanes, single)

    @property
    def program(self) -> str:
        """What computes the lanes, as a manifest says it; known once they are prepared."""
        if self._through_xla:
            return BY_XLA
        return BY_VECTORS if self._on_processor else BY_CUDA

    def outcomes(
        self, chunks: Chunks, numbers: Iterable[int], done: Callable[[int], None] = lambda lanes: None
    ) -> Iterator[tuple[int, Outcome]]:
        """Run chunks and yield each with its number; `done` is called with lanes as they are done."""
        assert self._program is not None
        return self._program.outcomes(((number, *chunks.span(number)) for number in numbers), done)

    def call(self, chunks: Chunks) -> int:
        """Run the first call of the first chunk, keep nothing of it, and return its number of lanes."""
        assert self._program is not None
        return self._program.call(*chunks.span(0))


def _stiffest(study: Study) -> Model:
    """Return a model with the extreme time constants of all lanes: steps for it serve them all.

    The least L_a / R_0 is needed, and R_0 J / k_tau^2 of the fastest and of the slowest motor, in this order.
    """
    ends = {"L_a": (min, min), "R_0": (min, max), "J": (min, max), "k_tau": (max, min)}
    varied = {name: [pick(study.range_of(name)) for pick in ends[name]] for name in ends if name in study.varied}
    return with_values(study.prepared.model, {name: jnp.asarray(values) for name, values in varied.items()})
