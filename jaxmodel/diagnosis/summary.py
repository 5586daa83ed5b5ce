"""A diagnosis in a few lines: what is missing, what is wrong, the errors, and what the data cannot show."""

from __future__ import annotations

import numpy as np

from jaxmodel.base.units import split_unit
from jaxmodel.diagnosis.headline import undetectable
from jaxmodel.diagnosis.opening import opening
from jaxmodel.diagnosis.result import Diagnosis, Extrapolated
from jaxmodel.diagnosis.wording import (
    amount,
    curve_sentence,
    effect_name,
    join,
    most_probable,
    named_sentence,
    number,
    run_sentence,
    specimen_sentences,
    verdict_sentence,
)


def whole_summary(diagnosis: Diagnosis) -> str:
    """Return the verdict, how sure it is, what to measure next, the reasons and the remarks, one in a line."""
    notes = (f"Note: {remark}" for remark in diagnosis.remarks)
    return "\n".join([verdict_sentence(diagnosis), *sure_and_next(diagnosis), *summary(diagnosis), *notes])


def sure_and_next(diagnosis: Diagnosis) -> list[str]:
    """Return how sure the verdict is, and what to measure next, a line each."""
    return [f"{question}: {sentence}" for question, sentence in opening(diagnosis).lines()[1:]]


def summary(diagnosis: Diagnosis) -> list[str]:
    """Return the result in a few lines: what is missing, what is wrong, the errors, and what the data cannot show."""
    lines = [f"Found: {named_sentence(effect)}" for effect in diagnosis.effects]
    if not diagnosis.effects and diagnosis.candidates:
        probability = diagnosis.candidates[0][1]
        lines.append(f"Most probable model: {most_probable(diagnosis)} (probability {probability:.2f}).")
    lines += [f"Found: {sentence}" for sentence in specimen_sentences(diagnosis)]
    lines += [f"Correction: {curve_sentence(curve)}" for curve in diagnosis.curves]
    lines += [f"Correction: {run_sentence(run)}" for run in diagnosis.runs]
    lines += [error_sentence(diagnosis, channel) for channel in diagnosis.noise]
    lines += purpose_sentences(diagnosis)
    if hidden := undetectable(diagnosis):
        lines.append(f"Not detectable with these data: {join([effect_name(label) for label in hidden])}.")
    return lines


def purpose_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say for each channel in how many check runs its error is within the tolerance, and in which it is not."""
    sentences = []
    for channel, of_run in diagnosis.fit_for_purpose.items():
        tolerance = diagnosis.tolerance.get(channel)
        if not of_run or tolerance is None:
            continue
        (limit,), unit = amount(channel, [tolerance.rms])
        failing = [run for run, within in of_run.items() if not within]
        beyond = f"; not in {join(failing)}" if failing and len(failing) <= 6 else ""
        sentences.append(
            f"Tolerance: {split_unit(channel)[0]} is within {limit}{unit and f' {unit}'} "
            f"({'assumed' if tolerance.assumed else 'stated'}) in {len(of_run) - len(failing)} of "
            f"{len(of_run)} check runs{beyond}."
        )
    return sentences


def extrapolated_sentence(one: Extrapolated) -> str:
    """Say which condition of which check run is outside the fit runs."""
    quantity, unit = split_unit(one.condition.strip("|"))
    quantity = f"size of {quantity}" if one.condition.startswith("|") else quantity
    unit = f" {unit}" if unit else ""
    low, high = (number(value) for value in one.span)
    first, last = (number(value) for value in one.span_fitted)
    there = f"{low} to {high}" if low != high else low
    fitted = f"{first} to {last}" if first != last else first
    return f"{one.file}: {quantity} {there}{unit}; the fit runs cover {fitted}{unit}."


def error_sentence(diagnosis: Diagnosis, channel: str) -> str:
    """Say a channel's error before and after, on the check runs if there are any."""
    quantity, before, after, floor, unit = _before_and_after(diagnosis, channel)
    held_out = np.isfinite(diagnosis.base.errors[channel].check)
    where = "on check runs" if held_out else "on fit runs (there are no check runs)"
    values = f"{before}{unit}" if diagnosis.final is diagnosis.base else f"{before}{unit} before, {after}{unit} after"
    predicted, known = diagnosis.final.errors[channel].prediction_sd, ""
    if np.isfinite(predicted):
        (sd,), own = amount(channel, [predicted])
        known = f"; sd of the prediction {sd} {own}".rstrip()
    return f"RMS error of {quantity} {where}: {values}; noise {floor}{unit}{known}."


def error_in_short(diagnosis: Diagnosis, channel: str) -> str:
    """Return 'voltage 24.7 → 0.9 mV (noise 0.8)'."""
    quantity, before, after, floor, unit = _before_and_after(diagnosis, channel)
    return f"{quantity} {before} → {after}{unit} (noise {floor})"


def _before_and_after(diagnosis: Diagnosis, channel: str) -> tuple[str, str, str, str, str]:
    """Return the quantity, its error before and after, the noise, and their unit with a leading blank."""
    before, after = diagnosis.base.errors[channel], diagnosis.final.errors[channel]
    pair = (before.check, after.check) if np.isfinite(before.check) else (before.fit, after.fit)
    shown, unit = amount(channel, [*pair, diagnosis.noise[channel].sd])
    return split_unit(channel)[0], shown[0], shown[1], shown[2], f" {unit}" if unit else ""
