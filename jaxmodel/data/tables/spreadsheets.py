"""Tables of spreadsheets: xlsx, xlsm, xlsb, xls and ods, by python-calamine."""

from __future__ import annotations

import datetime
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.keyed_tables import Sheets, matching, put_together
from jaxmodel.data.tables.names import are_units, of_two_lines
from jaxmodel.data.tables.raw_table import RawTable, repeated_names, to_numbers, unique_names, units_in

_SEARCHED_ROWS = 2000
# Of all parts of a spreadsheet, which is a ZIP archive, unpacked; a million rows of ten columns take half of it.
_MOST_BYTES = 1 << 30


def read_spreadsheet(path: Path, sheets: Sheets = None) -> RawTable:
    """Read the table of a spreadsheet: the sheet with most numbers, and those that go on with it.

    Args:
        path: the file.
        sheets: their names, or patterns of them; several are runs of their own. By default the largest table: sheets
            with the same header are read one after the other, as cyclers split a long log.

    Raises:
        MeasurementError: the file is damaged, has no such sheet, or holds no table of numbers.
    """
    import python_calamine

    label = file_label(path)
    _refuse_too_large(path, label)
    try:
        book = python_calamine.CalamineWorkbook.from_path(path)
        names = matching(book.sheet_names, sheets, label, "sheet")
        tables = {name: table for name in names if (table := _table(book.get_sheet_by_name(name).to_python()))}
    except (python_calamine.CalamineError, OSError, ValueError) as error:
        if isinstance(error, MeasurementError):
            raise
        raise MeasurementError(
            f"{label} cannot be read as a spreadsheet ({error}); save or export it again."
        ) from error
    if not tables:
        raise MeasurementError(f"{label} has no sheet with a table of numbers; give the file that holds the readings.")
    if sheets and len(tables) > 1:
        keyed = put_together({name: table[0] for name, table in tables.items()}, True)
        units = {name: unit for table in tables.values() for name, unit in table[1].items() if name in keyed.frame}
        stated = units_in(map(str, keyed.frame)) | units
        return RawTable(keyed.frame, stated, path, "spreadsheet", keyed.remarks, losses=keyed.losses, key=keyed.key)
    main = max(tables, key=lambda name: len(tables[name][0]))
    header = list(tables[main][0].columns)
    parts = [name for name in tables if list(tables[name][0].columns) == header]
    frame = pd.concat([tables[name][0] for name in parts], ignore_index=True)
    read = f"sheet '{parts[0]}'" if len(parts) == 1 else f"the sheets {', '.join(parts)} one after the other"
    remarks = [f"Read {read}."]
    if others := [name for name in book.sheet_names if name not in parts]:
        remarks.append(f"Not read: the sheets {', '.join(others)}.")
    units = units_in(header) | tables[main][1]
    repeated = tables[main][3]
    return RawTable(frame, units, path, "spreadsheet", tuple(remarks), tables[main][2], repeated=repeated)


def _refuse_too_large(path: Path, label: str) -> None:
    """Raise MeasurementError for an archive that would unpack to more than there is memory for."""
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(part.file_size for part in archive.infolist())
    except (zipfile.BadZipFile, OSError, ValueError):
        return  # .xls is no archive; of a damaged one the reader says what is wrong
    if size > _MOST_BYTES:
        raise MeasurementError(
            f"{label} unpacks to {size / 2**30:.1f} GB, for which there is no memory; export it as CSV or Parquet."
        )


def _table(rows: list[list[Any]]) -> tuple[pd.DataFrame, dict[str, str], int, tuple[str, ...]] | None:
    """Return the table of a sheet, the units of a row below its names, its first row, and names that occur twice.

    None if the sheet has no table.
    """
    start = next((number for number, row in enumerate(rows[:_SEARCHED_ROWS]) if _is_row(row)), None)
    if start is None:
        return None
    header, units = start - 1, {}
    while header >= 0 and not any(cell != "" for cell in rows[header]):
        header -= 1
    if header > 0 and are_units([str(cell) for cell in rows[header]], [str(cell) for cell in rows[header - 1]]):
        units, header = dict(enumerate(rows[header])), header - 1
    width = max(len(row) for row in rows[start:])
    named = [str(cell) for cell in rows[header]] if header >= 0 else []
    named += [""] * (width - len(named))
    if header > 0:
        named = of_two_lines(named, [str(cell).strip() if isinstance(cell, str) else "" for cell in rows[header - 1]])
    used = [n for n in range(width) if named[n] or any(n < len(row) and row[n] != "" for row in rows[start:])]
    names = unique_names(named[n] for n in used)
    columns = {
        name: _column([row[n] if n < len(row) else "" for row in rows[start:]])
        for name, n in zip(names, used, strict=True)
    }
    frame = pd.DataFrame(columns).dropna(how="all")
    stated = {name: str(units[n]).strip("[]()") for name, n in zip(names, used, strict=True) if units.get(n)}
    return frame, stated, start + 1, repeated_names(named[n] for n in used)


def _is_row(row: list[Any]) -> bool:
    filled = [cell for cell in row if cell != ""]
    return len(filled) >= 2 and sum(not isinstance(cell, str) for cell in filled) * 2 > len(filled)


def _column(cells: list[Any]) -> pd.Series | np.ndarray:
    """Return cells as numbers, time stamps or text; an empty cell is missing."""
    kinds = {type(cell) for cell in cells if cell != ""}
    if kinds <= {int, float, bool}:
        return np.array([np.nan if cell == "" else float(cell) for cell in cells])
    if kinds and kinds <= {datetime.datetime, datetime.date}:
        return pd.to_datetime(pd.Series([None if cell == "" else cell for cell in cells], dtype=object))
    if kinds and kinds <= {datetime.time, datetime.timedelta, int, float}:
        return np.array([np.nan if cell == "" else _seconds(cell) for cell in cells])
    texts = pd.Series([None if cell == "" else str(cell) for cell in cells], dtype="string")
    numbers = to_numbers(texts.str.replace(",", ".", regex=False))
    return numbers if np.isfinite(numbers).sum() > 0.5 * texts.notna().sum() else texts


def _seconds(cell: Any) -> float:
    """Return a time of day or a duration in seconds."""
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    if isinstance(cell, datetime.time):
        return cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + cell.microsecond * 1e-6
    return float(cell)
