"""Lines that a serial monitor has put a time before: '12:00:01.123 -> 1234,3.70,0.5', as that of the Arduino IDE."""

from __future__ import annotations

import re
from pathlib import Path

from jaxmodel.data.tables.sniffing import encoding_of, first_lines

ARRIVAL = "Arrival time"
_LINE = re.compile(r"^\s*(\d{1,2}:\d\d:\d\d[.,]\d{1,6})\s*->\s*(.*\S)\s*$")
_SAMPLE_LINES = 50
_SURE = 0.8  # of the first lines
_DELIMITERS = ("\t", ";", ",")


def is_serial_monitor(path: Path, encoding: str | None = None) -> bool:
    """Return whether most lines of a text have a time, an arrow and a number, or more of them.

    Args:
        path: the file.
        encoding: a codec of Python; by default found.
    """
    lines = first_lines(path, _SAMPLE_LINES, encoding)
    found = [one for line in lines if (one := _LINE.match(line)) is not None]
    numbers = sum(one[2][0] in "+-.0123456789" for one in found)
    return len(lines) > 1 and len(found) >= _SURE * len(lines) and numbers >= 0.5 * len(lines)


def without_arrows(path: Path, folder: Path, encoding: str | None = None) -> Path:
    """Return the lines as a table of text in a folder: the time is the first column, in the mark of the others.

    Args:
        path: the file.
        folder: in which the table is written under the name of the file.
        encoding: a codec of Python; by default found.
    """
    lines = path.read_text(encoding=encoding or encoding_of(path), errors="replace").splitlines()
    found = [one for line in lines if (one := _LINE.match(line)) is not None]
    sample = [one[2] for one in found[:_SAMPLE_LINES]]
    delimiter = next((mark for mark in _DELIMITERS if sum(mark in rest for rest in sample) > len(sample) // 2), ",")
    inside = folder / path.parent.name / path.name
    inside.parent.mkdir(exist_ok=True)
    rows = (
        f"{ARRIVAL if one[2][0].isalpha() else one[1].replace(',', '.')}{delimiter}{_in_fields(one[2], delimiter)}"
        for one in found
    )
    inside.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return inside


def _in_fields(rest: str, delimiter: str) -> str:
    """Return what stood behind the arrow in fields, which only blanks may have parted."""
    return rest if delimiter in rest or delimiter != "," else delimiter.join(rest.split())
