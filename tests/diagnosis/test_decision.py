"""The verdict: every rule by evidence made by hand, in the order of the table."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.diagnosis.decision import RULES, ChannelEvidence, Evidence, decide
from jaxmodel.diagnosis.result import VERDICTS

# A channel whose noise is 1, and all is well.
WELL = ChannelEvidence(noise=1.0, before=10.0, fit=1.0, check=1.1, tolerance=2.0, check_before=10.0)
LEFT = dataclasses.replace(WELL, fit=8.0, check=8.5)
FAILING = dataclasses.replace(WELL, check=3.0, tolerance=1.0)
NOTHING = Evidence(
    named=(), possible=(), sensors=frozenset(), unknown=(), channels={"voltage_V": WELL}, extrapolates=False
)
OFFSET, KIN = "voltage_offset:voltage_V", "charge_transfer"


def evidence(**changes) -> Evidence:
    return dataclasses.replace(NOTHING, **changes)


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        (evidence(unknown=("the overpotential lacks a law",)), "unknown law"),
        (evidence(channels={"voltage_V": LEFT}), "large remaining error"),
        (evidence(named=("self_heating",)), "named"),
        (evidence(named=("self_heating", OFFSET), sensors=frozenset({OFFSET})), "named"),
        (evidence(named=(OFFSET,), sensors=frozenset({OFFSET})), "fault"),
        (evidence(named=(OFFSET,), possible=("self_heating",), sensors=frozenset({OFFSET})), "fault"),
        (evidence(named=(OFFSET, KIN), sensors=frozenset({OFFSET}), kinetics=frozenset({KIN})), "fault"),
        (evidence(named=(KIN,), kinetics=frozenset({KIN})), "named"),
        (evidence(possible=("self_heating",)), "open"),
        (evidence(channels={"voltage_V": FAILING}), "held out"),
        (NOTHING, "adequate"),
    ],
)
def test_each_rule_gives_its_verdict(given: Evidence, rule: str):
    found = decide(given)
    assert found.rule == rule
    assert found.verdict == RULES[rule][0]
    assert (found.unexplained is not None) == (rule in ("unknown law", "large remaining error", "held out"))


def test_an_effect_that_takes_most_of_the_held_out_error_is_named_whatever_is_left_of_the_fit():
    most = dataclasses.replace(LEFT, check_before=30.0)
    little = dataclasses.replace(LEFT, check_before=10.0)
    assert decide(evidence(named=("self_heating",), channels={"voltage_V": most})).rule == "named"
    assert decide(evidence(named=("self_heating",), channels={"voltage_V": little})).rule != "named"


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"before": 2.0, "check_before": 2.0}, "open"),  # within the tolerance, but that is assumed
        ({"before": 0.6, "check_before": 0.6}, "adequate"),
        ({"before": 0.6, "check_before": 0.7}, "open"),
        ({"before": 2.0, "check_before": 2.0, "stated_tolerance": True}, "adequate"),
        ({"before": 2.1, "check_before": 2.0, "stated_tolerance": True}, "open"),
        ({"before": 2.0, "check_before": np.nan, "stated_tolerance": True}, "adequate"),  # no check run
    ],
)
def test_what_is_possible_decides_nothing_where_the_base_model_is_within_tolerance(changes: dict, rule: str):
    channel = dataclasses.replace(WELL, **changes)
    assert decide(evidence(possible=("self_heating",), channels={"voltage_V": channel})).rule == rule


def test_of_several_rules_that_hold_the_first_in_the_table_gives_the_verdict():
    every = [
        {"unknown": ("a law",)},
        {"channels": {"voltage_V": dataclasses.replace(LEFT, check=30.0)}},
        {"named": ("self_heating",)},
        {},
        {"possible": ("self_heating",)},
        {"channels": {"voltage_V": FAILING}},
        {},
    ]
    for first, rule in enumerate(RULES):
        if not every[first] and rule != "adequate":
            continue
        changes: dict = {}
        for more in reversed(every[first:]):
            changes |= more
        assert decide(evidence(**changes)).rule == rule


def test_every_verdict_is_one_that_the_answer_may_give():
    assert {verdict for verdict, _ in RULES.values()} == set(VERDICTS)


@pytest.mark.parametrize(
    ("changes", "is_left"),
    [
        ({}, True),
        ({"tolerance": 8.0}, False),  # within it
        ({"tolerance": 7.9}, True),
        ({"check": 4.9}, False),  # most is explained on check runs
        ({"check": np.nan, "check_before": np.nan}, True),  # no check run
        ({"fit": 2.9, "before": 3.0}, False),  # near the noise
        ({"fit": 4.9}, False),  # most is explained
        ({"fit": 5.1}, True),
    ],
)
def test_what_is_left_matters_where_it_is_far_above_noise_and_tolerance(changes: dict, is_left: bool):
    channel = dataclasses.replace(LEFT, **changes)
    assert (decide(evidence(channels={"voltage_V": channel})).rule == "large remaining error") == is_left


@pytest.mark.parametrize(
    ("changes", "fails"),
    [
        ({}, True),
        ({"tolerance": 3.0}, False),  # assumed or stated
        ({"tolerance": 3.0, "stated_tolerance": True}, False),
        ({"tolerance": 2.9}, True),
        ({"tolerance": 2.9, "stated_tolerance": True}, True),
        ({"check": 1.24}, False),
        ({"check": 1.26}, True),
        ({"fit": 0.2, "check": 1.1}, False),  # below the noise no ratio says anything
        ({"check": np.nan}, False),  # no check run
    ],
)
def test_held_out_runs_fail_beyond_a_factor_and_the_tolerance(changes: dict, fails: bool):
    result = decide(evidence(channels={"voltage_V": dataclasses.replace(FAILING, **changes)}))
    assert result.rule == ("held out" if fails else "adequate")


def test_words_say_where_and_how_far():
    result = decide(evidence(channels={"voltage_V": FAILING, "cell_temperature_degC": WELL}, extrapolates=True))
    assert result.unexplained == (
        "on check runs the error of voltage is 3.0 times that on fit runs; a check run is outside the conditions of "
        "the fit runs"
    )
    left = decide(evidence(channels={"voltage_V": LEFT})).unexplained or ""
    assert left.startswith("the error of voltage remains at 8 V (noise 1 V);")
