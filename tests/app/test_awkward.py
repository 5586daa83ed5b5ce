"""Unusual but valid cases: missing readings, rests, rounding, and clocks that start anywhere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.app.conftest import Run
from tests.app.test_mistakes import assert_one_sentence


def change(file: Path, **columns: object) -> None:
    """Set columns of a CSV; None leaves one out."""
    table = pd.read_csv(file)
    for name, values in columns.items():
        table = table.drop(columns=name) if values is None else table.assign(**{name: values})
    table.to_csv(file, index=False)


def add_run(folder: Path, name: str) -> Path:
    """Add a run to a case: a copy of its first."""
    with (folder / "case.toml").open("a", encoding="utf-8") as toml:
        toml.write(f'\n[[runs]]\nfile = "{name}.csv"\nsplit = "fit"\n')
    (folder / f"{name}.csv").write_bytes((folder / "run-01.csv").read_bytes())
    return folder / f"{name}.csv"


@pytest.fixture
def awkward(case_folder: Path) -> Path:
    """A rest read as exactly the ambient temperature, runs without a reading, a late clock, a byte order mark."""
    change(add_run(case_folder, "rest"), current_A=0.0, cell_temperature_degC=10.0)
    change(add_run(case_folder, "unread"), voltage_V=None, cell_temperature_degC=None)
    change(case_folder / "run-03.csv", voltage_V=np.nan, cell_temperature_degC=np.nan)
    late = pd.read_csv(case_folder / "run-02.csv").time_s + 1.7e9
    change(case_folder / "run-02.csv", time_s=late)
    toml = case_folder / "case.toml"
    toml.write_text(toml.read_text(encoding="utf-8"), encoding="utf-8-sig")
    return case_folder


@pytest.mark.slow
def test_unusual_case_is_compared_to_the_end(awkward: Path, run: Run, tmp_path: Path) -> None:
    result = run("compare", awkward, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    report = (tmp_path / "out" / "small" / "report.html").read_text(encoding="utf-8")
    assert "This run has no readings." in report
    assert "e+09" not in report
    errors = json.loads((tmp_path / "out" / "small" / "errors.json").read_text(encoding="utf-8"))
    assert errors["voltage_V"]["before"]["check"] is None


HOSTILE = "<img src=x onerror=alert(1)> $\\frac{$ [red]{0} %s & 'q'"


def test_names_of_markup_are_text_in_pictures_and_pages(case_folder: Path, run: Run, tmp_path: Path) -> None:
    name = HOSTILE.replace("/", "")
    (case_folder / "run-01.csv").rename(case_folder / f"{name}.csv")
    toml = case_folder / "case.toml"
    text = toml.read_text(encoding="utf-8").replace('"run-01.csv"', f"'''{name}.csv'''")
    for old in ("Small cell <bench> & load", "6 A pulses"):
        assert old in text
        text = text.replace(f'"{old}"', f"'''{HOSTILE}'''")
    toml.write_text(text, encoding="utf-8")
    result = run("compare", case_folder, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    page = (tmp_path / "out" / "small" / "report.html").read_text(encoding="utf-8")
    assert "<img src=x" not in page
    assert "&lt;img src=x" in page


@pytest.mark.parametrize("command", ["compare", "diagnose", "identify"])
def test_current_of_the_wrong_sign_is_refused(command: str, run: Run, case_folder: Path, tmp_path: Path) -> None:
    for file in case_folder.glob("run-*.csv"):
        change(file, current_A=-pd.read_csv(file).current_A)
    assert_one_sentence(run(command, case_folder, "--out", tmp_path / "out"), "multiply the column current_A by -1")


def test_channel_that_never_moves_and_whose_noise_nobody_states_is_named(
    run: Run, case_folder: Path, tmp_path: Path
) -> None:
    for file in case_folder.glob("run-*.csv"):
        change(file, voltage_V=3.7, cell_temperature_degC=None)
    toml = case_folder / "case.toml"
    lines = toml.read_text(encoding="utf-8").splitlines()
    toml.write_text("\n".join(line for line in lines if not line.startswith(("voltage_V", "cell_t"))), encoding="utf-8")
    assert_one_sentence(run("compare", case_folder, "--out", tmp_path / "out"), "voltage_V never change")


def test_simulation_is_not_written_over_the_measurement(run: Run, case_folder: Path) -> None:
    measured = (case_folder / "run-01.csv").read_bytes()
    assert_one_sentence(run("simulate", case_folder, "--out", case_folder), "in this folder is a measurement")
    assert (case_folder / "run-01.csv").read_bytes() == measured
