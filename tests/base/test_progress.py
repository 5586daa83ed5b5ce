"""Progress as the caller of long work wants it: shown, told or left out."""

from __future__ import annotations

import io
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from jaxmodel import Case, Investigation, import_case, read_case, simulate_case, sweeps
from jaxmodel.base.progress import counted, is_watched, stages


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Handle:
    """What a notebook gives for an output that may be changed."""

    def __init__(self, shown: list[str]) -> None:
        self._shown = shown

    def update(self, what: str) -> None:
        self._shown.append(what)


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A notebook; what its cell showed, one after the other."""
    shown: list[str] = []
    ipython: Any = types.ModuleType("IPython")
    ipython.get_ipython = lambda: types.SimpleNamespace(kernel=object())
    display: Any = types.ModuleType("IPython.display")
    display.HTML = str
    display.display = lambda what, display_id: Handle(shown)
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return shown


def test_a_function_is_told() -> None:
    told: list[Any] = []
    with stages(told.append, "work") as tell:
        tell("first")
    with counted(lambda done, total: told.append((done, total)), "work", "lanes") as tell_count:
        tell_count(1, 2)
    assert told == ["first", (1, 2)]


@pytest.mark.parametrize("progress", [True, False])
def test_nothing_is_shown_where_nobody_watches(progress: bool, capfd: pytest.CaptureFixture[str]) -> None:
    assert not is_watched()
    with stages(progress, "work") as tell, counted(progress, "work", "lanes") as tell_count:
        tell("first")
        tell_count(1, 2)
    assert capfd.readouterr() == ("", "")


def test_a_terminal_shows_what_is_done_now(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    with stages(True, "my cell") as tell:
        tell("calibrating")
    with counted(True, "my sweep", "lanes") as tell_count:
        tell_count(3, 4)
    assert "calibrating" in shown.getvalue()
    assert "3/4" in shown.getvalue()
    written = len(shown.getvalue())
    with stages(False, "my cell") as tell:
        tell("calibrating")
    assert len(shown.getvalue()) == written


def test_a_notebook_shows_one_line_that_goes_at_the_end(notebook: list[str]) -> None:
    with stages(True, "my <cell>", {"calibrating": 0.5}) as tell:
        tell("calibrating the base model")
    assert notebook[0].startswith("<small>my &lt;cell&gt;: calibrating the base model, about")
    assert notebook[-1] == ""
    notebook.clear()
    with counted(True, "my sweep", "lanes") as tell_count:
        for done in range(101):
            tell_count(done, 100)
    assert "value='1.0000'" in notebook[-2]
    assert "100 of 100 lanes" in notebook[-2]
    assert len(notebook) < 10  # however often it was told
    with pytest.raises(ZeroDivisionError), stages(True, "work"):
        raise ZeroDivisionError
    assert notebook[-1] == ""


def test_a_sweep_shows_its_lanes_in_a_notebook(notebook: list[str]) -> None:
    study = sweeps.Study(
        kind="cell",
        title="two temperatures",
        profile={"duration_s": 10.0, "step_s": 1.0, "current_A": 2.0},
        axes={"ambient_degC": [10.0, 20.0]},
        metrics=["final_soc"],
    )
    sweeps.run(study)
    assert any("two temperatures: 2 of 2 lanes" in one for one in notebook)
    notebook.clear()
    told: list[tuple[int, int]] = []
    sweeps.run(study, lambda done, total: told.append((done, total)))
    sweeps.run(study, False)
    assert told[-1] == (2, 2)
    assert notebook == []


def test_work_within_other_work_shows_nothing_of_its_own(notebook: list[str]) -> None:
    with stages(True, "whole") as tell:
        tell("first")
        with stages(True, "part") as tell_part, counted(True, "lanes of it", "lanes") as tell_count:
            tell_part("inner")
            tell_count(1, 2)
    assert any("first" in line for line in notebook)
    assert not any("inner" in line or "lanes" in line for line in notebook)
    with stages(False, "quiet"), stages(True, "part") as tell_part:  # who wants no progress gets none
        before = len(notebook)
        tell_part("inner")
        assert len(notebook) == before
    with stages(True, "next") as tell:  # and what comes after is shown again
        tell("second")
    assert any("second" in line for line in notebook)


def test_simulation_and_import_show_their_progress(notebook: list[str], case_folder: Path) -> None:
    case = read_case(case_folder)
    simulate_case(case, progress=False)
    assert notebook == []
    simulate_case(case)
    assert any("run-01" in line for line in notebook)
    told: list[str] = []
    simulate_case(case, progress=told.append)
    assert told == [run.name for run in case.runs]
    notebook.clear()
    file = case_folder / "run-01.csv"
    import_case(file, "cell", progress=False)
    assert notebook == []
    import_case(file, "cell")
    assert any("clocks and signs" in line for line in notebook)


def test_an_investigation_shows_its_progress(notebook: list[str], case: Case) -> None:
    Investigation(case, progress=False).errors()
    assert notebook == []
    investigation = Investigation(case)
    investigation.errors()
    assert any("calibrating" in line for line in notebook)
    assert notebook[-1] == ""
    told: list[str] = []
    Investigation(case, progress=told.append).errors()
    assert any("calibrating" in line for line in told)
