"""Conditions under which each reading was taken: inputs, states of the model, time since the load changed, age."""

from __future__ import annotations

import numpy as np

from discrepancy.contract import without_input_noise
from discrepancy.hypothesis import Hypothesis
from discrepancy.lanes import predict
from discrepancy.session import Session
from jaxmodel.cases import Case

# A step of an input by this share of its range in the run is a change of load.
_CHANGE = 0.1


def conditions(session: Session, hypothesis: Hypothesis) -> dict[str, np.ndarray]:
    """Return, for every fit reading, the inputs and the model's states at its row: (n,) arrays by name."""
    problem = hypothesis.problem
    index = np.asarray(problem.readings.index)[np.asarray(problem.readings.fit) > 0.0]
    runs, rows, _ = np.unravel_index(index, (*problem.times.shape, len(problem.channels)))
    return {name: values[runs, rows] for name, values in conditions_of_rows(session, hypothesis).items()}


def conditions_of_rows(session: Session, hypothesis: Hypothesis, *, currents: bool = False) -> dict[str, np.ndarray]:
    """Return the inputs, the run's age and the model's states at every row of every run: (runs, rows) arrays by name.

    With the `currents` that the model draws where something else drives it, if asked for. They say where a model fails;
    no law is sought in them, for a motor's current at speed is its torque once more.
    """
    problem = hypothesis.problem
    predicted = predict(problem, hypothesis.fitted.x)
    found: dict[str, np.ndarray] = {}
    measured = [run.measured for run in without_input_noise(session.case, session.noise).runs]
    for name in measured[0].inputs:
        padded = np.zeros(problem.times.shape)
        for number, one in enumerate(measured):
            if name in one.inputs:
                padded[number, : one.time_s.size] = one.inputs[name]
        found[name] = padded
    for place, name in enumerate(problem.channels):
        is_state = name.split("_")[0] in ("soc", "speed", "cell", "winding", "case", "motor")
        if name not in found and (is_state or (currents and name.endswith("current_A"))):
            found[name] = predicted[:, :, place]
    found["cycles"] = np.broadcast_to(np.asarray(problem.models.parameters.cycles)[:, None], problem.times.shape)
    times = np.asarray(problem.times)
    found["time_s"] = times - times[:, :1]  # a logger's clock may start anywhere
    found["run"] = np.broadcast_to(np.arange(len(measured), dtype=float)[:, None], problem.times.shape)
    return found


def since_load_changed(case: Case, shape: tuple[int, ...]) -> np.ndarray:
    """Return the time since the load last changed at every row of every run, in s: (runs, rows)."""
    since = np.zeros(shape)
    for number, run in enumerate(case.runs):
        time_s = run.measured.time_s
        changed = np.zeros(time_s.size, dtype=bool)
        changed[0] = True
        for name, values in run.measured.inputs.items():
            if not name.endswith("degC"):
                changed |= np.abs(np.diff(values, prepend=values[0])) > _CHANGE * max(np.ptp(values), 1e-12)
        last = np.maximum.accumulate(np.where(changed, np.arange(time_s.size), 0))
        since[number, : time_s.size] = time_s - time_s[last]
    return since
