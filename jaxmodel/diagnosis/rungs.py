"""The models of an investigation as rungs of a ladder: parameters, predictions and errors, by run and channel."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from jaxmodel.base.units import unit_of
from jaxmodel.case.records import Run
from jaxmodel.diagnosis.evidence.trial import Trial
from jaxmodel.diagnosis.fitting.fit import fit
from jaxmodel.diagnosis.fitting.model import View
from jaxmodel.diagnosis.fitting.readings import Weights, collect
from jaxmodel.diagnosis.noise.model_error import NONE
from jaxmodel.diagnosis.preparation.thinning import start_rows
from jaxmodel.diagnosis.residuals.conditions import time_since_load_changed
from jaxmodel.diagnosis.residuals.table import ChannelResiduals
from jaxmodel.diagnosis.result import ChannelError, Estimate, RunError, Rung
from jaxmodel.diagnosis.settings import Settings
from jaxmodel.diagnosis.workings import Workings
from jaxmodel.model.declaration import describe
from jaxmodel.model.names import parameter_table

# Readings of a run that are used for the statements on where a model fails.
_MOST_OF_A_RUN = 2000
# Initial states that may be adjusted on the first readings of a check run.
_STARTS = ("initial_soc", "initial_temperature_rise_K", "initial_hysteresis")


@dataclasses.dataclass(frozen=True)
class AdjustedStarts:
    """A model with the starts of check runs adjusted on their first readings.

    Attributes:
        x: (unknowns,) coordinates.
        pulls: by run, the largest adjustment of an initial state in sd, before it was limited.
    """

    x: np.ndarray
    pulls: dict[str, float]


def with_adjusted_starts(inv: Workings, trial: Trial) -> AdjustedStarts:
    """Return a model with the initial states of check runs adjusted on their first readings, within a few stated sd.

    These first readings are left out of the errors.
    """
    layout, settings = inv.space.layout, inv.settings
    checks = [number for number, run in enumerate(inv.case.runs) if run.split == "check"]
    own = [p for p in range(layout.base) if layout.runs[p] in checks and layout.coordinates[p].name in _STARTS]
    if not own:
        return AdjustedStarts(trial.fitted.x, {})
    fitted = inv.space.fitted
    rows = {number: start_rows(inv.case.runs[number], settings) for number in checks}
    channels = inv.space.coarse.channels
    readings = collect(fitted, trial.scale.noise, channels, checks, None, settings, rows)
    if not readings.count:
        return AdjustedStarts(trial.fitted.x, {})
    view = View(inv.space, readings)
    x = fit(view, trial.setting, Weights(readings, NONE), trial.fitted.x, free=own).x
    pulls = {
        inv.case.runs[number].name: float(
            max(abs(layout.coordinates[p].off(x[p])) for p in own if layout.runs[p] == number)
        )
        for number in checks
        if any(layout.runs[p] == number for p in own)
    }
    x[own] = np.clip(x[own], -settings.start_reach, settings.start_reach)
    return AdjustedStarts(x, pulls)


def nominal(inv: Workings) -> Rung:
    """Return the base model with its stated parameters; without predictions."""
    base = inv.base
    by_run = _by_run(inv, inv.space.predicted(base.setting, np.zeros_like(base.fitted.x)))
    errors = {name: _error(inv, one, one) for name, one in by_run.items()}
    return Rung("nominal", (), {}, (), errors, {}, float("nan"), base.fitted.rows.size, by_run)


def rung(
    inv: Workings, name: str, trial: Trial, adjusted: AdjustedStarts | None = None, *, compared: bool = False
) -> Rung:
    """Return one model of the ladder, with its errors on fit runs and on check runs.

    Args:
        inv: the investigation.
        name: in the ladder.
        trial: the model.
        adjusted: with the starts of check runs adjusted, if known.
        compared: it is only compared with others: its predictions are not kept.
    """
    adjusted = adjusted or with_adjusted_starts(inv, trial)
    predictions = inv.space.predicted(trial.setting, adjusted.x)
    by_run = as_stated = _by_run(inv, predictions)
    if np.any(adjusted.x != trial.fitted.x):
        checks = [number for number, run in enumerate(inv.case.runs) if run.split == "check"]
        as_stated = _by_run(inv, inv.space.predicted(trial.setting, trial.fitted.x, checks))
    estimates, far = estimates_of(inv, trial)
    return Rung(
        name=name,
        added=trial.labels,
        estimates=estimates,
        at_bound=far,
        errors={channel: _error(inv, by_run[channel], as_stated[channel]) for channel in inv.noise},
        predictions={} if compared else predictions,
        chi2=trial.fitted.chi2,
        readings=trial.fitted.rows.size,
        by_run=by_run,
    )


def _by_run(inv: Workings, predictions: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, dict[str, RunError]]:
    """Return the errors by channel and run, over all readings but those that adjust the start of a check run."""
    found: dict[str, dict[str, RunError]] = {}
    for channel in inv.noise:
        found[channel] = {}
        for number, run in enumerate(inv.case.runs):
            if run.name not in predictions or channel not in run.measured.outputs:
                continue
            rows, steepness = judged_rows(run, inv.settings), inv.space.steepness_of_all.get((channel, number))
            errors = run.measured.outputs[channel][rows] - predictions[run.name][channel][rows]
            error = RunError.of(errors, 1.0 if steepness is None else steepness[rows])
            if error is not None:
                found[channel][run.name] = error
    return found


def judged_rows(run: Run, settings: Settings) -> slice:
    """Return the rows of a run on which a model is judged: all but those that adjust the start of a check run."""
    return slice(start_rows(run, settings).stop if run.split == "check" else 0, None)


def _error(inv: Workings, by_run: Mapping[str, RunError], as_stated: Mapping[str, RunError]) -> ChannelError:
    """Return the error of a channel, of all readings of its fit runs and check runs."""

    def of(split: str, errors: Mapping[str, RunError]) -> list[RunError]:
        return [errors[run.name] for run in inv.case.runs if run.split == split and run.name in errors]

    def rms(errors: Sequence[RunError], which: str = "rms") -> float:
        count = sum(one.readings for one in errors)
        squares = sum(one.readings * getattr(one, which) ** 2 for one in errors)
        return float(np.sqrt(squares / count)) if count else float("nan")

    fitted, held_out = of("fit", by_run), of("check", by_run)
    return ChannelError(
        fit=rms(fitted),
        check=rms(held_out),
        stated=rms(of("check", as_stated)),
        worst=max((one.worst for one in held_out), default=float("nan")),
        level_fit=rms(fitted, "level"),
        level_check=rms(held_out, "level"),
    )


def estimates_of(inv: Workings, trial: Trial) -> tuple[dict[str, Estimate], tuple[str, ...]]:
    """Return a model's calibrated parameters by name, and the names of those far from their stated values."""
    units = {name: info.unit for name, info in parameter_table(inv.space.coarse.models).items()}
    for candidate in inv.space.candidates.values():
        label = candidate.effect.label
        units |= {f"{label}.{name}": info.unit for name, info in describe(candidate.effect).items()}
    layout, fitted = inv.space.layout, trial.fitted
    estimates, far = {}, []
    knots = {place for _, first, last, _ in layout.vectors for place in range(first, last)}
    for place, sd, pull in zip(trial.setting.free, trial.sd, fitted.pulls, strict=True):
        coordinate, run = layout.coordinates[place], layout.runs[place]
        if place in knots:
            continue
        is_undetermined = coordinate.name in _STARTS[1:] and sd > 0.98 and abs(pull) < 0.05
        if is_undetermined:  # an initial state that affects no reading
            continue
        name = coordinate.name + (f"[{inv.case.runs[run].name}]" if run >= 0 else "")
        x = fitted.x[place]
        estimates[name] = Estimate(coordinate.number(x), coordinate.slope(x) * sd, units.get(coordinate.name, ""))
        if abs(pull) > inv.settings.strained:
            far.append(name)
    return estimates, tuple(far)


