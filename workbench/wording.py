"""How results are said: verdicts, models and candidates in plain words, the same in the terminal and in the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discrepancy.ladder import Estimate
from discrepancy.result import Diagnosis, NamedEffect

VERDICT_TITLES = {
    "adequate": "Nothing is missing",
    "missing_effect": "The model misses an effect",
    "sensor_fault": "A sensor is at fault",
    "unknown_effect": "Something unknown is missing",
    "undecided": "This data cannot tell",
    "": "Calibrated",
}


def join(parts: Sequence[str], last: str = "and") -> str:
    """Return 'a, b and c'."""
    parts = list(parts)
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}" if parts else ""


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """Return the verdict in one sentence."""
    named = join([_with_probability(effect) for effect in diagnosis.effects])
    match diagnosis.verdict:
        case "adequate":
            return "The calibrated base model is as good as the sensors: nothing is missing that this data could show."
        case "missing_effect":
            return f"The base model misses {named}{_of_another_form(diagnosis)}."
        case "sensor_fault":
            return f"The physics is right, a sensor is not: {named}{_of_another_form(diagnosis)}."
        case "unknown_effect":
            beside = f" beside {named}" if named else ""
            what = f": {diagnosis.unexplained.rstrip('.')}" if diagnosis.unexplained else ""
            return f"Something is missing{beside} that no effect of the catalogue explains{what}."
        case "undecided" if diagnosis.unexplained:
            return (
                f"The base model is as good as the sensors where it was fitted, and not beyond: {diagnosis.unexplained}"
            )
        case "undecided":
            rivals = [candidate_name(name) for name, p in diagnosis.candidates if p >= 0.05] or ["the candidates"]
            found = f"This data shows {named}, but it" if named else "This data"
            return (
                f"{found} cannot tell between {join(rivals)}."
                if len(rivals) > 1
                else f"{found} cannot decide on {rivals[0]}."
            )
    return "The base model is calibrated; no effects were tried."


def _of_another_form(diagnosis: Diagnosis) -> str:
    left = (diagnosis.unexplained or "").rstrip(".")
    return f", in a form that differs a little from the catalogue's: {left}" if left else ""


def _with_probability(effect: NamedEffect) -> str:
    return f"{effect_name(effect.label)} (probability {effect.probability:.2f})"


def effect_name(label: str) -> str:
    """Return an effect's label as it reads: 'current_offset:current_A' is 'current_offset of current_A'."""
    return label.replace(":", " of ")


def candidate_name(name: str) -> str:
    """Return a hypothesis in words."""
    known = {"base": "the base model alone", "something_else": "something else"}
    return known.get(name) or " with ".join(effect_name(part) for part in name.split("+"))


def rung_name(diagnosis: Diagnosis, number: int) -> str:
    """Return a rung of the ladder in words: what was added to the one before."""
    if number == 0:
        return "base model, as stated"
    if number == 1:
        return "calibrated base model"
    before = diagnosis.ladder[number - 1].added
    new = [effect_name(label) for label in diagnosis.ladder[number].added if label not in before]
    return f"{'with' if number == 2 else 'and'} {join(new)}" if new else diagnosis.ladder[number].name


def final_name(diagnosis: Diagnosis) -> str:
    """Return the model that the diagnosis ends with in words, its effects in the order of the ladder."""
    added = dict.fromkeys(label for rung in diagnosis.ladder for label in rung.added)
    return f"with {join([effect_name(label) for label in added])}" if added else "calibrated base model"


def number(value: float, digits: int = 3) -> str:
    """Return a number to some significant digits, '-' where there is none."""
    if not np.isfinite(value):
        return "-"
    if 1e3 <= abs(value) < 1e7:
        return f"{float(f'{value:.{digits}g}'):,.0f}"
    return f"{value:.{digits}g}"


def with_sd(estimate: Estimate) -> str:
    """Return 'value ± sd unit', the value to the digits that its sd leaves."""
    value, sd = estimate.value, estimate.sd
    unit = f" {estimate.unit}" if estimate.unit else ""
    if not (np.isfinite(sd) and sd > 0.0):
        return f"{value:.5g}{unit}"
    first = int(np.floor(np.log10(sd)))
    if not -5 <= first <= 4:
        return f"{value:.5g} ± {sd:.2g}{unit}"
    decimals = max(0, 1 - first)
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}{unit}"
