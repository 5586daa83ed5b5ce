"""From a study file to its sensitivities: the same names and numbers as the sweep of that file."""

from __future__ import annotations

import numpy as np
import pytest
import xarray

from sensitivity.study import sensitivity_of_study
from sweeps.engine import run
from sweeps.study import Study, read_study

STUDY = """
title = "a cell at two ages"
kind = "cell"
metrics = ["soc_gradient", "final_soc", "delivered_energy_Wh", "min_voltage_V", "valid_share"]
store = ["voltage_V"]
store_every = 4
[parameters]
capacity_Ah = 3.0
[profile]
duration_s = 80.0
step_s = 10.0
current_A = 2.0
ambient_degC = 10.0
[axes]
cycles = [25.0, 100.0]
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    file = tmp_path_factory.mktemp("study") / "ages.toml"
    file.write_text(STUDY)
    return read_study(file)


@pytest.fixture(scope="module")
def data(study: Study) -> xarray.Dataset:
    return sensitivity_of_study(study)


def test_study_is_looked_at_in_its_own_point(study: Study, data: xarray.Dataset):
    """The parameters of the file, the axis at the preset's value, and of the metrics those that have a derivative."""
    assert data.attrs["title"] == "a cell at two ages"
    assert list(data.metric.values) == ["soc_gradient", "final_soc", "delivered_energy_Wh", "min_voltage_V"]
    assert float(data.value.sel(parameter="capacity_Ah")) == 3.0
    assert float(data.value.sel(parameter="cycles")) == 25.0
    assert list(data.time_s.values) == [0.0, 40.0, 80.0]
    assert list(data.output.values) == ["voltage_V"]
    assert data.attrs["simulations"] == 4 * data.sizes["parameter"]
    np.testing.assert_allclose(data.linear_change, data.metric_change, rtol=1e-9, atol=1e-15)


def test_metrics_are_those_of_the_sweep(study: Study, data: xarray.Dataset):
    """The sweep's first lane is the point, and its two lanes' difference the mean of the derivative between them."""
    swept = run(study)
    for name in data.metric.values:
        assert float(data.metric_value.sel(metric=name)) == pytest.approx(float(swept[name][0]), rel=1e-12)
    np.testing.assert_allclose(data.output_value.sel(output="voltage_V"), swept.voltage_V[0], rtol=1e-12)
    # R_cyc = 0.0015 sqrt(n), and the voltage is linear in it: from 25 to 100 cycles it moves by 2 n d/dn.
    lost = 2.0 * 25.0 * data.output_derivative.sel(output="voltage_V", parameter="cycles")
    np.testing.assert_allclose(swept.voltage_V[1] - swept.voltage_V[0], lost, rtol=1e-9)


def test_without_doubling_only_derivatives_are_returned(study: Study, data: xarray.Dataset):
    alone = sensitivity_of_study(study, doubling=False)
    assert set(alone) < set(data)
    assert "effect" not in alone
    xarray.testing.assert_identical(alone.elasticity, data.elasticity)
