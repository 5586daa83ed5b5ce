"""`compare-answers` and `history` on the command line."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from jaxmodel.diagnosis.result import Diagnosis
from tests.app.conftest import Run


@pytest.fixture(scope="module")
def results(diagnosis: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two folders of results, of which the second has a case more and a name less."""
    folder = tmp_path_factory.mktemp("results")
    fewer = dataclasses.replace(diagnosis, effects=diagnosis.effects[:1], verdict="undecided")
    diagnosis.write(folder / "before" / "small", pictures=False)
    for name in ("small", "other"):
        fewer.write(folder / "after" / name, pictures=False)
    fewer.write(folder / "twice", pictures=False)
    diagnosis.write(folder / "twice", pictures=False)
    return folder


def test_two_answers_as_tables(run: Run, results: Path) -> None:
    said = run("compare-answers", results / "before" / "small", results / "after" / "small" / "answer.json")
    assert said.exit_code == 0, said.output
    lines = [line.split() for line in said.stdout.splitlines()]
    assert any({"verdict", "missing_effect", "undecided"} <= set(line) for line in lines)
    assert any({"arrhenius_resistance", "named", "possible"} <= set(line) for line in lines)
    assert "RMS error of voltage [mV]" in said.stdout
    assert "No number moved." in said.stdout


def test_folders_of_several_cases_are_paired_by_name(run: Run, results: Path) -> None:
    said = run("compare-answers", results / "after", results / "after", "--json")
    assert set(json.loads(said.stdout)) == {"small", "other"}
    said = run("compare-answers", results / "before", results / "after" / "other", "--json")
    assert json.loads(said.stdout)["verdict"] == {"before": "missing_effect", "after": "undecided"}


def test_an_answer_beside_the_one_before_it(run: Run, results: Path) -> None:
    said = run("compare-answers", results / "twice", "--json")
    found = json.loads(said.stdout)
    assert found["verdict"] == {"before": "undecided", "after": "missing_effect"}
    assert {row["run"] for row in found["errors"]} >= {"run-01", "all check runs"}
    assert {row["what"] for row in found["data"]} == {"same"}
    alone = run("compare-answers", results / "before")
    assert alone.exit_code == 2
    assert "no earlier answer" in alone.stderr


def test_history_lists_every_diagnosis(run: Run, results: Path) -> None:
    said = run("history", results / "twice", "--json")
    assert [row["verdict"] for row in json.loads(said.stdout)] == ["undecided", "missing_effect"]
    table = run("history", results / "after").stdout
    assert "small" in table
    assert "other" in table
    assert "voltage [mV]" in table
    assert run("history", results / "after" / "small" / "history").exit_code == 2
