"""An investigation by hand, in any order: a model is what was added to it, and nothing raises but a sentence."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from jaxmodel.base.errors import EffectError, MeasurementError
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.search import Search
from jaxmodel.fit.estimate import Fit
from tests.diagnosis.conftest import HEATING
from tests.diagnosis.made_cases import SMALL_KEPT, SMALL_NOISE, investigation_of, small_cell
from tests.stress.trial import faults

ADDITIONS = ("self_heating", "arrhenius_resistance", "voltage_offset:voltage_V", "contact_resistance@run-01")
PHYSICS = {*ADDITIONS[:2]}
CURVE = "series_resistance_curve"
# What is no candidate: what is misspelt, what is ruled out, of a run that is not there, and nothing at all.
WRONG = ("self_heatin", "slow_diffusion", "contact_resistance@run-09", "", "a b\n")
READERS: Mapping[str, Callable[[Investigation], object]] = {
    "errors": Investigation.errors,
    "where": Investigation.where,
    "all previews": Investigation.preview,
    "some previews": lambda one: one.preview("self_heating", CURVE),
    "a map": lambda one: one.regime_map("voltage_V"),
    "parameters": Investigation.parameters,
    "page": Investigation._repr_html_,
    "posterior": lambda one: one.to_xarray(draws=8),
    "extended case": Investigation.extended_case,
}


@functools.cache
def warm() -> Case:
    return small_cell(HEATING, seed=1)


class StoppedByUser(Exception):
    """The user has stopped a search."""


class ByHand(RuleBasedStateMachine):
    """One investigation, and the models that it has been through."""

    # By what is ruled out: what was fitted in one order of steps is there in the next.
    originals: ClassVar[dict[str, Investigation]] = {}
    # By what was added: the numbers of an investigation that has added nothing else, the last first.
    numbers: ClassVar[dict[frozenset[str], Fit]] = {}

    @initialize(ruled_out=st.sampled_from(("nothing", "arrhenius_resistance")))
    def begin(self, ruled_out: str) -> None:
        if ruled_out not in self.originals:
            kept = [name for name in SMALL_KEPT if name != ruled_out]
            self.originals[ruled_out] = investigation_of(warm(), *kept)
        self.ruled_out = ruled_out
        self.one = self.another()
        self.path: list[tuple[frozenset[str], Fit]] = [(frozenset(), self.one.model)]

    def another(self) -> Investigation:
        """Return one that has gone nowhere yet, with what was fitted before."""
        one = copy.copy(self.originals[self.ruled_out])
        one.searching = Search(one.cache)
        return one

    def went_to(self, labels: frozenset[str]) -> None:
        """Note that a model is the present one now."""
        self.path.append((labels, self.one.model))

    def refused(self, do: Callable[..., object], *names: str, error: type = EffectError) -> None:
        with pytest.raises(error) as caught:
            do(*names)
        assert faults(str(caught.value), [""]) == "", caught.value

    @rule(
        verb=st.sampled_from(("add", "add", "add", "drop", "undo", "search", "follow")),
        names=st.sets(st.sampled_from(ADDITIONS), max_size=2),
        times=st.integers(1, 4),
    )
    def change(self, verb: str, names: set[str], times: int) -> None:
        present = self.path[-1][0]
        if verb == "undo":
            for _ in range(times):
                assert self.one.undo() is self.one
                self.path = self.path[:-1] or self.path
                assert self.one.model is self.path[-1][1]  # the same numbers, and nothing is fitted again
        elif verb == "follow":
            self.one = self.another().follow(self.one.path)
        elif verb == "search":
            self.search(times)
            assert present <= {*self.one.added}  # what is there stays
        elif self.ruled_out in names:
            self.refused(getattr(self.one, verb), *names)
        else:
            assert getattr(self.one, verb)(*names) is self.one
            self.went_to(present | names if verb == "add" else present - names)

    def search(self, stop_after: int) -> None:
        """Search to the end, or until so many models were shown."""
        seen = []

        def each() -> None:
            self.went_to(frozenset(self.one.added))
            seen.append(self.one.added)
            if len(seen) == stop_after:
                raise StoppedByUser

        try:
            assert self.one.search(each).final is self.one.model
        except StoppedByUser:
            assert len(seen) == stop_after

    @rule(good=st.lists(st.sampled_from(ADDITIONS), max_size=1), bad=st.sampled_from(WRONG))
    def a_mistake(self, good: list[str], bad: str) -> None:
        self.refused(self.one.add, *good, bad)
        self.refused(self.one.add, *good, CURVE)
        self.refused(self.one.drop, *good, bad)
        self.refused(lambda *names: self.one.follow([[], names]), *good, bad)
        self.refused(self.one.preview, *good, bad)
        self.refused(self.one.regime_map, bad, error=MeasurementError)

    @rule(name=st.sampled_from(sorted(READERS)))
    def read(self, name: str) -> None:
        found = READERS[name](self.one)
        if isinstance(found, Case):
            assert PHYSICS & {*found.effects} == PHYSICS & self.path[-1][0]

    @invariant()
    def the_present_model_is_what_was_added(self) -> None:
        labels, fit = self.path[-1]
        assert [*map(frozenset, self.one.path)] == [one for one, _ in self.path]
        assert frozenset(self.one.added) == labels
        assert self.one.model is fit
        assert {*self.one.noise} == {*SMALL_NOISE}
        if labels not in self.numbers:
            alone = investigation_of(warm(), *SMALL_KEPT)
            for label in reversed(self.one.added):
                alone.add(label)
            assert alone.added == self.one.added
            self.numbers[labels] = alone.model
        best = self.numbers[labels]
        np.testing.assert_allclose((fit.free - best.free) / best.sd, 0.0, atol=1e-3)

    @invariant()
    def every_view_is_of_the_present_model(self) -> None:
        labels = self.path[-1][0]
        assert not labels & {*self.one.candidates()["name"]}
        shown = [frozenset(added.split(" + ")) - {"base"} for added in self.one.ladder()["added"]]
        assert shown == [*dict.fromkeys(before for before, _ in self.path)]


ByHand.TestCase.settings = settings(max_examples=20, stateful_step_count=12)
TestByHand = ByHand.TestCase
