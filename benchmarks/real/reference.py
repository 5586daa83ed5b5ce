"""The reference: fitted to the fit runs of a case by least squares, judged on all of them as the diagnosis is."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np

from benchmarks.real.reference_cell import CellReference
from benchmarks.real.reference_motor import MotorReference
from jaxmodel.case.records import Case


@dataclasses.dataclass(frozen=True)
class Reference:
    """What the reference says of a case.

    Attributes:
        errors: RMS over all readings of a split, by channel and then "fit" and "check", in the channel's unit.
        runs: the same by channel and then by run.
        chosen: the numbers that were searched, by name.
        seconds: from the case read to the last prediction.
    """

    errors: dict[str, dict[str, float]]
    runs: dict[str, dict[str, float]]
    chosen: dict[str, Any]
    seconds: float


def reference(case: Case) -> Reference:
    """Fit the reference to the fit runs of a case and return its errors.

    Raises:
        ValueError: the case is of a kind that the reference does not know.
    """
    began = time.perf_counter()
    if case.kind == "robot":
        raise ValueError("The reference knows cells and motors, not a robot.")
    model = CellReference(case) if case.kind == "cell" else MotorReference(case)
    missed: dict[str, dict[str, np.ndarray]] = {}
    for run in case.runs:
        for channel, said in model.predict(run).items():
            error = run.measured.outputs[channel] - said
            missed.setdefault(channel, {})[run.name] = error[np.isfinite(error)]
    errors = {
        channel: {
            split: _rms(np.concatenate([by_run[run.name] for run in case.runs if run.split == split] or [np.empty(0)]))
            for split in ("fit", "check")
        }
        for channel, by_run in missed.items()
    }
    runs = {channel: {name: _rms(error) for name, error in by_run.items()} for channel, by_run in missed.items()}
    return Reference(errors, runs, model.chosen, time.perf_counter() - began)


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2))) if errors.size else float("nan")
