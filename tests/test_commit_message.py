"""The hook that reads a commit message refuses what CONTRIBUTING.md does not allow, and nothing else."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commit_message import CUT, faults
from tests.test_architecture import REPOSITORY

GOOD = "Hold the rotor at standstill\n\nIt crept by rounding.\n"


@pytest.mark.parametrize(
    "message",
    [GOOD, f"{'a' * 71}\n\nWhy.", f"# a comment\n{GOOD}", "Merge branch 'one'", f"fixup! {'a' * 71}"],
)
def test_a_good_message_is_taken(message: str) -> None:
    assert faults(message) == []


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (f"{'a' * 72}\n\nWhy.", "The first line has 72 characters"),
        ("What\nWhy.", "The second line is not empty"),
        ("What", "There is no body"),
        ("What\n\n# Please enter the message", "There is no body"),
        (f"What\n{CUT}\ndiff --git a/one b/one", "There is no body"),
        ("What\n\nSigned-off-by: One <one@example.org>", "There is no body"),
        ("", "There is no body"),
    ],
)
def test_a_fault_is_named(message: str, said: str) -> None:
    (found,) = faults(message)
    assert found.startswith(said)


def test_git_makes_no_commit_with_a_bad_message(tmp_path: Path) -> None:
    """As `make hooks` installs it. A commit without files needs no other check."""
    if shutil.which("git") is None:
        pytest.skip("there is no git on this machine")
    (tmp_path / "tests").mkdir()
    for name in (".pre-commit-config.yaml", "tests/commit_message.py"):
        shutil.copy(REPOSITORY / name, tmp_path / name)
    (tmp_path / ".venv").symlink_to(sys.prefix)
    who = {f"GIT_{role}_{what}": "one" for role in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)} | who

    def done(*command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)

    assert done("git", "init", "--quiet").returncode == 0
    assert done(".venv/bin/prek", "install").returncode == 0
    refused = done("git", "commit", "--allow-empty", "--message", "What")
    assert refused.returncode == 1
    assert "There is no body" in refused.stdout + refused.stderr
    taken = done("git", "commit", "--allow-empty", "--message", GOOD)
    assert taken.returncode == 0, taken.stderr
