"""The command line from end to end: what each command writes, and that one command takes what another gives."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jaxmodel.app import terminal, timings
from jaxmodel.app.commands import diagnose as diagnose_command
from jaxmodel.base.jax_settings import cache_folder
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.result import VERDICTS, Diagnosis
from jaxmodel.effects import CATALOGUE
from jaxmodel.lanes import Kernel, NotNative, Pool, over
from jaxmodel.model.simulation import simulate
from tests.app.conftest import Run
from tests.made_up import law, with_additions

PNG = b"\x89PNG\r\n\x1a\n"
STUDY = """
title = "a small cell"
kind = "cell"
metrics = ["soc_gradient", "final_soc", "min_voltage_V", "valid_share"]
store = ["voltage_V"]
[effects]
self_heating = {}
[profile]
duration_s = 40
step_s = 10
current_A = 2.0
ambient_degC = 20.0
[axes]
capacity_Ah = [2.0, 3.0, 4.0]
ambient_degC = [0.0, 80.0]
"""
OWN_EFFECT = '''
from typing import ClassVar

from jaxmodel.model.declaration import parameter
from jaxmodel.model.ports import Effect


class ContactResistance(Effect):
    """A contact in series with the cell."""

    name: ClassVar[str] = "contact_resistance"
    kinds: ClassVar[tuple[str, ...]] = ("cell",)
    equation: ClassVar[str] = "V -= i R_c"
    R_c: object = parameter(0.01, unit="ohm", meaning="contact", null=0.0, lower=0.0, upper=1.0, typical=(0.001, 0.1))

    def overpotential(self, value, context):
        return value + context.current_A * self.R_c
'''


def test_help_gives_an_example_and_loads_nothing_that_takes_long() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "jaxmodel.app.cli", "--help"], capture_output=True, text=True, timeout=60
    )
    assert result.returncode == 0
    assert "diagnose" in result.stdout
    loaded = "import sys, jaxmodel.app.cli; print(*sorted(sys.modules))"
    modules = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, timeout=60).stdout.split()
    assert {"jax", "pandas", "matplotlib", "xarray"}.isdisjoint(modules)


@pytest.mark.parametrize("command", ["simulate", "sweep", "sensitivity", "identify", "compare", "diagnose", "demo"])
def test_every_command_has_an_example(command: str, run: Run) -> None:
    result = run(command, "--help")
    assert result.exit_code == 0
    assert f"Example: jaxmodel {command}" in result.stdout
    assert "--out" in result.stdout


def test_simulate_writes_what_the_model_gives(run: Run, made_case: Path, case: Case, tmp_path: Path) -> None:
    result = run("simulate", made_case, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    for measured in case.runs:
        table = pd.read_csv(tmp_path / f"{measured.name}.csv")
        alone = simulate(case_model(case, measured), run_profile(measured))
        assert list(table.columns) == ["time_s", "voltage_V", "cell_temperature_degC", "soc", "valid"]
        assert table["valid"].all()
        np.testing.assert_allclose(table["time_s"], measured.measured.time_s)
        for name, values in alone.readings.items():
            np.testing.assert_allclose(table[name], values, rtol=1e-11)
        assert (tmp_path / f"{measured.name}.png").read_bytes().startswith(PNG)


def test_simulate_takes_effects_of_the_case_and_of_the_users_own(run: Run, case_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN_EFFECT, encoding="utf-8")
    own = ("--effect", f"{tmp_path / 'own.py'}:ContactResistance")
    assert run("simulate", case_folder, "--out", tmp_path / "without").exit_code == 0
    toml = case_folder / "case.toml"
    toml.write_text(toml.read_text() + "\n[effects]\ncontact_resistance = { R_c = 0.02 }\n", encoding="utf-8")
    result = run("simulate", case_folder, *own, "--out", tmp_path / "with")
    assert result.exit_code == 0, result.output
    before, after = (pd.read_csv(tmp_path / out / "run-01.csv") for out in ("without", "with"))
    np.testing.assert_allclose(before["voltage_V"] - after["voltage_V"], 0.02 * 3.0, rtol=1e-6)
    assert "contact_resistance" not in CATALOGUE


def test_lut_fidelity_is_another_model(run: Run, made_case: Path, tmp_path: Path) -> None:
    for fidelity in ("formula", "lut"):
        assert run("simulate", made_case, "--fidelity", fidelity, "--out", tmp_path / fidelity).exit_code == 0
    formula, lut = (pd.read_csv(tmp_path / fidelity / "run-03.csv") for fidelity in ("formula", "lut"))
    difference = np.abs(formula["voltage_V"] - lut["voltage_V"]).max()
    assert 1e-5 < difference < 0.3


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("study") / "study.toml"
    file.write_text(STUDY, encoding="utf-8")
    return file


def test_sweep_writes_tables_store_and_pictures(run: Run, study: Path, tmp_path: Path) -> None:
    result = run("sweep", study, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "6 lanes" in result.stdout
    assert (
        "2 of 6 lanes left" in result.stdout or "3 of 6 lanes left" in result.stdout
    )  # 80 degC is out of eq. 9's range
    store = xr.open_zarr(tmp_path / "result.zarr", consolidated=False)
    assert store["soc_gradient"].shape == (3, 2)
    for name in ("soc_gradient", "final_soc-curves", "voltage_V-over-time"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(PNG)


def test_sweep_is_told_before_it_is_run_goes_on_and_is_not_run_over(run: Run, study: Path, tmp_path: Path) -> None:
    told = run("sweep", study, "--dry-run", "--out", tmp_path / "out")
    assert told.exit_code == 0, told.output
    for said in ("lanes", "1 of at most 6 lanes", "memory", "disk", "lanes/s", "after"):
        assert said in told.stdout
    assert not (tmp_path / "out").exists()
    first = run("sweep", study, "--out", tmp_path / "out", "--memory", "100 MB")
    assert first.exit_code == 0, first.output
    again = run("sweep", study, "--out", tmp_path / "out")
    assert again.exit_code == 2
    assert "holds a finished sweep" in again.stderr
    resumed = run("sweep", study, "--out", tmp_path / "out", "--resume")
    assert resumed.exit_code == 0, resumed.output
    assert run("sweep", study, "--out", tmp_path / "other", "--engine", "nobody").exit_code == 2


def test_sweep_through_xla_for_want_of_an_instruction_is_said_in_one_line(
    run: Run, study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cannot(*_: object) -> None:
        raise NotNative('the operation "sort"')

    monkeypatch.setattr("jaxmodel.sweeps.runner.ByVectors", cannot)
    result = run("sweep", study, "--out", tmp_path / "out", "--answer-only")
    assert result.exit_code == 0
    assert result.stderr == 'The sweep runs through XLA: the operation "sort" has no vector instructions yet.\n'


def test_sweep_in_float32_is_asked_for_on_the_command_line(run: Run, study: Path, tmp_path: Path) -> None:
    assert run("sweep", study, "--out", tmp_path / "out", "--answer-only", "--precision", "float32").exit_code == 0
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["study"]["precision"] == "float32"
    refused = run("sweep", study, "--out", tmp_path / "other", "--precision", "float16")
    assert refused.exit_code == 2
    assert "precision" in refused.stderr


def test_sweep_of_a_sample_over_axes_is_drawn(run: Run, tmp_path: Path) -> None:
    text = STUDY.replace('store = ["voltage_V"]', "").replace("capacity_Ah = [2.0, 3.0, 4.0]\n", "")
    (tmp_path / "study.toml").write_text(
        text + "[sample]\ncount = 40\nranges = { capacity_Ah = [2.0, 4.0], current_A = [1.0, 2.0] }\n", encoding="utf-8"
    )
    result = run("sweep", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "80 lanes" in result.stdout
    assert "95 %" in result.stdout
    for name in ("soc_gradient", "parallel"):
        assert (tmp_path / "out" / f"{name}.png").read_bytes().startswith(PNG)
    assert len(pd.read_csv(tmp_path / "out" / "lanes.csv")) == 80


def test_pace_is_told_from_the_second_report_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first report comes before anything is compiled, and after what an earlier run has done."""
    clock = iter([0.0, 100.0, 110.0])
    monkeypatch.setattr(terminal.time, "perf_counter", lambda: next(clock))
    pace = terminal.Pace("lanes")
    assert pace.sentence(500, 4000) == ""
    assert pace.sentence(1000, 4000) == ""
    assert pace.sentence(2000, 4000) == "100 lanes/s, about 20 s left"
    assert [terminal.duration(s) for s in (42.0, 600.0, 10_800.0, 864_000.0)] == ["42 s", "10 min", "3 h", "10 days"]


