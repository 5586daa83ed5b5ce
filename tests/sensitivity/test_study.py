"""From a study file to its sensitivities: the same names and numbers as the sweep of that file."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray

from jaxmodel import sensitivity
from jaxmodel.base.errors import SweepError
from jaxmodel.sensitivity import interactions, local, stated_sd, uncertainty
from jaxmodel.sweeps.engine import run
from jaxmodel.sweeps.study import Study, read_study

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
CASE = """
kind = "cell"
preset = "paper"
[parameters]
capacity_Ah = { value = 3.0, sd = 0.1 }
[sensors]
voltage_V = 0.001
[[runs]]
file = "run.csv"
split = "fit"
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    file = tmp_path_factory.mktemp("study") / "ages.toml"
    file.write_text(STUDY)
    return read_study(file)


@pytest.fixture(scope="module")
def data(study: Study) -> xarray.Dataset:
    return local(study)


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
    alone = local(study, doubling=False)
    assert set(alone) < set(data)
    assert "effect" not in alone
    xarray.testing.assert_identical(alone.elasticity, data.elasticity)


def test_point_moves_the_derivatives(study: Study):
    """Of the charge used, i t / 3600 C with i the current at the point: the elasticity by C is -(1 - soc) / soc."""
    moved = local(study.at({"current_A": 4.0}), doubling=False).sel(metric="final_soc")
    soc = float(moved["metric_value"])
    by_capacity = float(moved["elasticity"].sel(parameter="capacity_Ah"))
    assert by_capacity == pytest.approx((1.0 - soc) / soc, rel=1e-9)
    assert float(moved["value"].sel(parameter="capacity_Ah")) == 3.0


def test_names_stand_for_every_pair_of_them(study: Study):
    data = interactions(study, ["capacity_Ah", "cycles"])
    found = list(zip(data["first"].values, data["second"].values, strict=True))
    assert found == [("capacity_Ah", "capacity_Ah"), ("capacity_Ah", "cycles"), ("cycles", "cycles")]
    pair = interactions(study, [("capacity_Ah", "cycles")])
    np.testing.assert_array_equal(pair["second_derivative"][:, 0], data["second_derivative"][:, 1])


def test_spread_is_that_of_the_case_unless_stated(study: Study, tmp_path: Path):
    (tmp_path / "case.toml").write_text(CASE)
    (tmp_path / "run.csv").write_text("time_s,current_A,ambient_degC,voltage_V\n0,0,20,4.1\n10,2,20,4.0\n")
    of_case = study.replace(case=str(tmp_path / "case.toml"), kind=None, parameters={}, metrics=["final_soc"])
    assert stated_sd(of_case) == {"capacity_Ah": 0.1}
    data = uncertainty(of_case, draws=16).sel(metric="final_soc")
    # soc = soc_0 - i t / C': its sd is (soc_0 - soc) sd / C.
    used = 1.0 - float(data["metric_value"])
    assert float(data["metric_sd_gradient"]) == pytest.approx(used * 0.1 / 3.0, rel=1e-9)
    with pytest.raises(SweepError, match="the study names no case"):
        uncertainty(study)


def test_result_is_read_back_as_it_was(data: xarray.Dataset, tmp_path: Path):
    store = sensitivity.save(data, tmp_path)
    assert store.name == "sensitivity.zarr"
    for place in (tmp_path, store):
        again = sensitivity.load(place)
        xarray.testing.assert_identical(again.compute(), data)
    table = pd.read_csv(tmp_path / "sensitivity.csv", index_col=["metric", "parameter"])
    assert table.loc[("final_soc", "capacity_Ah"), "elasticity"] == pytest.approx(
        float(data["elasticity"].sel(metric="final_soc", parameter="capacity_Ah")), rel=1e-11
    )


def test_what_is_no_result_is_refused(data: xarray.Dataset, tmp_path: Path):
    with pytest.raises(SweepError, match="holds no result of a sensitivity"):
        sensitivity.load(tmp_path)
    store = sensitivity.save(data, tmp_path)
    shutil.copytree(store, tmp_path / "global.zarr")
    with pytest.raises(SweepError, match=r"holds sensitivity\.zarr, global\.zarr; give the path of one"):
        sensitivity.load(tmp_path)
    (store / "zarr.json").write_text("{")
    with pytest.raises(SweepError, match="its files are damaged"):
        sensitivity.load(store)


def test_largest_elasticity_is_named(data: xarray.Dataset):
    name, value = sensitivity.largest_elasticity(data, "soc_gradient")
    assert abs(value) == float(abs(data["elasticity"].sel(metric="soc_gradient")).max())
    assert value == float(data["elasticity"].sel(metric="soc_gradient", parameter=name))
