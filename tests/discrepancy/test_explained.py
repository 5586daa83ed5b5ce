"""Beside a law in no catalogue only effects that explain much are named: small additions make up for the law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from discrepancy.best_model import BestModel
from discrepancy.explained import explains_all_but_little, without_small_additions
from discrepancy.hypothesis import Hypothesis, Labels
from discrepancy.ladder import ChannelError, Rung
from discrepancy.noise import NoiseModel
from discrepancy.problem import Start
from discrepancy.session import Session
from tests.discrepancy.test_search import _Model

ALONE = {"": (20.0, 10.0), "first": (2.0, 4.0), "second": (19.0, 9.0)}


class Bench(Session):
    """A session whose models leave so much more than a noise of 1, in mean squares of two channels."""

    def __init__(self, leaves: Mapping[str, tuple[float, float]]) -> None:
        self.leaves = {frozenset(key.split()): errors for key, errors in leaves.items()}
        self.noise = {name: NoiseModel(1.0, 0.0, "stated") for name in ("voltage_V", "speed_rad_s")}

    def hypothesis(
        self, labels: Sequence[str] = (), starts: Sequence[Start] = (), rival: float | None = None
    ) -> _Model:
        return _Model(tuple(sorted(labels)), sum(self.leaves[frozenset(labels)]))

    def hypotheses(self, sets: Sequence[tuple[Labels, Sequence[Start]]]) -> list[Hypothesis]:
        return [self.hypothesis(labels) for labels, _ in sets]

    def rung(self, name: str, hypothesis: Hypothesis | None) -> Rung:
        assert hypothesis is not None
        left = np.sqrt(1.0 + np.array(self.leaves[frozenset(hypothesis.labels)]))
        errors = {
            channel: ChannelError(float(rms), float("nan")) for channel, rms in zip(self.noise, left, strict=True)
        }
        return Rung(name, hypothesis.labels, {}, (), errors, {}, 0.0, 1)


@pytest.mark.parametrize(
    ("both", "named"),
    [
        ((1.5, 3.8), ("first",)),  # 2.5 % of one channel's excess, 2 % of the other's
        ((2.0, 3.4), ("first", "second")),  # 6 % of the other's
        ((0.0, 0.0), ("first", "second")),
        ((2.5, 4.5), ("first",)),  # worse
    ],
)
def test_a_second_effect_is_named_where_it_explains_much_in_a_channel(both, named):
    session = Bench(ALONE | {"first second": both})
    best = BestModel(session, session.hypothesis(("first", "second")))
    assert without_small_additions(best).best.labels == named


@pytest.mark.parametrize(
    ("leaves", "little"),
    [
        ((0.4, 0.4), True),  # 2 and 4 % of the two channels' excess
        ((0.4, 0.6), False),  # 6 % of the other's
        ((0.0, 9.0), False),
    ],
)
def test_effects_explain_all_but_little_only_where_no_channel_keeps_much(leaves, little):
    session = Bench({"": (20.0, 10.0), "first": leaves})
    assert explains_all_but_little(session, session.hypothesis(("first",))) is little


def test_nothing_explains_nothing():
    session = Bench({"": (0.05, 0.05), "first": (0.0, 0.0)})
    assert not explains_all_but_little(session, session.hypothesis())
    assert not explains_all_but_little(session, session.hypothesis(("first",)))  # no channel fails
