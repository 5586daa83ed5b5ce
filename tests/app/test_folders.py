"""Folders for results: that one cannot be used is said before anything is computed; one command writes at a time."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path

import pytest

from jaxmodel.app import folders
from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.reading import read_case
from jaxmodel.diagnosis import Diagnosis
from tests.app.conftest import Run
from tests.made_up import diagnosis_of

_Usage = namedtuple("_Usage", "total used free")
_HOLDS = """import sys
from pathlib import Path
from jaxmodel.app.folders import take
take(Path(sys.argv[1]))
print(1, flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def let_go() -> Iterator[None]:
    yield
    folders.let_go()


@pytest.fixture
def other(tmp_path: Path) -> Iterator[Path]:
    """A folder that another process holds."""
    folder = tmp_path / "held"
    process = subprocess.Popen([sys.executable, "-c", _HOLDS, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    yield folder
    process.kill()
    process.communicate()


@pytest.mark.skipif(folders.fcntl is None, reason="this system has no locks on folders")
def test_a_folder_that_another_command_writes_to_is_refused_until_that_ends(
    other: Path, made_case: Path, run: Run
) -> None:
    result = run("simulate", made_case, "--out", other, "--answer-only")
    assert result.exit_code == 2
    assert result.stderr.strip().endswith("another command is writing here; wait for it, or give another --out.")
    assert not any(other.iterdir())


def test_a_command_lets_its_folder_go_when_it_ends(made_case: Path, tmp_path: Path, run: Run) -> None:
    assert run("simulate", made_case, "--out", tmp_path, "--answer-only").exit_code == 0
    held = subprocess.run([sys.executable, "-c", _HOLDS, tmp_path], input=b"", check=True, capture_output=True)
    assert held.stdout == b"1\n"


def test_one_command_may_take_a_folder_twice(tmp_path: Path) -> None:
    folders.take(tmp_path)
    folders.take(tmp_path / ".")


@pytest.mark.parametrize(
    ("where", "what", "found", "sentence"),
    [
        (
            shutil,
            "disk_usage",
            lambda *_: _Usage(10**9, 10**9 - 10**5, 10**5),
            "the disk is full; remove files from it",
        ),
        (os, "access", lambda path, mode, **_: not mode & os.W_OK, "this folder is not writable; change its rights"),
    ],
)
@pytest.mark.parametrize("command", ["simulate", "compare", "parameterise"])
def test_a_folder_that_cannot_be_written_to_is_said_before_the_work(
    where, what, found, sentence, command, made_case: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(where, what, found)
    result = run(command, made_case, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert sentence in " ".join(result.stderr.split())
    assert "calibrating" not in result.stdout


def test_a_verdict_that_cannot_be_written_is_shown(
    made_case: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = diagnosis_of(read_case(made_case))

    def no_space(self: Diagnosis, folder: Path, **_: object) -> Path:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder / "answer.json"))

    monkeypatch.setattr("jaxmodel.app.commands.diagnose.diagnose", lambda case, **_: found)
    monkeypatch.setattr(Diagnosis, "write", no_space)
    for cases in ([made_case], [made_case, Path(shutil.copytree(made_case, tmp_path / "other"))]):
        result = run("diagnose", *cases, "--out", tmp_path / "out")
        assert result.exit_code == 2
        assert "Small cell <bench> & load" in result.stdout
        assert "No space left on device" in result.stderr
        assert "Traceback" not in result.stderr


def test_a_diagnosis_whose_extended_case_nobody_could_read_has_its_page(
    made_case: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = diagnosis_of(read_case(made_case))

    def refuse(*_: object) -> None:
        raise MeasurementError("extended.toml is not written, because it could not be read again: soc 0.9 after 0.9.")

    monkeypatch.setattr("jaxmodel.app.commands.diagnose.diagnose", lambda case, **_: found)
    monkeypatch.setattr("jaxmodel.diagnosis.extended.files.write_case", refuse)
    result = run("diagnose", made_case, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr.splitlines() == [
        "extended.toml is not written, because it could not be read again: soc 0.9 after 0.9."
    ]
    assert "Small cell <bench> & load" in result.stdout
    written = {path.name for path in (tmp_path / "out" / made_case.name).iterdir()}
    assert {"answer.json", "report.html"} <= written
