"""Channels, candidates and errors in the words that the pages show."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from jaxmodel.base.units import difference_unit, split_unit
from jaxmodel.diagnosis.wording import amount, join
from jaxmodel.fit.candidates import Candidate

GROUPS = {"effect": "Effects", "sensor": "Sensors", "specimen": "Single specimens", "run": "Single runs"}
NO_REASON = "These runs give no reason to add it."
# A candidate is said to help a channel if it takes away this share of its error.
_HELPS = 0.02


def title_of(candidate: Candidate) -> str:
    """Return what a candidate is called on the page: 'Self heating', 'Voltage offset of voltage'."""
    name, _, owner = candidate.label.partition("@")
    name, _, column = name.partition(":")
    words = name.replace("_", " ")
    words = re.sub(r"\b(ocv|rc|pwm)\b", lambda found: found[0].upper(), f"{words[:1].upper()}{words[1:]}", flags=re.I)
    of_column = f" of {split_unit(column)[0]}" if column else ""
    owned = f" {'of' if candidate.specimen else 'in'} {owner}" if owner else ""
    return f"{words}{of_column}{owned}"


def in_words(sentence: str, names: Iterable[str]) -> str:
    """Return a sentence with names such as `self_heating` as words."""
    for name in sorted(names, key=len, reverse=True):
        sentence = sentence.replace(name, name.replace("_", " "))
    return sentence


def reason_for(expected: Mapping[str, tuple[float, float]]) -> str:
    """Say what a candidate promises on the fit runs: the errors before and after, by channel; "" if nothing is less."""
    better, worse = [], []
    for channel, (before, after) in expected.items():
        (was, becomes), unit = amount(channel, [before, after])
        change = f"{split_unit(channel)[0]} from {was} to {becomes} {unit}"
        if after < (1.0 - _HELPS) * before:
            better.append(change)
        elif after > (1.0 + _HELPS) * before:
            worse.append(change)
    rises = f", and raise that of {join(worse)}" if worse else ""
    return f"It should reduce the error of {join(better)}{rises}." if better else ""


def beside_the_best(share: float, best: str) -> str:
    """Say what a candidate explains of what the best one does, which has a title."""
    if share >= 1.0:
        return "Nothing else explains more."
    percent = 100.0 * share
    much = f"{percent:.0f} %" if percent >= 1.0 else "less than 1 %"
    return f"It explains {much} of what {best[:1].lower()}{best[1:]} explains."


def channel_words(channel: str) -> dict[str, str]:
    """Return a channel's quantity, its unit and the unit of its differences."""
    quantity, unit = split_unit(channel)
    return {"name": channel, "quantity": quantity, "unit": unit, "difference": difference_unit(unit)}


def error_text(channel: str, value: float) -> str:
    """Return one error with its unit; '-' if there is none."""
    if not np.isfinite(value):
        return "-"
    (number,), unit = amount(channel, [value])
    return " ".join(filter(None, (number, unit)))


def finite(value: Any) -> float | None:
    """Return a number for JSON, which has no NaN."""
    number = float(value)
    return number if np.isfinite(number) else None
