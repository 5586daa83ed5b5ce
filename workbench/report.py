"""The report of one diagnosis: a single HTML page that opens offline and prints well."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.ladder import ChannelError, Estimate
from discrepancy.next_experiment import in_words
from discrepancy.result import Diagnosis
from discrepancy.score import SEED
from jaxmodel.cases import Known
from jaxmodel.declaration import describe
from jaxmodel.effects import CATALOGUE
from jaxmodel.parameters import TABLE
from jaxmodel.ports import Effect
from workbench.page import write_page
from workbench.pictures.style import axis_label, difference_unit, readable, split_unit
from workbench.provenance import provenance
from workbench.wording import (
    VERDICT_TITLES,
    candidate_name,
    effect_name,
    join,
    number,
    rung_name,
    verdict_sentence,
    with_sd,
)

_LARGE_PULL = 2.0
_SIGNIFICANT = 0.01


def write_report(
    diagnosis: Diagnosis,
    path: Path,
    pictures: Mapping[str, bytes],
    catalogue: Mapping[str, type[Effect]] = CATALOGUE,
) -> None:
    """Write the report of a diagnosis.

    Args:
        diagnosis: what to report.
        path: the HTML file.
        pictures: PNG by name, as `commands.diagnose.pictures_of` makes them.
        catalogue: the known effects, for what they are.
    """
    write_page(path, "diagnosis.html", **report_content(diagnosis, pictures, catalogue))


def report_content(
    diagnosis: Diagnosis, pictures: Mapping[str, bytes], catalogue: Mapping[str, type[Effect]] = CATALOGUE
) -> dict[str, Any]:
    """Return what the templates of a diagnosis show; arguments as `write_report`."""
    case = diagnosis.case
    return {
        "diagnosis": diagnosis,
        "case": case,
        "pictures": pictures,
        "verdict_title": VERDICT_TITLES[diagnosis.verdict],
        "verdict": verdict_sentence(diagnosis),
        "summary": summary(diagnosis),
        "rungs": [rung_name(diagnosis, place) for place in range(len(diagnosis.ladder))],
        "errors": error_rows(diagnosis),
        "chi2": [number(rung.chi2 / rung.readings) if rung.readings else "-" for rung in diagnosis.ladder],
        "named": [
            {
                "label": effect.label,
                "probability": effect.probability,
                "parameters": [f"{name} = {with_sd(estimate)}" for name, estimate in effect.parameters.items()],
                "equation": catalogue[effect.name].equation if effect.name in catalogue else "",
                "rivals": ", ".join(effect_name(label) for label in effect.cannot_tell_apart_from),
            }
            for effect in diagnosis.effects
        ],
        "alike": [
            f"{effect_name(effect.label)}: {join([effect_name(label) for label in effect.cannot_tell_apart_from])}"
            for effect in diagnosis.effects
            if effect.cannot_tell_apart_from
        ],
        "laws": [
            {
                "acts_on": law.channel + (f", in proportion to {law.multiplier}" if law.multiplier else ""),
                "variable": law.variable,
                "share": law.drop / diagnosis.laws[0].drop,
                "shape": law.shape(),
            }
            for law in diagnosis.laws
        ],
        "blind": join([effect_name(label) for label in diagnosis.blind_to]),
        "next": in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals]),
        "runs": case.runs,
        "parameters": _parameter_rows(diagnosis, catalogue),
        "at_bound": join(list(diagnosis.final.at_bound)),
        "noise": [_noise_row(diagnosis, channel) for channel in diagnosis.noise],
        "tests": _test_rows(diagnosis),
        "origin": provenance(_files(diagnosis, catalogue), _settings(diagnosis)),
    }


def _files(diagnosis: Diagnosis, catalogue: Mapping[str, type[Effect]]) -> list[Path]:
    """Return the files of the case, and those of effects of the user's own."""
    case = diagnosis.case
    own = dict.fromkeys(inspect.getfile(effect) for name, effect in catalogue.items() if name not in CATALOGUE)
    return [case.path, *(run.source for run in case.runs), *(Path(file) for file in own)]


def _settings(diagnosis: Diagnosis) -> list[str]:
    ordered = [f"ordered: {' '.join(diagnosis.ordered)}"] if diagnosis.ordered else []
    return [f"random numbers from seed {SEED}", *ordered]


def summary(diagnosis: Diagnosis) -> list[str]:
    """Return the result in a few lines: named, how good it gets, where it failed, what could not be seen."""
    lines = []
    if diagnosis.effects:
        for effect in diagnosis.effects:
            fitted = join([f"{name} = {with_sd(e)}" for name, e in effect.parameters.items()])
            lines.append(f"Named: {effect_name(effect.label)}, {fitted}.")
    elif diagnosis.candidates:
        name, probability = diagnosis.candidates[0]
        lines.append(f"Most probable: {candidate_name(name)} ({probability:.2f}).")
    for channel in diagnosis.noise:
        lines.append(error_sentence(diagnosis, channel))
    if diagnosis.failure.sentences:
        lines.append(f"Where the base model fails: {diagnosis.failure.sentences[0].rstrip('.')}.")
    if diagnosis.proposals:
        lines.append(in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals]))
    if diagnosis.blind_to:
        lines.append(f"Blind to: {join([effect_name(label) for label in diagnosis.blind_to])}.")
    return lines


