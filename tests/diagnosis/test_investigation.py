"""An investigation by hand and by the search: the same models, whichever way one comes there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.base.errors import EffectError, FitError, MeasurementError
from jaxmodel.diagnosis import conclusion, finish
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.search import Found
from jaxmodel.fit.estimate import Fit
from tests.diagnosis.conftest import HEATING
from tests.diagnosis.made_cases import SMALL_KEPT, SMALL_NOISE, investigation_of, small_cell


@pytest.fixture(scope="module")
def found(warm_small: Investigation) -> Found:
    return warm_small.searching.run()


def same_numbers(one: Fit, other: Fit) -> None:
    """Hold two fits of one model to a thousandth of an sd."""
    assert one.added == other.added
    np.testing.assert_allclose((one.free - other.free) / one.sd, 0.0, atol=1e-3)


def test_the_search_ends_at_what_is_hidden(warm_small: Investigation, found: Found):
    assert found.final.added == ("self_heating",)
    assert found.path == ((), ("self_heating",))
    assert found.tests["self_heating"].named
    layout, fit = warm_small.cache.space.layout, found.final
    for place, true in zip(layout.of["self_heating"], HEATING["self_heating"].values(), strict=True):
        sd = layout.coordinates[place].slope(fit.x[place]) * fit.sd[fit.spec.free.index(place)]
        assert layout.coordinates[place].number(fit.x[place]) == pytest.approx(true, abs=4.0 * sd)
    for channel, mean_square in fit.mean_squares(warm_small.cache.view).items():
        assert np.sqrt(mean_square) == pytest.approx(SMALL_NOISE[channel], rel=0.15)


def test_by_hand_one_comes_to_the_same_numbers(found: Found):
    by_hand = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    same_numbers(found.final, by_hand.add("self_heating").model)


def test_the_way_does_not_matter(warm_small: Investigation, found: Found):
    """Through another effect and back; models are kept, and the same whoever asks for them."""
    there = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    there.add("arrhenius_resistance")
    there.add("self_heating")
    same_numbers(found.final, there.drop("arrhenius_resistance").model)
    assert there.drop("self_heating").model is there.cache.calibrated
    same_numbers(there.cache.base, warm_small.cache.base)


def test_nothing_is_found_where_nothing_is_hidden(plain_small: Investigation):
    ended = plain_small.searching.run()
    assert ended.final is plain_small.cache.base
    assert plain_small.searching.is_noise(ended.final)
    assert not ended.refused


def test_verbs_tell_what_the_present_model_lacks_and_leaves():
    inv = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    ranked = inv.candidates()
    assert ranked["name"][0] == "self_heating"
    assert np.all(np.diff(ranked["log_evidence"]) <= 0.0)
    assert {"effect", "run"} <= set(ranked["group"])
    before = inv.errors()
    assert len(before) == len(inv.case.runs) * len(SMALL_NOISE)
    assert (inv.where()["channel"] == "cell_temperature_degC").any()
    inv.add("self_heating")
    assert inv.added == ("self_heating",)
    assert "self_heating" not in set(inv.candidates()["name"])
    assert inv.errors()["rms"].sum() < 0.5 * before["rms"].sum()
    ladder = inv.ladder()
    assert ladder["added"].tolist() == ["base", "self_heating"]
    for channel, noise in SMALL_NOISE.items():
        assert ladder[f"{channel} fit"][1] == pytest.approx(noise, rel=0.15)
        assert ladder[f"{channel} check"][1] < 2.0 * noise
    inv.drop("self_heating")
    assert inv.added == ()


def test_what_cannot_be_done_is_said(plain_small: Investigation):
    with pytest.raises(EffectError, match="self_heating"):
        plain_small.add("self_heatin")
    with pytest.raises(EffectError, match="is not a candidate of this case"):
        Investigation(small_cell(), without=["what is not there"])
    case = small_cell()
    check_only = dataclasses.replace(case, runs=tuple(dataclasses.replace(run, split="check") for run in case.runs))
    with pytest.raises(FitError, match='split = "fit"'):
        Investigation(check_only)


def test_what_enters_is_significant_stable_and_material(warm_small: Investigation):
    search, cache = warm_small.searching, warm_small.cache
    assert cache.scores(()).gains()[0].label == "self_heating"
    result = search.test(("self_heating",), "self_heating")
    assert result.named
    assert result.gain > 100.0
    assert result.why_not() == ""
    rest = {gain.label: gain for gain in cache.scores(("self_heating",)).gains()}
    assert max(gain.log_evidence for gain in rest.values()) < 6.0
    # What is not there gains nothing, and is not named.
    idle = search.test(("self_heating", "arrhenius_resistance"), "arrhenius_resistance")
    assert not idle.named
    assert idle.gain < idle.odds


def test_models_are_compared_at_equal_weights(warm_small: Investigation):
    """The weights of either model decide the same, and a model gains nothing over itself."""
    search, cache = warm_small.searching, warm_small.cache
    base, richer = cache.base, cache.fit(("self_heating",))
    assert search.gain(richer, base) > 0.0
    assert search.better(richer, base)
    assert not search.better(base, richer)
    assert search.gain(base, base) == pytest.approx(0.0, abs=1e-9)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def test_a_preview_predicts_the_refit():
    """To first order: what the hidden effect leaves of each channel is near the noise before any refit too."""
    one = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    previews = one.preview()
    assert set(previews.columns[4:]) <= set(one.candidates()["name"])
    only = one.preview("self_heating")
    refitted = one.add("self_heating").model.errors
    np.testing.assert_array_equal(previews["self_heating"], only["self_heating"])
    for channel, rows in previews.groupby("channel").groups.items():
        before, promised = rms(previews.loc[rows, "residual"]), rms(previews.loc[rows, "self_heating"])
        reached = rms(refitted[np.asarray(rows)])
        if before > 3.0 * reached:
            # A large effect bends: most of the fall is predicted, not the last of it.
            assert promised - reached < 0.3 * (before - reached), channel
    with pytest.raises(EffectError):
        one.preview("self_heatin")


def test_the_cells_of_a_map_add_up_to_the_channel(warm_small: Investigation):
    for channel in warm_small.noise:
        drawn = warm_small.regime_map(channel)
        seconds = drawn.seconds.sum()
        cells = drawn.to_dataframe()
        assert cells["seconds"].sum() == pytest.approx(seconds)
        assert np.isnan(drawn.mean[drawn.seconds == 0.0]).all()
        assert (cells["rms"] >= np.abs(cells["mean"]) - 1e-12).all()
        count = sum(
            drawn.readings_of(along, across).size
            for along in range(drawn.along.count)
            for across in range(drawn.across.count)
        )
        assert count == drawn.run.size
    with pytest.raises(MeasurementError, match="speed"):
        warm_small.regime_map("speed")


def test_undo_goes_back_along_the_path():
    one = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    assert one.undo().added == ()
    one.add("self_heating").add("arrhenius_resistance")
    assert one.undo().added == ("self_heating",)
    assert one.undo().added == ()
    assert len(one.ladder()) == 1


def test_finishing_automatically_ends_where_the_search_does(found: Found):
    """From the present model on; each model is shown as it is accepted, and what that raises ends the search there."""
    one = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    seen = []

    def stop() -> None:
        seen.append(one.added)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        one.search(stop)
    assert seen == [("self_heating",)]
    assert one.added == ("self_heating",)  # what was accepted stays
    one.undo()
    diagnosis = finish(one)
    assert one.added == found.final.added
    assert [effect.label for effect in diagnosis.effects] == ["self_heating"]
    by_hand = conclusion(one)
    assert by_hand.ordered == ("--add self_heating",)
    for channel, error in by_hand.final.errors.items():
        assert error.fit == pytest.approx(diagnosis.final.errors[channel].fit, rel=1e-9)
    assert conclusion(one.drop("self_heating")).verdict == ""


def test_the_calibrated_model_is_never_worse_than_the_stated_one(plain_small: Investigation, warm_small: Investigation):
    """Under the weights that the calibration ends with: what it minimises is the error that is reported."""
    for one in (plain_small, warm_small):
        cache = one.cache
        for fit in (cache.calibrated, cache.base):
            root = fit.likelihood.roots(cache.view.data)
            problem = cache.space.problem(fit.spec)
            stated = cache.view.data.value - cache.view.at(problem, [fit.spec.lane(np.zeros(fit.x.size))])[0]
            assert np.sum((root * fit.errors) ** 2) <= np.sum((root * stated) ** 2)
