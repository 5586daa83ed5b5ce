"""The work that all contestants do: a grid of cells at constant current, or of robots at constant duty."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxmodel.lanes import Kernel
from jaxmodel.sweeps import Study
from jaxmodel.sweeps.by_vectors import ByVectors
from jaxmodel.sweeps.runner import Runner

DURATION_S = 1800
AMBIENT_DEGC = 20.0
DUTY = 0.3
METRICS = {"cell": ("final_soc", "min_voltage_V"), "robot": ("final_soc", "min_pack_voltage_V")}
_LOADS = {"cell": ("current_A", 0.5, 5.0), "robot": ("load_torque_Nm", 0.05, 0.3)}
_INPUTS: dict[str, dict[str, float]] = {"cell": {}, "robot": {"duty": DUTY}}
_LOADS_AT_ONCE = 64


def study_of(kind: str, lanes: int, step_s: float = 1.0, **more: Any) -> Study:
    """Return a sweep over load and cycles: 1,800 s, all states advanced, the final SOC and least voltage kept."""
    load, low, high = _LOADS[kind]
    return Study(
        kind=kind,
        profile={"duration_s": DURATION_S, "step_s": step_s, "ambient_degC": AMBIENT_DEGC, **_INPUTS[kind]},
        axes={
            load: np.linspace(low, high, min(lanes, _LOADS_AT_ONCE)),
            "cycles": np.linspace(0.0, 400.0, max(1, lanes // _LOADS_AT_ONCE)),
        },
        metrics=list(METRICS[kind]),
        cutoff={},  # every lane takes every step
        **more,
    )


class Ours:
    """The sweep engine on a study, compiled; on the first so many devices, all if not said, or on the processor."""

    def __init__(
        self, study: Study, devices: int | None = None, through_xla: bool = False, processor: bool = False
    ) -> None:
        self.study = study
        self._runner = Runner(study, jax.devices("cpu" if processor else None)[:devices], through_xla)
        self._chunks = self._runner.chunks(None, whole=True)
        self._runner.prepare(self._chunks)
        self.steps = self._runner.steps
        self.course: Any = self._runner.shared[1]

    @property
    def kernel(self) -> Kernel:
        """The kernel of vector instructions that runs it."""
        program = self._runner._program
        assert isinstance(program, ByVectors)
        return program._kernel

    def __call__(self) -> dict[str, np.ndarray]:
        """Run all chunks and return each metric over the lanes."""
        return self._gathered("values")

    def stored(self) -> dict[str, np.ndarray]:
        """Run all chunks and return each stored column, shape (lanes, rows)."""
        return self._gathered("columns")

    def _gathered(self, what: str) -> dict[str, np.ndarray]:
        parts = [getattr(o, what) for _, o in self._runner.outcomes(self._chunks, range(len(self._chunks)))]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
