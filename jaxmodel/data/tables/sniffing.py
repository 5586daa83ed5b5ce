"""How a text file is laid out: encoding, delimiter, decimal mark, and the lines before its numbers begin."""

from __future__ import annotations

import codecs
import csv
import dataclasses
import itertools
import re
from collections.abc import Sequence
from pathlib import Path

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.fields import has_unit, width_of_lists, without_unit
from jaxmodel.data.tables.names import are_units, of_two_lines
from jaxmodel.data.tables.units import is_unit

_SAMPLE_BYTES = 4 << 20
_ENOUGH_LINES = 400
_MOST_BROKEN = 4  # lines of one row
_UNIT_COLUMNS = ("unit", "units", "einheit", "单位")
_HEADER_LINES = 2  # names, and units
_DELIMITERS = ("\t", ";", ",", "|")
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
# Encodings of benches' computers; the detector guesses exotic ones for a lone degree sign.
_ENCODINGS = ["cp1252", "gb18030", "shift_jis", "cp1251", "euc_kr", "big5"]
# Time, current, voltage: words that tell an encoding where a line or two of it are too short for statistics.
_WORDS_IN = {
    "gb18030": ("时间", "电流", "电压"),
    "shift_jis": ("時間", "電流", "電圧"),
    "euc_kr": ("시간", "전류", "전압"),
    "big5": ("時間", "電流", "電壓"),
    "cp1251": ("время", "ток", "напряжение"),
}
MISSING = ("", "nan", "NaN", "NAN", "na", "NA", "n/a", "N/A", "#N/A", "null", "NULL", "None", "-", "--", "---")

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?$")
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?([eE][+-]?\d+)?$")
_THOUSANDS_POINT = re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d*)([eE][+-]?\d+)?$")
_DURATION = re.compile(r"[+-]?(\d+\s*d(ays?)?\s+)?\d+:\d{1,2}(:\d{1,2}([.,:]\d*)?)?$", re.IGNORECASE)
_DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}([T ]\s*\d.*)?$")
_MARK = re.compile(r"\[?\w+\]?[\s,;]*")
_HEX = re.compile(r"\b0x[\dA-Fa-f]{2,}\b")
_NO_NUMBER = frozenset("inf -inf +inf infinity".split())


@dataclasses.dataclass(frozen=True)
class Layout:
    """The form of a text file.

    Attributes:
        encoding: a codec of Python.
        delimiter: one character; ' ' is any number of blanks.
        decimal: '.' or ','.
        thousands: the mark between groups of three digits, None where there is none.
        names: of the columns, "" where one has none.
        units: of the columns in a line of their own, "" where it has none; empty where there is no such line.
        header_line: the line of the names, counted from 0; None where no line names them.
        first_line: the line of the first row, counted from 0.
        texts: by column, whether the first rows hold text there.
        widths: by column, how many numbers each of its fields lists; 0 for a column without lists.
        before: the lines above the header.
        indented: three headers, each one field further in: tables of cycles, steps and records in one file.
        broken: whether quoted fields go on in the next line, as replies of an instrument that end in one.
    """

    encoding: str
    delimiter: str
    decimal: str
    thousands: str | None
    names: tuple[str, ...]
    units: tuple[str, ...]
    header_line: int | None
    first_line: int
    texts: tuple[bool, ...]
    widths: tuple[int, ...]
    before: tuple[str, ...]
    indented: bool = False
    broken: bool = False


