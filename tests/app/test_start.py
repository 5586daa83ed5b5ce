"""`jaxmodel start`: three stages, each done once, and repeated where it was stopped or its files changed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from jaxmodel import read_case
from jaxmodel.app.commands import start_to_finish
from jaxmodel.base.errors import FitError
from tests.app.conftest import Run
from tests.data.importing.benches import arbin, cell_log

STAGES = ["import", "parameterise", "diagnose"]


class Stages:
    """The three stages replaced by ones that only write their result, and say which were done."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.stops: dict[str, BaseException] = {}

    def do(self, name: str, *written: Path) -> None:
        self.done.append(name)
        for path in written:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(name)
        if name in self.stops:
            raise self.stops.pop(name)

    def since(self) -> list[str]:
        done, self.done = self.done, []
        return done


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> Stages:
    made = Stages()

    def imported(files, kind, out, **decisions):
        made.do("import", out / "case.toml", out / "run.csv")

    def parameterised(case, out, effects):
        made.do("parameterise", out / "case.toml", out / "run.csv")

    def diagnosed(cases, out, effects):
        made.do("diagnose", out / cases[0].name / "answer.json")

    monkeypatch.setattr(start_to_finish, "import_files", imported)
    monkeypatch.setattr(start_to_finish, "parameterise_case", parameterised)
    monkeypatch.setattr(start_to_finish, "diagnose_all", diagnosed)
    return made


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "logs" / "hppc.csv"
    path.parent.mkdir()
    path.write_text("time_s\n")
    return path


@pytest.fixture
def start(run: Run, log: Path, tmp_path: Path) -> Callable:
    return lambda *options: run("start", log, "--ambient", "25", "--out", tmp_path / "out", *options)


def test_stages_done_before_are_skipped_and_named(start, stages: Stages):
    said = start().stdout
    assert stages.since() == STAGES
    assert "3_diagnosis/2_parameterised/report.html" in said
    said = start().stdout
    assert stages.since() == []
    assert [line.split(":")[0] for line in said.splitlines()[:3]] == STAGES
    assert "--again repeats it" in said


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("stop", [FitError("No run is long enough; measure longer."), KeyboardInterrupt()])
def test_a_stage_that_was_stopped_is_repeated_and_those_before_are_kept(start, stages: Stages, stage: str, stop):
    stages.stops[stage] = stop
    result = start()
    assert result.exit_code == (2 if isinstance(stop, FitError) else 130)
    assert len(result.stderr.splitlines()) == 1
    assert ("The same command goes on" in result.stdout) == isinstance(stop, KeyboardInterrupt)
    stages.since()
    assert start().exit_code == 0
    assert stages.since() == STAGES[STAGES.index(stage) :]


def test_a_stage_killed_while_repeated_is_not_taken_for_the_one_before(start, stages: Stages, log: Path):
    start()
    stages.since()
    stages.stops["import"] = SystemExit(9)  # nothing of ours runs afterwards, as with a kill
    start("--capacity", "3")
    assert stages.since() == ["import"]
    start()  # as at first: what the killed one left behind is not that case
    assert stages.since()[0] == "import"


def test_what_changed_is_repeated(start, stages: Stages, log: Path, tmp_path: Path):
    start()
    stages.since()
    start("--again")
    assert stages.since() == STAGES
    start("--capacity", "3")
    assert stages.since()[0] == "import"
    log.write_text("time_s\n0\n")
    start("--capacity", "3")
    assert stages.since()[0] == "import"
    (tmp_path / "out" / "2_parameterised" / "report.html").write_text("a page is no part of the case")
    (tmp_path / "out" / "1_case" / "case.toml").write_text("corrected by hand")
    start("--capacity", "3")
    assert stages.since() == STAGES[1:]


def test_a_result_or_a_list_of_stages_that_is_gone_is_made_again(start, stages: Stages, tmp_path: Path):
    start()
    stages.since()
    (tmp_path / "out" / "3_diagnosis" / "2_parameterised" / "answer.json").unlink()
    start()
    assert stages.since() == ["diagnose"]
    (tmp_path / "out" / "start.json").write_text("{half of")
    assert start().exit_code == 0
    assert stages.since() == STAGES


@pytest.mark.parametrize("named", ["folder", "file"])
def test_a_case_takes_the_place_of_logs(run: Run, stages: Stages, case_folder: Path, tmp_path: Path, named: str):
    given = case_folder if named == "folder" else case_folder / "case.toml"
    out = ("--out", tmp_path / "out")
    assert run("start", given, *out).exit_code == 0
    assert stages.since() == STAGES[1:]
    run("start", given, *out)
    assert stages.since() == []
    csv = case_folder / "run-01.csv"
    os.utime(csv, ns=(0, csv.stat().st_mtime_ns + 10**9))
    run("start", given, *out)
    assert stages.since()[0] == "parameterise"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["CASE", "LOG"], "is a case; give one case alone"),
        (["CASE", "--ambient", "25"], "--ambient: "),
        (["CASE", "--unit", "I=mA"], "--unit: "),
        (["nowhere.csv"], "There is no file"),
        (["LOG", "--kind", "pump"], "'pump'"),
        ([], "Missing argument"),
    ],
)
def test_a_mistake_is_one_sentence(run: Run, case_folder: Path, log: Path, tmp_path: Path, arguments, says: str):
    places = {"CASE": case_folder, "LOG": log}
    result = run("start", *(places.get(one, one) for one in arguments), "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert says in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_logs_become_a_case_with_parameters_of_their_own(run: Run, log: Path, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(start_to_finish, "diagnose_all", lambda cases, out, effects: None)
    for seed, name in enumerate(("hppc.csv", "hppc_again.csv")):
        (log.parent / name).write_text(arbin(cell_log(seed)))
    out = tmp_path / "out"
    result = run("start", log.parent, "--ambient", "25", "--out", out)
    assert result.exit_code == 0, result.stderr
    assert json.loads((out / "1_case" / "import.json").read_text())["options"]["ambient"] == 25.0
    assert (read_case(out / "2_parameterised").parameters["capacity_Ah"].sd or 0.0) > 0.0
    assert (out / "2_parameterised" / "report.html").is_file()
    assert json.loads((out / "start.json").read_text()).keys() == set(STAGES)
