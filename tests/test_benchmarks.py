"""The C program that the benchmark times does the same work as the engine; nothing is timed here."""

from __future__ import annotations

import pytest

from benchmarks import check
from benchmarks.against_c import MOST_APART, MOST_APART_SINGLE, differences
from benchmarks.by_hand import ByHand, NoCompiler
from benchmarks.commands import COMMANDS, ROOT
from benchmarks.work import Ours, study_of
from jaxmodel.app.cli import app
from jaxmodel.lanes.machine import vector_bits


@pytest.mark.parametrize(("precision", "limits"), [("float64", MOST_APART), ("float32", MOST_APART_SINGLE)])
@pytest.mark.parametrize("kind", ["cell", "robot"])
def test_c_program_gives_the_engines_results(kind: str, precision: str, limits: dict[str, float]):
    # Steps of a minute, lanes that fill no whole block of either.
    ours = Ours(study_of(kind, 192, step_s=60.0, precision=precision))
    try:
        by_hand = ByHand(ours, threads=2)
    except NoCompiler as reason:
        pytest.skip(str(reason))
    apart = differences(ours(), by_hand())
    assert {name: apart[name] for name, most in limits.items() if not apart[name] <= most} == {}


def test_the_commands_that_are_timed_are_commands_on_files_that_exist():
    known = {str(command.name or command.callback.__name__) for command in app.registered_commands if command.callback}
    assert {words[0] for words in COMMANDS.values()} <= known
    files = [word for words in COMMANDS.values() for word in words if "/" in word]
    assert [file for file in files if not (ROOT / file).exists()] == []


def test_what_became_slower_is_said_and_kept_by_commit(tmp_path, monkeypatch, capsys):
    history = tmp_path / "history.csv"
    ratios = {"step, cell": 1.0, "simulate, cell": 2.0, "step, robot": None}
    monkeypatch.setattr(check, "MEASURED", {what: lambda what=what: ratios[what] for what in ratios})
    assert check.check(keep=True, history=history) == "", "nothing is kept yet"
    assert "step, robot: not compared" in capsys.readouterr().out
    ratios |= {"step, cell": 1.2, "simulate, cell": 2.9}
    slower = check.check(keep=True, history=history)
    assert "simulate, cell takes 2.9, at most 2.8" in slower
    assert "step" not in slower
    rows = check.read(history)
    assert [row["ratio"] for row in rows] == [1.0, 2.0, 1.2, 2.9]
    assert {row["vector_bits"] for row in rows} == {vector_bits()}
    assert history.with_suffix(".png").stat().st_size > 1000
    # One slow run moves no median of five.
    check.append(history, {"step, cell": 9.0})
    check.append(history, {"step, cell": 1.1})
    assert check.bound(check.read(history), "step, cell")[0] == pytest.approx(1.25 * 1.15)


def test_what_is_kept_is_what_is_measured():
    assert {row["what"] for row in check.read(check.HISTORY)} <= set(check.MEASURED)
