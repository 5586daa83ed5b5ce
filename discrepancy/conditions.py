"""Conditions under which each reading was taken, and the sentences that say under which of them a model fails."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from discrepancy.calibrate import predict
from discrepancy.contract import of_neighbours
from discrepancy.problem import Lane
from discrepancy.session import Hypothesis, Session
from discrepancy.where import Regressor, worst_region

_UNITS = {"A": "A", "V": "V", "Nm": "Nm", "degC": "degC", "s": "s"}


def conditions(session: Session, hypothesis: Hypothesis) -> dict[str, np.ndarray]:
    """Return, for every fit reading, the inputs and the model's states at its row: (n,) arrays by name."""
    problem = hypothesis.problem
    index = np.asarray(problem.readings.index)[np.asarray(problem.readings.fit) > 0.0]
    runs, rows, _ = np.unravel_index(index, (*problem.times.shape, len(problem.channels)))
    return {name: values[runs, rows] for name, values in conditions_of_rows(session, hypothesis).items()}


def conditions_of_rows(session: Session, hypothesis: Hypothesis) -> dict[str, np.ndarray]:
    """Return the inputs and the model's states at every row of every run: (runs, rows) arrays by name."""
    problem = hypothesis.problem
    predicted = predict(problem, hypothesis.fitted.x)
    found: dict[str, np.ndarray] = {}
    measured = [run.measured for run in session.case.runs]
    for name in measured[0].inputs:
        padded = np.zeros(problem.times.shape)
        for number, one in enumerate(measured):
            if name in one.inputs:
                values = one.inputs[name]
                if name in session.case.sensors:
                    values = of_neighbours(values, session.case.sensors[name])
                padded[number, : one.time_s.size] = values
        found[name] = padded
    for place, name in enumerate(problem.channels):
        if name not in found and name.split("_")[0] in ("soc", "speed", "cell", "winding", "case", "motor"):
            found[name] = predicted[:, :, place]
    found["time_s"] = np.asarray(problem.times)
    found["run"] = np.broadcast_to(np.arange(len(measured), dtype=float)[:, None], problem.times.shape)
    return found


def failing_sentences(session: Session, hypothesis: Hypothesis) -> tuple[str, ...]:
    """Return, for each channel that fails, the sentence that says where most of its excess error is."""
    problem = hypothesis.problem
    counted = np.asarray(problem.readings.fit) > 0.0
    lane = Lane(jnp.asarray(hypothesis.fitted.x), jnp.zeros(len(problem.switched)))
    whitened = np.asarray(problem.residual(lane))[counted]
    channel = np.asarray(problem.readings.index)[counted] % len(problem.channels)
    given = conditions(session, hypothesis)
    sentences = []
    for place, name in enumerate(problem.channels):
        mine = channel == place
        if not mine.any():
            continue
        regressors = [
            Regressor(condition, _unit(condition), values[mine])
            for condition, values in given.items()
            if condition not in (name, "run") and np.ptp(values[mine]) > 1e-6
        ]
        region = worst_region(whitened[mine], regressors)
        if region is not None:
            sentences.append(f"{name}: {region.sentence()}")
    return tuple(sentences)


def _unit(name: str) -> str:
    return _UNITS.get(name.rpartition("_")[2], "")
