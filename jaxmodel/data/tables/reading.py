"""One front door for every format: which reader takes a file, and what a known format fixes."""

from __future__ import annotations

import dataclasses
import gzip
import re
import shutil
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.columnar import read_columnar
from jaxmodel.data.tables.dataflash import is_dataflash, read_dataflash
from jaxmodel.data.tables.delimited import Keep, read_delimited
from jaxmodel.data.tables.icharger import is_icharger, read_icharger
from jaxmodel.data.tables.json_tables import is_json, read_json
from jaxmodel.data.tables.keyed_tables import Sheets
from jaxmodel.data.tables.known_formats import known_format
from jaxmodel.data.tables.labelled import is_labelled, read_labelled
from jaxmodel.data.tables.labview import is_labview, read_labview
from jaxmodel.data.tables.loggers import PACKAGES, read_logger
from jaxmodel.data.tables.long_tables import form_of_long, read_long
from jaxmodel.data.tables.matlab import read_matlab
from jaxmodel.data.tables.mavlink import read_mavlink
from jaxmodel.data.tables.mcap_messages import is_of_ros, read_mcap
from jaxmodel.data.tables.raw_table import RawTable, unique_names, units_in
from jaxmodel.data.tables.ros import SUFFIXES as ROS
from jaxmodel.data.tables.ros import read_ros
from jaxmodel.data.tables.serial_monitor import is_serial_monitor, without_arrows
from jaxmodel.data.tables.spreadsheets import read_spreadsheet
from jaxmodel.data.tables.ulog import is_ulog, read_ulog
from jaxmodel.data.tables.unreadable import refuse_unreadable
from jaxmodel.data.tables.wpilog import is_wpilog, read_wpilog

SPREADSHEETS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
COLUMNAR = (".parquet", ".pq", ".feather", ".arrow")
TEXT = (".csv", ".tsv", ".txt", ".mpt", ".asc", ".log", ".lvm", ".bdf", "")
JSON = (".json", ".jsonl", ".ndjson")
SUFFIXES = (*TEXT, *SPREADSHEETS, *COLUMNAR, *JSON, ".mat", ".bin", ".wpilog", ".tlog", ".ulg", *ROS, *PACKAGES, ".gz")
"""The endings of files that `read_table` knows; a file of another is taken as text."""

# By the ending of their files, makers whose current is positive on charge. Their own manuals.
_POSITIVE_ON_CHARGE = {
    ".mpr": "BioLogic", ".mpt": "BioLogic", ".nda": "Neware", ".ndax": "Neware", ".res": "Arbin",
}  # fmt: skip
_MOST_BYTES = 8 * 2**30  # that a compressed file may become
_CHUNK = 2**24
_STARTS = ((b"PK\x03\x04", ".xlsx"), (b"PAR1", ".parquet"), (b"ARROW1", ".feather"), (b"\xd0\xcf\x11\xe0", ".xls"))


def read_table(
    path: str | Path,
    *,
    columns: Collection[str] | Keep | None = None,
    rows: int | None = None,
    sheet: Sheets = None,
    encoding: str | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
    names: Sequence[str] = (),
) -> RawTable:
    """Read the table of a bench's file of any format; nothing is renamed or converted.

    Args:
        path: CSV, TSV or text of a cycler, a spreadsheet, Parquet, Feather, JSON, MATLAB, or a format of
            `loggers`.
        columns: names of those to read, or a function that chooses them from all names; by default all.
        rows: the most rows to read.
        sheet: of a spreadsheet; of a MATLAB file the variable, of JSON the key. A pattern such as 'run*', or several
            names, choose several tables, each with its name in the column `key` of the result.
        encoding: of text; by default found.
        delimiter: of text; by default found.
        decimal: of text, '.' or ','; by default found.
        names: of the columns, for a file without a line of names.

    Returns:
        The columns under the names of the file, their units, and remarks on how it was read.

    Raises:
        MeasurementError: the file is not there, is damaged or not a table, or its package is not installed.

    Example:
        >>> from jaxmodel import read_table
        >>> list(read_table("examples/samsung_30q/cc1C.csv").to_dataframe())[:2]
        ['time_s', 'current_A']
    """
    path = Path(path)
    if names:
        as_text: dict[str, Any] = {"sheet": sheet, "encoding": encoding, "delimiter": delimiter, "decimal": decimal}
        whole = _named(read_table(path, rows=rows, **as_text), names)
        return _as_known(_selected(whole, _keeper(columns, path), rows))
    if path.is_dir():
        raise MeasurementError(f"{file_label(path)} is a folder; name the files in it.")
    if not path.is_file():
        raise MeasurementError(f"There is no file {file_label(path)}; check its name.")
    if path.suffix.lower() == ".gz":
        with tempfile.TemporaryDirectory() as folder:
            inside = _decompressed(path, Path(folder))
            table = read_table(
                inside, columns=columns, rows=rows, sheet=sheet, encoding=encoding, delimiter=delimiter, decimal=decimal
            )
        return dataclasses.replace(table, source=path)
    refuse_unreadable(path)
    if path.suffix.lower() in TEXT and is_serial_monitor(path, encoding):
        with tempfile.TemporaryDirectory() as folder:
            inside = without_arrows(path, Path(folder), encoding)
            table = read_table(inside, columns=columns, rows=rows, sheet=sheet, delimiter=delimiter, decimal=decimal)
        return dataclasses.replace(table, source=path)
    keep = _keeper(columns, path)
    suffix = _suffix(path)
    if suffix in SPREADSHEETS:
        table = read_spreadsheet(path, sheet)
    elif suffix in COLUMNAR:
        table = read_columnar(path, keep, rows)
    elif suffix == ".mat":
        table = read_matlab(path, sheet)
    elif suffix in JSON:
        table = read_json(path, sheet)
    elif suffix in PACKAGES:
        table = read_logger(path)
    elif suffix == ".mcap" and not is_of_ros(path):
        table = read_mcap(path, keep)
    elif suffix in ROS:
        table = read_ros(path, keep)
    elif suffix == ".tlog":
        table = read_mavlink(path, keep)
    elif is_ulog(path):
        table = read_ulog(path, keep)
    elif is_wpilog(path):
        table = read_wpilog(path, keep)
    elif is_dataflash(path):
        table = read_dataflash(path, keep)
    elif is_labview(path):
        table = read_labview(path, encoding)
    elif delimiter is None and is_icharger(path):
        table = read_icharger(path)
    elif delimiter is None and (form := form_of_long(path, encoding)) is not None:
        table = read_long(path, form, keep)
    elif delimiter is None and is_labelled(path, encoding):
        table = read_labelled(path, encoding)
    else:
        table = read_delimited(path, keep=keep, rows=rows, encoding=encoding, delimiter=delimiter, decimal=decimal)
    if len(table.frame) == 0:
        raise MeasurementError(f"{table.label} has names of columns and no rows; export the measurement again.")
    return _as_known(_selected(table, keep, rows))


