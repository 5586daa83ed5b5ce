"""`jaxmodel import` from end to end: a case that is read again, pictures, flags, and one sentence for each mistake."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.case.reading import read_case
from tests.app.conftest import Run
from tests.data.importing.benches import arbin, cell_log, motor_log

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "logs" / "hppc.csv"
    path.parent.mkdir()
    path.write_text(arbin(cell_log()))
    return path


def test_a_log_becomes_a_case_with_a_picture_and_what_was_decided(run: Run, log: Path, tmp_path: Path):
    options = ("--ambient", "25", "--split-at", "rests", "--rest-minutes", "15")
    said = run("import", log, "--kind", "cell", *options, "--out", tmp_path / "case").stdout
    assert "positive on charge in the files, reversed" in said
    assert "jaxmodel parameterise" in said
    case = read_case(tmp_path / "case")
    assert [run.name for run in case.runs] == ["hppc-1", "hppc-2"]
    for one in case.runs:
        assert (tmp_path / "case" / f"{one.name}.png").read_bytes().startswith(PNG)
    record = json.loads((tmp_path / "case" / "import.json").read_text())
    assert {"decisions", "findings", "runs", "missing"} <= record.keys()
    assert record["options"]["ambient"] == 25.0


def test_a_folder_stands_for_its_files_and_flags_reach_the_case(run: Run, tmp_path: Path):
    folder = tmp_path / "motor"
    folder.mkdir()
    log = motor_log().drop(columns="torque_Nm")
    log.assign(current_A=-log.current_A).to_csv(folder / "run.csv", index=False)
    (folder / "README.md").write_text("not a log")
    options = ("--kind", "motor", "--ambient", "20", "--constant", "load_torque_Nm=0.05", "--flip", "current_A")
    more = ("--column", 'speed_rad_s="speed_rad_s"', "--answer-only", "--out", tmp_path / "case")
    result = run("import", folder, *options, *more)
    assert result.exit_code == 0, result.stderr
    (one,) = read_case(tmp_path / "case").runs
    np.testing.assert_array_equal(one.measured.inputs["load_torque_Nm"], 0.05)
    assert (one.measured.outputs["current_A"] > 0.0).all()
    assert not list((tmp_path / "case").glob("*.png"))


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--kind", "cell"], ["hppc.csv", "no ambient temperature", "--ambient"]),
        (["--kind", "pump"], ["'pump'", "cell, motor, robot"]),
        (["--kind", "cell", "--unit", "Voltage(V)"], ["--unit Voltage(V)", "COLUMN=UNIT"]),
        (["--kind", "motor", "--ambient", "25"], ["load_torque_Nm", "--constant load_torque_Nm=VALUE"]),
    ],
)
def test_a_mistake_is_one_sentence(run: Run, log: Path, tmp_path: Path, options, parts):
    log.write_text(arbin(cell_log().drop(columns="temperature_degC").assign(temperature_degC=np.nan)))
    result = run("import", log, *options, "--out", tmp_path / "case")
    assert result.exit_code == 2
    assert len(result.stderr.strip().splitlines()) == 1
    for part in parts:
        assert part in result.stderr


def test_measurements_are_not_written_over(run: Run, log: Path):
    result = run("import", log, "--kind", "cell", "--out", log.parent)
    assert result.exit_code == 2
    assert "give another one" in result.stderr


def test_a_case_that_was_edited_since_is_not_written_over(run: Run, log: Path, tmp_path: Path):
    case = tmp_path / "case"
    words = ("import", str(log), "--kind", "cell", "--ambient", "23", "--out", str(case), "--answer-only")
    assert run(*words).exit_code == 0
    assert run(*words).exit_code == 0, "as it was written it may be written again"
    edited = (case / "case.toml").read_text() + "\n# mine\n"
    (case / "case.toml").write_text(edited)
    refused = run(*words)
    assert refused.exit_code == 2
    assert "its case.toml was edited since it was imported; give another folder" in refused.stderr
    assert (case / "case.toml").read_text() == edited
    assert run(*words, "--force").exit_code == 0
    assert "# mine" not in (case / "case.toml").read_text()
