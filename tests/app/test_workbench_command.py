"""`jaxmodel workbench` before it serves: what it opens, and what it refuses in one sentence."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from jaxmodel.app.commands import workbench as command
from tests.app.conftest import Run


def test_help_says_what_it_takes(run: Run) -> None:
    shown = run("workbench", "--help")
    assert shown.exit_code == 0
    assert "Example: jaxmodel workbench" in shown.stdout
    assert "--no-open" in shown.stdout


def test_other_commands_load_nothing_of_it() -> None:
    program = "import sys, jaxmodel.app.cli, jaxmodel.app.commands.workbench; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60).stdout.split()
    assert {"nicegui", "fastapi", "jax", "pandas"}.isdisjoint(loaded)


def test_without_the_extra_it_says_what_to_install(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "_NEEDED", ("a_package_that_is_not_there",))
    refused = run("workbench", "--no-open")
    assert refused.exit_code == 2
    assert "pip install 'jaxmodel[workbench]'" in refused.stderr


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--host", "0.0.0.0"], "--token"),
        (["--host", "0.0.0.0", "--token", "short"], "guessed"),
        (["nowhere"], "nowhere"),
    ],
)
def test_what_it_cannot_do_is_one_sentence(run: Run, arguments: list[str], word: str) -> None:
    refused = run("workbench", "--no-open", *arguments)
    assert refused.exit_code == 2
    assert word in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1


def test_a_port_that_is_taken_is_said(run: Run) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        refused = run("workbench", "--no-open", "--port", taken.getsockname()[1])
    assert refused.exit_code == 2
    assert "give another port" in refused.stderr


def test_a_case_is_opened_and_raw_files_are_imported(made_case: Path, tmp_path: Path) -> None:
    opened = {"do": "open", "with": {"path": str(made_case.resolve()), "how": "case"}}
    assert command.first_job([made_case], "cell", None) == opened
    assert command.first_job([], "cell", None) is None
    logs = [tmp_path / "b.csv", tmp_path / "a.csv", tmp_path / ".hidden"]
    for log in logs:
        log.touch()
    job = command.first_job([tmp_path], "motor", 23.0)
    assert job is not None
    assert [Path(file).name for file in job["with"]["files"]] == ["a.csv", "b.csv"]
    assert (job["with"]["kind"], job["with"]["options"]) == ("motor", {"ambient": 23.0})
