"""Lines that name each of their numbers, as a controller prints them: '12:00:01.5 -> V:3.71,I:0.42'."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.raw_table import RawTable, to_numbers, units_in
from jaxmodel.data.tables.sniffing import encoding_of, first_lines
from jaxmodel.data.tables.units import is_unit

_STAMP = re.compile(
    r"^\W*(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?"
    r"|\d{1,2}:\d\d:\d\d(?:[.,:]\d+)?)(?=\W|$)\W*"
)
_PAIR = re.compile(
    r"(?P<name>[^\W\d][\w ./()\[\]°%-]*?)\s*[:=]\s*(?P<number>[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)"
    r"(?:\s*(?P<unit>[^\W\d_]+|[°%Ω℃]\w*)(?!\w*\s*[:=]))?(?![\w:.])"
)
_TIME = "Time"
_SAMPLE_LINES = 200
_FEWEST_PAIRS = 2
_SURE = 0.8  # of the first lines


def is_labelled(path: Path, encoding: str | None = None) -> bool:
    """Return whether most lines of a text name the same numbers.

    Args:
        path: the file.
        encoding: a codec of Python; by default found.
    """
    lines = first_lines(path, _SAMPLE_LINES, encoding)
    named = Counter(names for line in lines if len(names := tuple(_pairs(line)[1])) >= _FEWEST_PAIRS)
    return bool(named) and len(lines) > 1 and named.most_common(1)[0][1] >= 0.5 * len(lines) and (
        named.total() >= _SURE * len(lines)
    )  # fmt: skip


def _pairs(line: str) -> tuple[str, dict[str, tuple[str, str]]]:
    """Return the time stamp at the start of a line, '' for none, and number and unit by name."""
    stamp = _STAMP.match(line)
    rest = line[stamp.end() :] if stamp else line
    found: dict[str, tuple[str, str]] = {}
    for pair in _PAIR.finditer(rest):
        found.setdefault(pair["name"].strip(), (pair["number"], pair["unit"] or ""))
    return (stamp[1] if stamp else ""), found


def read_labelled(path: Path, encoding: str | None = None) -> RawTable:
    """Read lines that name each of their numbers: a column for each name of the commonest sort of line.

    Args:
        path: the file.
        encoding: a codec of Python; by default found.

    Raises:
        MeasurementError: it cannot be read.
    """
    encoding = encoding or encoding_of(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = [_pairs(line) for line in stream if line.strip()]
    sorts = Counter(frozenset(found) for _, found in lines if len(found) >= _FEWEST_PAIRS)
    if not sorts:
        raise MeasurementError(f"{file_label(path)} names no numbers; export the measurement as CSV.")
    sort = max(sorts, key=lambda names: sorts[names])
    rows = [(stamp, found) for stamp, found in lines if sort <= found.keys()]
    names = [name for name in rows[0][1] if name in sort]
    frame = pd.DataFrame(
        {name: to_numbers(pd.Series([found[name][0] for _, found in rows], dtype="string")) for name in names}
    )
    written = {name: Counter(found[name][1] for _, found in rows).most_common(1)[0][0] for name in names}
    if any(stamp for stamp, _ in rows):
        frame.insert(0, _TIME, pd.Series([stamp or None for stamp, _ in rows], dtype="string"))
    units = units_in(names) | {name: unit for name, unit in written.items() if is_unit(unit)}
    lost = len(lines) - len(rows)
    losses = (f"{lost:,} of {len(lines):,} lines name other numbers and were left out.",) if lost else ()
    remark = f"Each line names its numbers: {', '.join(names)}."
    return RawTable(frame, units, path, "lines of named numbers", (remark,), losses=losses)
