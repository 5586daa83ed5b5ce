"""All pictures of a diagnosis: ladder, residuals, curves, errors, candidates, scores, runs and their pulses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from jaxmodel.case.records import Case
from jaxmodel.case.simulation import CaseSimulation
from jaxmodel.diagnosis.residuals.pulses import pulses
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.diagnosis.wording import final_in_short
from jaxmodel.plots import evidence, runs
from jaxmodel.plots.errors import errors_by_run
from jaxmodel.plots.pulses import pulse_by_pulse

# Rows of all runs that are drawn over the conditions; more dots cannot be distinguished.
_MOST_DOTS = 50_000
# Pictures of pulses in a report.
_MOST_OF_PULSES = 8
_CONDITIONS = {
    "cell": ("soc", "current_A", "cell_temperature_degC"),
    "motor": ("current_A", "speed_rad_s", "winding_temperature_degC"),
    "robot": ("soc", "pack_current_A", "speed_rad_s", "winding_temperature_degC"),
}


def pictures_of(diagnosis: Diagnosis) -> dict[str, Figure]:
    """Return every picture that a diagnosis has data for, by name."""
    pictures = {"ladder": evidence.ladder(diagnosis), "residuals-by-condition": residuals_by_condition(diagnosis)}
    if diagnosis.curves:
        pictures["curves"] = evidence.curves(diagnosis.curves)
    if diagnosis.errors is not None and len(diagnosis.errors):
        pictures["errors-by-run"] = errors_of(diagnosis)
    if diagnosis.candidates:
        pictures["candidates"] = evidence.candidates(diagnosis)
    if diagnosis.scores:
        pictures["scores"] = evidence.scores(diagnosis)
    for name, channel in pulses_drawn(diagnosis):
        pictures[pulses_name(name, channel)] = pulses_of(diagnosis, name, channel)
    for run in diagnosis.case.runs:
        if runs.channels_read(run, diagnosis.noise):
            pictures[f"run-{run.name}"] = run_of(diagnosis, run.name)
    return pictures


def pulses_name(run: str, channel: str) -> str:
    """Return the name of the picture of a run's pulses."""
    return f"pulses-{run}-{channel}"


def pulses_drawn(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return the runs with pulses or steps, and the channels that follow them at once; the worst where there are many.

    A temperature follows too slowly to be seen in a pulse.
    """
    found = [
        (run.name, channel)
        for run in diagnosis.case.runs
        if pulses(run)
        for channel in runs.channels_read(run, diagnosis.noise)
        if not channel.endswith("degC") and channel != "soc" and run.name in diagnosis.final.predictions
    ]

    def size(one: tuple[str, str]) -> float:
        error = diagnosis.final.by_run.get(one[1], {}).get(one[0])
        return 0.0 if error is None else error.rms / max(diagnosis.noise[one[1]].sd, 1e-300)

    worst = sorted(found, key=size, reverse=True)[:_MOST_OF_PULSES]
    return [one for one in found if one in worst]


def pulses_of(diagnosis: Diagnosis, name: str, channel: str | None = None) -> Figure:
    """Draw the pulses or steps of one run, of its first channel that follows them by default."""
    run = next(run for run in diagnosis.case.runs if run.name == name)
    if channel is None:
        read = runs.channels_read(run, diagnosis.noise)
        channel = next((one for one in read if not one.endswith("degC")), next(iter(diagnosis.noise)))
    predicted = {model: predictions[name] for model, predictions in _models(diagnosis).items()}
    return pulse_by_pulse(run, predicted, channel, diagnosis.noise[channel].sd)


def errors_of(diagnosis: Diagnosis) -> Figure:
    """Draw each channel's error in each run, before and after, against noise and stated tolerance."""
    assumed = tuple(channel for channel, one in diagnosis.tolerance.items() if one.assumed)
    return errors_by_run(diagnosis.errors, assumed)


def run_of(diagnosis: Diagnosis, name: str) -> Figure:
    """Draw measurement, models and residuals of one run."""
    place = [run.name for run in diagnosis.case.runs].index(name)
    predicted = {model: predictions[name] for model, predictions in _models(diagnosis).items()}
    noise_sd = {channel: noise.sd for channel, noise in diagnosis.noise.items()}
    valid = diagnosis.simulation[place].table["valid"].to_numpy(dtype=bool)
    return runs.fit_and_residuals(diagnosis.case.runs[place], predicted, noise_sd, valid)


def residuals_by_condition(diagnosis: Diagnosis) -> Figure:
    """Draw the residuals of the base model and of the final one over the conditions that matter for the kind."""
    residuals = {model: _residuals(diagnosis, predictions) for model, predictions in _models(diagnosis).items()}
    noise_sd = {channel: noise.sd for channel, noise in diagnosis.noise.items()}
    return runs.residuals_by_condition(residuals, _conditions(diagnosis.simulation), noise_sd)


def _models(diagnosis: Diagnosis) -> Mapping[str, Mapping[str, Mapping[str, np.ndarray]]]:
    models = {"calibrated base model": diagnosis.base.predictions}
    if diagnosis.final is not diagnosis.base:
        models[final_in_short(diagnosis)] = diagnosis.final.predictions
    return models


def _residuals(diagnosis: Diagnosis, predictions: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return measured minus predicted of every channel, run after run; NaN without a reading."""
    every = _drawn(diagnosis.case)
    return {
        channel: np.concatenate(
            [
                run.measured.outputs.get(channel, np.full(run.measured.time_s.size, np.nan))[every]
                - predictions[run.name][channel][every]
                for run in diagnosis.case.runs
            ]
        )
        for channel in diagnosis.noise
    }


def _conditions(simulation: CaseSimulation) -> dict[str, np.ndarray]:
    """Return the conditions that matter for a kind, run after run: inputs as measured, the rest as modelled."""
    every = _drawn(simulation.case)
    return {
        name: np.concatenate(
            [
                (one.run.measured.inputs[name] if name in one.run.measured.inputs else one.table[name].to_numpy())[
                    every
                ]
                for one in simulation
            ]
        )
        for name in _CONDITIONS[simulation.case.kind]
    }


def _drawn(case: Case) -> slice:
    """Return which rows of every run are drawn over conditions: every k-th of a long case."""
    return slice(None, None, -(-sum(run.measured.time_s.size for run in case.runs) // _MOST_DOTS))
