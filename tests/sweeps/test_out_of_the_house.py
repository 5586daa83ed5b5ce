"""Results of sweeps for other tools: attributes of the CF conventions, and lanes as Parquet."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import xarray as xr

from jaxmodel import sweeps
from jaxmodel.sweeps import parquet
from tests.export.other_python import run_by

HERE = Path(__file__).parent
CELL = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
AXES = {"capacity_Ah": [2.0, 3.0, 4.0], "ambient_degC": [0.0, 20.0]}


@pytest.fixture(scope="module")
def grid() -> xr.Dataset:
    study = sweeps.Study(kind="cell", profile=CELL, axes=AXES, store=["voltage_V", "soc"])
    return sweeps.run(study, progress=False)


@pytest.fixture(scope="module")
def sample() -> xr.Dataset:
    drawn = {"count": 5, "ranges": {"capacity_Ah": (2.0, 3.0)}}
    return sweeps.run(sweeps.Study(kind="cell", profile=CELL, sample=drawn), progress=False)


@pytest.mark.parametrize("which", ["grid", "sample"])
def test_a_result_and_what_is_stored_of_it_say_the_same_of_themselves(
    which: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    result = request.getfixturevalue(which)
    stored = sweeps.load(sweeps.save(result, tmp_path)).load()
    xr.testing.assert_identical(stored, result)
    assert result.attrs["Conventions"] == "CF-1.11"
    assert result.attrs["title"] == "Sweep of a cell"
    for one in (result, stored):
        assert one["status"].attrs["flag_values"].dtype == one["status"].dtype == np.int8
        assert all(coordinate.encoding["_FillValue"] is None for coordinate in one.coords.values())
        assert all({"units", "long_name"} <= variable.attrs.keys() for variable in one.variables.values())


def test_columns_over_time_are_named_in_words(grid: xr.Dataset) -> None:
    assert grid["soc"].attrs == {"units": "", "long_name": "state of charge"}
    assert grid["ambient_degC"].attrs == {"units": "degC", "long_name": "input ambient"}


def test_a_row_is_a_lane_in_the_order_of_the_axes(grid: xr.Dataset, tmp_path: Path) -> None:
    table = pd.read_parquet(sweeps.to_parquet(grid, tmp_path / "lanes.parquet"))
    assert list(table.columns)[:2] == list(AXES)
    assert "voltage_V" not in table
    np.testing.assert_array_equal(table["capacity_Ah"], [2.0, 2.0, 3.0, 3.0, 4.0, 4.0])
    np.testing.assert_array_equal(table["final_soc"], grid["final_soc"].to_numpy().ravel())
    assert table["status"].dtype == np.int8
    stored = sweeps.load(sweeps.save(grid, tmp_path / "out"))
    pd.testing.assert_frame_equal(pd.read_parquet(sweeps.to_parquet(stored, tmp_path / "again.parquet")), table)


@pytest.mark.parametrize("most", [1, 2, 3, 4, 5])
def test_lanes_go_out_in_blocks_of_any_size(
    grid: xr.Dataset, most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = pd.read_parquet(sweeps.to_parquet(grid, tmp_path / "whole.parquet"))
    monkeypatch.setattr(parquet, "_LANES_AT_ONCE", most)
    blocks = sweeps.to_parquet(grid, tmp_path / "blocks.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(blocks), whole)
    assert pq.ParquetFile(blocks).num_row_groups > 1


def test_columns_say_their_units(sample: xr.Dataset, tmp_path: Path) -> None:
    schema = pq.read_schema(sweeps.to_parquet(sample, tmp_path / "lanes.parquet"))
    assert schema.field("capacity_Ah").metadata[b"units"] == b"A h"
    assert json.loads(schema.field("status").metadata[b"flag_values"]) == [0, 1, 2, 3]
    assert json.loads(schema.metadata[b"manifest"])["study"]["sample"]["count"] == 5


def test_a_file_that_cannot_be_whole_is_not_there(sample: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        sweeps.to_parquet(sample, tmp_path / "nowhere" / "lanes.parquet")
    broken = sample.assign(status=sample["status"].astype(float))
    broken["status"].attrs["flag_values"] = {"not": "an array"}
    with pytest.raises(AttributeError):
        sweeps.to_parquet(broken, tmp_path / "lanes.parquet")
    assert list(tmp_path.iterdir()) == []


def test_the_checker_of_the_cf_conventions_has_no_complaint(
    grid: xr.Dataset, sample: xr.Dataset, tmp_path: Path
) -> None:
    paths = [tmp_path / "grid.nc", tmp_path / "sample.nc"]
    for path, result in zip(paths, (grid, sample), strict=True):
        sweeps.load(sweeps.save(result, tmp_path / path.stem)).to_netcdf(path, engine="scipy")
    found = run_by("compliance_checker", str(HERE / "by_compliance_checker.py"), *paths)
    for path in paths:
        assert found[str(path)]["checked"] > 10
        assert found[str(path)]["complaints"] == []


def test_duckdb_reads_the_lanes(grid: xr.Dataset, tmp_path: Path) -> None:
    path = sweeps.to_parquet(grid, tmp_path / "lanes.parquet")
    read = run_by("duckdb", str(HERE / "by_duckdb.py"), path)[str(path)]
    np.testing.assert_array_equal(read["columns"]["final_soc"], grid["final_soc"].to_numpy().ravel())
    assert read["said"]["Conventions"] == "CF-1.11"
