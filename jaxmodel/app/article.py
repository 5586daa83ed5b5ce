"""A page of sections: paragraphs, tables and pictures in their order; what several commands report with."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
from collections.abc import Sequence
from pathlib import Path

from jaxmodel.app import terminal
from jaxmodel.app.page import write_page
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.provenance import provenance


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows of text under a head; the columns after the first `words` are numbers.

    Attributes:
        name: of the CSV that holds the same.
    """

    name: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1


@dataclasses.dataclass(frozen=True)
class Picture:
    """A picture and what it shows."""

    name: str
    png: bytes
    caption: str


@dataclasses.dataclass(frozen=True)
class Section:
    """A title, and texts, tables and pictures in the order in which they are read."""

    title: str
    parts: Sequence[str | Table | Picture]


def write_article(
    folder: Path,
    title: str,
    under: str,
    findings: Sequence[str],
    sections: Sequence[Section],
    files: Sequence[Path],
    *,
    pictures: bool = True,
) -> None:
    """Write a CSV for each table, a PNG for each picture and `report.html` to a folder.

    Args:
        folder: which is there.
        title: of the page.
        under: a line below it.
        findings: what a reader should take away, a line each.
        sections: of the page.
        files: what the result was made from, for its provenance.
        pictures: False writes the tables alone.
    """
    for part in (part for section in sections for part in section.parts):
        if isinstance(part, Picture) and pictures:
            write_whole(folder / f"{part.name}.png", part.png)
        elif isinstance(part, Table):
            table = io.StringIO()
            csv.writer(table).writerows([part.head, *part.rows])
            write_whole(folder / f"{part.name}.csv", table.getvalue())
    if not pictures:
        return
    write_page(
        folder / "report.html",
        "article.html",
        title=title,
        under=under,
        findings=findings,
        sections=[(section.title, [_part(part) for part in section.parts]) for section in sections],
        origin=provenance(files),
    )


def print_tables(sections: Sequence[Section]) -> None:
    """Print the tables of some sections at a terminal, under their names."""
    for table in (part for section in sections for part in section.parts if isinstance(part, Table)):
        terminal.table(table.name, table.head, table.rows, right=range(table.words, len(table.head)))


def _part(part: str | Table | Picture) -> tuple[str, str | Table | Picture]:
    return {str: "text", Table: "table", Picture: "picture"}[type(part)], part


def power(value: float, exponent: int, digits: int = 2) -> str:
    """Return a number in units of a power of ten, as a table whose head names the power shows it."""
    text = f"{value / 10.0**exponent:.{digits}f}"
    return re.sub(r"^-(0\.?0*)$", r"\1", text)


def percent(share: float, digits: int = 1) -> str:
    """Return a share in percent, with its sign."""
    text = f"{100.0 * share:+.{digits}f} %"
    return text[1:] if float(text[:-2]) == 0.0 else text