def encoding_of(path: Path) -> str:
    """Return the encoding of a text file.

    Raises:
        MeasurementError: the file cannot be read, is empty, or is not text.
    """
    head = _head(path)
    for mark, name in _BYTE_ORDER_MARKS:
        if head.startswith(mark):
            return name
    zeros = head[:4096].count(0)
    if zeros > len(head[:4096]) // 4:
        return "utf-16-le" if head[1:2] == b"\0" else "utf-16-be"
    if zeros:
        raise MeasurementError(f"{file_label(path)} is not text; give the file with the ending of its format.")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
        return "utf-8"
    except UnicodeDecodeError:
        pass
    import charset_normalizer

    lines = b"\n".join(line for line in head[: 1 << 18].splitlines() if any(byte > 127 for byte in line))
    for name, words in _WORDS_IN.items():
        text = lines.decode(name, errors="replace").lower()
        if sum(word in text for word in words) > 1:
            return name
    best = charset_normalizer.from_bytes(lines[:20_000], cp_isolation=_ENCODINGS, threshold=0.9).best()
    # A degree or micro sign by itself is also half of a character of the east.
    alone = re.search(rb"[\x00-\x7f][\xb0\xb5\xb2\xb3\xba][\x00-\x7f]", lines) is not None
    return "cp1252" if best is None or alone else best.encoding


def first_lines(path: Path, most: int, encoding: str | None = None) -> list[str]:
    """Return the first lines of a text that are not blank; none of a file that the reader of tables will refuse.

    Args:
        path: the file.
        most: lines that are read.
        encoding: a codec of Python; by default found.
    """
    try:
        with path.open(encoding=encoding or encoding_of(path), errors="replace") as stream:
            return [line for line in itertools.islice(stream, most) if line.strip()]
    except (MeasurementError, LookupError):
        return []


def _no_table(path: Path, lines: Sequence[str]) -> str:
    """Return why a text holds no table, in one sentence."""
    filled = [line.strip() for line in lines if line.strip()]
    numbers = [line for line in filled if _NUMBER.match(line)]
    if len(numbers) > 1 and len(numbers) >= len(filled) - _HEADER_LINES:
        return f"{file_label(path)} has one column of numbers; a log has a time and its readings in one row."
    if len(filled) <= _HEADER_LINES and any(mark in line for line in filled for mark in _DELIMITERS):
        return f"{file_label(path)} has names of columns and no rows; export the measurement again."
    return (
        f"{file_label(path)} has no rows of numbers in its first {len(lines):,} lines; give a table with one row of "
        "readings per line."
    )


def layout_of(path: Path, encoding: str | None = None, delimiter: str | None = None) -> Layout:
    """Return how a text file is laid out.

    Args:
        path: the file.
        encoding: a codec of Python; by default found.
        delimiter: one character; by default found.

    Raises:
        MeasurementError: the file is not a table of text, or cannot be decoded.
    """
    encoding = encoding or encoding_of(path)
    try:
        text = codecs.getincrementaldecoder(encoding)(errors="replace").decode(_head(path))
    except LookupError:
        raise MeasurementError(f"{file_label(path)}: there is no encoding '{encoding}'; try utf-8 or cp1252.") from None
    lines = text.splitlines()
    if len(lines) > 1 and path.stat().st_size > _SAMPLE_BYTES:
        lines.pop()  # cut in the middle
    physical = len(lines)
    lines, places = _whole_lines(lines)
    best: tuple[float, str, int, int] = (0.0, "", 0, 0)
    for candidate in (delimiter,) if delimiter else (*_DELIMITERS, " "):
        # Blanks also stand inside a field; they delimit where nothing else does.
        if candidate == " " and best[0] > 0.0:
            continue
        score, start, count = _longest_block(lines, candidate)
        if score > best[0]:
            best = (score, candidate, start, count)
    score, found, start, count = best
    if score <= 0.0:
        raise MeasurementError(_no_table(path, lines))
    rows = [split(line, found) for line in lines[start : start + _ENOUGH_LINES] if line.strip()]
    rows = [row for row in rows if len(row) == count]
    decimal, thousands = _marks([without_unit(field) for row in rows for field in row], found)
    header, units, indented = _header(lines, start, count, found)
    names = split(lines[header].lstrip("#%! "), found)[:count] if header is not None else []
    names = [name.strip() for name in names] + [""] * (count - len(names))
    if header and found != " " and not indented:
        above_it = split(lines[header - 1].lstrip("#%! "), found)
        names = of_two_lines(names, above_it if len(above_it) == count else [])
    texts = tuple(_is_text([row[place] for row in rows], thousands) for place in range(count))
    units = _units_beside(names, rows, units)
    widths = tuple(width_of_lists([row[place] for row in rows]) for place in range(count))
    before = tuple(lines[: start if header is None else header])
    at = None if header is None else places[header]
    first, broken = places[start], len(lines) < physical
    return Layout(
        encoding, found, decimal, thousands, tuple(names), units, at, first, texts, widths, before, indented, broken
    )  # fmt: skip


