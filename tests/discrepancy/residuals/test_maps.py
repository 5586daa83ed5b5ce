"""Maps over two conditions, profiles of runs, and the table of errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from discrepancy.residuals import ChannelResiduals, error_table, map_over_two, maps, profile
from discrepancy.residuals.regimes import cut
from discrepancy.residuals.summary import COLUMNS
from tests.discrepancy.residuals.made_residuals import between, constant_currents, pulses


def test_a_map_finds_the_planted_corner() -> None:
    residuals = pulses(lambda run, number: 0.005 * (run["soc"] < 0.6) * (run["current_A"] > 3.0), rho=0.0)
    cells = map_over_two(residuals, cut(residuals, "soc"), cut(residuals, "current_A"))
    for cell in cells:
        inside = cell.x[1] < 0.6 and cell.y[0] > 3.0
        assert not cell.is_biased or inside
        assert cell.is_biased or not inside or cell.count < 200, "where several runs were it is beyond chance"
        assert cell.mean == pytest.approx(0.005 * inside, abs=4e-4)
    assert sum(cell.count for cell in cells) == pytest.approx(residuals.error.size, abs=20)


def test_a_memory_of_the_noise_is_no_bias() -> None:
    biased = [
        cell.is_biased
        for seed in range(5)
        for cells in maps(pulses(lambda run, number: 0.0, rho=0.97, seed=seed)).values()
        for cell in cells
    ]
    assert np.mean(biased) < 0.03


def test_readings_that_the_model_meets_exactly_are_no_bias() -> None:
    residuals = constant_currents(lambda run, number: 0.0)
    still = dataclasses.replace(residuals, error=np.where(residuals.run == 0, 0.0, 1.0))
    assert not any(cell.is_biased and cell.mean == 0.0 for cells in maps(still).values() for cell in cells)


def test_a_profile_gives_each_run_its_means_by_time() -> None:
    residuals = constant_currents(lambda run, number: 0.01 * number * between(run["soc"], 0.3, 0.4), sd=1e-9)
    found = profile(residuals, "soc")
    place = found.bins.lower.tolist().index(0.3)
    assert found.mean[:, place] == pytest.approx([0.0, 0.01, 0.02, 0.03], abs=1e-8)
    assert found.seconds.sum() == pytest.approx(residuals.weight_s.sum())
    partly = profile(residuals.rows((residuals.run > 0) | (residuals.conditions["soc"] > 0.5)), "soc")
    assert np.isnan(partly.mean[0, 0])


def test_the_table_has_a_row_for_each_channel_of_each_run() -> None:
    residuals = constant_currents(lambda run, number: 0.002 * (number + 1), sd=1e-4, tolerance=0.005)
    other: ChannelResiduals = dataclasses.replace(
        residuals.rows(residuals.run < 2), channel="soc", unit="", tolerance=None
    )
    table = error_table([residuals, other], {"run-01": "fit", "run-04": "check"})
    assert tuple(table.columns) == COLUMNS
    assert len(table) == 6
    voltage = table[table.channel == "voltage_V"].set_index("run")
    assert voltage.rms.to_list() == pytest.approx([0.002, 0.004, 0.006, 0.008], rel=0.01)
    assert voltage["mean"].to_list() == pytest.approx([0.002, 0.004, 0.006, 0.008], rel=0.01)
    assert voltage.within_tolerance.to_list() == [True, True, False, False]
    assert voltage.loc["run-01", "split"] == "fit"
    assert voltage.loc["run-02", "split"] == ""
    assert voltage.loc["run-01", "rms_over_noise"] == pytest.approx(20.0, rel=0.01)
    assert table[table.channel == "soc"].within_tolerance.isna().all()


def test_a_row_counts_by_the_time_it_stands_for() -> None:
    residuals = constant_currents(lambda run, number: 0.0, rates=(1.0,))
    weight = np.where(np.arange(residuals.error.size) == 0, 3.0 * residuals.error.size, 1.0)
    error = np.where(np.arange(residuals.error.size) == 0, 1.0, 0.0)
    table = error_table([dataclasses.replace(residuals, weight_s=weight, error=error)])
    assert table.loc[0, "rms"] == pytest.approx(np.sqrt(0.75), rel=1e-3)


def test_columns_of_unequal_length_and_missing_values_are_refused() -> None:
    residuals = constant_currents(lambda run, number: 0.0)
    with pytest.raises(ValueError, match="shape"):
        dataclasses.replace(residuals, weight_s=residuals.weight_s[1:])
    with pytest.raises(ValueError, match="missing"):
        dataclasses.replace(residuals, error=np.where(residuals.run == 0, np.nan, residuals.error))
