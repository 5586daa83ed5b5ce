"""Floor ratios and Ljung-Box tests say of noise that it is noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from discrepancy.residuals.whiteness import floor_ratio, ljung_box

ROWS = 6000


def noise(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=ROWS)


def test_noise_alone_is_at_the_floor_about_as_often_as_promised() -> None:
    ratios = [floor_ratio(noise(seed)) for seed in range(200)]
    assert np.mean([found.ratio for found in ratios]) == pytest.approx(1.0, abs=0.003)
    assert 0.93 <= np.mean([found.is_at_floor for found in ratios]) <= 1.0


def test_floor_counts_readings_that_were_made_and_parameters_paid_for() -> None:
    w = noise()
    w[::3] = np.nan
    found = floor_ratio(w, parameters=10.0)
    assert found.dof == ROWS - ROWS // 3 - 10
    assert found.ratio == pytest.approx(np.sqrt(np.nansum(w**2) / found.dof))
    assert not floor_ratio(1.1 * w).is_at_floor
    assert floor_ratio(1.1 * w, sd_uncertainty=0.1).is_at_floor


def test_ljung_box_tells_white_from_coloured_and_corrects_for_the_number_of_series() -> None:
    series = {f"run {k}": noise(k)[:500] for k in range(5)}
    series["coloured"] = lfilter([1.0], [1.0, -0.3], noise(9)[:500])
    series["too short"] = noise()[:10]
    found = {result.series: result for result in ljung_box(series)}
    assert found.keys() == series.keys() - {"too short"}
    assert found["coloured"].p_holm < 1e-4
    assert found["coloured"].lags == 25
    assert min(found[f"run {k}"].p_holm for k in range(5)) > 0.05
    assert all(result.p_holm >= result.p for result in found.values())
