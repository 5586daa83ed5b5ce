"""What a search asks of a name beyond its evidence: exact tables, a channel that shows it, held-out runs that agree."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxmodel.case.records import Case
from jaxmodel.diagnosis import comparison, held_out
from jaxmodel.diagnosis import search as search_module
from jaxmodel.diagnosis.held_out import _in_vain, confirmed
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.rungs import rung
from jaxmodel.diagnosis.search import Search
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.likelihood import ChannelWeight
from tests.diagnosis.made_cases import SMALL_KEPT, all_but, cache_of, made_cell, small_cell

SIGNIFICANT = comparison.Test("self_heating", 50.0, 8.0, 1.0, 9.0, True, True, ())


def without_thermometer(case: Case) -> Case:
    def of(run):
        outputs = {"voltage_V": run.measured.outputs["voltage_V"]}
        return dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs))

    return dataclasses.replace(case, runs=tuple(of(run) for run in case.runs), sensors={"voltage_V": 0.002})


def with_a_wrong_table(case: Case) -> Case:
    """The cell reads 8 mV more than its table above half charge, and 8 mV less below."""
    runs = []
    for run in case.runs:
        current = run.measured.inputs["current_A"]
        drawn = np.cumsum(current) * 10.0 / 3600.0 / 2.03
        off = 0.008 * np.tanh(10.0 * (run.initial_soc.value - drawn - 0.7))
        outputs = run.measured.outputs | {"voltage_V": run.measured.outputs["voltage_V"] + off}
        runs.append(dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs)))
    return dataclasses.replace(case, runs=tuple(runs))


def test_a_model_is_exact_where_noise_is_left_and_no_table_is_corrected(plain_small: Investigation):
    plain = Search(plain_small.cache)
    assert plain.is_noise(plain.cache.base)
    assert plain.is_exact(plain.cache.base)
    wrong = Search(cache_of(with_a_wrong_table(small_cell()), *SMALL_KEPT))
    assert wrong.is_noise(wrong.cache.base), "the curve of the table takes what it is off"
    assert not wrong.is_exact(wrong.cache.base)


def test_what_no_channel_shows_is_no_name():
    assert SIGNIFICANT.named
    assert SIGNIFICANT.enters
    unseen = dataclasses.replace(SIGNIFICANT, unseen="cell_temperature_degC")
    assert not unseen.named
    assert not unseen.enters
    assert unseen.why_not() == "it acts through cell_temperature_degC, which no channel shows"


@pytest.mark.parametrize("thermometer", [True, False])
def test_a_cell_that_warms_is_seen_by_its_thermometer_where_tables_are_wrong(thermometer: bool):
    case = with_a_wrong_table(small_cell({"self_heating": {"C_th": 60.0, "hA": 0.1}}, seed=1))
    search = Search(cache_of(case if thermometer else without_thermometer(case), *SMALL_KEPT))
    test = search.test(("self_heating",), "self_heating")
    assert test.unseen == ("" if thermometer else "cell_temperature_degC")


def test_what_is_far_off_enters_first_and_alone_is_refitted():
    case = small_cell({"self_heating": {"C_th": 60.0, "hA": 0.02}}, seed=1)
    cache = cache_of(case, *SMALL_KEPT)
    assert not cache.is_within_tolerance(cache.base)
    said: list[str] = []
    cache._progress = said.append
    found = Search(cache).run()
    assert found.final.added == ("self_heating",)
    first = said.index("adding self_heating")
    refitted = ", ".join(text for text in said[:first] if text.startswith("refitting"))
    assert "self_heating" in refitted
    assert len(refitted.split(",")) <= 2, "what leaves more than twice as much is not refitted"


def held_to(search: Search, M_V: float) -> list[str]:
    """What held-out runs contradict in a model with a hysteresis of that size."""
    cache, labels = search.cache, ("ocv_hysteresis",)
    fit, (place, *rest) = cache.fit(labels), cache.space.layout.of["ocv_hysteresis"]
    coordinate, x = cache.space.layout.coordinates[place], fit.x.copy()
    x[rest] = 0.0
    x[place] = (np.log(M_V) - coordinate.centre) / coordinate.spread
    key = next(key for key, one in cache._fits.items() if one is fit)
    cache._fits[key] = dataclasses.replace(fit, x=x)
    found = list(_in_vain(search, labels, labels))
    cache._fits[key] = fit
    return found


def test_held_out_runs_speak_against_what_they_do_not_show(tmp_path: Path):
    case = made_cell(tmp_path / "plain", {}).case
    search = Search(FitCache(case, without=all_but(case, "ocv_hysteresis", "ocv_curve")))
    assert held_to(search, 0.003) == ["ocv_hysteresis"]
    assert held_to(search, 0.001) == [], "with so much the check run is predicted better"


def test_held_out_runs_speak_for_what_they_show(tmp_path: Path):
    case = made_cell(tmp_path / "hysteresis", {"ocv_hysteresis": {"M_V": 0.02, "g": 30.0}}).case
    search = Search(FitCache(case, without=all_but(case, "ocv_hysteresis", "ocv_curve")))
    found = search.run()
    assert found.final.added == ("ocv_hysteresis",)
    assert confirmed(search, found).final.added == ("ocv_hysteresis",)


def test_what_is_missing_on_held_out_runs_weighs_a_change_of_their_prediction():
    """A change of 5 mV in 200 independent readings is much beside 1 mV of noise, and nothing beside 50 mV of error."""
    weight = ChannelWeight(0.001, 1.0, 200)
    noise, change = np.random.default_rng(1).normal(size=200), 0.005 * np.ones(200)
    for left, lowered, moved in ((0.001, -5000.0, 5000.0), (0.05, 0.0, 2.0)):
        gained, chi_square = held_out._of_chi_square(weight, [left * noise + change], [left * noise])
        assert gained == pytest.approx(lowered, rel=0.3, abs=2.0)
        assert chi_square == pytest.approx(moved, rel=0.3)


def test_another_search_goes_on_without_what_held_out_runs_contradict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What it finds must predict them better than the model that lacks what they contradict."""
    case = made_cell(tmp_path / "hysteresis", {"ocv_hysteresis": {"M_V": 0.02, "g": 30.0}}).case
    search = Search(FitCache(case, without=all_but(case, "ocv_hysteresis", "slow_diffusion", "ocv_curve")))

    def contradicting(search: Search, model: tuple[str, ...], others: list[str]) -> dict[str, tuple[float, str]]:
        return {"ocv_hysteresis": (1.0, "it is not so")} if "ocv_hysteresis" in others else {}

    monkeypatch.setattr(held_out, "_raising", contradicting)
    found = confirmed(search, search.run())
    assert "ocv_hysteresis" not in found.final.added
    assert found.refused["ocv_hysteresis"].why_not() == "it is not so"
    assert not search.without(["ocv_hysteresis"]).may_enter((), "ocv_hysteresis")
    lacking, other = (
        sum(one.check for one in rung(search.cache, "", search.cache.fit(labels, "all")).errors.values())
        for labels in ((), found.final.added)
    )
    assert other <= lacking