@pytest.mark.slow
def test_sensitivity_of_the_same_study_at_another_point(run: Run, study: Path, tmp_path: Path) -> None:
    result = run("sensitivity", study, "--at", "capacity_Ah=2.5", "--at", "ambient_degC=10", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    data = xr.open_zarr(tmp_path / "sensitivity.zarr", consolidated=False)
    assert float(data["value"].sel(parameter="capacity_Ah")) == 2.5
    assert float(data["elasticity"].sel(metric="soc_gradient", parameter="capacity_Ah")) == pytest.approx(
        -1.0, abs=1e-3
    )
    assert float(data["effect"].sel(metric="soc_gradient", parameter="capacity_Ah")) == pytest.approx(-0.5, abs=1e-3)
    table = pd.read_csv(tmp_path / "sensitivity.csv")
    assert len(table) == data.sizes["metric"] * data.sizes["parameter"]
    assert (tmp_path / "doubling-soc_gradient.png").read_bytes().startswith(PNG)
    assert "capacity_Ah -1.00" in result.stdout


@pytest.fixture(scope="module")
def diagnosed(made_case: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a real diagnosis of the small case, whose truth is self-heating."""
    from typer.testing import CliRunner

    from jaxmodel.app.cli import app

    out = tmp_path_factory.mktemp("diagnosed")
    result = CliRunner().invoke(app, ["diagnose", str(made_case), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "self_heating" in result.stdout
    return out / "small"


def test_diagnose_finds_what_the_case_hides(diagnosed: Path) -> None:
    answer = json.loads((diagnosed / "answer.json").read_text())
    assert answer["verdict"] == "missing_effect"
    assert answer["verdict"] in VERDICTS
    assert [effect["name"] for effect in answer["effects"]] == ["self_heating"]
    for error in answer["error"].values():
        assert error["after"]["check"] < 1.5 * error["noise_floor"] < error["before"]["check"]
    assert (diagnosed / "report.html").stat().st_size > 100_000


def test_simulate_takes_what_diagnose_wrote(run: Run, diagnosed: Path, tmp_path: Path) -> None:
    result = run("simulate", diagnosed / "extended.toml", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    extended = read_case(diagnosed / "extended.toml")
    answer = json.loads((diagnosed / "answer.json").read_text())
    assert set(extended.effects) - {"heat_details"} == {"self_heating"}  # small details of its heat may be there too
    for channel, error in answer["error"].items():
        residuals = [
            run.measured.outputs[channel] - pd.read_csv(tmp_path / f"{run.name}.csv")[channel]
            for run in extended.runs
            if run.split == "fit"
        ]
        assert np.sqrt(np.mean(np.concatenate(residuals) ** 2)) == pytest.approx(error["after"]["fit"], rel=1e-3)


@pytest.mark.slow
def test_sweep_and_sensitivity_take_what_diagnose_wrote(run: Run, diagnosed: Path, tmp_path: Path) -> None:
    study = STUDY.replace('kind = "cell"', f'case = "{(diagnosed / "extended.toml").as_posix()}"')
    study = study.replace("[effects]\nself_heating = {}\n", "")
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    for command in (
        ["sweep"],
        ["sensitivity", "--gradient-only"],
        ["sensitivity", "--uncertain", "case", "--count", "8"],
    ):
        result = run(*command, tmp_path / "study.toml", "--out", tmp_path / command[-1])
        assert result.exit_code == 0, result.output


def test_compare_calibrates_and_tries_no_effect(run: Run, made_case: Path, tmp_path: Path) -> None:
    result = run("compare", made_case, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "no effects were tested" in result.stdout
    assert not (tmp_path / "small" / "answer.json").exists()
    assert read_case(tmp_path / "small" / "calibrated.toml").effects == {}
    errors = json.loads((tmp_path / "small" / "errors.json").read_text())
    assert errors["voltage_V"]["after"] == errors["voltage_V"]["before"]
    assert (tmp_path / "small" / "report.html").is_file()


def test_other_cases_go_on_where_one_fails(
    run: Run, case_folder: Path, tmp_path: Path, diagnosis: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The diagnosis itself is made up here: what is tested is what the command does around it."""
    monkeypatch.setattr(diagnose_command, "diagnose", lambda case, **_: diagnosis)
    spoilt = Path(shutil.copytree(case_folder, tmp_path / "spoilt"))
    (spoilt / "run-02.csv").unlink()
    result = run("diagnose", spoilt, case_folder, "--answer-only", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "there is no 'run-02.csv'" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert json.loads((tmp_path / "out" / "small" / "answer.json").read_text())["verdict"] == "missing_effect"
    assert not (tmp_path / "out" / "small" / "report.html").exists()
    lines = [line.split() for line in result.stdout.splitlines()]
    assert any("spoilt" in line and "failed" in line for line in lines)
    assert any("small" in line and "missing_effect" in line for line in lines)


@pytest.mark.parametrize(
    ("words", "passed"),
    [
        (("--add", "self_heating"), {"add": ["self_heating"], "with_effects": [], "without": []}),
        (
            ("--with", "self_heating", "--with", "rate_capacity", "--without", "clock_shift"),
            {"add": [], "with_effects": ["self_heating", "rate_capacity"], "without": ["clock_shift"]},
        ),
    ],
)
def test_what_the_user_orders_is_passed_on(
    run: Run,
    made_case: Path,
    tmp_path: Path,
    diagnosis: Diagnosis,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    passed: dict[str, list[str]],
) -> None:
    given: dict[str, object] = {}
    monkeypatch.setattr(diagnose_command, "diagnose", lambda case, **options: given.update(options) or diagnosis)
    result = run("diagnose", made_case, *words, "--answer-only", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert {name: given[name] for name in passed} == passed


def test_found_law_is_written_and_how_to_try_it_is_said(
    run: Run, made_case: Path, tmp_path: Path, diagnosis: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = dataclasses.replace(with_additions(diagnosis, curves=(law(),)), law_source="# a law\n")
    monkeypatch.setattr(diagnose_command, "diagnose", lambda case, **_: found)
    result = run("diagnose", made_case, "--answer-only", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "small" / "found_law.py").read_text(encoding="utf-8") == "# a law\n"
    assert "found_law.py:FoundLaw --with found_law" in " ".join(result.stdout.split())


def test_a_cache_folder_that_cannot_be_written_is_told_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    cache = tmp_path / "file" / "cache"
    others = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    said = subprocess.run(
        [sys.executable, "-m", "jaxmodel.app.cli", "simulate", "examples/samsung_30q", "--out", str(tmp_path / "out")],
        env=others | {"JAXMODEL_CACHE": str(cache)},
        capture_output=True,
        text=True,
        timeout=240,
        check=True,
    )
    (line,) = said.stderr.splitlines()
    assert line.startswith(f"Compiled programs cannot be stored in {cache}: not a directory;")


def test_compiled_programs_are_kept_where_the_user_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("JAXMODEL_CACHE", str(tmp_path / "mine"))
    assert cache_folder() == tmp_path / "mine"
    monkeypatch.delenv("JAXMODEL_CACHE")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "jaxmodel"


def test_timings_say_where_the_time_of_a_command_went(
    run: Run, made_case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # This process has computed for minutes, of which the command would be no hundredth.
    monkeypatch.setattr(timings, "process_time", lambda: 0.1)
    result = run("--timings", "simulate", made_case, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    rows = {}
    for line in result.stdout.splitlines():
        cells = [one.strip() for one in line.strip("│").split("│")]
        if len(cells) == 3 and cells[2].endswith("%"):
            rows[cells[0]] = float(cells[1])
    assert rows["drawing pictures"] > 0.0
    parts = sum(seconds for what, seconds in rows.items() if what != "whole command")
    assert parts == pytest.approx(rows["whole command"], abs=0.01 * len(rows))
    assert "whole command" in run("simulate", made_case, "--out", tmp_path, "--timings").stdout
    assert "Time" not in run("simulate", made_case, "--out", tmp_path).stdout


def test_what_a_thread_does_is_told_by_its_frames() -> None:
    seen = []

    def twice(shared: float, own: object) -> object:
        seen.append(timings._what(sys._getframe()))
        return own + own

    kernel = over(Kernel, twice, np.float64(0.0), np.float64(0.0), "what a thread does")
    with Pool(1) as pool:
        pool.start(kernel, np.float64(0.0), np.arange(3.0), 3, 1).tree(
            lambda _: seen.append(timings._what(sys._getframe()))
        )
    assert seen == ["tracing and writing kernels", "running kernels"]
