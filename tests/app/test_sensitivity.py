"""`jaxmodel sensitivity` and `identify` beyond the derivatives: what is written, and what is said of mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from tests.app.conftest import Run

PNG = b"\x89PNG\r\n\x1a\n"
STUDY = """
title = "a small cell"
kind = "cell"
metrics = ["final_soc", "min_voltage_V"]
store = ["voltage_V"]
[profile]
duration_s = 40
step_s = 10
current_A = 2.0
ambient_degC = 20.0
[sample]
count = 4
ranges = { capacity_Ah = [2.0, 4.0], current_A = [1.0, 2.0] }
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("study") / "study.toml"
    file.write_text(STUDY, encoding="utf-8")
    return file


def test_uncertainty_is_written_by_both_ways(run: Run, study: Path, tmp_path: Path) -> None:
    options = ("--at", "current_A=1.7", "--uncertain", "capacity_Ah=0.05", "--count", 64)
    result = run("sensitivity", study, *options, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    data = xr.open_zarr(tmp_path / "uncertainty.zarr", consolidated=False)
    sd = data["metric_sd_gradient"].sel(metric="final_soc")
    used = 1.0 - float(data["metric_value"].sel(metric="final_soc"))
    assert float(sd) == pytest.approx(used * 0.05 / 5.2, rel=0.05)  # the cell of the paper: 5.2 Ah
    table = pd.read_csv(tmp_path / "uncertainty.csv", index_col="metric")
    assert table.loc["final_soc", "metric_sd_gradient"] == pytest.approx(float(sd))
    assert "quantile_0.025" in table
    assert "by the gradient, 95 %" in (tmp_path / "uncertainty.html").read_text(encoding="utf-8")
    for name in ("uncertainty", "uncertainty-voltage_V"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(PNG)
    assert "capacity_Ah 100%" in result.stdout


@pytest.mark.slow
def test_identify_answers_and_hands_its_covariance_on(run: Run, made_case: Path, tmp_path: Path) -> None:
    identified = run("identify", made_case, "--parameter", "capacity_Ah", "--out", tmp_path / "told")
    assert identified.exit_code == 0, identified.output
    assert "Profile of capacity_Ah: " in identified.stdout
    table = pd.read_csv(tmp_path / "told" / "identifiability.csv", index_col="parameter")
    covariance = pd.read_csv(tmp_path / "told" / "covariance.csv", index_col=0)
    assert np.sqrt(covariance.loc["capacity_Ah", "capacity_Ah"]) == pytest.approx(
        table.loc["capacity_Ah", "sd"], rel=1e-6
    )
    names = {path.name for path in (tmp_path / "told").iterdir()}
    assert {"information.png", "profile-capacity_Ah.png", "identify.json", "sd-without.csv"} <= names

    (tmp_path / "study.toml").write_text(STUDY.replace("title", f'case = "{made_case}"\ntitle'), encoding="utf-8")
    result = run("sensitivity", tmp_path / "study.toml", "--uncertain", tmp_path / "told", "--out", tmp_path / "bands")
    assert result.exit_code == 0, result.output
    data = xr.open_zarr(tmp_path / "bands" / "uncertainty.zarr", consolidated=False)
    assert float(data["value"].sel(parameter="capacity_Ah")) == pytest.approx(
        table.loc["capacity_Ah", "value"], rel=1e-6
    )
    assert set(data["parameter"].values) == {name for name in table.index if "[" not in name}


def test_identify_leaves_a_glitch_out_and_says_so(run: Run, case_folder: Path, tmp_path: Path) -> None:
    table = pd.read_csv(case_folder / "run-01.csv")
    table.loc[20, "voltage_V"] = 0.0
    table.to_csv(case_folder / "run-01.csv", index=False)
    identified = run("identify", case_folder, "--out", tmp_path)
    assert identified.exit_code == 0, identified.output
    outlier = "1 reading of voltage_V excluded as outlier"
    assert outlier in identified.stdout
    (remark,) = json.loads((tmp_path / "identify.json").read_text(encoding="utf-8"))["remarks"]
    assert remark.startswith(outlier)
    capacity = pd.read_csv(tmp_path / "identifiability.csv", index_col="parameter").loc["capacity_Ah"]
    assert abs(capacity["value"] - 3.0) < 4.0 * capacity["sd"]


def test_derivatives_are_drawn_to_be_read_with_a_pointer(run: Run, study: Path, tmp_path: Path) -> None:
    result = run("sensitivity", study, "--gradient-only", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "in forward mode" in result.stdout
    page = (tmp_path / "sensitivity.html").read_text(encoding="utf-8")
    assert page.count("Plotly.newPlot(") >= 2  # elasticities, and the voltage over time
    assert "change for +1 % of each parameter" in page


def test_map_over_two_axes_is_drawn(run: Run, tmp_path: Path) -> None:
    axes = "[axes]\ncurrent_A = [1.0, 2.0, 4.0]\nambient_degC = [0.0, 30.0]\n"
    (tmp_path / "study.toml").write_text(STUDY.split("[sample]")[0] + axes, encoding="utf-8")
    result = run("sensitivity", tmp_path / "study.toml", "--map", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    data = xr.open_zarr(tmp_path / "out" / "elasticity-map.zarr", consolidated=False)
    used = 1.0 - data["metric_value"].sel(metric="final_soc")
    np.testing.assert_allclose(used.diff("current_A").sum("current_A"), 0.75 * used.sel(current_A=4.0), rtol=0.02)
    assert (tmp_path / "out" / "elasticity-map-final_soc.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize("method", ["sobol", "morris", "dgsm"])
def test_global_indices_are_written(method: str, run: Run, study: Path, tmp_path: Path) -> None:
    result = run("sensitivity", study, "--global", method, "--count", 64, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    runs = {"sobol": 64 * 6, "morris": 64 * 3, "dgsm": 64 * 3}[method]
    assert f"{method}, {runs} runs" in result.stdout
    main = {"sobol": "total", "morris": "mu_star", "dgsm": "dgsm"}[method]
    table = pd.read_csv(tmp_path / "global.csv", index_col=["metric", "factor"])
    assert set(table.index.get_level_values("factor")) == {"capacity_Ah", "current_A"}
    assert (table[main] > 0.0).all()
    assert (table[f"{main}_error"] > 0.0).all()
    page = (tmp_path / "global.html").read_text(encoding="utf-8")
    assert "Plotly.newPlot" in page
    assert "src=" not in page.split("<body>")[1][:200]  # nothing is fetched
    assert "current_A" in page.split("Plotly.newPlot")[-1]
    for name in (f"{method}-final_soc", "convergence-final_soc"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--at", "scale.current_A=2"), "a point has parameters and inputs"),
        (("--uncertain", "capacity_Ah"), "holds no results of identify; name a folder that does"),
        (("--uncertain", "case"), "the study names no case"),
        (("--uncertain", "capacity=1"), "Did you mean 'capacity_Ah'"),
        (("--map",), "two axes make a map"),
        (("--pair", "capacity_Ah"), "write two names or more"),
        (("--pair", "capacity_Ah,cycle"), "Did you mean 'cycles'"),
        (("--global", "fast"), "method fast: use one of sobol, morris, dgsm"),
        (("--global", "sobol", "--at", "current_A=2"), "two parameters or groups at least"),
        (("--global", "sobol", "--group", "all"), "--group all: write a name and its members"),
        (("--global", "sobol", "--uncertain", "capacity_Ah=1"), "either --uncertain or --global or --pair"),
        (("--uncertain", "capacity_Ah=x"), "--uncertain capacity_Ah=x: write a name and a number"),
    ],
)
def test_mistakes_are_told(options: tuple[str, ...], says: str, run: Run, study: Path, tmp_path: Path) -> None:
    result = run("sensitivity", study, *options, "--out", tmp_path)
    assert result.exit_code == 2
    assert says in result.stderr


def test_pairs_are_differentiated_twice_and_doubled_both(run: Run, study: Path, tmp_path: Path) -> None:
    pair = ("--pair", "capacity_Ah,current_A,cycles")
    result = run("sensitivity", study, *pair, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "interactions.csv", index_col=["metric", "first", "second"])
    assert len(table) == 2 * 6  # two metrics; three pairs, and each name with itself
    # The charge used is i t / (3600 Q): doubled both, the run ends as before.
    used = table.loc[("final_soc", "capacity_Ah", "current_A")]
    assert used["change_both"] == pytest.approx(0.0, abs=1e-12)
    assert used["predicted_joint"] == pytest.approx(1.0 - used["metric_value"], rel=1e-9)
    assert (tmp_path / "interactions-final_soc.png").read_bytes().startswith(PNG)
    assert "power law" in result.stdout