def test_an_energy_far_outside_its_usual_range_is_not_plausible():
    cache = cache_of(small_cell(), "charge_transfer")
    fit, search = cache.fit(("charge_transfer",)), Search(cache)
    candidate, (_, energy) = cache.space.candidates["charge_transfer"], cache.space.layout.of["charge_transfer"]
    for share, plausible in ((1.0, True), (5.0, False), (-5.0, False)):
        x = fit.x.copy()
        x[energy] = share
        assert search._plausible(dataclasses.replace(fit, x=x), candidate) is plausible


def test_of_two_that_data_hardly_tell_apart_the_one_of_all_runs_enters():
    cache = cache_of(small_cell(), "self_heating", "contact_resistance")
    shift = next(label for label, one in cache.space.candidates.items() if one.group == "run")
    of_run, of_all = dataclasses.replace(SIGNIFICANT, label=shift), SIGNIFICANT
    search = Search(cache)
    assert search._of_all_runs([(35.0, of_run), (34.0, of_all)]) == of_all
    assert search._of_all_runs([(35.0, of_run), (20.0, of_all)]) == of_run
    assert search._of_all_runs([(35.0, of_run)]) == of_run
    assert search._of_all_runs([]) is None


@pytest.mark.parametrize("second", ["ocv_hysteresis", None])
def test_effects_that_are_needed_only_beside_each_other_enter_together(second: str | None, monkeypatch):
    """Neither has enough evidence alone; the first stays only if it has with the other beside it."""
    cache = cache_of(small_cell(), "self_heating", "ocv_hysteresis")
    search = Search(cache)
    weak = dataclasses.replace(SIGNIFICANT, gain=6.0)
    monkeypatch.setattr(cache, "is_within_tolerance", lambda fit: False)
    monkeypatch.setattr(search, "_reduces_what_is_missed", lambda model, label: True)
    monkeypatch.setattr(search, "_entering", lambda model: (second, {}))
    monkeypatch.setattr(search, "test", lambda model, label: SIGNIFICANT)
    together = search._entering_together((), {"self_heating": weak})
    assert together == (None if second is None else cache.space.key(("self_heating", "ocv_hysteresis")))
    monkeypatch.setattr(search, "test", lambda model, label: weak)
    assert search._entering_together((), {"self_heating": weak}) is None


