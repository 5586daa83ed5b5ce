"""Verdicts, models, candidates and numbers in words, the same in the terminal and in the report."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.diagnosis.result import CurveFound, Diagnosis, Estimate, NamedEffect, Removed, RunFound, Rung

VERDICT_TITLES = {
    "adequate": "Nothing is missing",
    "missing_effect": "An effect is missing",
    "sensor_fault": "A sensor is faulty",
    "unknown_effect": "Unknown physics is missing",
    "undecided": "The data do not decide",
    "": "Calibrated",
}

_ONE_LINE = 48  # letters in a legend or at the head of a column


def join(parts: Sequence[str], last: str = "and") -> str:
    """Return 'a, b and c'."""
    parts = list(parts)
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}" if parts else ""


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """Return the verdict in one sentence."""
    named = join([_with_probability(effect) for effect in diagnosis.effects])
    match diagnosis.verdict:
        case "adequate":
            return (
                f"The calibrated base model is adequate{_for_tolerances(diagnosis)}: the data show no missing effect."
            )
        case "missing_effect":
            return f"The base model lacks {named}{_of_another_form(diagnosis)}."
        case "sensor_fault":
            return f"The model needs no further physics; a sensor is faulty: {named}{_of_another_form(diagnosis)}."
        case "unknown_effect":
            besides = f"Besides {named}, the" if named else "The"
            what = f": {diagnosis.unexplained.rstrip('.')}" if diagnosis.unexplained else ""
            return f"{besides} base model lacks something that no effect of the catalogue explains{what}."
        case "undecided" if diagnosis.unexplained:
            return f"The base model predicts the fit runs, but not the check runs: {diagnosis.unexplained.rstrip('.')}."
        case "undecided":
            rivals = [candidate_name(name) for name, p in diagnosis.candidates if p >= 0.05] or ["the candidates"]
            found = f"The data show {named}, but do not" if named else "The data do not"
            return (
                f"{found} distinguish between {join(rivals)}." if len(rivals) > 1 else f"{found} confirm {rivals[0]}."
            )
    return "The base model is calibrated; no effects were tested."


def _for_tolerances(diagnosis: Diagnosis) -> str:
    """Return for which tolerances a model is adequate: ' for 12 mV of voltage (assumed)'; '' where one is exceeded."""
    parts = []
    for name, one in diagnosis.tolerance.items():
        error = diagnosis.final.errors[name]
        if max(error.fit, error.check if np.isfinite(error.check) else 0.0) > one.rms:
            return ""
        (value,), unit = amount(name, [one.rms])
        parts.append(f"{value} {unit} of {split_unit(name)[0]}{' (assumed)' if one.assumed else ''}")
    return f" for {join(parts)}" if parts else ""


def _of_another_form(diagnosis: Diagnosis) -> str:
    left = (diagnosis.unexplained or "").rstrip(".")
    return f", in a form that differs slightly from the catalogue's: {left}" if left else ""


def _with_probability(effect: NamedEffect) -> str:
    return f"{effect_name(effect.label)} (probability {effect.probability:.2f})"


def effect_name(label: str) -> str:
    """Return a label in words: 'current_offset:current_A' is 'current_offset of current_A', 'r@x' is 'r in x'."""
    if is_law(label):
        return f"a law of {label}"
    return label.replace(":", " of ").replace("@", " in ")


def is_law(label: str) -> bool:
    """Return True for an unknown law, labelled by its port and its variable, 'port(variable)'."""
    return "(" in label


def candidate_name(name: str) -> str:
    """Return a hypothesis in words."""
    known = {"base": "the base model alone", "something_else": "something else"}
    return known.get(name) or " with ".join(effect_name(part) for part in name.split("+"))


def ladder_names(ladder: Sequence[Rung]) -> list[str]:
    """Return the models of a diagnosis in words: as stated, calibrated, then what each adds to the previous one."""
    return ["base model, as stated", *step_names([one.added for one in ladder[1:]])]


def step_names(steps: Sequence[tuple[str, ...]]) -> list[str]:
    """Return models in words: what each adds to, and removes from, the previous one."""
    names = []
    for before, now in itertools.pairwise([(), *steps]):
        new = [effect_name(label) for label in now if label not in before]
        gone = [effect_name(label) for label in before if label not in now]
        added = f"{'and' if len(names) > 1 else 'with'} {join(new)}" if new else ""
        said = ", ".join(filter(None, (added, f"without {join(gone)}" if gone else "")))
        names.append(said or ("the same model" if names else "calibrated base model"))
    return names


def final_name(diagnosis: Diagnosis) -> str:
    """Return the final model in words, its additions in the order of the ladder."""
    final = diagnosis.final.added
    added = dict.fromkeys(label for rung in diagnosis.ladder for label in rung.added if label in final)
    return f"with {join([effect_name(label) for label in added])}" if added else "calibrated base model"


def final_in_short(diagnosis: Diagnosis) -> str:
    """Return the name of the final model, or 'final model' if it is too long for one line."""
    name = final_name(diagnosis)
    return name if len(name) <= _ONE_LINE else "final model"


def amount(channel: str, values: Sequence[float]) -> tuple[list[str], str]:
    """Return errors of a channel as numbers in a readable unit, and that unit."""
    scale, unit = readable(values, difference_unit(split_unit(channel)[1]))
    return [number(value * scale) for value in values], unit


def removed(removes: Mapping[str, Removed]) -> str:
    """Say by how much errors change: 'reduces the error of voltage by 12 mV on fit runs and 9 mV on check runs'.

    What rises is said to be raised; '' if nothing changes.
    """
    parts_of_channels = []
    for channel, one in removes.items():
        values = {"fit runs": one.fit, "check runs": one.check}
        values = {split: value for split, value in values.items() if np.isfinite(value)}
        if any(values.values()):
            numbers, unit = amount(channel, list(map(abs, values.values())))
            verbs = ["raises" if value < 0.0 else "reduces" for value in values.values()]
            parts = [" ".join(filter(None, (n, unit, "on", split))) for n, split in zip(numbers, values, strict=True)]
            name = split_unit(channel)[0]
            if len(set(verbs)) == 1:
                parts_of_channels.append(f"{verbs[0]} the error of {name} by {join(parts)}")
            else:
                said = f"{verbs[0]} the error of {name} by {parts[0]} and {verbs[1]} it by {parts[1]}"
                parts_of_channels.append(said)
    return "; ".join(parts_of_channels)


def named_sentence(effect: NamedEffect) -> str:
    """Say which effect is named, its parameters, and by how much it reduces the errors."""
    numbers = join([f"{name} = {with_sd(estimate)}" for name, estimate in effect.parameters.items()])
    takes = removed(effect.removes)
    alone = f"; only {effect.rests_on} shows it" if effect.rests_on else ""
    reduces = takes and f"; it {takes}"
    return f"{', '.join(filter(None, (effect_name(effect.label), numbers)))}{reduces}{alone}."


def curve_sentence(curve: CurveFound) -> str:
    """Say by how much a table or relation is wrong, and by how much its correction reduces the errors."""
    takes = removed(curve.removes)
    return f"{curve.sentence()}{takes and f'; the correction {takes}'}."


def run_sentence(run: RunFound) -> str:
    """Say which parameter of which run differs from that of the other runs, and by how much."""
    what, _, where = run.parameter.partition(":")
    what = split_unit(what.removesuffix("_ohm"))[0]
    scale, unit = readable([run.value], run.unit)
    value = with_sd(Estimate(scale * run.value, scale * run.sd, unit))
    sign = "" if value.startswith("-") or not np.isfinite(run.value) else "+"
    takes = removed(run.removes)
    reduces = takes and f"; this shift {takes}"
    return f"{run.run}: {what}{where and f' of {where}'} differs by {sign}{value} from the other runs{reduces}."


def number(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, '-' if it is not finite."""
    if not np.isfinite(value):
        return "-"
    if 1e3 <= abs(value) < 1e7:
        return f"{float(f'{value:.{digits}g}'):,.0f}"
    return f"{value:.{digits}g}"


def with_sd(estimate: Estimate) -> str:
    """Return 'value ± sd unit', the value rounded to the digits of its sd."""
    value, sd = estimate.value, estimate.sd
    unit = f" {estimate.unit}" if estimate.unit else ""
    if not (np.isfinite(sd) and sd > 0.0):
        return f"{value:.5g}{unit}"
    first = int(np.floor(np.log10(sd)))
    if not -5 <= first <= 4:
        return f"{value:.5g} ± {sd:.2g}{unit}"
    decimals = max(0, 1 - first)
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}{unit}"
