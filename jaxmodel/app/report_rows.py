"""The rows of a report's tables, as text: errors of models and of channels, parameters, noise."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.case.known import Known
from jaxmodel.diagnosis.headline import held_out
from jaxmodel.diagnosis.result import Diagnosis, Estimate
from jaxmodel.diagnosis.wording import ladder_names, number, with_sd
from jaxmodel.model.declaration import describe
from jaxmodel.model.parameters import TABLE
from jaxmodel.model.ports import Effect
from jaxmodel.plots.style import axis_label

_LARGE_PULL = 2.0
_SIDE_BY_SIDE = 3  # channels of the ladder in one table
_MOST_DECIMALS = 4


@dataclasses.dataclass(frozen=True)
class _Unit:
    """How the errors of a channel are shown: label, factor, and unit with a leading blank."""

    label: str
    scale: float
    unit: str

    def __call__(self, value: float | None) -> str:
        """Return a number without its unit."""
        return "-" if value is None else number(value * self.scale)


def _unit(diagnosis: Diagnosis, channel: str) -> _Unit:
    """Return how the errors of a channel are shown, the same for all models."""
    errors = [e for rung in diagnosis.ladder for e in (rung.errors[channel].fit, rung.errors[channel].check)]
    quantity, unit = split_unit(channel)
    scale, unit = readable(errors, difference_unit(unit))
    return _Unit(axis_label(quantity, unit), scale, f" {unit}" if unit else "")


def ladder_tables(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return the ladder as tables of a few channels each, so that they fit on a narrow page.

    A row is a model; a cell has the error and the change from the row above, both rounded alike, so that the changes
    shown add up to the difference of the errors shown.
    """
    channels = list(diagnosis.noise)
    groups = [channels[k : k + _SIDE_BY_SIDE] for k in range(0, len(channels), _SIDE_BY_SIDE)]
    return [_ladder_table(diagnosis, group) for group in groups]


def _ladder_table(diagnosis: Diagnosis, channels: Sequence[str]) -> dict[str, Any]:
    units = {channel: _unit(diagnosis, channel) for channel in channels}
    columns = {
        (channel, split): [getattr(rung.errors[channel], split) * units[channel].scale for rung in diagnosis.ladder]
        for channel in channels
        for split in ("fit", "check")
    }
    decimals = {channel: _decimals([*columns[channel, "fit"], *columns[channel, "check"]]) for channel in channels}
    steps = {(channel, split): _steps(values, decimals[channel]) for (channel, split), values in columns.items()}
    return {
        "channels": [units[channel].label for channel in channels],
        "rows": [
            {"name": name, "cells": [steps[column][place] for column in columns]}
            for place, name in enumerate(ladder_names(diagnosis.ladder))
        ],
        "total": [_total(steps[column]) for column in columns],
        "noise": [
            f"{diagnosis.noise[channel].sd * units[channel].scale:,.{decimals[channel]}f}" for channel in channels
        ],
    }


def _decimals(values: Sequence[float]) -> int:
    """Return the decimals with which the smallest of some errors has two digits, and the largest three."""
    sizes = [value for value in values if np.isfinite(value) and value > 0.0] or [1.0]
    needed = max(1 - np.floor(np.log10(min(sizes))), 2 - np.floor(np.log10(max(sizes))))
    return int(np.clip(needed, 0, _MOST_DECIMALS))


def _steps(values: Sequence[float], decimals: int) -> list[tuple[str, str]]:
    """Return each error, and its change from the one before, as they are shown; '-' where nothing was read."""
    shown = [round(Decimal(str(value)), decimals) if np.isfinite(value) else None for value in values]
    found: list[tuple[str, str]] = []
    for place, value in enumerate(shown):
        before = shown[place - 1] if place else None
        change = "" if value is None or before is None else _signed(value - before)
        found.append(("-" if value is None else f"{value:,f}", change))
    return found


def _signed(change: Decimal) -> str:
    """Return a change with its sign, the minus as wide as a plus; '0' for none."""
    return "0" if not change else f"{change:+,f}".replace("-", "\u2212")


def _total(steps: Sequence[tuple[str, str]]) -> str:
    """Return the change from the first model to the last, of the numbers shown."""
    first, last = steps[0][0], steps[-1][0]
    if "-" in (first, last):
        return "-"
    return _signed(Decimal(last.replace(",", "")) - Decimal(first.replace(",", "")))