def test_once_something_shows_beside_curves_alone_nothing_is_tried_without_them(monkeypatch: pytest.MonkeyPatch):
    """Without the curves the model that it enters is far off, and tells nothing of what else is missing."""
    case = small_cell({"self_heating": {"C_th": 60.0, "hA": 0.02}}, seed=1)
    search = Search(cache_of(case, "self_heating", "ocv_curve"))
    shown, tried = ["self_heating"], []

    def entering(model: tuple[str, ...]) -> tuple[None, dict]:
        tried.append(model)
        return None, {}

    monkeypatch.setattr(search, "_entering", entering)
    monkeypatch.setattr(search, "_entering_beside", lambda model: shown.pop() if shown else None)
    assert search.run().final.added == ("self_heating",)
    assert tried == [()]


def test_an_effect_is_exchanged_only_by_more_than_the_difference_of_the_odds():
    """Two effects that the data do not tell apart: the one that is seldom the cause does not take the other's place."""
    search = Search(cache_of(small_cell({"self_heating": {"C_th": 60.0, "hA": 0.02}}, seed=1), "self_heating"))
    richer, before = search.cache.fit(("self_heating",)), search.cache.base
    gains = [
        search.evidence(richer, one) - search.evidence(before, one) for one in (richer.likelihood, before.likelihood)
    ]
    least = search.cache.settings.least_odds
    assert search.better(richer, before, min(gains) - least - 1.0)
    assert not search.better(richer, before, min(gains) - least + 1.0)


@pytest.mark.parametrize(("rival_is_needed", "label_is_needed"), [(True, True), (False, True), (False, False)])
def test_what_is_needed_beside_curves_is_not_exchanged_for_what_is_not(
    rival_is_needed: bool, label_is_needed: bool, monkeypatch: pytest.MonkeyPatch, plain_small: Investigation
):
    """An energy of the kinetics does the work of that of a resistance, and curves of the energies do its own."""
    search, label, rival = Search(plain_small.cache), "self_heating", "voltage_offset:voltage_V"
    needed = {label: label_is_needed, rival: rival_is_needed}

    def test(*given: Any) -> Any:
        return dataclasses.replace(SIGNIFICANT, label=given[-1])

    def final_test(model: Any, one: str) -> Any:
        return dataclasses.replace(SIGNIFICANT, gain=50.0 if needed[one] else 0.0)

    monkeypatch.setattr(search, "test", test)
    monkeypatch.setattr(search, "_test", test)
    monkeypatch.setattr(search, "final_test", final_test)
    monkeypatch.setattr(search, "_in_place_of", lambda *_: ((), [rival]))
    monkeypatch.setattr(search, "better", lambda *_: True)
    exchanged = search._exchanged((label,), ())
    assert exchanged == ((rival,) if rival_is_needed or not label_is_needed else (label,))


