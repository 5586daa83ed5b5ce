"""The numbers of a run's CSV: read by pyarrow, and read again line by line only to say which line is wrong."""

from __future__ import annotations

import array
import csv
import itertools
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from jaxmodel.base.errors import MeasurementError

_BLOCK_BYTES = 1 << 22
_THREADS_BYTES = 1 << 25
_EMPTY = ("", " ", "  ", "   ")


class Header(NamedTuple):
    """The first line of a run's CSV that is neither blank nor a comment.

    Attributes:
        line: its number, counted from 1.
        names: of the columns.
        last_line: the line at which it ends, the same unless a name spans lines.
    """

    line: int
    names: list[str]
    last_line: int


def worth_threads(path: Path) -> bool:
    """Return whether pyarrow shall read a file with threads.

    A program that ends while they are still starting is aborted ("terminate called without an active exception", one in
    ten of short programs with pyarrow 26), and a small file needs none.
    """
    return path.stat().st_size > _THREADS_BYTES


def read_header(path: Path, label: str) -> Header:
    """Return the header of a run's CSV.

    Args:
        path: the file, UTF-8 with or without a byte-order mark.
        label: its name in messages.

    Raises:
        MeasurementError: the file cannot be read, is not UTF-8, or has no header.
    """
    with _opened(path, label) as stream:
        return _header(stream, label)[0]


def read_numbers(path: Path, header: Header, label: str) -> dict[str, np.ndarray]:
    """Return every column of a run's CSV as numbers, shape (rows,), NaN where a field is empty.

    Raises:
        MeasurementError: a line has another number of fields than the header, or a field is not a finite number; the
            message names line and column.
    """
    import pyarrow as pa
    import pyarrow.csv as arrow_csv

    try:
        table = arrow_csv.read_csv(
            path,
            arrow_csv.ReadOptions(
                use_threads=worth_threads(path),
                column_names=header.names,
                skip_rows=header.last_line,
                block_size=_BLOCK_BYTES,
                encoding="utf8",
            ),
            arrow_csv.ParseOptions(),
            arrow_csv.ConvertOptions(column_types=dict.fromkeys(header.names, pa.float64()), null_values=_EMPTY),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError):  # also of a file without rows
        return _read_by_line(path, label)
    columns: dict[str, np.ndarray] = {}
    for name in header.names:
        column = table.column(name)
        table = table.drop_columns([name])  # its memory goes as soon as the array is there
        values = column.to_numpy()  # a null is NaN
        # A float that is written as text may be NaN or infinite without being empty: those have messages of their own.
        if np.count_nonzero(~np.isfinite(values)) != column.null_count:
            return _read_by_line(path, label)
        columns[name] = values if values.flags.writeable else values.copy()
    return columns


def line_of_row(path: Path, label: str, row: int) -> int:
    """Return the line, counted from 1, on which a row of numbers stands; rows are counted from 0."""
    with _opened(path, label) as stream:
        header, reader = _header(stream, label)
        line, _ = next(itertools.islice(_rows(reader, header, label), row, None))
    return line


def refuse_no_file(path: Path, label: str) -> None:
    """Raise MeasurementError for what is there and is no file: a folder, or a device or pipe that may never end."""
    if os.path.exists(path) and not os.path.isfile(path):
        what = "a folder" if os.path.isdir(path) else "a device or pipe"
        raise MeasurementError(f"{label} is {what}, not a file; name a file.")


def _opened(path: Path, label: str) -> TextIO:
    try:
        refuse_no_file(path, label)
        return path.open(encoding="utf-8-sig", newline="")
    except OSError as error:
        raise MeasurementError(f"{label} cannot be read ({error.strerror}); check its name.") from error


