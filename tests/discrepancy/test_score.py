"""The score test on simulated linear problems, where refits and false alarms can be counted exactly."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, chi2, norm

from discrepancy.projection import Candidate, project, z_equivalent
from discrepancy.score import score_effects, sight
from discrepancy.whitening import chain_starts, whiten

ROWS = 400


def smooth(generator: np.random.Generator, columns: int, rows: int = ROWS) -> np.ndarray:
    """Sensitivities as physics makes them: slow, and alike."""
    raw = lfilter([0.02], [1.0, -0.98], generator.normal(size=(rows, columns)), axis=0)
    return raw / np.linalg.norm(raw, axis=0)


def catalogue(generator: np.random.Generator, rows: int = ROWS) -> dict[str, Candidate]:
    """Free, one-sided, shaped and many-parameter effects together."""
    effects = {f"effect {k}": Candidate([smooth(generator, 1, rows)], signs=(0, 1, -1)[k % 3]) for k in range(9)}
    effects["shaped"] = Candidate([smooth(generator, 1, rows) for _ in range(5)], signs=1)
    effects["two amplitudes"] = Candidate([smooth(generator, 2, rows)], signs=1)
    effects["block"] = Candidate([smooth(generator, 5, rows)])
    return effects


def alarm_rate(base: np.ndarray, effects: dict[str, Candidate], residuals: np.ndarray) -> float:
    """Share of residuals (n, data sets) in which any effect exceeds the critical value."""
    critical = score_effects(base, residuals[:, 0], effects).critical_z
    projection = project(base, residuals[:, 0], effects)
    loudest = [z_equivalent(block.log_p(residuals.T @ block.u)) for block in projection.blocks]
    return float(np.mean(np.max(loudest, axis=0) > critical))


def test_false_alarm_rate_over_the_whole_catalogue_is_the_nominal_one():
    generator = np.random.default_rng(0)
    base, effects = smooth(generator, 4), catalogue(generator)
    rate = alarm_rate(base, effects, generator.normal(size=(ROWS, 4000)))
    low, high = binom.interval(0.999, 4000, 0.05)
    assert low / 4000 <= rate <= high / 4000


def test_coloured_noise_breaks_the_rate_and_whitening_keeps_it():
    generator = np.random.default_rng(1)
    base, effects = smooth(generator, 4), catalogue(generator)
    starts, rho, count = chain_starts([range(ROWS // 2), range(ROWS // 2)]), 0.9, 3000
    innovation = generator.normal(size=(2, ROWS // 2, count))
    innovation[:, 1:] *= np.sqrt(1.0 - rho**2)
    noise = lfilter([1.0], [1.0, -rho], innovation, axis=1).reshape(ROWS, count)
    assert alarm_rate(base, effects, noise) > 0.8

    def white(values: np.ndarray) -> np.ndarray:
        return whiten(values, starts, rho, 1.0)

    whitened = {name: Candidate([white(s) for s in c.shapes], c.signs) for name, c in effects.items()}
    low, high = binom.interval(0.999, count, 0.05)
    assert low / count <= alarm_rate(white(base), whitened, white(noise)) <= high / count


def test_score_predicts_the_refit_exactly_on_a_linear_problem():
    generator = np.random.default_rng(2)
    priors = np.diag([2.0, 0.5, 3.0])
    base = np.vstack([generator.normal(size=(ROWS, 3)), priors])
    s = np.vstack([generator.normal(size=(ROWS, 1)) + base[:ROWS, :1], np.zeros((3, 1))])
    data = base @ [1.0, -2.0, 0.5] + 0.3 * s[:, 0] + generator.normal(size=ROWS + 3)
    before, (chi2_before,), *_ = np.linalg.lstsq(base, data)
    after, (chi2_after,), *_ = np.linalg.lstsq(np.hstack([base, s]), data)
    residual = data - base @ before
    table = score_effects(base, residual, {"effect": Candidate([s])}, ["a", "b", "c"])
    effect = table["effect"]
    covariance = np.linalg.inv(np.hstack([base, s]).T @ np.hstack([base, s]))
    assert effect.chi2 == pytest.approx(chi2_before - chi2_after)
    assert effect.z == pytest.approx(after[3] / np.sqrt(covariance[3, 3]))
    assert effect.amplitude[0] == pytest.approx(after[3])
    assert effect.amplitude_sd[0] == pytest.approx(np.sqrt(covariance[3, 3]))
    assert effect.hidden_by == "a"
    assert np.abs(table.projection.base_z).max() < 1e-9


def test_projection_finds_the_effect_that_plain_correlation_misses():
    """The base imitates 95 % of the true effect; a decoy that it cannot imitate lies at 60 degrees to the rest."""
    generator = np.random.default_rng(3)
    orthogonal = np.linalg.qr(generator.normal(size=(ROWS, 6)))[0]
    base = orthogonal[:, :3]
    true = (0.95 * base[:, 0] + np.sqrt(1.0 - 0.95**2) * orthogonal[:, 3])[:, None]
    decoy = (0.5 * orthogonal[:, 3] + np.sqrt(0.75) * orthogonal[:, 4])[:, None]
    misled = hits = 0
    for _ in range(40):
        data = 40.0 * true[:, 0] + generator.normal(size=ROWS)
        residual = data - base @ (base.T @ data)
        misled += abs(decoy[:, 0] @ residual) > abs(true[:, 0] @ residual)
        table = score_effects(base, residual, {"decoy": Candidate([decoy]), "true": Candidate([true])}, draws=100)
        hits += table.names[0] == "true"
    assert misled == 40
    assert hits == 40


def test_result_depends_on_inner_products_only():
    """So the R factor of all columns may stand for the rows, run by run."""
    generator = np.random.default_rng(4)
    base, effects = smooth(generator, 3), catalogue(generator)
    residual = generator.normal(size=ROWS)
    sizes = [shape.shape[1] for effect in effects.values() for shape in effect.shapes]
    columns = [shape for effect in effects.values() for shape in effect.shapes]
    runs = np.array_split(np.column_stack([base, *columns, residual]), 2)
    packed = np.vstack([np.linalg.qr(run, mode="r") for run in runs])
    parts = iter(np.split(packed[:, 3:-1], np.cumsum(sizes)[:-1], axis=1))
    packed_effects = {name: Candidate([next(parts) for _ in c.shapes], c.signs) for name, c in effects.items()}
    whole = score_effects(base, residual, effects, draws=100)
    small = score_effects(packed[:, :3], packed[:, -1], packed_effects, draws=100)
    assert small.names == whole.names
    assert [e.p for e in small.effects] == pytest.approx([e.p for e in whole.effects])


def test_one_sided_effect_counts_only_its_physical_side():
    s = np.linalg.qr(np.random.default_rng(5).normal(size=(ROWS, 1)))[0]
    base = np.zeros((ROWS, 0))
    up = score_effects(base, 2.0 * s[:, 0], {"effect": Candidate([s], signs=1)})["effect"]
    down = score_effects(base, -2.0 * s[:, 0], {"effect": Candidate([s], signs=1)})["effect"]
    both = score_effects(base, 2.0 * s[:, 0], {"effect": Candidate([s])})["effect"]
    assert (up.z, down.z) == pytest.approx((2.0, -2.0))
    assert up.p == pytest.approx(norm.sf(2.0))
    assert down.p == pytest.approx(norm.cdf(2.0))
    assert both.p == pytest.approx(2.0 * norm.sf(2.0))
    assert (up.chi2, down.chi2) == pytest.approx((4.0, 0.0))


def test_chi_bar_square_of_two_orthogonal_one_sided_amplitudes():
    s = np.linalg.qr(np.random.default_rng(6).normal(size=(ROWS, 2)))[0]
    for amplitude, drop in (([2.0, 1.0], 5.0), ([2.0, -1.0], 4.0)):
        effect = score_effects(np.zeros((ROWS, 0)), s @ amplitude, {"effect": Candidate([s], signs=1)})["effect"]
        assert effect.chi2 == pytest.approx(drop)
        assert effect.p == pytest.approx(0.5 * chi2.sf(drop, 1) + 0.25 * chi2.sf(drop, 2), rel=0.05)
        assert np.all(effect.amplitude >= 0.0)


def test_p_of_a_correlated_cone_is_uniform():
    generator = np.random.default_rng(7)
    block = project(np.zeros((ROWS, 0)), np.zeros(ROWS), {"cone": Candidate([smooth(generator, 3)], signs=(1, -1, 0))})
    p = np.exp(block.blocks[0].log_p(generator.standard_normal((4000, 3))))
    for level in (0.01, 0.05, 0.3):
        low, high = binom.interval(0.999, 4000, level)
        assert low <= np.sum(p < level) <= high


def test_overwhelming_evidence_is_still_ranked():
    s = np.linalg.qr(np.random.default_rng(8).normal(size=(ROWS, 8)))[0]
    residual = s @ np.array([3000.0, 2000.0, 0, 0, 0, 0, 0, 0])
    effects = {"one": Candidate([s[:, :1]]), "block": Candidate([s[:, 1:6]]), "small": Candidate([s[:, 7:]])}
    table = score_effects(np.zeros((ROWS, 0)), residual, effects)
    assert table.names == ("one", "block", "small")
    assert table["block"].z_equivalent == pytest.approx(2000.0, rel=0.01)


def test_the_best_shape_is_found_and_all_are_counted():
    generator = np.random.default_rng(9)
    t = np.linspace(0.0, 1.0, ROWS)[:, None]
    shapes = [np.exp(-t / width) for width in (0.01, 0.03, 0.1, 0.3, 1.0)]
    residual = 5.0 * shapes[2][:, 0] + generator.normal(size=ROWS)
    one = score_effects(np.ones((ROWS, 1)), residual, {"decay": Candidate(shapes[2:3])})
    all_of_them = score_effects(np.ones((ROWS, 1)), residual, {"decay": Candidate(shapes)})
    assert all_of_them["decay"].shape == 2
    assert one.critical_z == pytest.approx(1.96, abs=0.05)
    assert 2.1 < all_of_them.critical_z < norm.isf(0.025 / 5)


def test_what_the_base_imitates_is_absorbed_and_says_by_what():
    generator = np.random.default_rng(10)
    base = generator.normal(size=(ROWS, 3))
    imitated = base[:, 1:2] + 0.01 * generator.normal(size=(ROWS, 1))
    table = score_effects(base, generator.normal(size=ROWS), {"effect": Candidate([imitated])}, ["R", "Q", "C"])
    effect = table["effect"]
    assert effect.dof == 0
    assert effect.hidden_by == "Q"
    assert effect.p == 1.0
    assert effect.amplitude_sd[0] == np.inf
    assert table.significant == ()


def test_an_effect_that_this_data_never_excites_is_blind_not_absent():
    table = score_effects(np.ones((ROWS, 1)), np.zeros(ROWS), {"still": Candidate([np.zeros((ROWS, 1))])})
    assert table["still"].dof == 0
    assert sight(table, {"still": 1.0})[0].cell == "blind"


def test_base_parameters_without_own_information_are_dropped_harmlessly():
    generator = np.random.default_rng(11)
    base, effects = smooth(generator, 3), catalogue(generator)
    residual = generator.normal(size=ROWS)
    twice = np.column_stack([base, 1e6 * base[:, 0], np.zeros(ROWS)])
    plain, doubled = score_effects(base, residual, effects), score_effects(twice, residual, effects)
    assert [e.z for e in doubled.effects] == pytest.approx([e.z for e in plain.effects], rel=1e-6)
    assert len(doubled.projection.base.dropped) == 2


def test_effects_that_look_alike_form_a_class_and_others_do_not_join():
    generator = np.random.default_rng(12)
    u = np.linalg.qr(generator.normal(size=(ROWS, 3)))[0]
    effects = {
        "gain": Candidate([u[:, :1]]),
        "gear": Candidate([-u[:, :1] + 0.05 * u[:, 1:2]]),
        "cousin": Candidate([0.8 * u[:, :1] + 0.6 * u[:, 1:2]]),
        "stranger": Candidate([u[:, 2:]]),
    }
    table = score_effects(np.zeros((ROWS, 0)), 20.0 * u[:, 0] + 0.3 * generator.normal(size=ROWS), effects)
    (alike,) = table.classes
    assert set(alike) == {"gain", "gear"}
    gain, gear, cousin = (table.names.index(name) for name in ("gain", "gear", "cousin"))
    assert table.cosine[gain, gear] == pytest.approx(-1.0, abs=0.01)
    assert table.cosine[gain, cousin] == pytest.approx(0.8)
    assert table.separation[gain, cousin] == pytest.approx(0.6 * abs(table["cousin"].z), rel=0.1)


def test_weak_evidence_cannot_tell_cousins_apart():
    u = np.linalg.qr(np.random.default_rng(13).normal(size=(ROWS, 3)))[0]
    effects = {
        "one": Candidate([u[:, :1]]),
        "cousin": Candidate([0.8 * u[:, :1] + 0.6 * u[:, 1:2]]),
        "stranger": Candidate([u[:, 2:]]),
    }
    weak = score_effects(np.zeros((ROWS, 0)), 4.0 * u[:, 0], effects)
    strong = score_effects(np.zeros((ROWS, 0)), 20.0 * u[:, 0], effects)
    assert weak.significant == ("one", "cousin")
    assert weak.classes == (("one", "cousin"),)
    assert strong.classes == ()


def test_one_direction_inside_a_block_is_alike_to_it():
    u = np.linalg.qr(np.random.default_rng(14).normal(size=(ROWS, 4)))[0]
    effects = {"line": Candidate([u[:, :1] + u[:, 1:2]]), "plane": Candidate([u[:, :2] @ [[2.0, 1.0], [0.0, 1.0]]])}
    table = score_effects(np.zeros((ROWS, 0)), 10.0 * (u[:, 0] + u[:, 1]), effects)
    assert abs(table.cosine[0, 1]) == pytest.approx(1.0)
    assert set(table.classes[0]) == {"line", "plane"}
    assert table.names[0] == "line"


def test_four_cells():
    s = np.linalg.qr(np.random.default_rng(19).normal(size=(ROWS, 4)))[0]
    effects = {name: Candidate([s[:, k : k + 1]]) for k, name in enumerate("abcd")}
    table = score_effects(np.zeros((ROWS, 0)), s @ [10.0, 10.0, 0.5, 0.5], effects)
    cells = {found.name: found for found in sight(table, {"a": 8.0, "b": 20.0, "c": 6.0, "d": 2.0})}
    assert {name: found.cell for name, found in cells.items()} == {
        "a": "present",
        "b": "negligible",
        "c": "absent",
        "d": "blind",
    }
    assert cells["c"].sigma == pytest.approx(6.0)


@pytest.mark.parametrize("broken", [np.full((ROWS, 1), np.nan), np.ones((ROWS - 1, 1))])
def test_unusable_sensitivities_are_refused_by_name(broken):
    with pytest.raises(ValueError, match="hysteresis"):
        score_effects(np.ones((ROWS, 1)), np.zeros(ROWS), {"hysteresis": Candidate([broken])})


def test_nothing_to_be_scored_is_a_table_without_entries():
    table = score_effects(np.ones((ROWS, 1)), np.ones(ROWS), {}, ["a"], draws=100)
    assert (table.effects, table.significant, table.classes) == ((), (), ())