def residuals_of(inv: Workings, one: Rung) -> list[ChannelResiduals]:
    """Return the residuals of every channel, thinned, with the conditions of each reading."""
    found = []
    names = tuple(run.name for run in inv.case.runs)
    since_load_changed = [time_since_load_changed(run) for run in inv.case.runs]
    for channel in inv.noise:
        parts: dict[str, list[np.ndarray]] = {}
        for number, run in enumerate(inv.case.runs):
            values = run.measured.outputs.get(channel)
            if values is None:
                continue
            first = judged_rows(run, inv.settings).start
            there = first + np.flatnonzero(np.isfinite(values[first:]))
            if there.size < 2:
                continue
            kept = there[:: max(1, -(-there.size // _MOST_OF_A_RUN))]
            time_s = run.measured.time_s[kept] - run.measured.time_s[0]
            given = {n: v[kept] for n, v in run.measured.inputs.items()}
            predicted = one.predictions[run.name]
            given |= {
                n: predicted[n][kept]
                for n in predicted
                if n not in given and n != channel and n.split("_")[0] in _CONDITIONS
            }
            cycles = run.overrides.get("cycles", inv.case.parameters.get("cycles"))
            if cycles is not None:
                given["cycles"] = np.full(kept.size, cycles.value)
            given["time_since_load_changed_s"] = since_load_changed[number][kept]
            columns = {
                "run": np.full(kept.size, number),
                "time_s": time_s,
                "weight_s": np.maximum(np.gradient(time_s), 1e-9) if kept.size > 1 else np.ones(1),
                "error": values[kept] - predicted[channel][kept],
            } | {f"condition {n}": v for n, v in given.items()}
            for name, column in columns.items():
                parts.setdefault(name, []).append(column)
        if "error" not in parts:
            continue
        count = len(parts["error"])
        together = {n: np.concatenate(p) for n, p in parts.items() if len(p) == count}
        tolerance = inv.case.tolerance.get(channel)
        found.append(
            ChannelResiduals(
                channel=channel,
                unit="K" if unit_of(channel) == "degC" else unit_of(channel),
                noise_sd=inv.noise[channel].sd,
                tolerance=None if tolerance is None else tolerance.rms,
                run=together["run"],
                run_names=names,
                time_s=together["time_s"],
                weight_s=together["weight_s"],
                error=together["error"],
                conditions={n.removeprefix("condition "): v for n, v in together.items() if n.startswith("condition ")},
            )
        )
    return found


_CONDITIONS = ("soc", "speed", "cell", "winding", "case", "current", "motor", "pack")


def errors_by_run(inv: Workings, models: Mapping[str, Rung]) -> pd.DataFrame:
    """Return a row for each channel of each run and model, over all readings, in the channel's unit.

    Columns: model, run, split, channel, unit, readings; rms, mean and max (the largest size) of the errors; noise_sd,
    rms_over_noise, tolerance; within_tolerance, None where no tolerance is stated.
    """
    rows = []
    for model, one in models.items():
        for channel, noise in inv.noise.items():
            tolerance = inv.case.tolerance.get(channel)
            for run in inv.case.runs:
                error = one.by_run[channel].get(run.name)
                if error is None:
                    continue
                rows.append(
                    {
                        "model": model,
                        "run": run.name,
                        "split": run.split,
                        "channel": channel,
                        "unit": "K" if unit_of(channel) == "degC" else unit_of(channel),
                        "readings": error.readings,
                        "rms": error.rms,
                        "mean": error.mean,
                        "max": error.worst,
                        "noise_sd": noise.sd,
                        "rms_over_noise": error.rms / noise.sd,
                        "tolerance": float("nan") if tolerance is None else tolerance.rms,
                        "within_tolerance": None if tolerance is None else error.rms <= tolerance.rms,
                    }
                )
    return pd.DataFrame(rows)
