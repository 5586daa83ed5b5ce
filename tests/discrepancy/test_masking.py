"""Effects that hide each other are found together, and no pair is made out of noise or of one effect."""

import numpy as np
import pytest

from discrepancy.masking import masking_pairs
from discrepancy.projection import Candidate
from discrepancy.score import score_effects
from tests.discrepancy.test_score import ROWS, catalogue, smooth


def test_two_effects_that_mask_each_other_are_found_as_a_pair():
    u = np.linalg.qr(np.random.default_rng(15).normal(size=(ROWS, 3)))[0]
    second = 0.95 * u[:, :1] + np.sqrt(1.0 - 0.95**2) * u[:, 1:2]
    effects = {"one": Candidate([u[:, :1]]), "two": Candidate([second]), "other": Candidate([u[:, 2:]])}
    residual = 30.0 * u[:, 0] - 30.0 * second[:, 0]
    table = score_effects(np.zeros((ROWS, 0)), residual, effects)
    assert max(effect.chi2 for effect in table.effects) < 0.03 * (residual @ residual)
    (pair,) = masking_pairs(table)
    assert pair.labels == ("one", "two")
    assert pair.chi2 == pytest.approx(residual @ residual)
    assert pair.amplitudes == pytest.approx((30.0, -30.0))
    one_sided = {name: Candidate(effect.shapes, signs=1) for name, effect in effects.items()}
    assert masking_pairs(score_effects(np.zeros((ROWS, 0)), residual, one_sided)) == ()


def test_one_effect_alone_needs_no_pair():
    generator = np.random.default_rng(16)
    base, effects = smooth(generator, 4), catalogue(generator)
    residual = 15.0 * effects["effect 0"].shapes[0][:, 0] + generator.normal(size=ROWS)
    assert masking_pairs(score_effects(base, residual, effects)) == ()


def test_many_amplitudes_do_not_make_a_pair_out_of_noise():
    generator = np.random.default_rng(21)
    effects = {name: Candidate([generator.normal(size=(ROWS, 9))]) for name in "abcd"}
    effects["one"] = Candidate([generator.normal(size=(ROWS, 1))])
    tables = [score_effects(np.ones((ROWS, 1)), r, effects, draws=200) for r in generator.normal(size=(8, ROWS))]
    assert [masking_pairs(table) for table in tables] == [()] * 8
