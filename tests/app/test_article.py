"""Pages of sections, and mistakes of the commands that write them."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from jaxmodel.app.article import Picture, Section, Table, percent, power, write_article
from tests.app.conftest import Run

TABLE_1 = Path(__file__).parents[2] / "examples" / "paper_table1"


def test_article_holds_all_of_its_parts(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.write_text("x", encoding="utf-8")
    table = Table("numbers", ("what", "how many"), [("a < b", "1"), ("c", "2")])
    section = Section("One", ["A sentence.", table, Picture("dot", b"\x89PNG", "A dot.")])
    hostile = "<script>alert(1)</script>"
    write_article(tmp_path, hostile, hostile, ["first", hostile], [section, Section(hostile, [hostile])], [source])
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "a &lt; b" in page
    assert hostile not in page
    assert re.search(r'<td class="n">2</td>', page)
    assert "data:image/png;base64," in page
    assert (tmp_path / "dot.png").read_bytes() == b"\x89PNG"
    with (tmp_path / "numbers.csv").open(encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["what", "how many"], ["a < b", "1"], ["c", "2"]]


def test_numbers_are_written_for_a_person() -> None:
    assert power(-2.046e-4, -4) == "-2.05"
    assert power(-1e-9, -4) == "0.00"
    assert percent(0.157) == "+15.7 %"
    assert percent(-1e-9) == "0.0 %"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("mission", "nowhere.toml"), "nowhere.toml"),
        (("mission", "--age", "old"), "--age 18,25"),
        (("compensate", "--model", "nowhere"), "nowhere"),
    ],
)
def test_mistake_is_one_sentence(run: Run, tmp_path: Path, arguments: tuple[str, ...], said: str) -> None:
    result = run(*arguments, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert said in result.stderr
    assert result.stderr.count("\n") == 1


def test_estimate_wants_runs_of_both_kinds(run: Run, tmp_path: Path) -> None:
    result = run("estimate", TABLE_1, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "kind cell" in result.stderr
