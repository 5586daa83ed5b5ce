"""Where the error is: planted errors are found, and none is found where there is only noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from discrepancy.where import Regressor, split_excess, worst_region
from discrepancy.whiteness import floor_ratio, ljung_box
from discrepancy.whitening import block_labels, chain_starts

ROWS = 6000


@pytest.fixture
def conditions() -> list[Regressor]:
    generator = np.random.default_rng(0)
    return [
        Regressor("temperature", "degC", generator.choice([-10.0, 0.0, 20.0, 40.0], ROWS)),
        Regressor("|current|", "A", generator.uniform(0.0, 9.0, ROWS)),
        Regressor("state of charge", "", generator.uniform(0.1, 1.0, ROWS)),
    ]


def noise(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=ROWS)


def test_noise_alone_is_at_the_floor_about_as_often_as_promised():
    ratios = [floor_ratio(noise(seed)) for seed in range(200)]
    assert np.mean([found.ratio for found in ratios]) == pytest.approx(1.0, abs=0.003)
    assert 0.93 <= np.mean([found.is_at_floor for found in ratios]) <= 1.0


def test_floor_counts_readings_that_were_made_and_parameters_paid_for():
    w = noise()
    w[::3] = np.nan
    found = floor_ratio(w, parameters=10.0)
    assert found.dof == ROWS - ROWS // 3 - 10
    assert found.ratio == pytest.approx(np.sqrt(np.nansum(w**2) / found.dof))
    assert not floor_ratio(1.1 * w).is_at_floor
    assert floor_ratio(1.1 * w, sd_uncertainty=0.1).is_at_floor


def test_shares_of_every_condition_add_to_one_and_point_at_the_planted_cell(conditions):
    w = noise()
    cold = conditions[0].values == -10.0
    w[cold] += 1.5
    cells = split_excess(w, conditions, block_labels(chain_starts([range(ROWS)]), 50))
    for condition in conditions:
        of_it = [cell for cell in cells if cell.regressor == condition.name]
        assert sum(cell.share for cell in of_it) == pytest.approx(1.0)
        assert sum(cell.count for cell in of_it) == ROWS
    coldest, *warmer = [cell for cell in cells if cell.regressor == "temperature"]
    assert (coldest.lower, coldest.upper) == (-10.0, -10.0)
    assert coldest.share > 0.9
    assert coldest.bias == pytest.approx(1.5, abs=4.0 * coldest.bias_se)
    assert coldest.is_biased
    assert not any(cell.is_biased for cell in warmer)


def test_clusters_keep_correlated_errors_from_looking_like_bias():
    correlated = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], noise())
    everywhere = [Regressor("everywhere", "", np.zeros(ROWS))]
    (naive,) = split_excess(correlated, everywhere, np.arange(ROWS))
    (robust,) = split_excess(correlated, everywhere, block_labels(chain_starts([range(ROWS)]), 200))
    assert robust.bias_se == pytest.approx(naive.bias_se * np.sqrt(1.95 / 0.05), rel=0.35)


def test_missing_readings_count_nowhere(conditions):
    w = noise()
    w[:1000] = np.nan
    cells = split_excess(w, conditions, np.arange(ROWS) // 50)
    assert sum(cell.count for cell in cells) == 3 * (ROWS - 1000)


def test_tree_finds_a_planted_region_and_says_so(conditions):
    temperature, current, _ = (condition.values for condition in conditions)
    w = noise()
    planted = (temperature < 5.0) & (current > 6.0)
    w[planted] += 4.0
    region = worst_region(w, conditions)
    assert region is not None
    assert np.mean(region.rows == planted) > 0.99
    assert region.share > 0.97
    assert region.fraction == pytest.approx(planted.mean(), abs=0.01)
    bounds = {(c.regressor, c.is_below): c.threshold for c in region.conditions}
    assert bounds.keys() == {("temperature", True), ("|current|", False)}
    assert bounds["temperature", True] == 10.0
    assert bounds["|current|", False] == pytest.approx(6.0, abs=0.15)
    sentence = region.sentence()
    assert f"of the excess error is in {100.0 * region.fraction:.0f} % of the samples" in sentence
    assert "temperature below 10 degC" in sentence
    assert "|current| above" in sentence


def test_sentence_is_true_of_the_rows_it_speaks_of(conditions):
    charge = conditions[2].values
    w = noise() * np.where((charge > 0.3) & (charge < 0.4), 3.0, 1.0)
    region = worst_region(w, conditions)
    assert region is not None
    values = {condition.name: condition.values for condition in conditions}
    holds = np.ones(ROWS, dtype=bool)
    for condition in region.conditions:
        below = values[condition.regressor] < condition.threshold
        holds &= below if condition.is_below else ~below
    assert np.array_equal(region.rows, holds)
    assert region.share == pytest.approx(np.sum(w[holds] ** 2 - 1.0) / np.sum(w**2 - 1.0))
    assert "state of charge between 0.3" in region.sentence()


def test_tree_is_silent_about_noise_and_about_an_even_spread(conditions):
    assert all(worst_region(noise(seed), conditions) is None for seed in range(10))
    assert worst_region(1.5 * noise(), conditions) is None


def test_tree_leaves_out_missing_readings_and_refuses_missing_conditions(conditions):
    w = noise()
    w[conditions[1].values > 6.0] += 3.0
    w[::2] = np.nan
    region = worst_region(w, conditions)
    assert region is not None
    assert not region.rows[::2].any()
    conditions[1].values[1] = np.nan
    with pytest.raises(ValueError, match="current"):
        worst_region(w, conditions)


def test_ljung_box_tells_white_from_coloured_and_corrects_for_the_number_of_series():
    series = {f"run {k}": noise(k)[:500] for k in range(5)}
    series["coloured"] = lfilter([1.0], [1.0, -0.3], noise(9)[:500])
    series["too short"] = noise()[:10]
    found = {result.series: result for result in ljung_box(series)}
    assert found.keys() == series.keys() - {"too short"}
    assert found["coloured"].p_holm < 1e-4
    assert found["coloured"].lags == 25
    assert min(found[f"run {k}"].p_holm for k in range(5)) > 0.05
    assert all(result.p_holm >= result.p for result in found.values())


def test_a_motor_at_rest_is_one_condition_whatever_its_rounding() -> None:
    generator = np.random.default_rng(5)
    speed = np.concatenate([generator.normal(size=300) * 1e-160, np.repeat([50.0, 100.0], 300)])
    cells = split_excess(generator.normal(size=900), [Regressor("speed", "rad/s", speed)], np.arange(900) // 30)
    assert [(cell.lower, cell.upper, cell.count) for cell in cells] == [
        (0.0, 0.0, 300),
        (50.0, 50.0, 300),
        (100.0, 100.0, 300),
    ]


def test_readings_that_the_model_meets_exactly_are_no_bias() -> None:
    """A coarse thermometer at rest reads what an isothermal model says, every time."""
    residual = np.concatenate([np.zeros(200), noise()[:200] + 3.0])
    run = Regressor("run", "", np.repeat([0.0, 1.0], 200))
    cells = split_excess(residual, [run], np.arange(400) // 20)
    assert [cell.is_biased for cell in cells] == [False, True]
