"""A session is a folder of its user; what is dropped on it stays in there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.app.browser.sessions import MOST_OF_A_FILE, Sessions, UploadRefused, safe_name
from jaxmodel.app.browser.worker.opening import refuse_outside
from jaxmodel.base.errors import MeasurementError

ANNA, BEN = "a" * 32, "b" * 32


def test_a_session_is_its_users_alone(tmp_path: Path) -> None:
    sessions = Sessions(tmp_path)
    session = sessions.new(ANNA)
    assert sessions.of(ANNA, session.name) is session
    assert sessions.of(BEN, session.name) is None
    assert sessions.of(ANNA, "../" + session.name) is None
    assert sessions.latest(BEN) is None
    assert session.folder.stat().st_mode & 0o077 == 0


def test_what_is_wanted_outlives_the_server(tmp_path: Path) -> None:
    session = Sessions(tmp_path).new(ANNA)
    wanted = session.want("add", names=["self_heating"])
    again = Sessions(tmp_path).latest(ANNA)
    assert again is not None
    assert again.wanted == wanted
    again.was_stopped()
    assert again.wanted is None
    assert session.progress is not None
    assert session.progress["state"] == "stopped"


def test_only_what_is_unused_is_removed(tmp_path: Path) -> None:
    sessions = Sessions(tmp_path)
    old, new = sessions.new(ANNA), sessions.new(BEN)
    (old.folder / "view.json").write_text("{}")
    os.utime(old.folder / "view.json", (1000.0, 1000.0))
    assert sessions.size() == (2, 2)
    assert sessions.remove_unused(2000.0) == 1
    assert sessions.of(ANNA, old.name) is None
    assert sessions.of(BEN, new.name) is new


@given(st.text(max_size=200))
def test_no_name_leads_out_of_the_folder(name: str) -> None:
    try:
        safe = safe_name(name)
    except UploadRefused:
        return
    assert Path("/folder", safe).resolve().parent == Path("/folder")
    assert not safe.startswith(".")
    assert len(safe) <= 120


@pytest.mark.parametrize(("name", "size"), [("effect.py", 10), ("page.HTML", 10), ("log.csv", MOST_OF_A_FILE + 1)])
def test_code_and_what_is_too_large_are_refused(tmp_path: Path, name: str, size: int) -> None:
    with pytest.raises(UploadRefused, match=name.split(".")[0]):
        Sessions(tmp_path).new(ANNA).place_for(name, size)


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ('preset = "../other/cell.toml"', "outside"),
        ('[[runs]]\nfile = "C:\\\\logs\\\\a.csv"', "outside"),
        ('[[runs]]\nfile = "/etc/passwd"', "outside"),
        ('effects = ["mine.py:Mine"]', "code"),
    ],
)
def test_an_uploaded_case_names_no_code_and_nothing_outside(tmp_path: Path, line: str, word: str) -> None:
    path = tmp_path / "case.toml"
    path.write_text(line, encoding="utf-8")
    with pytest.raises(MeasurementError, match=word):
        refuse_outside(path)
