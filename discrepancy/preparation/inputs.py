"""A case as a session takes it: every run driven by the same inputs."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.case import Case
from jaxmodel.errors import FitError
from jaxmodel.measurements import KINDS
from jaxmodel.robot import duty_of_signal


def with_like_inputs(case: Case) -> Case:
    """Return a case whose runs have the same inputs: a set voltage becomes a duty (eq. 22), missing optional inputs 0.

    Raises:
        FitError: two runs have different inputs.
    """
    case = _with_duty(case)
    optional = KINDS[case.kind].optional_inputs
    zeros = [name for name in optional if any(name in run.measured.inputs for run in case.runs)]
    runs = []
    for run in case.runs:
        inputs = {name: np.zeros(run.measured.time_s.size) for name in zeros} | run.measured.inputs
        runs.append(run.driven_by(inputs))
    first = runs[0]
    for run in runs[1:]:
        if other := sorted(first.measured.inputs.keys() ^ run.measured.inputs.keys()):
            raise FitError(
                f"{case.label}: {first.file} and {run.file} have different inputs ("
                f"{', '.join(other)}); put runs with the same inputs into a case of their own."
            )
    return dataclasses.replace(case, runs=tuple(runs))


def _with_duty(case: Case) -> Case:
    """Return a robot's case with the operator's signal and its noise converted to duties (eq. 22)."""
    runs = []
    for run in case.runs:
        inputs = dict(run.measured.inputs)
        if "V_set" in inputs:
            inputs["duty"] = duty_of_signal(inputs.pop("V_set"))
        runs.append(run.driven_by(inputs))
    sensors = dict(case.sensors)
    if "V_set" in sensors:
        sd = sensors.pop("V_set") * (duty_of_signal(1.0) - duty_of_signal(0.0))
        sensors = {"duty": sd} | sensors
    return dataclasses.replace(case, runs=tuple(runs), sensors=sensors)
