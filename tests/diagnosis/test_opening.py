"""The first lines of a diagnosis: they follow from its records and contradict none of them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.diagnosis.advice.next_experiment import Proposal
from jaxmodel.diagnosis.headline import Doubt, Grade, Next, consistent, headline, possible, undetectable
from jaxmodel.diagnosis.opening import opening
from jaxmodel.diagnosis.result import (
    ChannelError,
    Diagnosis,
    Estimate,
    Extrapolated,
    Immaterial,
    Removed,
    Rung,
    ToleranceUsed,
)
from jaxmodel.diagnosis.wording import ladder_names, verdict_sentence, verdict_title
from tests.made_up import contact, with_additions

GENEROUS = {name: ToleranceUsed(100.0, None, False) for name in ("voltage_V", "cell_temperature_degC")}


def with_final(diagnosis: Diagnosis, **changes: object) -> Diagnosis:
    """Return a diagnosis with another final model."""
    final: Rung = dataclasses.replace(diagnosis.final, **changes)  # type: ignore[arg-type]
    return dataclasses.replace(diagnosis, ladder=(*diagnosis.ladder[:-1], final))


@pytest.fixture(scope="module")
def certain(diagnosis: Diagnosis) -> Diagnosis:
    """One effect, nothing against it; without it an error is above its tolerance."""
    base, final = (one.errors["voltage_V"] for one in (diagnosis.base, diagnosis.final))
    limit = 0.5 * (max(base.fit, base.check) + max(final.fit, final.check))
    return dataclasses.replace(
        diagnosis,
        effects=diagnosis.effects[:1],
        tolerance=GENEROUS | {"voltage_V": ToleranceUsed(limit, None, False)},
        fit_for_purpose={"voltage_V": {"run-03": True}},
        extrapolated=(),
        immaterial=(),
    )


@pytest.fixture(scope="module")
def adequate(certain: Diagnosis) -> Diagnosis:
    return dataclasses.replace(
        certain,
        verdict="adequate",
        effects=(),
        candidates=(("base", 0.98), ("something_else", 0.02)),
        ladder=certain.ladder[:2],
        tolerance=GENEROUS,
    )


def doubts(diagnosis: Diagnosis) -> list[Doubt]:
    return [one.doubt for one in headline(diagnosis).reservations]


def test_effect_that_nothing_speaks_against_is_sure(certain: Diagnosis) -> None:
    assert headline(certain).grade is Grade.SURE
    assert opening(certain).missing.startswith("The model lacks self_heating: the cell warms by its own losses.")
    assert opening(certain).sure.startswith("Sure: probability 0.97.")
    assert headline(certain).next_step.what is Next.NOTHING


def test_kinetics_beside_a_fault_are_no_fault(certain: Diagnosis) -> None:
    fault = dataclasses.replace(certain.effects[0], label="voltage_offset:voltage_V", name="voltage_offset")
    kinetics = dataclasses.replace(certain.effects[0], label="charge_transfer", name="charge_transfer")
    both = dataclasses.replace(certain, verdict="sensor_fault", effects=(fault, kinetics))
    said = "a sensor is faulty: voltage_offset of voltage_V, beside charge_transfer, which every cell has"
    assert said in verdict_sentence(both, plain=True)


def test_what_is_found_below_the_tolerances_comes_second(certain: Diagnosis) -> None:
    within = dataclasses.replace(certain, tolerance=GENEROUS)
    first = "The calibrated model is adequate for 100 V of voltage and 100 K of cell temperature; below that, "
    assert opening(within).missing.startswith(f"{first}the model lacks self_heating: the cell warms")
    assert verdict_title(within) == "Within tolerance; below it, an effect is missing"
    faulty = dataclasses.replace(within, verdict="sensor_fault")
    assert "below that, a sensor is faulty: " in verdict_sentence(faulty)
    assert verdict_title(certain) == "An effect is missing"


@pytest.mark.parametrize(
    ("estimate", "doubt"),
    [(Estimate(1e6, 1.0, "J/K"), Doubt.UNUSUAL), (Estimate(float("nan"), 1.0, "J/K"), Doubt.UNUSUAL)],
)
def test_effect_of_an_unusual_size_is_not_established(certain: Diagnosis, estimate: Estimate, doubt: Doubt) -> None:
    effect = dataclasses.replace(certain.effects[0], parameters={"C_th": estimate})
    strange = dataclasses.replace(certain, effects=(effect,))
    assert doubts(strange) == [doubt]
    assert headline(strange).grade is Grade.NOT_SURE
    assert verdict_sentence(strange).startswith("The base model may lack self_heating")
    assert opening(strange).missing.startswith("The model may lack self_heating")
    assert verdict_title(strange) == "An effect may be missing"


def test_sensor_is_not_called_faulty_where_something_else_would_do(certain: Diagnosis) -> None:
    effect = dataclasses.replace(certain.effects[0], cannot_tell_apart_from=("temperature_shift:cell_temperature@run",))
    rivalled = dataclasses.replace(certain, effects=(effect,))
    assert verdict_title(rivalled) == "An effect is missing"
    assert verdict_title(dataclasses.replace(rivalled, verdict="sensor_fault")) == "A sensor may be faulty"


def test_fit_without_a_minimum_establishes_nothing(certain: Diagnosis) -> None:
    unfinished = with_final(certain, converged=False)
    assert doubts(unfinished) == [Doubt.NO_MINIMUM]
    assert verdict_sentence(unfinished).startswith("The base model may lack ")


def test_effect_that_may_be_nothing_is_not_established(diagnosis: Diagnosis, certain: Diagnosis) -> None:
    arrhenius = dataclasses.replace(
        diagnosis.effects[1],
        cannot_tell_apart_from=(),
        rests_on="",
        parameters={"E_a": Estimate(9000.0, 6000.0, "J/mol")},
    )
    assert doubts(dataclasses.replace(certain, effects=(arrhenius,))) == [Doubt.SMALL]


def test_adequate_model_is_within_tolerance_wherever_it_says_so(adequate: Diagnosis) -> None:
    """Nowhere does a page say that a model is adequate beside an error above tolerance."""
    assert "is adequate for 100 V of voltage" in verdict_sentence(adequate)
    assert verdict_title(adequate) == "Nothing is missing"
    for above in (
        dataclasses.replace(adequate, tolerance=GENEROUS | {"voltage_V": ToleranceUsed(1e-4, None, True)}),
        dataclasses.replace(adequate, fit_for_purpose={"voltage_V": {"run-03": False}}),
    ):
        assert "adequate" not in " ".join([verdict_title(above), verdict_sentence(above), *above.summary().split(".")])
        assert verdict_sentence(above).startswith("The data show no missing effect, but the error of voltage")
        assert Doubt.ABOVE_TOLERANCE in doubts(above)
        assert headline(above).grade is not Grade.SURE


def test_single_run_that_differs_is_told_beside_an_adequate_model(adequate: Diagnosis) -> None:
    off = with_additions(adequate, runs=(contact(),))
    assert verdict_title(off) == "No effect is missing, but a run differs"
    assert "Single runs differ: run-02: series resistance differs by +11.20 ± 0.80 mohm." in opening(off).missing


def test_named_effect_is_not_possible_as_well(diagnosis: Diagnosis) -> None:
    """Nor is one that the data do show among those that they cannot show."""
    twice = dataclasses.replace(
        diagnosis,
        immaterial=(
            Immaterial("self_heating", {}, "self_heating: on another column"),
            Immaterial("slow_diffusion", {}, "slow_diffusion: significant"),
        ),
        blind_to=("self_heating", "slow_diffusion", "clock_shift"),
    )
    assert [one.name for one in possible(twice)] == ["slow_diffusion"]
    assert undetectable(twice) == ("clock_shift",)
    assert [one["name"] for one in twice.answer()["immaterial"]] == ["slow_diffusion"]
    assert twice.answer()["blind_to"] == ["clock_shift"]


def test_stated_model_that_stays_is_not_called_calibrated(adequate: Diagnosis) -> None:
    stays = dataclasses.replace(
        adequate, ladder=(*adequate.ladder, dataclasses.replace(adequate.ladder[0], name="as stated"))
    )
    assert stays.stays_as_stated
    assert verdict_title(stays) == "The model stays as stated"
    assert "no effect is named" in verdict_sentence(stays)


def test_next_measurement_is_what_the_verdict_lacks_most(certain: Diagnosis) -> None:
    def next_of(one: Diagnosis) -> Next:
        return headline(one).next_step.what

    rivals = dataclasses.replace(certain, rivals=("a", "b"), proposals=(Proposal("pulses at 0 degC", 7.0),))
    assert next_of(rivals) is Next.DECIDE
    assert "pulses at 0 degC" in opening(rivals).measure
    blunt = dataclasses.replace(rivals, proposals=(Proposal("pulses at 0 degC", 0.2),))
    assert next_of(blunt) is Next.NOTHING

    fitted = tuple(dataclasses.replace(run, split="fit") for run in certain.case.runs)
    no_checks = dataclasses.replace(certain, case=dataclasses.replace(certain.case, runs=fitted))
    assert next_of(no_checks) is Next.HOLD_OUT

    far = dataclasses.replace(certain, fit_for_purpose={"voltage_V": {"run-03": False}})
    assert next_of(far) is Next.FIT_LIKE
    beyond = (Extrapolated("run-03.csv", "|current_A|", (3.0, 6.0), (3.0, 9.0)),)
    outside = dataclasses.replace(far, extrapolated=beyond)
    assert next_of(outside) is Next.COVER
    assert "current 3 to 9 A (fitted so far: 3 to 6 A)" in opening(outside).measure
    # A check run outside the fit runs that is predicted all the same speaks for the model.
    assert doubts(dataclasses.replace(certain, extrapolated=beyond)) == []

    assumed = dataclasses.replace(certain, tolerance={"voltage_V": ToleranceUsed(100.0, None, True)})
    assert next_of(assumed) is Next.STATE_TOLERANCE


def test_comparison_says_that_nothing_was_tested(adequate: Diagnosis) -> None:
    compared = dataclasses.replace(adequate, verdict="", candidates=(), scores=())
    assert opening(compared).sure.startswith("No effects were tested")
    assert headline(compared).next_step.what is Next.DIAGNOSE


def test_effect_without_which_check_runs_are_predicted_better_is_doubted(certain: Diagnosis) -> None:
    worse = dataclasses.replace(certain.effects[0], removes={"voltage_V": Removed(0.01, -0.02)})
    limits = GENEROUS | {"voltage_V": ToleranceUsed(0.1, None, False)}
    final = with_final(certain, errors=certain.final.errors | {"voltage_V": ChannelError(0.03, 0.05)})
    doubted = dataclasses.replace(final, effects=(worse,), tolerance=limits)
    assert doubts(doubted) == [Doubt.WORSE_HELD_OUT]
    assert "the check runs would be predicted better (voltage)" in opening(doubted).sure
    # An error cannot be negative: what would make it so tells nothing.
    impossible = dataclasses.replace(worse, removes={"voltage_V": Removed(0.01, -0.06)})
    assert doubts(dataclasses.replace(doubted, effects=(impossible,))) == []
    assert np.isnan(consistent(impossible.removes, doubted)["voltage_V"].check)


def test_more_runs_of_a_kind_that_the_model_does_not_fit_are_not_asked_for(certain: Diagnosis) -> None:
    final = with_final(certain, errors=certain.final.errors | {"voltage_V": ChannelError(0.5, 0.5)})
    missed = dataclasses.replace(final, tolerance={"voltage_V": ToleranceUsed(0.1, None, False)})
    assert headline(missed).next_step.what is Next.OWN_EFFECT


def test_many_channels_are_not_listed_one_by_one(adequate: Diagnosis) -> None:
    names = [f"speed_{k}_rad_s" for k in range(6)]
    errors = {name: ChannelError(0.1 * k, 0.1 * k) for k, name in enumerate(names)}
    before = errors | {"speed_2_rad_s": ChannelError(0.9, 0.9)}
    last = dataclasses.replace(adequate.final, errors=errors)
    ladder = (*(dataclasses.replace(rung, errors=before) for rung in adequate.ladder), last)
    limits = dict.fromkeys(names, ToleranceUsed(1.0, None, True))
    noise = dict.fromkeys(names, adequate.noise["voltage_V"])
    many = dataclasses.replace(adequate, ladder=ladder, noise=noise, tolerance=limits)
    assert "adequate for the tolerances of all 6 channels (below, assumed)" in verdict_sentence(many)
    assert "speed 5 is 0.5 rad/s" in opening(many).sure
    assert "Of 6 channels speed 5 is the worst against its tolerance, and speed 2 changes most." in opening(many).sure
    assert "speed 3" not in opening(many).sure
    assert "The tolerance of 6 channels was assumed" in opening(many).measure


def test_models_that_add_nothing_say_what_they_are(certain: Diagnosis) -> None:
    corrected = dataclasses.replace(certain.ladder[1], name="with corrected tables")
    stays = dataclasses.replace(certain.ladder[0], name="as stated")
    assert ladder_names((*certain.ladder[:2], corrected))[2] == "with corrected tables and formulas"
    assert ladder_names((*certain.ladder[:2], stays))[2] == "back to the model as stated"


def test_an_error_above_the_tolerance_is_said_with_where_most_of_it_is(certain: Diagnosis) -> None:
    tight = dataclasses.replace(certain, tolerance=GENEROUS | {"voltage_V": ToleranceUsed(1e-4, None, False)})
    assert "errors above the tolerance (voltage)" in opening(tight).sure
    left = dataclasses.replace(tight.remaining["voltage_V"], mostly="SOC below 0.1")
    located = dataclasses.replace(tight, remaining={**tight.remaining, "voltage_V": left})
    assert "errors above the tolerance (voltage mostly at SOC below 0.1)" in opening(located).sure
    assert located.answer()["remaining"]["voltage_V"]["mostly"] == "SOC below 0.1"
    assert "mostly" not in tight.answer()["remaining"]["voltage_V"]
