"""Tables of JSON: rows, records, columns or channels, alone or under keys; each key is then a run of its own."""

from __future__ import annotations

import codecs
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.keyed_tables import Sheets, matching, put_together, short_labels
from jaxmodel.data.tables.raw_table import RawTable, to_numbers, unique_names, units_in

_DEEPEST = 8
# A number takes some 100 bytes as an object of Python.
_MOST_BYTES = 1 << 29
_HEAD = 1 << 16
_NAMES = ("columns", "names", "fields", "header", "headers", "labels")
_OWN_NAMES = ("name", "label", "id", "title", "test")
# Rows of FRC SysId, which have no names. Its docs/data-collection.md: other mechanisms than a drivetrain have four.
_SYSID = ("time (s)", "voltage (V)", "position (rev)", "velocity (rev/s)")


def is_json(path: Path) -> bool:
    """Return whether a file is JSON or JSON lines, whatever it is called: by its first line, or by both of its ends."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD).removeprefix(codecs.BOM_UTF8).lstrip()
        if head[:1] not in (b"{", b"["):
            return False
        stream.seek(max(path.stat().st_size - _HEAD, 0))
        tail = stream.read().rstrip()
    first = head.splitlines()[0].rstrip()
    try:
        return isinstance(json.loads(first), dict | list)
    except ValueError:  # it goes on in the next line, or is no JSON, as '[Settings]'
        return (first[:1], tail[-1:]) in ((b"{", b"}"), (b"[", b"]")) and re.match(
            rb'[{[]\s*(["{[\d-]|$)', first
        ) is not None


def read_json(path: Path, keys: Sheets = None) -> RawTable:
    """Read a JSON file, or one of JSON lines.

    It may hold a list of records or of rows, columns by name, channels with their values and unit, or several of these
    under keys. Those of the same columns become one table, with the key of each row in the column 'run'.

    Args:
        path: the file.
        keys: of the tables to be read, or patterns of them; by default all.

    Raises:
        MeasurementError: it is no JSON, holds no table, or has no such key.
    """
    label = file_label(path)
    content = _content(path, label)
    units: dict[str, str] = {}
    found = list(_tables(content, (), units))
    if not found:
        raise MeasurementError(
            f"{label} holds no table: neither a list of rows nor columns of equal length; export it as CSV."
        )
    tables = dict(zip(short_labels([parts for parts, _ in found]), (table for _, table in found), strict=True))
    tables = {name: tables[name] for name in matching(tables, keys, label, "table")}
    if isinstance(content, Mapping) and content.get("sysid") is True:
        nameless = [f"column {number}" for number in range(1, len(_SYSID) + 1)]
        names = dict(zip(nameless, _SYSID, strict=True))
        tables = {k: t.rename(columns=names) if list(t) == nameless else t for k, t in tables.items()}
    keyed = put_together({name: _typed(table) for name, table in tables.items()}, bool(keys))
    frame = keyed.frame
    stated = units_in(map(str, frame)) | {name: unit for name, unit in units.items() if name in frame}
    return RawTable(frame, stated, path, "JSON", keyed.remarks, losses=keyed.losses, key=keyed.key)


def _content(path: Path, label: str) -> Any:
    """Return what a file holds; JSON lines are a list.

    Raises:
        MeasurementError: it is no JSON, or too large for this form.
    """
    if path.stat().st_size > _MOST_BYTES:
        raise MeasurementError(f"{label} is too large for JSON, which is read as a whole; export it as CSV or Parquet.")
    try:
        text = path.read_text(encoding="utf-8-sig")
        try:
            return json.loads(text)
        except json.JSONDecodeError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < 2 or not lines[0].rstrip().endswith(("}", "]")):
                raise
            return [json.loads(line) for line in lines]
    except (ValueError, RecursionError, OSError) as error:
        raise MeasurementError(f"{label} cannot be read as JSON ({error}); export it again.") from None


def _tables(
    value: Any, path: tuple[str, ...], units: dict[str, str]
) -> Iterator[tuple[tuple[str, ...], pd.DataFrame]]:  # fmt: skip
    """Yield every table of a value by its keys, and put units that it states by name of the column into `units`."""
    if len(path) > _DEEPEST:
        return
    if (table := _table(value, units)) is not None:
        yield path, table
        return
    inner: list[tuple[str, Any]] = []
    if isinstance(value, Mapping):
        inner = [(str(name), item) for name, item in value.items()]
    elif isinstance(value, list):
        inner = [(_name_of(item) or str(number), item) for number, item in enumerate(value, start=1)]
    for name, item in inner:
        if isinstance(item, Mapping | list):
            yield from _tables(item, (*path, name), units)


def _table(value: Any, units: dict[str, str]) -> pd.DataFrame | None:
    """Return a value that is one table, None if it is none."""
    if isinstance(value, list) and len(value) > 1:
        if all(isinstance(item, list) for item in value):
            return _of_rows(value, ())
        if all(isinstance(item, Mapping) and _is_record(item) for item in value):
            table = pd.DataFrame([_flat(item) for item in value])
            return table if len(table.columns) > 1 else None
    if isinstance(value, Mapping):
        names = next((value[name] for name in _NAMES if _is_line(value.get(name))), ())
        for item in value.values() if names else ():
            if isinstance(item, list) and (table := _of_rows(item, names)) is not None:
                return table
        return _of_columns(value.items(), units)
    if isinstance(value, list):
        return _of_columns(((_name_of(item), item) for item in value), units)
    return None


def _is_scalar(value: Any) -> bool:
    return value is None or isinstance(value, int | float | str)


def _is_line(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 1 and all(map(_is_scalar, value))


def _is_record(value: Mapping[str, Any]) -> bool:
    """Return whether a mapping is one row: numbers and texts by name, at most one level down."""
    return any(map(_is_scalar, value.values())) and not any(isinstance(item, list) for item in value.values())


def _flat(record: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, item in record.items():
        if isinstance(item, Mapping):
            flat |= {f"{name}.{inner}": deep for inner, deep in item.items() if _is_scalar(deep)}
        else:
            flat[name] = item
    return flat


def _of_rows(rows: Sequence[Any], names: Sequence[Any]) -> pd.DataFrame | None:
    """Return a list of rows of one width; the first of them names the columns if it is of texts alone."""
    widths = {len(row) for row in rows if _is_line(row)}
    if len(widths) != 1 or len(rows) < 2 or not all(map(_is_line, rows)):
        return None
    if not names and all(isinstance(item, str) for item in rows[0]):
        names, rows = rows[0], rows[1:]
    width = widths.pop()
    names = [str(name) for name in names] if len(names) == width else [""] * width
    return pd.DataFrame(rows, columns=unique_names(names))


def _of_columns(items: Any, units: dict[str, str]) -> pd.DataFrame | None:
    """Return columns by name, of the commonest length: lists, channels, or values by the number of the row."""
    found: dict[str, Sequence[Any]] = {}
    for name, item in items:
        if name and (values := _values(item)) is not None:
            found[str(name)] = values
            unit = next((item[key] for key in ("unit", "units") if isinstance(item, Mapping) and key in item), None)
            if isinstance(unit, str) and unit:
                units[str(name)] = unit
    lengths = Counter(len(values) for values in found.values())
    length, count = max(lengths.items(), key=lambda pair: (pair[1], pair[0]), default=(0, 0))
    if count < 2:
        return None
    return pd.DataFrame({name: values for name, values in found.items() if len(values) == length})


def _values(item: Any) -> Sequence[Any] | None:
    """Return the values of a column, None if there are none."""
    if _is_line(item):
        return item
    if isinstance(item, Mapping):
        lists = [value for value in item.values() if _is_line(value)]
        if len(lists) == 1 and all(_is_scalar(value) for value in item.values() if value is not lists[0]):
            return lists[0]
        if len(item) > 1 and all(str(key).isdigit() and _is_scalar(value) for key, value in item.items()):
            return list(item.values())
    return None


def _name_of(item: Any) -> str:
    """Return what an item of a list calls itself."""
    if not isinstance(item, Mapping):
        return ""
    return next((str(item[key]) for key in _OWN_NAMES if _is_scalar(item.get(key, {}))), "")


def _typed(table: pd.DataFrame) -> pd.DataFrame:
    """Return columns as numbers, and as text where most of a column is no number."""
    columns: dict[str, Any] = {}
    for name, column in table.items():
        if column.dtype.kind in "iufb":
            columns[str(name)] = column.to_numpy(dtype=float)
            continue
        text = column.astype("string")
        numbers = to_numbers(text)
        columns[str(name)] = numbers if np.isfinite(numbers).sum() > 0.5 * text.notna().sum() else text
    return pd.DataFrame(columns)
