"""A session's fits: what two at a time must come near does not depend on which of them is done first."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from discrepancy.candidates import make_candidate
from discrepancy.hypothesis import Hypothesis
from discrepancy.session import Session
from jaxmodel.effects import CATALOGUE


class Fitted(Hypothesis):
    """A model of which nothing is known but what its fit left."""

    def __init__(self, labels: tuple[str, ...], objective: float) -> None:
        object.__setattr__(self, "labels", labels)
        object.__setattr__(self, "fitted", SimpleNamespace(objective=objective))


def test_what_fits_must_come_near_is_settled_before_each_two():
    objectives = {("a",): 5.0, ("b",): 3.0, ("c",): 1.0, ("d", "e"): 0.5, ("f",): 0.1}
    session = Session.__new__(Session)
    session._hypotheses = {}
    asked = {}

    def fitted(labels, starts, rival):
        asked[labels] = rival
        session._hypotheses[labels] = Fitted(labels, objectives[labels])
        return session._hypotheses[labels]

    session.hypothesis = fitted
    found = session.hypotheses([(labels, []) for labels in objectives])
    assert [one.labels for one in found] == list(objectives)
    # A pair is no rival of a single effect.
    assert asked == {("a",): np.inf, ("b",): np.inf, ("c",): 3.0, ("d", "e"): 3.0, ("f",): 1.0}


def test_what_makes_a_program_slow_is_shared_with_its_like_alone():
    session = Session.__new__(Session)
    names = ("viscous_friction", "windage", "brush_drop", "saturation", "clock_shift")
    made = [make_candidate(CATALOGUE[name]()) for name in names]
    made.append(make_candidate(CATALOGUE["temperature_lag"](column="winding_temperature_degC")))
    session.candidates = {candidate.label: candidate for candidate in made}
    lag = made[-1].label
    session._families = [()]
    session.bring_together(("windage",), ("viscous_friction", "clock_shift", "brush_drop", "saturation", lag))
    families = {frozenset(family) for family in session._families}
    assert families == {
        frozenset(),
        frozenset({"windage", "viscous_friction", lag}),
        frozenset({"windage", "clock_shift"}),
        frozenset({"windage", "brush_drop", "saturation"}),
    }