def _whole_lines(lines: Sequence[str]) -> tuple[list[str], list[int]]:
    """Return lines in which no quoted field is broken, and the place of each among those of the file."""
    whole: list[str] = []
    places: list[int] = []
    place = 0
    while place < len(lines):
        count, line = 1, lines[place]
        while line.count('"') % 2 and count < _MOST_BROKEN and place + count < len(lines):
            line = f"{line} {lines[place + count]}"
            count += 1
        if line.count('"') % 2:  # a quote that is none
            count, line = 1, lines[place]
        whole.append(line)
        places.append(place)
        place += count
    return whole, places


def _units_beside(names: Sequence[str], rows: Sequence[Sequence[str]], units: tuple[str, ...]) -> tuple[str, ...]:
    """Return the units of columns with those that a column called 'Units' beside them has in every row."""
    found = [*units, *[""] * (len(names) - len(units))]
    for place, name in enumerate(names):
        if place and name.lower() in _UNIT_COLUMNS and not found[place - 1]:
            said = {row[place] for row in rows}
            unit = said.pop() if len(said) == 1 else ""
            found[place - 1] = unit if is_unit(unit) else ""
    return tuple(found) if any(found) else units


def split(line: str, delimiter: str) -> list[str]:
    """Return the fields of a line, without quotes and blanks around them."""
    if delimiter == " ":
        return line.split()
    fields = next(csv.reader([line], delimiter=delimiter)) if '"' in line else line.split(delimiter)
    return [field.strip() for field in fields]


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            head = stream.read(_SAMPLE_BYTES)
    except OSError as error:
        raise MeasurementError(f"{file_label(path)} cannot be read ({error.strerror}); check its name.") from error
    if not head.strip():
        raise MeasurementError(f"{file_label(path)} is empty; export the measurement again.")
    return head


def _is_number(field: str) -> bool:
    return bool(_NUMBER.match(field) or _THOUSANDS.match(field) or _THOUSANDS_POINT.match(field))


def _longest_block(lines: Sequence[str], delimiter: str) -> tuple[float, int, int]:
    """Return score, first line and number of fields of the longest block of lines that are rows with this delimiter."""
    best = (0.0, 0, 0)
    if delimiter != " " and not any(delimiter in line for line in lines):
        return best
    score, start, fields_of_block, long = 0.0, 0, 0, 0
    for number, line in enumerate(lines):
        if not line.strip():
            continue
        fields = split(line, delimiter)
        good = _goodness(fields) if len(fields) >= 2 else 0.0  # one field is no row, whatever is in it
        if good > 0.0 and len(fields) == fields_of_block:
            score, long = score + good, long + 1
        else:
            best = max(best, (score, start, fields_of_block), key=lambda block: block[0])
            if long >= _ENOUGH_LINES:
                return best
            row = good > 0.0
            score, start, fields_of_block, long = (good, number, len(fields), 1) if row else (0.0, number, 0, 0)
        if long >= _ENOUGH_LINES:
            break
    return max(best, (score, start, fields_of_block), key=lambda block: block[0])


