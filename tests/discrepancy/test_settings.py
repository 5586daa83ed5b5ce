"""Every constant is in one table, with a meaning and a source, and the docs repeat it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from discrepancy.settings import SETTINGS, Settings, table

DOCS = Path(__file__).parents[2] / "docs" / "discrepancy.md"


def test_every_constant_has_a_meaning_and_a_source():
    rows = table()
    assert [row["name"] for row in rows] == [field.name for field in dataclasses.fields(Settings)]
    for row in rows:
        assert row["meaning"], row
        assert row["source"], row
        assert row["value"] == str(getattr(SETTINGS, row["name"]))


def test_a_changed_constant_is_listed_with_its_value():
    changed = dataclasses.replace(SETTINGS, named=0.9)
    assert [row["value"] for row in table(changed) if row["name"] == "named"] == ["0.9"]


def test_every_constant_is_used():
    """An unused constant in the table would be misleading."""
    package = Path(__file__).parents[2] / "discrepancy"
    text = "\n".join(path.read_text(encoding="utf-8") for path in package.rglob("*.py") if path.name != "settings.py")
    assert [row["name"] for row in table() if f".{row['name']}" not in text] == []


def test_docs_repeat_the_table():
    text = DOCS.read_text(encoding="utf-8")
    if "| `least_odds` |" not in text:
        pytest.skip("the page has no table of constants yet")
    lines = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines()]
    in_docs = {cells[0].strip("`"): cells for cells in lines if cells and cells[0].startswith("`")}
    for row in table():
        assert in_docs[row["name"]][1].strip("`") == row["value"], row["name"]
