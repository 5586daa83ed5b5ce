"""The table of errors: a row for each channel of each run."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from discrepancy.residuals.summary import COLUMNS

from discrepancy.residuals import ChannelResiduals, error_table
from tests.discrepancy.residuals.made_residuals import constant_currents


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


def test_every_reading_counts_once_as_in_the_ladder() -> None:
    residuals = constant_currents(lambda run, number: 0.0, rates=(1.0,))
    weight = np.where(np.arange(residuals.error.size) == 0, 3.0 * residuals.error.size, 1.0)
    error = np.where(np.arange(residuals.error.size) == 0, 1.0, 0.0)
    table = error_table([dataclasses.replace(residuals, weight_s=weight, error=error)])
    assert table.loc[0, "rms"] == pytest.approx(np.sqrt(np.mean(error**2)))


def test_columns_of_unequal_length_and_missing_values_are_refused() -> None:
    residuals = constant_currents(lambda run, number: 0.0)
    with pytest.raises(ValueError, match="shape"):
        dataclasses.replace(residuals, weight_s=residuals.weight_s[1:])
    with pytest.raises(ValueError, match="missing"):
        dataclasses.replace(residuals, error=np.where(residuals.run == 0, np.nan, residuals.error))
