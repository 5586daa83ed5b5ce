"""An investigation by hand and by the policy: the same models, whichever way one comes there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.base.errors import EffectError, FitError, MeasurementError
from jaxmodel.diagnosis import conclusion, finish, gates, policy
from jaxmodel.diagnosis.evidence.trial import Settled
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.policy import Found
from tests.diagnosis.conftest import HEATING
from tests.diagnosis.made_cases import SMALL_KEPT, SMALL_NOISE, investigation_of, small_cell


@pytest.fixture(scope="module")
def found(warm_small: Investigation) -> Found:
    return policy.run(warm_small)


def same_numbers(one: Settled, other: Settled) -> None:
    """Hold two fits of one model to a thousandth of an sd."""
    assert one.labels == other.labels
    own = list(one.setting.free)
    np.testing.assert_allclose((one.fitted.x[own] - other.fitted.x[own]) / one.fitted.sd(), 0.0, atol=1e-3)


def test_the_policy_ends_at_what_is_hidden(warm_small: Investigation, found: Found):
    assert found.final.labels == ("self_heating",)
    assert [model.labels for model in found.path] == [(), ("self_heating",)]
    assert found.laws == ()
    assert found.final.log_evidence > max(trial.log_evidence for trial in found.compared[1:])
    layout, fitted = warm_small.space.layout, found.final.fitted
    for place, true in zip(layout.of["self_heating"], HEATING["self_heating"].values(), strict=True):
        sd = layout.coordinates[place].slope(fitted.x[place]) * fitted.sd()[list(fitted.free).index(place)]
        assert layout.coordinates[place].number(fitted.x[place]) == pytest.approx(true, abs=4.0 * sd)
    errors = warm_small.errors_of(found.final)
    readings = found.final.scale.view.readings
    for place, channel in enumerate(SMALL_NOISE):
        rms = np.sqrt(np.mean(errors[readings.channel == place] ** 2))
        assert rms == pytest.approx(SMALL_NOISE[channel], rel=0.15)


def test_by_hand_one_comes_to_the_same_numbers(found: Found):
    by_hand = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    same_numbers(found.final, by_hand.add("self_heating").model)


def test_the_way_does_not_matter(warm_small: Investigation, found: Found):
    """Through another effect and back; models are kept, and the same whoever asks for them."""
    there = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    there.add("arrhenius_resistance")
    there.add("self_heating")
    same_numbers(found.final, there.drop("arrhenius_resistance").model)
    assert there.drop("self_heating").model is there.base
    same_numbers(there.base, warm_small.base)


def test_nothing_is_found_where_nothing_is_hidden(plain_small: Investigation):
    ended = policy.run(plain_small)
    assert ended.final is plain_small.base
    assert not ended.final.scale.error.sd
    assert not ended.refused


def test_verbs_tell_what_the_present_model_lacks_and_leaves():
    inv = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    ranked = inv.candidates()
    assert ranked["name"][0] == "self_heating"
    assert np.all(np.diff(ranked["log_evidence"]) <= 0.0)
    assert {"effect", "curve", "run"} <= set(ranked["group"])
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


def test_additions_are_gated_by_evidence_and_by_runs_left_out(warm_small: Investigation, found: Found):
    gains = warm_small.linear(warm_small.base).gains()
    assert gains[0].label == "self_heating"
    result = gates.addition(warm_small, warm_small.base, gains[0])
    assert result.significant
    assert result.material
    assert result.obvious
    assert result.score_gain > 0.0
    assert result.gain == pytest.approx(result.trial.log_evidence - warm_small.base.log_evidence)
    # The score predicts the gain of the refit to first order.
    assert result.gain > 0.5 * gains[0].log_evidence
    rest = {gain.label: gain for gain in warm_small.linear(found.final).gains()}
    assert max(gain.log_evidence for gain in rest.values()) < 6.0


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def test_a_preview_predicts_the_refit():
    """To first order: what the hidden effect leaves of each channel is near the noise before any refit too."""
    one = investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    previews = one.preview()
    assert set(previews.columns[4:]) <= set(one.candidates()["name"])
    only = one.preview("self_heating")
    refitted = one.add("self_heating").errors_of(one.model)
    np.testing.assert_array_equal(previews["self_heating"], only["self_heating"])
    for channel, rows in previews.groupby("channel").groups.items():
        before, promised = rms(previews.loc[rows, "residual"]), rms(previews.loc[rows, "self_heating"])
        reached = rms(refitted[np.asarray(rows)])
        if before > 3.0 * reached:
            # A large effect bends: most of the fall is predicted, not the last of it.
            assert promised - reached < 0.25 * (before - reached), channel
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


def test_finishing_automatically_ends_where_the_policy_does(found: Found):
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
    assert one.added == found.final.labels
    assert [effect.label for effect in diagnosis.effects] == ["self_heating"]
    by_hand = conclusion(one)
    assert by_hand.ordered == ("--add self_heating",)
    assert by_hand.final.errors == diagnosis.final.errors
    assert conclusion(one.drop("self_heating")).verdict == ""
