"""The report of one diagnosis: a single HTML page that opens offline and prints well.

It answers in the order in which a user asks: what is missing, which of my numbers and tables are off, what remains and
does it matter to me.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.advice.next_experiment import in_words
from discrepancy.advice.remarks import extrapolated_sentence as remark_on_extrapolation
from discrepancy.fitting.starts import SEED
from discrepancy.result import Diagnosis, Extrapolated
from discrepancy.wording import (
    VERDICT_TITLES,
    amount,
    candidate_name,
    curve_sentence,
    effect_name,
    join,
    named_sentence,
    number,
    removed,
    run_sentence,
    verdict_sentence,
    with_sd,
)
from jaxmodel.units import split_unit
from workbench.page import write_page
from workbench.provenance import provenance
from workbench.report_rows import channel_rows, ladder_rows, noise_rows, parameter_rows


def write_report(
    diagnosis: Diagnosis,
    path: Path,
    pictures: Mapping[str, bytes],
) -> None:
    """Write the report of a diagnosis.

    Args:
        diagnosis: what to report.
        path: the HTML file.
        pictures: PNG by name, as `commands.diagnose.pictures_of` makes them.
    """
    write_page(path, "diagnosis.html", **report_content(diagnosis, pictures))


def report_content(diagnosis: Diagnosis, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Return what the templates of a diagnosis show; arguments as `write_report`."""
    case, parameters = diagnosis.case, parameter_rows(diagnosis)
    told_of_them = set(map(remark_on_extrapolation, diagnosis.extrapolated))
    return {
        "diagnosis": diagnosis,
        "case": case,
        "pictures": pictures,
        "verdict_title": VERDICT_TITLES[diagnosis.verdict],
        "verdict": verdict_sentence(diagnosis),
        "summary": summary(diagnosis),
        "ladder": ladder_rows(diagnosis),
        "named": [
            {
                "label": effect.label,
                "probability": effect.probability,
                "parameters": [f"{name} = {with_sd(estimate)}" for name, estimate in effect.parameters.items()],
                "equation": case.catalogue[effect.name].equation if effect.name in case.catalogue else "",
                "removes": removed(effect.removes),
                "rests_on": effect.rests_on,
                "rivals": ", ".join(effect_name(label) for label in effect.cannot_tell_apart_from),
            }
            for effect in diagnosis.effects
        ],
        "where_base": _by_channel(diagnosis.where_base),
        "curves": [curve_sentence(curve) for curve in diagnosis.curves],
        "off_runs": [run_sentence(run) for run in diagnosis.runs],
        "strained": [row for row in parameters if row["strained"]],
        "channels": channel_rows(diagnosis),
        "fit_for_purpose": purpose_sentences(diagnosis),
        "where": _by_channel({channel: one.where for channel, one in diagnosis.remaining.items()}),
        "immaterial": [_immaterial(one.sentence, removed(one.removes)) for one in diagnosis.immaterial],
        "extrapolated": [extrapolated_sentence(one) for one in diagnosis.extrapolated],
        # What is extrapolated is a remark too: here it has a heading of its own.
        "remarks": [remark for remark in diagnosis.remarks if remark not in told_of_them],
        "blind": join([effect_name(label) for label in diagnosis.blind_to]),
        "alike": [
            f"{effect_name(effect.label)}: {join([effect_name(label) for label in effect.cannot_tell_apart_from])}"
            for effect in diagnosis.effects
            if effect.cannot_tell_apart_from
        ],
        "next": in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals]),
        "runs": case.runs,
        "parameters": parameters,
        "noise": noise_rows(diagnosis),
        "origin": provenance(_files(diagnosis, catalogue), _settings(diagnosis)),
    }


def _by_channel(sentences: Mapping[str, tuple[str, ...]]) -> list[tuple[str, list[str]]]:
    """Return the channels of which something is said, and what."""
    return [(split_unit(channel)[0], [_sentence(one) for one in said]) for channel, said in sentences.items() if said]


def _sentence(text: str) -> str:
    """Return a text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def _immaterial(sentence: str, takes: str) -> str:
    return _sentence(f"{sentence.rstrip('.')}{takes and f'; it takes off {takes}'}")


def _files(diagnosis: Diagnosis) -> list[Path]:
    """Return the files of the case, and those of effects of the user's own."""
    case = diagnosis.case
    own = dict.fromkeys(inspect.getfile(effect) for effect in case.own_effects.values())
    return [*case.files, *(Path(file) for file in own)]


