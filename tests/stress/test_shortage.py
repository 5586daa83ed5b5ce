"""Memory that runs out while a command writes is said in a sentence, and leaves nothing that is half written."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from jaxmodel.app.cli import app
from jaxmodel.app.one_sentence import MISTAKE, sentence_of
from jaxmodel.case.reading import read_case
from jaxmodel.parameterisation import parameterise
from jaxmodel.sweeps.results import MANIFEST
from tests.made_up import diagnosis_of, write_case
from tests.stress.faults import half, unclear
from tests.stress.kills import different
from tests.stress.shortage import of_arrays, of_files

COMMANDS = {
    "import": "import case/run-01.csv --kind cell --ambient 25 --answer-only --out out",
    "parameterise": "parameterise case --answer-only --preset own --out out",
    "simulate": "simulate case --answer-only --out out",
    "diagnose": "diagnose case --answer-only --out out",
    "sweep": "sweep study.toml --answer-only --out out",
    "export a file": "export case --to c --out out/model.c",
    "export a folder": "export case --to bdf --out out",
}
STUDY = """kind = "cell"
metrics = ["final_soc"]
profile = { duration_s = 60, step_s = 10, current_A = 2.0, ambient_degC = 20.0 }
axes = { capacity_Ah = [2.0, 3.0] }
"""
# Of a command so many files are tried, and so many arrays: most of those that are asked for first once a file is begun.
FILES, ARRAYS, ANYWHERE = 7, 4, 2


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which all commands run, with a case and a study."""
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "case")
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def _computed_before(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what takes long be computed already: its writing alone is disturbed."""
    case = read_case(folder / "case")
    if name == "diagnose":
        made = diagnosis_of(case)
        monkeypatch.setattr("jaxmodel.app.commands.diagnose.diagnose", lambda case, **_: made)
    if name == "parameterise":
        found = parameterise(case, progress=False)
        monkeypatch.setattr("jaxmodel.app.commands.parameterise.parameterise", lambda case, **_: found)


def _run(name: str, *more: str) -> tuple[int, str]:
    """Run a command; return its exit code and what it said."""
    ended = CliRunner().invoke(app, [*COMMANDS[name].split(), *more])
    broke = ended.exception is not None and not isinstance(ended.exception, SystemExit)
    return ended.exit_code, f"Traceback: {ended.exception!r}" if broke else ended.stderr


def _spread(moments: Iterable[int], most: int) -> list[int]:
    """Return at most so many of some moments, the first and the last among them."""
    every = sorted({*moments})
    return [every[round(place)] for place in np.linspace(0, len(every) - 1, min(most, len(every)))]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_without_memory_says_so_and_leaves_nothing_half_written(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _computed_before(name, folder, monkeypatch)
    out, whole, begun = folder / "out", folder / "whole", []
    assert _run(name)[0] == 0  # what is compiled once, is
    shutil.rmtree(out)
    with of_arrays() as arrays, of_files(out, each=lambda: begun.append(arrays() + 1)) as files:
        assert _run(name)[0] == 0
        moments = [(of_files, out, at) for at in _spread(range(1, files() + 1), FILES)]
        anywhere = _spread(range(1, arrays() + 1), ANYWHERE)
    moments += [(of_arrays, at) for at in (*_spread(begun, ARRAYS), *anywhere)]
    out.rename(whole)
    reached = 0
    for number, (short, *where) in enumerate(moments):
        with short(*where, lasts=number % 2 == 1) as asked:
            code, said = _run(name)
            is_reached = asked() >= where[-1]  # not where the last file is followed by no array
        reached += is_reached
        assert code == (MISTAKE if is_reached else 0), (where, said)
        assert unclear(code, said) == []
        assert ("too little memory" in said) == is_reached
        assert half(out, whole) == []
        if (out / "case.toml").exists():
            read_case(out)  # all of it is there
        held = name == "sweep" and (out / MANIFEST).exists()
        assert _run(name, *(["--resume"] if held else []))[0] == 0, where
        assert different(out, whole) == []
        shutil.rmtree(out)
    assert reached >= len(moments) - 3


def test_what_jax_has_no_memory_for_is_said_too() -> None:
    with pytest.raises(RuntimeError) as caught:
        jnp.zeros(10**15).block_until_ready()
    assert "too little memory" in sentence_of(caught.value)
    assert sentence_of(RuntimeError("of another kind")) == ""


def test_a_shortage_is_of_the_moment_that_was_asked_for(tmp_path: Path) -> None:
    with of_arrays(3):
        assert [np.zeros(4).size, np.zeros(4).size] == [4, 4]
        with pytest.raises(MemoryError):
            np.zeros(4)
        assert np.zeros(4).size == 4
    with of_arrays(1, lasts=True) as arrays:
        for _ in range(2):
            with pytest.raises(MemoryError):
                np.zeros(4)
        assert arrays() == 2
    with of_files(tmp_path, 2) as files:
        (tmp_path / "one").write_text("1")
        with pytest.raises(MemoryError):
            (tmp_path / "two").write_text("2")
        (tmp_path / "one").read_text()  # of reading there is no end
        (tmp_path / "three").mkdir()
        assert files() == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "three"]
    (tmp_path / "two").write_text("2")
