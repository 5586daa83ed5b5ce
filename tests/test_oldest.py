"""The oldest releases that are supported, as a constraints file."""

from __future__ import annotations

from packaging.version import Version

from tests.oldest import oldest
from tests.test_architecture import REPOSITORY

LINES = oldest((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))


def test_each_dependency_has_a_line() -> None:
    assert "jax==0.10" in LINES
    assert len(LINES) == len({line.partition("==")[0] for line in LINES}) > 40


def test_pinned_releases_are_not_older() -> None:
    text = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8")
    pinned = dict(line.lower().split("==") for line in text.splitlines() if "==" in line)
    older = [
        line
        for line in LINES
        if (n := line.split("=="))[0].lower() in pinned and Version(pinned[n[0].lower()]) < Version(n[1])
    ]
    assert older == []
