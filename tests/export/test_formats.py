"""Formats by name: ours, those of other packages, and mistakes."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import pytest

from jaxmodel import Case, read_case
from jaxmodel.base.errors import ParameterError
from jaxmodel.case.exported import Exported
from jaxmodel.export import formats


def export_title(case: Case, *, loud: bool = False) -> Exported:
    return Exported(case.title.upper() if loud else case.title, ("It carries the title alone.",))


@pytest.fixture
def case() -> Case:
    return read_case("examples/samsung_30q")


@pytest.fixture
def _with_a_format_of_another_package(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        importlib.metadata.EntryPoint("title", f"{__name__}:export_title", formats.GROUP),
        importlib.metadata.EntryPoint("broken", "no_such_package:export", formats.GROUP),
    ]
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: points if group == "jaxmodel.export" else [])


@pytest.mark.usefixtures("_with_a_format_of_another_package")
def test_another_package_adds_a_format(case: Case, tmp_path: Path) -> None:
    found = case.export("title", tmp_path / "title.txt", loud=True)
    assert (tmp_path / "title.txt").read_text() == case.title.upper() == found.content
    assert found.left_out == ("It carries the title alone.",)


@pytest.mark.usefixtures("_with_a_format_of_another_package")
def test_a_format_whose_package_is_broken_says_so(case: Case) -> None:
    with pytest.raises(ParameterError, match=r"'broken' cannot be loaded .*no_such_package"):
        case.export("broken")


def test_an_unknown_format_names_the_nearest(case: Case) -> None:
    with pytest.raises(ParameterError, match=r"no format 'cc'.*Did you mean 'c'"):
        case.export("cc")


def test_an_option_of_another_format_is_refused(case: Case) -> None:
    with pytest.raises(ParameterError, match="takes no 'colour'"):
        case.export("c", colour="red")


@pytest.mark.parametrize("name", formats.OWN)
def test_our_formats_can_be_loaded(name: str) -> None:
    assert callable(formats.formats()[name]())