def channel_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return a row for each channel: errors before and after, noise, tolerance, and remaining error."""
    rows = []
    for channel, noise in diagnosis.noise.items():
        unit = _unit(diagnosis, channel)
        before, after = diagnosis.base.errors[channel], diagnosis.final.errors[channel]
        remaining = diagnosis.remaining.get(channel)
        rows.append(
            {
                "label": unit.label,
                "noise": unit(noise.sd),
                "tolerance": _tolerance(diagnosis, channel, unit),
                "stated": tuple(unit(e) for e in _pair(diagnosis.ladder[0].errors[channel])),
                "before": tuple(unit(e) for e in _pair(before)),
                "after": tuple(unit(e) for e in _pair(after)),
                "as_stated": unit(after.stated),
                "worst": unit(after.worst),
                "tau": f"{number(remaining.tau_s)} s" if remaining and remaining.tau_s > 0.0 else "-",
                "within": within_tolerance(diagnosis, channel),
            }
        )
    return rows


def within_tolerance(diagnosis: Diagnosis, channel: str) -> str:
    """Return "yes", "no", "in 2 of 3 runs", or "" without a tolerance: of the check runs, of fit runs without any."""
    if channel not in diagnosis.tolerance:
        return ""
    of_run = diagnosis.fit_for_purpose.get(channel, {})
    good = sum(of_run.values())
    if 0 < good < len(of_run):
        return f"in {good} of {len(of_run)} runs"
    if held_out(diagnosis.final.errors[channel]) > diagnosis.tolerance[channel].rms:
        return "no"
    return "yes" if good == len(of_run) else "no"


def _pair(error: Any) -> tuple[float, float]:
    return error.fit, error.check


def _tolerance(diagnosis: Diagnosis, channel: str, unit: _Unit) -> tuple[str, ...]:
    """Return the tolerance of a channel, its largest single error, and whether it is assumed."""
    one = diagnosis.tolerance.get(channel)
    if one is None:
        return ("-",)
    largest = (f"at most {unit(one.largest)}",) if one.largest is not None else ()
    return (unit(one.rms), *largest, *(("assumed",) if one.assumed else ()))


def noise_rows(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return a row for each channel: the noise of its sensor and its source."""
    rows = []
    for channel, noise in diagnosis.noise.items():
        unit = difference_unit(split_unit(channel)[1])
        unit = f" {unit}" if unit else ""
        rows.append(
            {
                "channel": channel,
                "sd": f"{number(noise.sd)}{unit}",
                "rho": number(noise.rho) if noise.rho else "none",
                "quantum": f"{number(noise.quantum)}{unit}" if noise.quantum else "-",
                "source": noise.source,
            }
        )
    return rows


def parameter_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return one row for each calibrated parameter, in the order of the final model."""
    base, final = diagnosis.base.estimates, diagnosis.final.estimates
    stated = _stated(diagnosis)
    rows = []
    for name in dict.fromkeys((*base, *final)):
        known = stated.get(name)
        pull = np.nan
        if known is not None and known.sd and name in final:
            pull = (final[name].value - known.value) / known.sd
        rows.append(
            {
                "name": name,
                "unit": (final.get(name) or base[name]).unit,
                "stated": _of(Estimate(known.value, known.sd or 0.0, "")) if known else "-",
                "base": _of(base.get(name)),
                "final": _of(final.get(name)),
                "pull": f"{pull:+.1f}" if np.isfinite(pull) else "-",
                "flagged": bool(np.isfinite(pull) and abs(pull) > _LARGE_PULL),
                "strained": name in diagnosis.final.at_bound,
                "meaning": _meaning(name, diagnosis.case.catalogue),
            }
        )
    return rows


def _of(estimate: Estimate | None) -> str:
    """Return a number with its sd; its unit stands beside the name, so that the row fits on a narrow page."""
    return "-" if estimate is None else with_sd(dataclasses.replace(estimate, unit=""))


def _stated(diagnosis: Diagnosis) -> dict[str, Known]:
    """Return the stated values under the names of the estimates."""
    case = diagnosis.case
    stated = dict(case.parameters)
    for name, sds in case.effect_sd.items():
        values, column = case.effects[name], case.effects[name].get("column")
        label = f"{name}:{column}" if column else name
        stated |= {f"{label}.{field}": Known(float(values[field]), sd) for field, sd in sds.items()}
    for run in case.runs:
        own = {**run.overrides, "initial_soc": run.initial_soc}
        stated |= {f"{name}[{run.name}]": known for name, known in own.items()}
    return stated


def _meaning(name: str, catalogue: Mapping[str, type[Effect]]) -> str:
    label, _, field = re.sub(r"\[.*\]$", "", name).rpartition(".")
    if label:
        cls = catalogue.get(label.partition(":")[0])
        return describe(cls)[field].meaning if cls is not None and field in describe(cls) else ""
    return TABLE[field].meaning if field in TABLE else ""