def _header(stream: TextIO, label: str) -> tuple[Header, Iterator[list[str]]]:
    """Return the header, and a reader of what follows it."""
    line = 1
    try:
        for first in stream:
            if first.strip() and not first.lstrip().startswith("#"):
                break
            line += 1
        else:
            raise MeasurementError(f"{label} is empty; its first line must name the columns, time_s first.")
        reader = csv.reader(itertools.chain([first], stream))
        names = [name.strip() for name in next(reader)]
        return Header(line, names, line - 1 + reader.line_num), reader
    except UnicodeDecodeError as error:
        raise _not_utf8(label) from error
    except csv.Error as error:
        raise _not_csv(label, line, error) from error


def _rows(reader: Iterator[list[str]], header: Header, label: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line and fields of every row; raise MeasurementError where their number is not the header's."""
    count, line = len(header.names), header.last_line + 1
    try:
        for fields in reader:
            if len(fields) == count and (count > 1 or fields[0].strip()):
                yield line, fields
            elif any(field.strip() for field in fields) or len(fields) > 1:
                raise MeasurementError(
                    f"{label}, line {line} has {len(fields)} fields and the header has {count}; leave the field "
                    "of a missing reading empty between its commas, and write decimals with a point."
                )
            line = header.line + reader.line_num  # type: ignore[attr-defined]
    except csv.Error as error:
        raise _not_csv(label, line, error) from error
    except UnicodeDecodeError as error:
        raise _not_utf8(label) from error


def _read_by_line(path: Path, label: str) -> dict[str, np.ndarray]:
    """Return the columns as `read_numbers`, one line after the other: slow, and exact about what is wrong."""
    with _opened(path, label) as stream:
        header, reader = _header(stream, label)
        columns = [array.array("d") for _ in header.names]
        for line, fields in _rows(reader, header, label):
            for name, column, field in zip(header.names, columns, fields, strict=True):
                column.append(_number(field, label, line, name))
    return {name: np.array(column, dtype=float) for name, column in zip(header.names, columns, strict=True)}


def _number(field: str, label: str, line: int, name: str) -> float:
    """Return a field as a number, NaN if it is empty."""
    if not field or field.isspace():
        return math.nan
    where = f"{label}, line {line}, column '{name}'"
    try:
        value = float(field)
    except ValueError:
        raise MeasurementError(f"{where}: {_short(field)} is not a number; correct it.") from None
    if math.isnan(value):
        raise MeasurementError(f"{where}: {_short(field)}; leave the field empty for a missing reading.")
    if math.isinf(value):
        raise MeasurementError(f"{where}: {_short(field)} is not finite; correct it or leave it empty.")
    if "_" in field:  # Python reads 1_0 as ten; in a log it is a damaged field
        raise MeasurementError(f"{where}: {_short(field)} is not a number; correct it.")
    return value


def _short(field: str) -> str:
    """Return a field in quotes, cut where a stray quote mark has swallowed the lines below."""
    field = field.strip()
    return f"'{field}'" if len(field) <= 40 else f"'{field[:40]}...'"


def _not_csv(label: str, line: int, error: csv.Error) -> MeasurementError:
    return MeasurementError(f"{label}, line {line} is not CSV ({error}); look for a stray quote.")


def _not_utf8(label: str) -> MeasurementError:
    return MeasurementError(f"{label} is not UTF-8 text; save it again as UTF-8.")


def write_numbers(columns: dict[str, np.ndarray], path: Path, comments: Sequence[str] = ()) -> None:
    """Write a run's CSV, each number with the fewest digits that give it back, an empty field for NaN.

    Args:
        columns: by name, shape (rows,) each; the first is time_s.
        path: the new file.
        comments: lines at the top, written after '# '.
    """
    import pyarrow as pa
    import pyarrow.csv as arrow_csv

    names = list(columns)
    with pa.OSFile(str(path), "wb") as sink:
        sink.write("".join(f"# {line}\n" for line in comments).encode())
        sink.write((",".join(names) + "\n").encode())
        rows = len(columns[names[0]])
        options = arrow_csv.WriteOptions(include_header=False)
        for start in range(0, rows, 1 << 20):  # in parts: text takes more memory than numbers
            part = {n: pa.array(columns[n][start : start + (1 << 20)], from_pandas=True) for n in names}
            arrow_csv.write_csv(pa.table(part), sink, options)
