"""The C program that the benchmark times does the same work as the engine; nothing is timed here."""

from __future__ import annotations

import pytest

from benchmarks.against_c import MOST_APART, MOST_APART_SINGLE, differences
from benchmarks.by_hand import ByHand, NoCompiler
from benchmarks.commands import COMMANDS, ROOT
from benchmarks.work import Ours, study_of
from jaxmodel.app.cli import app


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
