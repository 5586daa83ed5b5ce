"""What somebody new meets: the version, the help, results without pictures, and lines while work goes on."""

from __future__ import annotations

import threading
import warnings
from importlib.metadata import version
from pathlib import Path

import pytest

from jaxmodel.app import terminal
from jaxmodel.plots.style import new_figure, png
from tests.app.conftest import Run
from tests.app.test_cli import STUDY

DRAWN = (".png", ".html")


def test_version_is_that_of_the_installation(run: Run) -> None:
    result = run("--version")
    assert (result.exit_code, result.stdout.strip()) == (0, f"jaxmodel {version('jaxmodel')}")


def test_bare_command_shows_its_help_and_nothing_after_it(run: Run) -> None:
    result = run()
    assert result.exit_code == 0
    assert result.stderr == ""
    assert result.stdout.strip() == run("--help").stdout.strip()
    assert "diagnose" in result.stdout


def written(out: Path) -> list[str]:
    """Return the names of all files below a folder that are not inside a Zarr store."""
    files = [path.relative_to(out) for path in out.rglob("*") if path.is_file()]
    return [str(path) for path in files if not any(part.endswith(".zarr") for part in path.parts)]


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        pytest.param(["simulate", "CASE"], "run-01.csv", id="simulate"),
        pytest.param(["compare", "CASE"], "small/errors.json", id="compare"),
        pytest.param(["identify", "CASE"], "identify.json", id="identify"),
        pytest.param(["sweep", "STUDY"], "lanes.csv", id="sweep"),
        pytest.param(["sensitivity", "STUDY", "--gradient-only"], "sensitivity.csv", id="sensitivity"),
        pytest.param(
            ["sensitivity", "STUDY", "--uncertain", "capacity_Ah=0.1", "--count", "8"],
            "uncertainty.csv",
            id="uncertain",
        ),
        pytest.param(
            ["sensitivity", "STUDY", "--pair", "capacity_Ah,series_resistance_scale,cycles"],
            "interactions.csv",
            id="pair",
        ),
        pytest.param(["sensitivity", "STUDY", "--global", "morris", "--count", "2"], "global.csv", id="global"),
    ],
)
def test_answer_only_writes_no_pictures(
    arguments: list[str], answer: str, run: Run, made_case: Path, tmp_path: Path
) -> None:
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    places = {"CASE": made_case, "STUDY": tmp_path / "study.toml"}
    result = run(*(places.get(one, one) for one in arguments), "--answer-only", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    files = written(tmp_path / "out")
    assert answer in files
    assert [name for name in files if name.endswith(DRAWN)] == []
    assert "picture" not in result.stdout.splitlines()[-1]


@pytest.mark.parametrize("command", ["compensate", "estimate", "mission", "diagnose"])
def test_answer_only_is_an_option_of_every_command_that_draws(command: str, run: Run) -> None:
    assert "--answer-only" in run(command, "--help").stdout


def test_nothing_held_out_is_said(run: Run, case_folder: Path, tmp_path: Path) -> None:
    text = (case_folder / "case.toml").read_text(encoding="utf-8")
    (case_folder / "case.toml").write_text(text.replace('"check"', '"fit"'), encoding="utf-8")
    result = run("compare", case_folder, "--answer-only", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert 'cannot be judged; set split = "check" for one of them' in " ".join(result.stdout.split())


def test_unknown_effect_says_how_ones_own_is_given(run: Run, case_folder: Path, tmp_path: Path) -> None:
    toml = case_folder / "case.toml"
    text = toml.read_text(encoding="utf-8")
    for name, said in (("found_law", "--effect found_law.py:FoundLaw."), ("own_law", "--effect FILE.py:CLASS.")):
        toml.write_text(f"{text}\n[effects]\n{name} = {{}}\n", encoding="utf-8")
        result = run("simulate", case_folder, "--out", tmp_path / "out")
        assert result.exit_code == 2
        assert result.stderr.strip().endswith(f"Give an effect of your own by {said}")


def test_a_figure_too_full_for_its_layout_is_drawn_without_a_warning() -> None:
    figure = new_figure(2.0, 1.0)
    for axes in figure.subplots(6, 6).flat:
        axes.set_ylabel("a label that is far too long for so small a figure")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert png(figure).startswith(b"\x89PNG")


def test_a_part_of_the_work_that_lasts_is_named_again(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, "PLAIN_PAUSE_S", 0.05)
    heard = threading.Event()
    said: list[str] = []

    def say(line: str) -> None:
        said.append(line)
        if "still" in line:
            heard.set()

    monkeypatch.setattr(terminal, "say", say)
    before = threading.active_count()
    with terminal.stages("bench", {"calibrating": 0.5}) as progress:
        progress("calibrating")
        assert heard.wait(10.0)
    assert said[0].startswith("bench: calibrating (0 s")
    assert said[1].startswith("bench: still calibrating (0 s, about 0 s left)")
    assert threading.active_count() == before
