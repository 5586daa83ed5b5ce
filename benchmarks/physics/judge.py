"""How right an answer is and how well its model predicts: names against the truth, held-out errors against the best."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.discrepancy.rates import Rate, rate
from benchmarks.physics.truth import Truth

ASKED_RIGHT, ASKED_WRONG, ASKED_RATIO = 0.70, 0.03, 1.1
# How many of its sd a parameter has to be from zero, where it is what names a thing.
CLEAR_SD = 2.0


@dataclasses.dataclass(frozen=True)
class Row:
    """What came out of one cell.

    Attributes:
        name: of the cell.
        about: the parameter set and what is hidden, in words.
        truth: what is right.
        answer: of the diagnosis, with `ladder` and `seconds`; or with `failed`; empty where it was not asked.
        reference: with `errors`, or with `failed`; empty where it was not asked.
    """

    name: str
    about: str
    truth: Truth
    answer: dict[str, Any]
    reference: dict[str, Any]

    @property
    def answered(self) -> bool:
        """Whether there is an answer."""
        return "verdict" in self.answer

    @property
    def named(self) -> tuple[str, ...]:
        """The names of the effects in the answer."""
        return tuple(effect["name"] for effect in self.answer.get("effects", ()))

    @property
    def missed(self) -> tuple[str, ...]:
        """What is expected and not named."""
        return tuple(either for either in self.truth.expected if not is_named(either, self.answer))

    @property
    def wrong(self) -> tuple[str, ...]:
        """What is named and not allowed."""
        return tuple(name for name in self.named if name not in self.truth.allowed)

    @property
    def right(self) -> bool:
        """Whether all that is expected is named, and nothing wrong."""
        return self.answered and not self.missed and not self.wrong

    @property
    def right_verdict(self) -> bool:
        """Whether the verdict is one that is not wrong."""
        return self.answer.get("verdict") in self.truth.verdicts

    def after(self, channel: str) -> float:
        """Return the final model's error on check runs; NaN where there is none."""
        return _number(self.answer.get("error", {}).get(channel, {}).get("after", {}).get("check"))

    def tried(self, channel: str) -> dict[str, float]:
        """Return the error on check runs of every model tried: the ladder's, and the reference."""
        found = {rung["name"]: _number(rung["error"].get(channel, {}).get("check")) for rung in self.answer["ladder"]}
        found["reference"] = _number(self.reference.get("errors", {}).get(channel, {}).get("check"))
        return {name: error for name, error in found.items() if np.isfinite(error) and error > 0.0}

    def ratios(self) -> dict[str, float]:
        """Return the final model's error over the best one's, on check runs, by channel."""
        found = {}
        for channel in self.answer.get("error", {}) if self.answered else ():
            tried = self.tried(channel)
            if tried and np.isfinite(self.after(channel)):
                found[channel] = self.after(channel) / min(*tried.values(), self.after(channel))
        return found

    def best(self, channel: str) -> tuple[str, float]:
        """Return the best model tried on a channel, and its error."""
        tried = self.tried(channel)
        name = min(tried, key=tried.__getitem__, default="")
        return name, tried.get(name, float("nan"))


def is_named(either: str, answer: dict[str, Any]) -> bool:
    """Return whether an answer names a hidden thing in one of the ways of `benchmarks.physics.truth.NAMES`."""
    effects = {effect["name"]: effect for effect in answer.get("effects", ())}
    curves = {curve.get("port") for curve in answer.get("curves", ())}
    for one in either.split("|"):
        name, _, more = one.partition(":")
        if name == "curve":
            if more in curves:
                return True
        elif name in effects and (not more or _is_clear(effects[name].get("parameters", {}).get(more))):
            return True
    return False


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Return what the rows come to; a cell without an answer counts as not right."""
    asked = [row for row in rows if row.answer]
    answered = [row for row in asked if row.answered]
    ratios = {f"{row.name} {channel}": ratio for row in answered for channel, ratio in row.ratios().items()}
    values = np.array(list(ratios.values()))
    worst = max(ratios, key=ratios.__getitem__, default="")
    expected = [either for row in answered for either in row.truth.expected]
    missed = [either for row in answered for either in row.missed]
    return {
        "cells": len(rows),
        "asked": len(asked),
        "failed": [row.name for row in asked if not row.answered],
        "right": _as_json(rate(row.right for row in asked)),
        "with_a_wrong_name": _as_json(rate(bool(row.wrong) for row in answered)),
        "expected_named": [len(expected) - len(missed), len(expected)],
        "missed": _counted(missed),
        "wrong": _counted([name for row in answered for name in row.wrong]),
        "right_verdict": _as_json(rate(row.right_verdict for row in answered)),
        "single_runs_blamed": _as_json(rate(bool(row.answer.get("runs")) for row in answered)),
        "ratios": len(ratios),
        "geometric_mean_ratio": float(np.exp(np.mean(np.log(values)))) if values.size else None,
        "median_ratio": float(np.median(values)) if values.size else None,
        "worst_ratio": ratios.get(worst),
        "worst": worst,
        "median_seconds": float(np.median([row.answer["seconds"] for row in answered])) if answered else None,
    }


def _is_clear(parameter: Any) -> bool:
    if not isinstance(parameter, dict):
        return False
    value, sd = _number(parameter.get("value")), _number(parameter.get("sd"))
    return bool(abs(value) > CLEAR_SD * sd)


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _counted(names: Sequence[str]) -> dict[str, int]:
    return {name: names.count(name) for name in sorted(set(names))}


def _as_json(found: Rate) -> dict[str, int]:
    return dataclasses.asdict(found)
