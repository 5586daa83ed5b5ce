"""The rows of a report's tables, as text: errors of models and of channels, parameters, noise."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.case.known import Known
from jaxmodel.diagnosis.result import Diagnosis, Estimate
from jaxmodel.diagnosis.wording import ladder_names, number, with_sd
from jaxmodel.model.declaration import describe
from jaxmodel.model.parameters import TABLE
from jaxmodel.model.ports import Effect
from jaxmodel.plots.style import axis_label

_LARGE_PULL = 2.0


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


def ladder_rows(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the channels of the ladder's table, their noise, and a row for each model: (fit, check) by channel."""
    units = {channel: _unit(diagnosis, channel) for channel in diagnosis.noise}
    return {
        "channels": [unit.label for unit in units.values()],
        "noise": [unit(diagnosis.noise[channel].sd) for channel, unit in units.items()],
        "rungs": [
            {
                "name": name,
                "errors": [
                    (unit(rung.errors[channel].fit), unit(rung.errors[channel].check))
                    for channel, unit in units.items()
                ],
                "chi2": number(rung.chi2 / rung.readings) if rung.readings else "-",
            }
            for name, rung in zip(ladder_names(diagnosis.ladder), diagnosis.ladder, strict=True)
        ],
    }


def channel_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return a row for each channel: errors before and after, noise, tolerance, and remaining error."""
    rows = []
    for channel, noise in diagnosis.noise.items():
        unit, tolerance = _unit(diagnosis, channel), diagnosis.tolerance.get(channel)
        before, after = diagnosis.base.errors[channel], diagnosis.final.errors[channel]
        remaining = diagnosis.remaining.get(channel)
        last = after.check if np.isfinite(after.check) else after.fit
        rows.append(
            {
                "label": unit.label,
                "noise": unit(noise.sd),
                "tolerance": _tolerance(diagnosis, channel, unit),
                "assumed": bool(tolerance and tolerance.assumed),
                "stated": tuple(unit(e) for e in _pair(diagnosis.ladder[0].errors[channel])),
                "before": tuple(unit(e) for e in _pair(before)),
                "after": tuple(unit(e) for e in _pair(after)),
                "as_stated": unit(after.stated),
                "worst": unit(after.worst),
                "ratio": number(last / noise.sd) if noise.sd > 0.0 else "-",
                "tau": f"{number(remaining.tau_s)} s" if remaining and remaining.tau_s > 0.0 else "none",
                "within": "" if tolerance is None else "yes" if last <= tolerance.rms else "no",
            }
        )
    return rows


def _pair(error: Any) -> tuple[float, float]:
    return error.fit, error.check


def _tolerance(diagnosis: Diagnosis, channel: str, unit: _Unit) -> str:
    one = diagnosis.tolerance.get(channel)
    if one is None:
        return "-"
    largest = f", at most {unit(one.largest)}" if one.largest is not None else ""
    return f"{unit(one.rms)}{largest}{' (assumed)' if one.assumed else ''}"


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
                "stated": _of(Estimate(known.value, known.sd or 0.0, ""), final.get(name)) if known else "-",
                "base": _of(base.get(name), base.get(name)),
                "final": _of(final.get(name), final.get(name)),
                "pull": f"{pull:+.1f}" if np.isfinite(pull) else "-",
                "flagged": bool(np.isfinite(pull) and abs(pull) > _LARGE_PULL),
                "strained": name in diagnosis.final.at_bound,
                "meaning": _meaning(name, diagnosis.case.catalogue),
            }
        )
    return rows


def _of(estimate: Estimate | None, with_unit: Estimate | None) -> str:
    if estimate is None:
        return "-"
    return with_sd(dataclasses.replace(estimate, unit=with_unit.unit if with_unit else estimate.unit))


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