def test_a_sensor_that_is_off_may_be_off_in_one_run_alone(monkeypatch: pytest.MonkeyPatch):
    """Where data do not tell, a shift of one run is a rival of a sensor's fault, and of no effect."""
    offset, shift = "voltage_offset:voltage_V", "voltage_shift:voltage_V@run-02"
    search = Search(cache_of(small_cell(), "self_heating", "voltage_offset", shift))
    monkeypatch.setattr(search, "_told", lambda *_: False)
    assert (shift,) in search._rivals((offset,))[offset]
    assert (shift,) not in search._rivals(("self_heating",))["self_heating"]
    monkeypatch.setattr(search, "_told", lambda *_: True)
    assert not search._rivals((offset,))[offset]


def test_a_shift_of_one_run_counts_by_what_it_moves(monkeypatch: pytest.MonkeyPatch):
    """Curves may bend to a contact of one run, so that without it hardly more is missed."""
    label, case = "contact_resistance@run-02", small_cell()
    second = case.runs[1]
    current, outputs = second.measured.inputs["current_A"], second.measured.outputs
    read = outputs | {"voltage_V": outputs["voltage_V"] - 0.03 * current}
    worn = dataclasses.replace(second, measured=dataclasses.replace(second.measured, outputs=read))
    search = Search(cache_of(dataclasses.replace(case, runs=(case.runs[0], worn, *case.runs[2:])), *SMALL_KEPT, label))
    fit, candidate = search.cache.fit((label,)), search.cache.space.candidates[label]
    found = candidate.coordinates[0].number(fit.x[search.cache.space.layout.of[label][0]])
    assert found == pytest.approx(0.03, abs=0.02)
    moves_V = found * float(np.sqrt(np.mean(current**2)))
    for share, moved in ((0.7, True), (1.4, False)):
        limits = {"voltage_V": share * moves_V, "cell_temperature_degC": 1.0}
        monkeypatch.setitem(vars(search.cache), "tolerances", limits)
        assert search._moves(fit, candidate) == moved


def test_the_size_of_a_name_is_that_of_the_final_model(monkeypatch: pytest.MonkeyPatch):
    search = Search(cache_of(small_cell({"self_heating": {"C_th": 60.0, "hA": 0.1}}), "self_heating"))
    monkeypatch.setattr(search, "_test", lambda *_: SIGNIFICANT)
    sizes = iter((1.2, 20.0))
    monkeypatch.setattr(search, "_size_sd", lambda *_: next(sizes))
    small, large = (search.final_test(("self_heating",), "self_heating") for _ in range(2))
    assert not small.named
    assert small.why_not() == "its size is 1.2 sd from nothing"
    assert large.named
    assert large.size_sd == SIGNIFICANT.size_sd


def test_what_does_the_same_is_a_rival_where_the_model_is(monkeypatch: pytest.MonkeyPatch):
    """A leak is like an offset of the current, and no score shows it: a leak has no place at which it is nothing."""
    label, other = "self_discharge", "current_offset:current_A"
    search = Search(cache_of(small_cell({"self_discharge": {"R_self": 30.0}}, 3), label, "current_offset"))
    own = search.cache.fit((label,))
    place = own.spec.free.index(search.cache.space.layout.of[label][0])
    assert search.cache.scores((label,)).resembling(place)[other] == pytest.approx(0.61, abs=0.05)
    assert search._same_as(own, label) == []
    monkeypatch.setattr(search_module, "SAME", 0.5)
    assert search._same_as(own, label) == [other]
    assert search._rivals((label,))[label] == (), "the resistance tells them apart"
    monkeypatch.setattr(search_module, "NOT_TOLD", np.inf)
    assert search._rivals((label,))[label] == ((other,),)
    exchanged = search.cache.in_place(own, label, other)
    assert exchanged.added == (other,)
    assert exchanged.x[search.cache.space.layout.of[label][0]] == 0.0
    mean_V = [np.sqrt(one.mean_squares(search.cache.view)["voltage_V"]) for one in (own, exchanged)]
    assert mean_V[0] < mean_V[1] < 5.0 * mean_V[0], "near the optimum of the rest"
