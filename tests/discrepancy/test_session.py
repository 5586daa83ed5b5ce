"""A session's fits: what two at a time must come near does not depend on which of them is done first."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from discrepancy.hypothesis import Hypothesis
from discrepancy.session import Session


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
