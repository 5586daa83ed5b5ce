"""What held-out runs contradict: an effect without which they are predicted better, and not its curve in its place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxmodel.diagnosis import comparison, held_out
from jaxmodel.diagnosis.diagnosis import _hypotheses
from jaxmodel.diagnosis.held_out import CHANGED, _of_chi_square, _raising
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.result import ChannelError
from jaxmodel.diagnosis.search import Found, Search
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.likelihood import ChannelWeight

NAME = "arrhenius_resistance"


def search(monkeypatch: pytest.MonkeyPatch, errors: dict[tuple[bool, str], float], group: str = "effect") -> Any:
    """A search whose check runs have these errors, by whether the effect is in the model, and the kind of curves."""

    def fit(labels: tuple[str, ...], curves: str) -> tuple[bool, str]:
        return NAME in labels, curves

    def of_fit(cache: Any, name: str, found: tuple[bool, str], compared: bool) -> Any:
        return SimpleNamespace(errors={"voltage_V": ChannelError(0.01, errors[found])})

    monkeypatch.setattr(held_out, "rung", of_fit)
    cache, found = object.__new__(FitCache), object.__new__(Search)
    space = SimpleNamespace(candidates={NAME: SimpleNamespace(group=group)})
    for where, name, what in (
        (cache, "fit", fit),
        (cache, "tolerances", {"voltage_V": 0.01}),
        (cache, "space", space),
        (found, "cache", cache),
        (found, "compared", lambda *_: (fit((NAME,), "beside"), fit((), "beside"))),
    ):
        monkeypatch.setitem(vars(where), name, what)
    return found


def test_an_effect_without_which_check_runs_are_predicted_better_is_contradicted(monkeypatch: pytest.MonkeyPatch):
    errors = {(True, "all"): 0.03, (False, "all"): 0.02, (True, "beside"): 0.031, (False, "beside"): 0.021}
    found = _raising(search(monkeypatch, errors), (NAME,), [NAME])
    assert found[NAME] == (pytest.approx(1.0), "on check runs it raises the error of voltage_V from 20 to 30 mV")


def test_a_curve_that_is_the_effect_by_another_name_does_not_contradict_it(monkeypatch: pytest.MonkeyPatch):
    errors = {(True, "all"): 0.03, (False, "all"): 0.02, (True, "beside"): 0.03, (False, "beside"): 0.06}
    assert _raising(search(monkeypatch, errors), (NAME,), [NAME]) == {}


@pytest.mark.parametrize("group", ["law", "run"])
def test_a_law_and_a_shift_of_one_run_have_no_curve_of_their_name(monkeypatch: pytest.MonkeyPatch, group: str):
    errors = {(True, "all"): 0.03, (False, "all"): 0.02, (True, "beside"): 0.03, (False, "beside"): 0.06}
    assert _raising(search(monkeypatch, errors, group), (NAME,), [NAME])


@pytest.mark.parametrize("held_out", ["", "on check runs it raises the error of voltage_V from 3 to 9 mV"])
def test_what_held_out_runs_contradict_is_no_rival(plain_small: Investigation, held_out: str) -> None:
    search = Search(plain_small.cache)
    refused = comparison.Test("self_heating", 50.0, 8.0, 1.0, 9.0, True, True, (), held_out=held_out)
    found = Found(plain_small.cache.base, ((),), {}, {"self_heating": refused}, {})
    assert _hypotheses(search, found)[()] == pytest.approx(1.0 if held_out else 0.0, abs=1e-9)


def test_held_out_errors_that_last_count_as_few_readings():
    """White errors of fitted runs make no reading of a check run independent whose errors go on for minutes.

    An offset of the current that was planted left a simulated cell: 5.9 mV became 6.0, and chi-square rose by 98.
    """
    rng, time = np.random.default_rng(0), np.arange(4000)
    weight = ChannelWeight(0.003, 1.0, 8000)
    slow, white = 0.006 * np.sin(time / 300.0), 0.006 * rng.standard_normal(time.size)
    moved = {}
    for name, errors in (("slow", slow), ("white", white)):
        lowered, moved[name] = _of_chi_square(weight, [errors + 0.001], [errors])
        assert lowered == pytest.approx(-moved[name], rel=1.0)
    assert moved["slow"] < CHANGED < moved["white"]
    assert moved["white"] == pytest.approx(time.size * (0.001 / 0.006) ** 2, rel=0.2)