def error_sentence(diagnosis: Diagnosis, channel: str) -> str:
    """Say a channel's error before and after, on the runs held out where there are any."""
    quantity, before, after, floor, unit = _before_and_after(diagnosis, channel)
    held_out = np.isfinite(diagnosis.base.errors[channel].check)
    where = "on the runs held out" if held_out else "on the runs fitted (none was held out)"
    values = f"{before}{unit}" if diagnosis.final is diagnosis.base else f"{before}{unit} before, {after}{unit} after"
    return f"Error of {quantity} {where}: {values}, noise floor {floor}{unit}."


def error_in_short(diagnosis: Diagnosis, channel: str) -> str:
    """Return 'voltage 24.7 → 0.9 mV (noise 0.8)'."""
    quantity, before, after, floor, unit = _before_and_after(diagnosis, channel)
    return f"{quantity} {before} → {after}{unit} (noise {floor})"


def _before_and_after(diagnosis: Diagnosis, channel: str) -> tuple[str, str, str, str, str]:
    """Return the quantity, its error before and after, the noise floor, and the unit of all three."""
    before, after = diagnosis.base.errors[channel], diagnosis.final.errors[channel]
    pair = (before.check, after.check) if np.isfinite(before.check) else (before.fit, after.fit)
    quantity, unit = split_unit(channel)
    floor = diagnosis.noise[channel].sd
    scale, unit = readable([*pair, floor], difference_unit(unit))
    shown = [number(value * scale) for value in (*pair, floor)]
    return quantity, shown[0], shown[1], shown[2], f" {unit}" if unit else ""


def error_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return a row for each channel: its label, its noise floor, and the errors (fit, check) of every rung, as text."""
    rows = []
    for channel, noise in diagnosis.noise.items():
        scale, unit = _scale(diagnosis, channel)
        errors: list[ChannelError] = [rung.errors[channel] for rung in diagnosis.ladder]
        rows.append(
            {
                "label": axis_label(split_unit(channel)[0], unit),
                "floor": number(noise.sd * scale),
                "errors": [(number(error.fit * scale), number(error.check * scale)) for error in errors],
            }
        )
    return rows


def _scale(diagnosis: Diagnosis, channel: str) -> tuple[float, str]:
    """Return factor and unit for the errors of a channel, one for all rungs."""
    errors = [e for rung in diagnosis.ladder for e in (rung.errors[channel].fit, rung.errors[channel].check)]
    return readable(errors, difference_unit(split_unit(channel)[1]))


def _noise_row(diagnosis: Diagnosis, channel: str) -> dict[str, str]:
    noise = diagnosis.noise[channel]
    unit = difference_unit(split_unit(channel)[1])
    unit = f" {unit}" if unit else ""
    return {
        "channel": channel,
        "sd": f"{number(noise.sd)}{unit}",
        "rho": number(noise.rho) if noise.rho else "none",
        "quantum": f"{number(noise.quantum)}{unit}" if noise.quantum else "-",
        "source": noise.source,
    }


def _test_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return what the residuals of the calibrated base model say, channel by channel."""
    rows = []
    for channel, floor in diagnosis.failure.floor.items():
        series = [one for one in diagnosis.failure.memory if one.series.startswith(f"{channel} in ")]
        with_memory = sum(one.p_holm < _SIGNIFICANT for one in series)
        rows.append(
            {
                "channel": channel,
                "ratio": number(floor.ratio),
                "limit": number(floor.limit),
                "fails": not floor.is_at_floor,
                "memory": f"{with_memory} of {len(series)} runs",
            }
        )
    return rows


def _parameter_rows(diagnosis: Diagnosis, catalogue: Mapping[str, type[Effect]]) -> list[dict[str, Any]]:
    """Return one row for each number that was calibrated, in the order of the final model."""
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
                "meaning": _meaning(name, catalogue),
            }
        )
    return rows


def _of(estimate: Estimate | None, with_unit: Estimate | None) -> str:
    if estimate is None:
        return "-"
    return with_sd(dataclasses.replace(estimate, unit=with_unit.unit if with_unit else estimate.unit))


def _stated(diagnosis: Diagnosis) -> dict[str, Known]:
    """Return what the case states, under the names of the estimates."""
    stated = dict(diagnosis.case.parameters)
    for run in diagnosis.case.runs:
        own = {**run.overrides, "initial_soc": run.initial_soc}
        stated |= {f"{name}[{run.name}]": known for name, known in own.items()}
    return stated


def _meaning(name: str, catalogue: Mapping[str, type[Effect]]) -> str:
    label, _, field = name.rpartition(".")
    if label:
        cls = catalogue.get(label.partition(":")[0])
        return describe(cls)[field].meaning if cls is not None and field in describe(cls) else ""
    plain = re.sub(r"\[.*\]$", "", name)
    return TABLE[plain].meaning if plain in TABLE else ""