def _goodness(fields: Sequence[str]) -> float:
    """Return how much a line looks like a row of readings; 0 and less if it does not."""
    numbers = values = others = 0
    for field in fields:
        if _is_number(field):
            numbers += 1
        elif _DURATION.match(field) or _DATE.match(field) or field in MISSING or field.lower() in _NO_NUMBER:
            values += field != ""
        elif has_unit(field) or width_of_lists([field]):
            numbers += 1
        else:
            others += 1
    if numbers == 0 or numbers + values < others:
        return 0.0
    return numbers + 0.5 * values - others + 0.01


def _marks(fields: Sequence[str], delimiter: str) -> tuple[str, str | None]:
    """Return the decimal mark and that of thousands."""
    points = sum(1 for field in fields if _POINT.match(field))
    commas = [field for field in fields if _COMMA.match(field)]
    if any(_THOUSANDS_POINT.match(field) for field in fields):
        return ",", "."
    if commas and not points and not (delimiter == "," and not any("," in field for field in fields)):
        # 1,234 alone is a thousand only where every such field has three digits behind its comma.
        if all(_THOUSANDS.match(field) for field in commas) and any("," not in f and _NUMBER.match(f) for f in fields):
            values = [field for field in commas if not field.startswith(("0", "-0", "+0"))]
            if len(values) == len(commas) and len({field.split(",")[0] for field in commas}) < len(commas) // 3:
                return ",", None
            return (",", None) if len(values) < len(commas) else (".", ",")
        return ",", None
    return ".", "," if any(_THOUSANDS.match(field) for field in fields if "," in field) else None


def _is_text(fields: Sequence[str], thousands: str | None) -> bool:
    there = [field for field in fields if field not in MISSING]
    texts = sum(not _is_number(field) and field.lower() not in _NO_NUMBER for field in there)
    return texts > len(there) // 2


def _header(
    lines: Sequence[str], start: int, count: int, delimiter: str
) -> tuple[int | None, tuple[str, ...], bool]:  # fmt: skip
    """Return the line of the names, the units of a line below it, and whether headers are indented."""
    above = [number for number in range(start - 1, max(start - 6, -1), -1) if lines[number].strip(" \t#%\r\n")]
    if len(above) > 1 and _MARK.fullmatch(lines[above[0]].strip()) and len(split(lines[above[1]], delimiter)) == count:
        above = above[1:]  # '[Data]' or 'trace_values' between names and rows
    words = [_words_of(lines[number], count, delimiter) for number in above[:2]]
    if not words or not words[0]:
        return None, (), False
    if len(words) == 2 and are_units(words[0], words[1]):
        units = tuple((words[0] + [""] * count)[:count])
        return above[1], units, _is_indented(lines, above[1], delimiter)
    alone = tuple((words[0] + [""] * count)[:count]) if are_units(words[0], words[0]) else ()
    return above[0], alone, _is_indented(lines, above[0], delimiter)


def _words_of(line: str, count: int, delimiter: str) -> list[str]:
    """Return the fields of a line if it can be the header of rows of so many fields; empty if it cannot."""
    line = line.strip("\r\n")
    fields = split(line.lstrip("#%! ") if delimiter != "\t" else line.lstrip("#%!"), delimiter)
    named = [field for field in fields if field]
    near = count - 1 <= len(fields) <= count + 1 or (len(fields) <= count and len(named) >= max(2, count // 2))
    if not near or not named or sum(_is_number(field) for field in named) > len(named) // 2:
        return []
    if any(_HEX.search(field) for field in named):
        return []  # what a program prints between the rows
    if len(named) < count and any(_DURATION.match(field) or _DATE.match(field) for field in named):
        return []  # 'Time','00:30:00': what is known of the whole table
    return fields


def _is_indented(lines: Sequence[str], header: int, delimiter: str) -> bool:
    """Return whether the names of cycles, steps and records stand in three lines, each one field further in."""
    if header < 2 or delimiter == " ":
        return False
    three = [split(line, delimiter) for line in lines[header - 2 : header + 1]]
    return all(
        len(fields) > depth + 1 and fields[depth] and not any(fields[:depth]) and not _is_number(fields[depth])
        for depth, fields in enumerate(three)
    )
