"""`jaxmodel parameterise`: a case that is read again, tables of numbers and errors, a page, and what is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from jaxmodel import read_case
from jaxmodel.app.cli import app
from jaxmodel.base import toml
from jaxmodel.case.known import scalars, tables
from jaxmodel.case.presets import PresetForm
from tests.app.conftest import Run
from tests.parameterisation import made


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


def test_a_preset_holds_the_numbers_their_sources_and_the_errors_held_out(run: Run, case: Path, tmp_path: Path) -> None:
    options = ("--preset", "my_cell", "--data", "bench 7", "--licence", "CC0")
    result = run("parameterise", case, "--answer-only", *options, "--out", tmp_path)
    assert result.exit_code == 0, result.stderr
    form = PresetForm.model_validate(toml.parsed((tmp_path / "my_cell.toml").read_text(), "my_cell.toml"))
    assert (form.data, form.licence, form.kinds) == ("bench 7", "CC0", ["cell", "robot"])
    written = read_case(tmp_path)
    parameters = scalars(form.parameters.model_extra or {}, "my_cell")
    assert {name: one.value for name, one in parameters.items()} == {
        name: one.value for name, one in written.parameters.items()
    }
    np.testing.assert_array_equal(tables(form.parameters)["ocv"].values, written.tables["ocv"].values)
    errors = pd.read_csv(tmp_path / "errors.csv").set_index("run")
    assert [(one.run, one.column) for one in form.held_out] == [("drive", "voltage_V")]
    assert form.held_out[0].rms == pytest.approx(errors.loc["drive", "rms"], rel=0.01)
    text = (tmp_path / "my_cell.toml").read_text()
    assert "joint refit of all curves of pulses" in text
    assert "# not identified: activation energies" in text


@pytest.mark.parametrize(("name", "says"), [("My Cell", "is no name"), ("../cell", "is no name")])
def test_a_name_that_no_preset_can_have_is_refused_before_the_work(run: Run, case: Path, tmp_path: Path, name, says):
    result = run("parameterise", case, "--preset", name, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert says in result.stderr
    assert not (tmp_path / "out").exists()


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
