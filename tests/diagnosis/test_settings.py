"""Every constant is in one table, with a meaning and a source."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from jaxmodel.fit.settings import SETTINGS, Settings, table


def test_every_constant_has_a_meaning_and_a_source():
    rows = table()
    assert [row["name"] for row in rows] == [field.name for field in dataclasses.fields(Settings)]
    for row in rows:
        assert row["meaning"], row
        assert row["source"], row
        assert row["value"] == str(getattr(SETTINGS, row["name"]))


def test_a_changed_constant_is_listed_with_its_value():
    changed = dataclasses.replace(SETTINGS, strained=4.0)
    assert [row["value"] for row in table(changed) if row["name"] == "strained"] == ["4.0"]


def test_every_constant_is_used():
    """An unused constant in the table would be misleading."""
    package = Path(__file__).parents[2] / "jaxmodel"
    text = "\n".join(path.read_text(encoding="utf-8") for path in package.rglob("*.py") if path.name != "settings.py")
    assert [row["name"] for row in table() if f".{row['name']}" not in text] == []
