"""`jaxmodel parameterise`: a case that is read again, tables of numbers and errors, a page, and what is missing."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from jaxmodel import read_case
from tests.parameterisation import made
from tests.workbench.conftest import Run
from workbench.cli import app


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    made.raw_cell(made.measured({"pulses": made.pulses(25.0), "drive": made.drive(25.0)}), check=["drive"]).write(
        folder
    )
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parameterised")


@pytest.fixture(scope="module")
def result(case: Path, out: Path) -> Result:
    return CliRunner().invoke(app, ["parameterise", str(case), "--out", str(out)])


def test_a_case_its_numbers_its_errors_and_a_page_are_written(result: Result, out: Path) -> None:
    assert result.exit_code == 0, result.stderr
    numbers = pd.read_csv(out / "extractions.csv").set_index("name")
    stated = read_case(out).parameters["capacity_Ah"]
    assert stated.value == pytest.approx(numbers.loc["capacity_Ah", "value"])
    assert stated.sd == pytest.approx(numbers.loc["capacity_Ah", "sd"])
    errors = pd.read_csv(out / "errors.csv").set_index("run")
    assert errors.loc["drive", "split"] == "check"
    page = (out / "report.html").read_text()
    for words in ("Numbers from the data", "Not in these data", "Forward simulation of every run", "capacity_Ah"):
        assert words in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert sorted(out.glob("*.png"))


def test_what_is_missing_is_said_with_its_test(result: Result) -> None:
    lines = [line for line in result.stdout.splitlines() if "not in this data" in line]
    assert any(line.startswith("C_th and hA") and "thermometer" in line for line in lines)
    assert any(line.startswith("activation energies") and "two temperatures" in line for line in lines)


def test_tables_alone_are_written_without_pictures(run: Run, case: Path, tmp_path: Path) -> None:
    assert run("parameterise", case, "--answer-only", "--out", tmp_path).exit_code == 0
    assert (tmp_path / "extractions.csv").is_file()
    assert not list(tmp_path.glob("*.png"))
    assert not (tmp_path / "report.html").exists()


def test_measurements_are_not_written_over(run: Run, case: Path) -> None:
    before = {path.name: path.read_bytes() for path in case.iterdir()}
    result = run("parameterise", case, "--out", case)
    assert result.exit_code == 2
    assert "give another one" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert {path.name: path.read_bytes() for path in case.iterdir()} == before


def test_a_case_without_fit_runs_is_one_sentence(run: Run, case: Path, tmp_path: Path) -> None:
    text = (case / "case.toml").read_text()
    for path in case.glob("*.csv"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "case.toml").write_text(text.replace('split = "fit"', 'split = "check"'))
    result = run("parameterise", tmp_path, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "no fit run" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
