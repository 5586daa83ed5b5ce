"""Probabilities: the prior and the evidence and nothing else, ordered, and never more than one in all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from discrepancy.hypothesis import Hypothesis
from discrepancy.misfit import Block
from discrepancy.posterior import (
    MOST,
    PRIOR,
    PRIOR_SOMETHING_ELSE,
    SOMETHING_ELSE,
    bayes_factors,
    hypothesis_name,
    probabilities,
)
from discrepancy.session import Session


@pytest.fixture(scope="module")
def base(plain_session: Session) -> Hypothesis:
    """The base model as if it had left exactly what the noise leaves, and no unknown had been learnt anything of."""
    made = plain_session.hypothesis()
    readings = float(np.sum(np.asarray(made.problem.readings.fit)))
    size = made.fitted.x.size
    fitted = dataclasses.replace(
        made.fitted, x=np.zeros(size), chi2=readings, prior=0.0, information=np.eye(size), greatest_score=0.0
    )
    return dataclasses.replace(made, fitted=fitted)


# Odds that something in no catalogue acts beside whatever else does.
BESIDE = PRIOR_SOMETHING_ELSE / (1.0 - PRIOR_SOMETHING_ELSE)


def with_effects(base: Hypothesis, *labels: str, gain: float, chi2: float | None = None) -> Hypothesis:
    """A hypothesis whose log evidence is that of the base model plus `gain`."""
    chi2 = base.fitted.chi2 if chi2 is None else chi2
    prior = base.fitted.objective - 2.0 * gain - chi2
    return dataclasses.replace(base, labels=labels, fitted=dataclasses.replace(base.fitted, chi2=chi2, prior=prior))


def block(chi2: float, p_value: float = 1.0) -> Block:
    return Block("voltage_V", "", "soc", chi2, 9, p_value, np.linspace(0.0, 1.0, 9), np.zeros(9))


def test_effects_are_named_without_their_columns() -> None:
    assert hypothesis_name(()) == "base"
    assert hypothesis_name(("ocv_hysteresis", "current_offset:current_A")) == "ocv_hysteresis+current_offset"


def test_odds_are_evidence_times_prior(base: Hypothesis, plain_session: Session) -> None:
    candidates = plain_session.candidates
    one = with_effects(base, "entropic_ocv", gain=1.0)
    two = with_effects(base, "entropic_ocv", "ocv_hysteresis", gain=2.5)
    found, _ = probabilities([base, one, two], base, {(): []}, candidates)
    count = len(candidates)
    expected = {
        "base": PRIOR[0],
        "entropic_ocv": PRIOR[1] / count * np.exp(1.0),
        "entropic_ocv+ocv_hysteresis": PRIOR[2] / (count * (count - 1) / 2) * np.exp(2.5),
        SOMETHING_ELSE: PRIOR[0] * BESIDE,
    }
    total = sum(expected.values())
    assert found == pytest.approx({name: weight / total for name, weight in expected.items()})
    assert sum(found.values()) == pytest.approx(1.0)
    assert list(found.values()) == sorted(found.values(), reverse=True)


def test_nothing_is_surer_than_the_most_and_the_sum_never_exceeds_one(base: Hypothesis, plain_session: Session) -> None:
    for gain in (-2000.0, 0.0, 5.0, 20.0, 2000.0):
        one = with_effects(base, "entropic_ocv", gain=gain)
        best = one if gain > 0.0 else base
        found, _ = probabilities([base, one], best, {best.labels: [block(5.0)]}, plain_session.candidates)
        assert sum(found.values()) <= 1.0 + 1e-12
        assert max(found.values()) <= MOST
        assert min(found.values()) >= 0.0
    assert found["entropic_ocv"] == MOST
    assert next(iter(found)) == "entropic_ocv"


def test_the_same_effect_on_two_sensors_counts_once_at_its_best(base: Hypothesis, plain_session: Session) -> None:
    faults = [
        with_effects(base, "current_offset:pack_current_A", gain=3.0),
        with_effects(base, "current_offset:motor_current_A", gain=1.0),
    ]
    both, _ = probabilities([base, *faults], faults[0], {faults[0].labels: []}, plain_session.candidates)
    alone, _ = probabilities([base, faults[0]], faults[0], {faults[0].labels: []}, plain_session.candidates)
    assert both == pytest.approx(alone)


def test_what_is_left_speaks_for_something_else_once_it_pays_for_its_freedom(
    base: Hypothesis, plain_session: Session
) -> None:
    readings = base.fitted.chi2
    price = 9.0 * np.log(readings)

    def something(chi2: float, others: int = 0) -> float:
        left = [block(chi2, p_value=1e-9), *[block(0.0)] * others]
        found, _ = probabilities([base], base, {(): left}, plain_session.candidates)
        return found[SOMETHING_ELSE] / found["base"]

    assert something(price) == pytest.approx(BESIDE)
    assert something(price + 4.0) == pytest.approx(BESIDE * np.exp(2.0))
    assert something(price + 4.0, others=9) == pytest.approx(BESIDE * np.exp(2.0) / 10.0)
    assert something(9.0) < 1e-6  # what chance leaves


def test_noise_larger_than_stated_makes_every_odd_shorter(base: Hypothesis, plain_session: Session) -> None:
    readings = base.fitted.chi2
    noisy = with_effects(base, gain=0.0, chi2=1.44 * readings)
    one = with_effects(noisy, "entropic_ocv", gain=6.0, chi2=1.44 * readings)
    count = len(plain_session.candidates)

    def odds(left: list[Block]) -> float:
        found, _ = probabilities([noisy, one], one, {one.labels: left}, plain_session.candidates)
        return found["entropic_ocv"] / found["base"] * PRIOR[0] / PRIOR[1] * count

    assert odds([]) == pytest.approx(np.exp(6.0 / 1.44))
    # Where a law is left, the excess is the law's, and no reason to distrust the noise.
    assert odds([block(300.0, p_value=1e-9)]) == pytest.approx(np.exp(6.0))


def test_an_unknown_law_may_stand_in_place_of_an_effect_that_comes_near_it(
    base: Hypothesis, plain_session: Session
) -> None:
    """Beside the base model it explains what the effect explains, and more; beside the effect nothing is left."""
    readings = base.fitted.chi2
    poor = with_effects(base, gain=0.0, chi2=readings + 900.0)
    near = with_effects(poor, "slow_diffusion", gain=300.0, chi2=readings + 300.0)
    left = {(): [block(900.0, p_value=1e-99)], near.labels: [block(9.0)]}
    found, beside = probabilities([poor, near], near, left, plain_session.candidates)
    assert found[SOMETHING_ELSE] > 0.9
    assert beside == ()
    left[()] = [block(500.0, p_value=1e-99)]
    found, _ = probabilities([poor, near], near, left, plain_session.candidates)
    assert found["slow_diffusion"] > 0.9


def test_laws_of_several_channels_do_not_explain_more_than_there_is(base: Hypothesis, plain_session: Session) -> None:
    """Far from the noise each channel's law may take what the model's own unknowns could: their sum is no evidence."""
    readings = base.fitted.chi2
    poor = with_effects(base, gain=0.0, chi2=readings + 1e5)
    right = with_effects(poor, "slow_diffusion", gain=0.49995e5, chi2=readings)
    laws = [dataclasses.replace(block(9e4, p_value=0.0), channel=channel) for channel in ("voltage_V", "speed_rad_s")]
    found, _ = probabilities([poor, right], right, {(): laws, right.labels: []}, plain_session.candidates)
    assert found["slow_diffusion"] == pytest.approx(1.0 - PRIOR_SOMETHING_ELSE)


def test_bayes_factor_is_the_mean_of_the_odds_over_the_prior(plain_session: Session) -> None:
    """Of amplitudes drawn from the prior, in the linear problem that a screen makes of the readings."""
    screened = plain_session.screen(plain_session.hypothesis())
    found = bayes_factors(screened, plain_session.candidates)
    draws = np.random.default_rng(0).standard_normal(400_000)
    tested = 0
    for label in ("arrhenius_resistance", "entropic_ocv", "ocv_hysteresis", "self_discharge"):
        candidate = plain_session.candidates[label]
        means = []
        blocks = [block for block in screened.table.projection.blocks if block.candidate == label]
        for block, probe in zip(blocks, screened.probes[label], strict=True):
            way = np.zeros(screened.residual.size) if not block.dof else block.u[:, 0] * block.triangle[0, 0]
            unit = way * block.scale[0]  # what a probe moves that no recalibration can make up for
            amounts = candidate.times_as_strong(draws, probe[0])
            drop = 2.0 * amounts * (unit @ screened.residual) - amounts**2 * (unit @ unit)
            means.append(np.mean(np.exp(0.5 * drop)))
        if np.mean(means) > 1e-2:
            assert found[label] == pytest.approx(np.log(np.mean(means)), abs=0.03), label
            tested += 1
    assert tested >= 2


def test_what_the_data_cannot_see_is_as_probable_as_before(base: Hypothesis, plain_session: Session) -> None:
    candidates = plain_session.candidates
    unfitted = {("entropic_ocv",): base.log_evidence, ("self_discharge",): base.log_evidence - 20.0}
    found, _ = probabilities([base], base, {(): []}, candidates, unfitted)
    assert found["entropic_ocv"] / found["base"] == pytest.approx(PRIOR[1] / PRIOR[0] / len(candidates))
    assert found["self_discharge"] < 1e-9


def test_an_unseen_second_effect_keeps_its_share(base: Hypothesis, plain_session: Session) -> None:
    candidates = plain_session.candidates
    one = with_effects(base, "slow_diffusion", gain=50.0)
    unfitted = {("self_discharge", "slow_diffusion"): one.log_evidence}
    found, _ = probabilities([base, one], one, {one.labels: []}, candidates, unfitted)
    pairs = len(candidates) * (len(candidates) - 1) / 2
    odds = found["self_discharge+slow_diffusion"] / found["slow_diffusion"]
    assert odds == pytest.approx(PRIOR[2] / pairs / (PRIOR[1] / len(candidates)))
