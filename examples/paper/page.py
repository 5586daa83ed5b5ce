"""The page that compares the paper with the simulation: paragraphs, tables and pictures in one file."""

from __future__ import annotations

import base64
import csv
import dataclasses
import hashlib
import importlib.metadata
import io
import re
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from matplotlib.figure import Figure

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h2 { margin-top: 2.5rem }
div.wide { overflow-x: auto }
table { border-collapse: collapse; font-size: 0.9rem }
th, td { padding: 0.2rem 0.7rem; text-align: left; border-bottom: 1px solid #ddd; vertical-align: top }
.n { text-align: right; font-variant-numeric: tabular-nums }
figure { margin: 1.5rem 0 } img { max-width: 100% } figcaption, footer { color: #666; font-size: 0.9rem }
"""


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
    """A figure, the name of its PNG, and what it shows."""

    name: str
    figure: Figure
    caption: str


@dataclasses.dataclass(frozen=True)
class Section:
    """A title, and texts, tables and pictures in the order in which they are read."""

    title: str
    parts: Sequence[str | Table | Picture]


def write_page(
    folder: Path, title: str, under: str, findings: Sequence[str], sections: Sequence[Section], files: Sequence[Path]
) -> None:
    """Write a CSV for each table, a PNG for each picture and `report.html` to a folder.

    Args:
        folder: which is there.
        title: of the page.
        under: a line below it.
        findings: what a reader should take away, a line each.
        sections: of the page.
        files: what the result was made from; the foot of the page has the SHA-256 of each.
    """
    lines = [f"<h1>{escape(title)}</h1>", f"<p>{escape(under)}</p>", "<ul>"]
    lines += [*(f"<li>{escape(line)}</li>" for line in findings), "</ul>"]
    for section in sections:
        lines.append(f"<h2>{escape(section.title)}</h2>")
        for part in section.parts:
            if isinstance(part, Table):
                with (folder / f"{part.name}.csv").open("w", encoding="utf-8", newline="") as file:
                    csv.writer(file).writerows([part.head, *part.rows])
                lines += _table(part)
            elif isinstance(part, Picture):
                png = io.BytesIO()
                part.figure.savefig(png, format="png")
                (folder / f"{part.name}.png").write_bytes(png.getvalue())
                source = f"data:image/png;base64,{base64.b64encode(png.getvalue()).decode()}"
                caption = escape(part.caption)
                lines.append(f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption></figure>')
            else:
                lines.append(f"<p>{escape(part)}</p>")
    made = "; ".join(f"{file.name} {hashlib.sha256(file.read_bytes()).hexdigest()}" for file in files)
    lines.append(f"<footer>jaxmodel {importlib.metadata.version('jaxmodel')}; SHA-256 of {escape(made)}</footer>")
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    text = "\n".join(
        ["<!doctype html>", '<html lang="en">', f"<head>{head}</head>", "<body>", *lines, "</body></html>"]
    )
    (folder / "report.html").write_text(text, encoding="utf-8")


def _table(table: Table) -> Iterator[str]:
    def row(cells: Sequence[str], kind: str) -> str:
        marks = [' class="n"' if column >= table.words else "" for column in range(len(cells))]
        return "".join(f"<{kind}{mark}>{escape(cell)}</{kind}>" for mark, cell in zip(marks, cells, strict=True))

    yield f'<div class="wide"><table><tr>{row(table.head, "th")}</tr>'
    yield from (f"<tr>{row(cells, 'td')}</tr>" for cells in table.rows)
    yield "</table></div>"


def power(value: float, exponent: int, digits: int = 2) -> str:
    """Return a number in units of a power of ten, as a table whose head names the power shows it."""
    text = f"{value / 10.0**exponent:.{digits}f}"
    return re.sub(r"^-(0\.?0*)$", r"\1", text)


def percent(share: float, digits: int = 1) -> str:
    """Return a share in percent, with its sign."""
    text = f"{100.0 * share:+.{digits}f} %"
    return text[1:] if float(text[:-2]) == 0.0 else text
