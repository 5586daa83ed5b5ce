"""The order in which models are tried, on a bench where what each leaves is given and nothing is simulated."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from discrepancy.calibrate import Fit
from discrepancy.hypothesis import Hypothesis, Labels
from discrepancy.problem import BASE, Start
from discrepancy.screen import Screen
from discrepancy.search import search
from discrepancy.session import Session

CRITICAL_Z = 3.0


class _Model(Hypothesis):
    """A model of which only is known what it leaves."""

    def __init__(self, labels: Labels, chi2: float) -> None:
        nothing = np.zeros((1, 1))
        fitted = Fit(np.zeros(1), chi2, 0.0, np.eye(1), nothing[None], nothing, 0.0, 1)
        self.__dict__.update(labels=labels, fitted=fitted)

    @property
    def start(self) -> Start:
        return {label: np.zeros(1) for label in (BASE, *self.labels)}


class _Screen(Screen):
    """Scores of which only is known how strong they are."""

    def __init__(self, table: SimpleNamespace) -> None:
        self.__dict__.update(table=table)


class _Bench(Session):
    """A session whose models leave what a table says; one that is not in it leaves as much as its best part."""

    def __init__(
        self, leaves: Mapping[str, float], told: Mapping[str, float] | None = None, masked: Sequence[str] = ()
    ) -> None:
        """`told` are scores of effects beside the base model in place of those promised, `masked` pairs seen there."""
        self.masked = masked
        self.leaves = {frozenset(key.split()): chi2 for key, chi2 in leaves.items()}
        self.told = told or {}
        self.order = sorted(set().union(*self.leaves))
        self.candidates = {}
        self.models: dict[Labels, _Model] = {}

    def key(self, labels: Sequence[str]) -> Labels:
        return tuple(label for label in self.order if label in labels)

    def _chi2(self, labels: Sequence[str]) -> float:
        parts = itertools.chain.from_iterable(itertools.combinations(labels, n) for n in range(len(labels) + 1))
        return min(self.leaves.get(frozenset(part), np.inf) for part in parts)

    def hypothesis(self, labels: Sequence[str] = (), starts: Sequence[Start] = ()) -> _Model:
        key = self.key(labels)
        return self.models.setdefault(key, _Model(key, self._chi2(key)))

    def hypotheses(self, sets: Sequence[tuple[Labels, Sequence[Start]]]) -> list[Hypothesis]:
        return [self.hypothesis(*one) for one in sets]

    def again(self, sets: Sequence[Labels], rival: Hypothesis) -> list[Hypothesis]:
        return [self.hypothesis(labels) for labels in sets]

    def known(self) -> list[Hypothesis]:
        return list(self.models.values())

    def starts(self, screened: Screen, label: str) -> list[Start]:
        return [{label: np.ones(1)}]

    def bring_together(self, labels: Sequence[str], others: Sequence[str]) -> None:
        pass

    def masking(self, screened: Screen) -> list[tuple[Labels, list[Start]]]:
        return [(self.key(labels.split()), [{}]) for labels in self.masked]

    def screen(self, hypothesis: Hypothesis) -> Screen:
        def z(label: str) -> float:
            promised = float(np.sqrt(hypothesis.fitted.chi2 - self._chi2((*hypothesis.labels, label))))
            return promised if hypothesis.labels else self.told.get(label, promised)

        absent = sorted((label for label in self.order if label not in hypothesis.labels), key=lambda one: -z(one))
        effects = tuple(SimpleNamespace(name=label, z_equivalent=z(label)) for label in absent)
        significant = tuple(effect.name for effect in effects if effect.z_equivalent > CRITICAL_Z)
        return _Screen(SimpleNamespace(effects=effects, significant=significant, classes=()))


def _found(bench: _Bench) -> Labels:
    return search(bench, None).labels


def test_a_base_model_that_leaves_nothing_is_kept():
    bench = _Bench({"": 100.0, "a": 99.0, "b": 98.0})
    assert _found(bench) == ()
    assert set(bench.models) == {()}


def test_a_second_effect_must_be_worth_it():
    assert _found(_Bench({"": 1000.0, "a": 200.0, "a b": 185.0})) == ("a", "b")
    assert _found(_Bench({"": 1000.0, "a": 200.0, "a b": 191.5})) == ("a",)


def test_a_stand_in_for_two_effects_goes():
    bench = _Bench({"": 1000.0, "stand-in": 200.0, "a": 600.0, "b": 700.0, "a stand-in": 150.0, "a b": 20.0})
    assert _found(bench) == ("a", "b")


def test_a_second_effect_that_is_the_first_one_s_equal_takes_its_place():
    bench = _Bench({"": 1000.0, "first": 200.0, "second": 21.0, "first second": 20.0}, told={"second": 2.0})
    assert _found(bench) == ("second",)


def test_beside_what_explains_nothing_by_itself_only_rivals_of_the_first_are_tried():
    leaves = {"": 1e6, "first": 300.0, "rival": 400.0, "faint": 9e5, "other": 8e5, "first faint": 100.0}
    bench = _Bench(leaves | {"faint rival": 30.0, "faint other rival": 10.0})
    assert _found(bench) == ("faint", "rival")
    assert ("faint", "other") not in bench.models


def test_a_fault_that_slopes_tell_poorly_is_refitted_where_nothing_else_explains_all():
    decoys = {f"decoy {number}".replace(" ", "-"): 500.0 + number for number in range(5)}
    told = {name: 100.0 - number for number, name in enumerate(decoys)}
    bench = _Bench({"": 1e4, **decoys, "fault": 10.0}, told=told | {"fault": 50.0})
    assert _found(bench) == ("fault",)
    assert max(len(labels) for labels in bench.models) == 1, "and no pair is needed to find it"


def test_two_effects_that_hide_each_other_are_found_together():
    leaves = {"": 150.0, "one": 147.0, "two": 146.0, "other": 149.0, "one two": 60.0}
    assert _found(_Bench(leaves)) == ()
    assert _found(_Bench(leaves, masked=["one two"])) == ("one", "two")
    assert _found(_Bench(leaves | {"one two": 140.0}, masked=["one two"])) == (), "they must be worth it"
    assert _found(_Bench(leaves | {"two": 65.0}, told={"two": 0.0}, masked=["one two"])) == ()
