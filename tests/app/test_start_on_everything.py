"""`jaxmodel start` on every folder of public and wild logs, by commands alone: a verdict, or one sentence before it.

docs/public_logs.toml has the command of each folder, docs/public_logs.json what came out of it.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from benchmarks import public_logs
from jaxmodel.diagnosis.result import VERDICTS

REPOSITORY = Path(__file__).parents[2]
DOCS = REPOSITORY / "docs"
FOLDERS = [log["folder"] for log in tomllib.loads((DOCS / "public_logs.toml").read_text(encoding="utf-8"))["logs"]]


def test_page_is_what_came_out():
    made = public_logs.page(public_logs.results())
    assert (DOCS / "public_logs.md").read_text(encoding="utf-8") == made, "run: python -m benchmarks.public_logs"


def test_every_folder_is_started(shared: Path):
    there = [f"{path.parent.name}/{path.name}" for room in ("data", "wild") for path in (shared / room).glob("*/")]
    assert sorted(FOLDERS) == sorted(there)
    assert set(public_logs.results()) <= set(FOLDERS)


@pytest.mark.slow
@pytest.mark.parametrize("folder", FOLDERS)
def test_start_ends_with_a_verdict_or_a_sentence(shared: Path, tmp_path: Path, folder: str):
    log = next(log for log in public_logs.logs() if log["folder"] == folder)
    if not (shared / folder).is_dir():
        pytest.skip("this folder is not beside this copy of the repository")
    result = public_logs.start(log, shared, tmp_path / "out")
    if result["exit_code"] == 0:
        assert result["verdict"] in VERDICTS
    else:
        assert result["exit_code"] == 2
        assert len(result["said"].splitlines()) == 1
        assert not (tmp_path / "out" / public_logs.ANSWER.parts[0]).exists()  # before the longest stage
    if folder not in public_logs.results():
        return
    kept = public_logs.results()[folder]
    same = ("exit_code", "said", "verdict")  # errors and times are those of one machine
    assert {name: result.get(name) for name in same} == {name: kept.get(name) for name in same}