def _settings(diagnosis: Diagnosis) -> list[str]:
    ordered = [f"ordered: {' '.join(diagnosis.ordered)}"] if diagnosis.ordered else []
    return [f"random numbers from seed {SEED}", *ordered]


def summary(diagnosis: Diagnosis) -> list[str]:
    """Return the result in a few lines: what is missing, what is off, how good it gets, what could not be seen."""
    lines = [f"Named: {named_sentence(effect)}" for effect in diagnosis.effects]
    if not diagnosis.effects and diagnosis.candidates:
        name, probability = diagnosis.candidates[0]
        lines.append(f"Most probable: {candidate_name(name)} ({probability:.2f}).")
    lines += [f"Off: {curve_sentence(curve)}" for curve in diagnosis.curves]
    lines += [f"Off: {run_sentence(run)}" for run in diagnosis.runs]
    lines += [error_sentence(diagnosis, channel) for channel in diagnosis.noise]
    lines += purpose_sentences(diagnosis)
    if diagnosis.proposals:
        lines.append(in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals]))
    if diagnosis.blind_to:
        lines.append(f"Blind to: {join([effect_name(label) for label in diagnosis.blind_to])}.")
    return lines


def purpose_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say of each channel in how many of the held-out runs its error is within the tolerance, and in which not."""
    said = []
    for channel, of_run in diagnosis.fit_for_purpose.items():
        tolerance = diagnosis.tolerance.get(channel)
        if not of_run or tolerance is None:
            continue
        (limit,), unit = amount(channel, [tolerance.rms])
        failing = [run for run, within in of_run.items() if not within]
        beyond = f", not in {join(failing)}" if failing and len(failing) <= 6 else ""
        said.append(
            f"Fit for purpose: {split_unit(channel)[0]} is within {limit}{unit and f' {unit}'} "
            f"({'assumed' if tolerance.assumed else 'your tolerance'}) in {len(of_run) - len(failing)} of "
            f"{len(of_run)} held-out runs{beyond}."
        )
    return said


def extrapolated_sentence(one: Extrapolated) -> str:
    """Say which condition of which held-out run lies outside those that were fitted."""
    quantity, unit = split_unit(one.condition.strip("|"))
    quantity = f"size of {quantity}" if one.condition.startswith("|") else quantity
    unit = f" {unit}" if unit else ""
    low, high = (number(value) for value in one.span)
    first, last = (number(value) for value in one.span_fitted)
    there = f"{low} to {high}" if low != high else low
    fitted = f"{first} to {last}" if first != last else first
    return f"{one.file}: {quantity} {there}{unit}, where {fitted}{unit} was fitted."


def error_sentence(diagnosis: Diagnosis, channel: str) -> str:
    """Say a channel's error before and after, on the runs held out where there are any."""
    quantity, before, after, floor, unit = _before_and_after(diagnosis, channel)
    held_out = np.isfinite(diagnosis.base.errors[channel].check)
    where = "on the runs held out" if held_out else "on the runs fitted (none was held out)"
    values = f"{before}{unit}" if diagnosis.final is diagnosis.base else f"{before}{unit} before, {after}{unit} after"
    return f"Error of {quantity} {where}: {values}, noise {floor}{unit}."


def error_in_short(diagnosis: Diagnosis, channel: str) -> str:
    """Return 'voltage 24.7 → 0.9 mV (noise 0.8)'."""
    quantity, before, after, floor, unit = _before_and_after(diagnosis, channel)
    return f"{quantity} {before} → {after}{unit} (noise {floor})"


def _before_and_after(diagnosis: Diagnosis, channel: str) -> tuple[str, str, str, str, str]:
    """Return the quantity, its error before and after, the noise, and the unit of all three with a blank before it."""
    before, after = diagnosis.base.errors[channel], diagnosis.final.errors[channel]
    pair = (before.check, after.check) if np.isfinite(before.check) else (before.fit, after.fit)
    shown, unit = amount(channel, [*pair, diagnosis.noise[channel].sd])
    return split_unit(channel)[0], shown[0], shown[1], shown[2], f" {unit}" if unit else ""
