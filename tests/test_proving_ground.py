"""The judge of the blind cases counts what it says it counts."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.discrepancy.generate import Blind
from benchmarks.discrepancy.judge import Judged, Rate, metrics, power, reliability, report


def said(verdict: str, *names: str, probability: float = 0.97, sd: float = 0.1, **more: Any) -> dict[str, Any]:
    effects = [{"name": name, "parameters": {"a": {"value": 1.0, "sd": sd}}} for name in names]
    candidates = [
        {"name": "+".join(names) or "base", "probability": probability},
        {"name": "windage", "probability": 0.01},
    ]
    error = {"speed_rad_s": {"noise_floor": 0.5, "after": {"fit": 0.5, "check": 0.6}}}
    return {
        "verdict": verdict,
        "effects": effects,
        "candidates": candidates,
        "error": error,
        "unexplained": None,
    } | more


def case(group: str, answer: dict[str, Any], *hidden: str, outside: str = "", hostile: bool = False, a: float = 1.1):
    return Judged(1, Blind("motor", group, {name: {"a": a} for name in hidden}, outside, hostile), answer, 10.0)


CASES = [
    case("null", said("adequate")),
    case("null", said("missing_effect", "windage"), hostile=True),
    case("single", said("missing_effect", "saturation"), "saturation"),
    case("single", said("missing_effect", "saturation"), "windage", a=1.5),
    case("single", said("unknown_effect", unexplained="a law"), "saturation"),
    case("double", said("missing_effect", "gear_loss", "windage", probability=0.7), "windage", "gear_loss", a=2.0),
    case("sensor", said("missing_effect", "windage"), "current_offset"),
    case("outside", said("unknown_effect", unexplained="a law"), outside="brake_that_fades"),
]


def test_each_rate_counts_its_own_cases():
    counts = {name: f"{r.hits} of {r.of}" for name, r in metrics(CASES).items() if isinstance(r, Rate)}
    assert counts == {
        "false alarms on clean nulls": "0 of 1",
        "false alarms on hostile nulls": "1 of 1",
        "right verdict": "5 of 8",
        "singles: right effect first": "1 of 3",
        "singles: right effect in the first three": "2 of 3",
        "doubles exactly right": "1 of 1",
        "outside the catalogue recognised": "1 of 1",
        "known effects called unknown": "1 of 5",
        "physics called a sensor's fault": "0 of 4",
        "a sensor's fault called physics": "1 of 1",
        "answers above 0.95 that are right": "3 of 7",
        "parameters in their 95 % interval": "1 of 3",
    }
    assert metrics(CASES)["check error over floor, median"] == pytest.approx(1.2)


def test_power_and_reliability_count_by_effect_and_by_probability():
    assert power(CASES)["saturation"] == Rate(1, 2)
    assert power(CASES)["windage"] == Rate(1, 2)
    assert reliability(CASES)["0.50 to 0.80"] == Rate(1, 1)


def test_the_misses_are_listed():
    misses = report(CASES).partition("not right\n")[2].splitlines()
    assert len(misses) == 4
    assert "0001 motor: windage | missing_effect: saturation" in misses
