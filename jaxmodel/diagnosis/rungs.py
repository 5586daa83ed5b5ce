"""The models of an investigation as rungs of a ladder: parameters, predictions and errors, by run and channel."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from jaxmodel.base.units import unit_of
from jaxmodel.case.records import Run
from jaxmodel.case.signals import represented_s
from jaxmodel.diagnosis.residuals.conditions import time_since_load_changed
from jaxmodel.diagnosis.residuals.table import ChannelResiduals
from jaxmodel.diagnosis.result import ChannelError, RunError, Rung
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.data import collect
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.estimates import estimates_of
from jaxmodel.fit.gauss_newton import descend
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.preparation.thinning import start_rows
from jaxmodel.fit.settings import Settings
from jaxmodel.fit.space import View

# Readings of a run that are used for the statements on where a model fails.
_MOST_OF_A_RUN = 2000
# Initial states that may be adjusted on the first readings of a check run.
_STARTS = ("initial_soc", "initial_temperature_rise_K", "initial_hysteresis")
_STEPS = 10


@dataclasses.dataclass(frozen=True)
class AdjustedStarts:
    """A model with the starts of check runs adjusted on their first readings.

    Attributes:
        x: (unknowns,) coordinates.
        pulls: by run, the largest adjustment of an initial state in sd, before it was limited.
    """

    x: np.ndarray
    pulls: dict[str, float]


def with_adjusted_starts(cache: FitCache, fit: Fit) -> AdjustedStarts:
    """Return a model with the initial states of check runs adjusted on their first readings, within a few stated sd.

    These first readings are left out of the errors.
    """
    layout, settings = cache.space.layout, cache.settings
    checks = [number for number, run in enumerate(cache.case.runs) if run.split == "check"]
    own = [p for p in range(layout.base) if layout.runs[p] in checks and layout.coordinates[p].name in _STARTS]
    if not own:
        return AdjustedStarts(fit.x, {})
    rows = {number: start_rows(cache.case.runs[number], settings) for number in checks}
    data = collect(cache.space.fitted, cache.noise, cache.space.coarse.channels, checks, settings, rows)
    if not data.count:
        return AdjustedStarts(fit.x, {})
    view = View(cache.space, data)
    # What the model is off in the fitted runs it is off here too, and that is no fault of the start. It lasts longer
    # than these readings, which together count as one.
    count = max(rows.stop - rows.start for slices in data.by_channel.values() for rows in slices)
    weights = Likelihood(
        {name: ChannelWeight(one.sd, float(count), 1) for name, one in fit.likelihood.channels.items()}
    )
    spec = dataclasses.replace(fit.spec, free=tuple(own), precision=np.ones(len(own)))
    x = descend(view, spec, weights, fit.x, steps=_STEPS).x
    pulls = {
        cache.case.runs[number].name: float(
            max(abs(layout.coordinates[p].off(x[p])) for p in own if layout.runs[p] == number)
        )
        for number in checks
        if any(layout.runs[p] == number for p in own)
    }
    x[own] = np.clip(x[own], -settings.start_reach, settings.start_reach)
    return AdjustedStarts(x, pulls)


def nominal(cache: FitCache) -> Rung:
    """Return the base model with its stated parameters."""
    spec = cache.space.spec(())
    predictions = cache.space.predicted(spec, np.zeros(cache.space.layout.size))
    by_run = _by_run(cache, predictions)
    errors = {name: _error(cache, one, one) for name, one in by_run.items()}
    return Rung("nominal", (), {}, (), errors, predictions, float("nan"), cache.view.data.count, by_run)


def rung(
    cache: FitCache, name: str, fit: Fit, adjusted: AdjustedStarts | None = None, *, compared: bool = False
) -> Rung:
    """Return one model of the ladder, with its errors on fit runs and on check runs.

    Args:
        cache: of the case.
        name: in the ladder.
        fit: the model.
        adjusted: with the starts of check runs adjusted, if known.
        compared: it is only compared with others: its predictions are not kept.
    """
    adjusted = adjusted or with_adjusted_starts(cache, fit)
    predictions = cache.space.predicted(fit.spec, adjusted.x)
    by_run = as_stated = _by_run(cache, predictions)
    if np.any(adjusted.x != fit.x):
        checks = [number for number, run in enumerate(cache.case.runs) if run.split == "check"]
        as_stated = _by_run(cache, cache.space.predicted(fit.spec, fit.x, checks))
    estimates, far = estimates_of(cache, fit)
    return Rung(
        name=name,
        added=fit.added,
        estimates=estimates,
        at_bound=far,
        errors={channel: _error(cache, by_run[channel], as_stated[channel]) for channel in cache.noise},
        predictions={} if compared else predictions,
        chi2=fit.objective,
        readings=cache.view.data.count,
        by_run=by_run,
        converged=fit.converged,
    )


def _by_run(cache: FitCache, predictions: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, dict[str, RunError]]:
    """Return the errors by channel and run, over all readings but those that adjust the start of a check run."""
    found: dict[str, dict[str, RunError]] = {}
    for channel in cache.noise:
        found[channel] = {}
        for run in cache.case.runs:
            if run.name not in predictions or channel not in run.measured.outputs:
                continue
            rows = evaluated_rows(run, cache.settings)
            error = RunError.of(run.measured.outputs[channel][rows] - predictions[run.name][channel][rows])
            if error is not None:
                found[channel][run.name] = error
    return found


def evaluated_rows(run: Run, settings: Settings) -> slice:
    """Return the rows of a run on which a model is evaluated: all but those that adjust the start of a check run."""
    return slice(start_rows(run, settings).stop if run.split == "check" else 0, None)


def _error(cache: FitCache, by_run: Mapping[str, RunError], as_stated: Mapping[str, RunError]) -> ChannelError:
    """Return the error of a channel, of all readings of its fit runs and check runs."""

    def of(split: str, errors: Mapping[str, RunError]) -> list[RunError]:
        return [errors[run.name] for run in cache.case.runs if run.split == split and run.name in errors]

    def rms(errors: Sequence[RunError]) -> float:
        count = sum(one.readings for one in errors)
        return float(np.sqrt(sum(one.readings * one.rms**2 for one in errors) / count)) if count else float("nan")

    held_out = of("check", by_run)
    return ChannelError(
        fit=rms(of("fit", by_run)),
        check=rms(held_out),
        stated=rms(of("check", as_stated)),
        worst=max((one.worst for one in held_out), default=float("nan")),
    )


def residuals_of(cache: FitCache, one: Rung) -> list[ChannelResiduals]:
    """Return the residuals of every channel, thinned, with the conditions of each reading."""
    found = []
    names = tuple(run.name for run in cache.case.runs)
    since_load_changed = [time_since_load_changed(run) for run in cache.case.runs]
    for channel in cache.noise:
        parts: dict[str, list[np.ndarray]] = {}
        for number, run in enumerate(cache.case.runs):
            values = run.measured.outputs.get(channel)
            if values is None:
                continue
            first = evaluated_rows(run, cache.settings).start
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
            cycles = run.overrides.get("cycles", cache.case.parameters.get("cycles"))
            if cycles is not None:
                given["cycles"] = np.full(kept.size, cycles.value)
            given["time_since_load_changed_s"] = since_load_changed[number][kept]
            columns = {
                "run": np.full(kept.size, number),
                "time_s": time_s,
                "weight_s": represented_s(time_s),
                "error": values[kept] - predicted[channel][kept],
            } | {f"condition {n}": v for n, v in given.items()}
            for name, column in columns.items():
                parts.setdefault(name, []).append(column)
        if "error" not in parts:
            continue
        count = len(parts["error"])
        together = {n: np.concatenate(p) for n, p in parts.items() if len(p) == count}
        tolerance = cache.case.tolerance.get(channel)
        found.append(
            ChannelResiduals(
                channel=channel,
                unit="K" if unit_of(channel) == "degC" else unit_of(channel),
                noise_sd=cache.noise[channel].sd,
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


def errors_by_run(cache: FitCache, models: Mapping[str, Rung]) -> pd.DataFrame:
    """Return a row for each channel of each run and model, over all readings, in the channel's unit.

    Columns: model, run, split, channel, unit, readings; rms, mean and max (the largest size) of the errors; noise_sd,
    rms_over_noise, tolerance; within_tolerance, None where no tolerance is stated.
    """
    rows = []
    for model, one in models.items():
        for channel, noise in cache.noise.items():
            tolerance = cache.case.tolerance.get(channel)
            for run in cache.case.runs:
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