def _decompressed(path: Path, folder: Path) -> Path:
    """Return the content of a gzip file as a file of a temporary folder, named so that messages name it alike.

    Raises:
        MeasurementError: it is damaged, holds another gzip file, or becomes larger than `_MOST_BYTES`.
    """
    inside = folder / path.parent.name / path.stem
    if inside.suffix.lower() == ".gz":
        raise MeasurementError(f"{file_label(path)} is compressed twice; decompress it once.")
    inside.parent.mkdir(exist_ok=True)
    size = 0
    try:
        with gzip.open(path, "rb") as packed, inside.open("wb") as plain:
            while chunk := packed.read(_CHUNK):
                size += len(chunk)
                if size > _MOST_BYTES or shutil.disk_usage(folder).free < _CHUNK:
                    raise MeasurementError(
                        f"{file_label(path)} becomes larger than {size / 2**30:.0f} GiB when it is decompressed; "
                        "decompress it yourself, and give the part that holds the measurement."
                    )
                plain.write(chunk)
    except (OSError, EOFError) as error:
        sentence = f"{file_label(path)} is damaged or not a gzip file ({error}); export it again."
        raise MeasurementError(sentence) from None
    return inside


def _suffix(path: Path) -> str:
    """Return the ending of a file, by its first bytes where the ending says nothing."""
    suffix = path.suffix.lower()
    with path.open("rb") as stream:
        start = stream.read(8)
    if suffix == ".dat" and start.startswith(b"MDF"):
        return suffix
    if suffix in (*TEXT, ".dat") and is_json(path):
        return ".json"
    if suffix == ".dat":
        return ".txt"
    if suffix in (*TEXT, ".bin", ".wpilog", ".ulg") or suffix not in SUFFIXES:
        return next((ending for mark, ending in _STARTS if start.startswith(mark)), ".txt")
    if suffix in SPREADSHEETS and re.match(rb"[\w#\"\xef]", start) and not start.startswith(b"PK"):
        return ".txt"  # text that a cycler's software has called .xls
    return suffix


def _keeper(columns: Collection[str] | Keep | None, path: Path) -> Keep | None:
    if columns is None or callable(columns):
        return columns
    wanted = [columns] if isinstance(columns, str) else list(columns)

    def keep(names: Sequence[str]) -> Sequence[str]:
        for name in wanted:
            if name not in names:
                raise MeasurementError(f"{file_label(path)} has no column '{name}'; it has {', '.join(names)}.")
        return wanted

    return keep


def _named(table: RawTable, names: Sequence[str]) -> RawTable:
    """Return a table whose columns have no names with these.

    Raises:
        MeasurementError: it has another number of columns.
    """
    if len(names) != len(table.frame.columns):
        raise MeasurementError(
            f"{table.label} has {len(table.frame.columns)} columns, and {len(names)} names are given."
        )
    frame = table.frame.set_axis(unique_names(names), axis=1)
    return dataclasses.replace(table, frame=frame, units=units_in(map(str, frame)))


def _selected(table: RawTable, keep: Keep | None, rows: int | None) -> RawTable:
    frame = table.frame if rows is None else table.frame.iloc[:rows]
    if keep is None or table.left_out:
        return dataclasses.replace(table, frame=frame)
    names = [str(name) for name in frame if name != table.key]
    wanted = list(keep(names))
    left_out = tuple(name for name in names if name not in wanted)
    frame = pd.DataFrame(frame[[*wanted, *([table.key] if table.key else [])]])
    return dataclasses.replace(table, frame=frame, left_out=left_out)


def _as_known(table: RawTable) -> RawTable:
    """Return a table with what its format fixes."""
    names = [name for name in (*map(str, table.frame), *table.left_out) if name != table.key]
    if known := known_format(names):
        columns = known.plain(names)
        stated = {name: unit for name, (_, unit) in columns.items() if unit and name in table.frame}
        return dataclasses.replace(
            table,
            format=known.name,
            units=dict(table.units) | stated,
            remarks=(*table.remarks, known.remark),
            current_positive_on=known.current_positive_on,
            plain={name: plain for name, (plain, _) in columns.items()},
        )
    if maker := _POSITIVE_ON_CHARGE.get(table.source.suffix.lower()):
        remark = f"{maker}: its current is positive on charge."
        return dataclasses.replace(table, remarks=(*table.remarks, remark), current_positive_on="charge")
    return table
