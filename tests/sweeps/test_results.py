from __future__ import annotations

import json

import numpy as np
import pandas as pd
import xarray as xr

from jaxmodel.sweeps import load, metrics_of, run, save


def test_axes_and_metrics_are_labelled_with_units(robot_study, robot_result):
    assert dict(robot_result.sizes) == {"ambient_degC": 2, "load_torque_Nm": 3, "ocv_hysteresis.M_V": 2, "time_s": 5}
    units = {name: robot_result[name].attrs["units"] for name in robot_result.coords}
    assert units == {"ambient_degC": "degC", "load_torque_Nm": "N m", "ocv_hysteresis.M_V": "V", "time_s": "s"}
    np.testing.assert_array_equal(robot_result.time_s, [0.0, 60.0, 120.0, 180.0, 240.0])
    expected = {metric.name: metric.unit for metric in metrics_of("robot").values()}
    assert {name: robot_result[name].attrs["units"] for name in expected} == expected
    assert robot_result.pack_voltage_V.attrs["units"] == "V"
    assert robot_result.status.attrs["flag_meanings"].split()[robot_result.status.values.max()] == "reached_cutoff"


def test_values_lie_where_their_labels_say(robot_result):
    """More torque drains faster, and at 100 degC more rows are outside the range of the equations."""
    at = robot_result.sel(ambient_degC=-20.0).isel({"ocv_hysteresis.M_V": 0})
    assert np.all(np.diff(at.soc_gradient) < 0.0)
    assert float(robot_result.valid_share.sel(ambient_degC=-20.0).min()) == 1.0
    assert float(robot_result.valid_share.sel(ambient_degC=100.0).max()) < 1.0


def test_saved_result_reads_back_the_same(tmp_path, robot_study, robot_result):
    folder = save(robot_result, tmp_path / "out")
    xr.testing.assert_identical(load(folder).load(), robot_result)
    table = pd.read_csv(folder / "lanes.csv", dtype=str)  # the parser of pandas 3.0.0 drops digits
    assert len(table) == robot_study.size
    np.testing.assert_array_equal(table["soc_gradient"].astype(float), robot_result.soc_gradient.values.ravel())
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["study_sha256"] == robot_study.digest
    assert manifest["study"]["axes"] == robot_study.axes
    assert manifest["versions"]["jax"]
    assert manifest["performance"]["lanes"] == robot_study.size


def test_saving_again_replaces_what_was_there(tmp_path, cell_study):
    save(run(cell_study()), tmp_path)
    smaller = run(cell_study(axes={"current_A": [1.0, 2.0]}))
    xr.testing.assert_identical(load(save(smaller, tmp_path)).load(), smaller)
