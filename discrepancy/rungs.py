"""The models of an investigation as rungs of a ladder: parameters, predictions and errors, by run and channel."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pandas as pd

from discrepancy.evidence.trial import Trial
from discrepancy.fitting.fit import fit
from discrepancy.fitting.model import View
from discrepancy.fitting.readings import Weights, collect
from discrepancy.noise.model_error import NONE
from discrepancy.preparation.thinning import start_rows
from discrepancy.residuals.conditions import time_since_load_changed
from discrepancy.residuals.summary import error_table
from discrepancy.residuals.table import ChannelResiduals
from discrepancy.result import ChannelError, Estimate, Rung
from discrepancy.workings import Workings
from jaxmodel.declaration import describe
from jaxmodel.names import parameter_table
from jaxmodel.units import unit_of

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
    """Return the base model with its stated parameters."""
    base = inv.base
    x = np.zeros_like(base.fitted.x)
    predicted = inv.space.predicted(base.setting, x)
    by_run = inv.space.by_run(predicted)
    errors = {name: _errors(inv, name, by_run, by_run) for name in inv.noise}
    return Rung("nominal", (), {}, (), errors, by_run, float("nan"), base.fitted.rows.size)


def rung(inv: Workings, name: str, trial: Trial, adjusted: AdjustedStarts | None = None) -> Rung:
    """Return one model of the ladder, with its errors on fit runs and on check runs."""
    adjusted = adjusted or with_adjusted_starts(inv, trial)
    by_run = inv.space.by_run(inv.space.predicted(trial.setting, adjusted.x))
    as_stated = inv.space.by_run(inv.space.predicted(trial.setting, trial.fitted.x))
    estimates, far = estimates_of(inv, trial)
    return Rung(
        name=name,
        added=trial.labels,
        estimates=estimates,
        at_bound=far,
        errors={channel: _errors(inv, channel, by_run, as_stated) for channel in inv.noise},
        predictions=by_run,
        chi2=trial.fitted.chi2,
        readings=trial.fitted.rows.size,
    )


def _errors(
    inv: Workings,
    channel: str,
    predictions: Mapping[str, Mapping[str, np.ndarray]],
    as_stated: Mapping[str, Mapping[str, np.ndarray]],
) -> ChannelError:
    def errors(split: str, predicted: Mapping[str, Mapping[str, np.ndarray]]) -> np.ndarray:
        parts = []
        for run in inv.case.runs:
            if run.split != split or channel not in run.measured.outputs:
                continue
            first = start_rows(run, inv.settings).stop if split == "check" else 0
            parts.append((run.measured.outputs[channel] - predicted[run.name][channel])[first:])
        together = np.concatenate([*parts, np.zeros(0)])
        return together[np.isfinite(together)]

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")

    held_out = errors("check", predictions)
    return ChannelError(
        fit=rms(errors("fit", predictions)),
        check=rms(held_out),
        stated=rms(errors("check", as_stated)),
        worst=float(np.max(np.abs(held_out))) if held_out.size else float("nan"),
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
    for channel in inv.noise:
        parts: dict[str, list[np.ndarray]] = {}
        for number, run in enumerate(inv.case.runs):
            values = run.measured.outputs.get(channel)
            if values is None:
                continue
            first = start_rows(run, inv.settings).stop if run.split == "check" else 0
            there = np.flatnonzero(np.isfinite(values))
            there = there[there >= first]
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
            given["time_since_load_changed_s"] = time_since_load_changed(run)[kept]
            columns = {
                "run": np.full(kept.size, number),
                "time_s": time_s,
                "weight_s": np.maximum(np.gradient(time_s), 1e-9) if kept.size > 1 else np.ones(1),
                "error": (values - predicted[channel])[kept],
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


def errors_by_run(inv: Workings, left: Mapping[str, Sequence[ChannelResiduals]]) -> pd.DataFrame:
    """Return a row for each channel of each run and model, given the residuals by model name."""
    splits: dict[str, Literal["fit", "check"]] = {run.name: run.split for run in inv.case.runs}
    tables = []
    for name, channels in left.items():
        table = error_table(channels, splits)
        table.insert(0, "model", name)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
