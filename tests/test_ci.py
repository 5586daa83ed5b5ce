"""A reader, a merge, the public CI and the hooks of a commit run the same checks; a release is made of a whole tree."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from tests.test_architecture import PROJECT, REPOSITORY


def text_of(name: str) -> str:
    return (REPOSITORY / name).read_text(encoding="utf-8")


MERGE = text_of(".ci/run").splitlines()[-1].removeprefix("exec ")
JOBS = yaml.safe_load(text_of(".github/workflows/test.yml"))["jobs"]
OLDEST = PROJECT["project"]["requires-python"].removeprefix(">=")


def commands(job: str) -> list[str]:
    return [step["run"] for step in JOBS[job]["steps"] if "run" in step]


def test_the_public_ci_runs_what_a_merge_needs_and_the_readme_says() -> None:
    assert MERGE in [line.partition("#")[0].strip() for line in text_of("README.md").splitlines()]
    assert commands("test") == [MERGE]
    assert commands("oldest") == ["make test-oldest"]


def test_the_public_ci_begins_with_the_oldest_python() -> None:
    matrix = JOBS["test"]["strategy"]["matrix"]
    first, *others = [tuple(map(int, python.split("."))) for python in matrix["python"]]
    assert matrix["python"][0] == OLDEST
    assert others == [(3, first[1] + more) for more in range(1, len(others) + 1)]
    setups = [step["with"]["python-version"] for step in JOBS["oldest"]["steps"] if "with" in step]
    assert [*setups, *(one["python"] for one in matrix["include"])] == [OLDEST, OLDEST]


def test_a_commit_is_checked_by_the_commands_of_make_test() -> None:
    recipe = text_of("Makefile").partition("\ntest: $(INSTALLED)\n")[2].partition("\n\n")[0]
    checks = [line.strip().replace("$(BIN)", ".venv/bin") for line in recipe.splitlines()][:-1]  # without the tests
    (local,) = yaml.safe_load(text_of(".pre-commit-config.yaml"))["repos"]
    assert [hook["entry"] for hook in local["hooks"] if "stages" not in hook] == checks


def test_a_release_needs_a_version_a_clean_tree_and_its_section(tmp_path: Path) -> None:
    if shutil.which("git") is None:
        pytest.skip("there is no git on this machine")
    shutil.copy(REPOSITORY / "Makefile", tmp_path)
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## [1.2.3] - 2027-01-31\n\n- It runs.\n", encoding="utf-8")

    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}

    def git(*arguments: str) -> None:
        who = ("-c", "user.name=one", "-c", "user.email=one@example.org")
        subprocess.run(["git", *who, *arguments], cwd=tmp_path, env=environment, check=True)

    def said(version: str) -> str:
        command = ["make", "release-check", f"VERSION={version}"]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True).stdout

    git("init", "--quiet")
    assert "Commit" in said("1.2.3")
    git("add", ".")
    git("commit", "--quiet", "--message", "All of it")
    assert said("1.2.3") == ""
    assert "make release VERSION=1.2.3" in said("")
    assert "make release VERSION=1.2.3" in said("v1.2.3")
    assert "no section [1.2.4]" in said("1.2.4")
    git("tag", "v1.2.3")
    assert "v1.2.3 is there already" in said("1.2.3")
