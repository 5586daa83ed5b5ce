"""Tables of text: CSV, TSV and the exports of cyclers, read by pyarrow, or by pandas where the marks ask for it."""

from __future__ import annotations

import csv
import dataclasses
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, reason
from jaxmodel.case.measurements import file_label
from jaxmodel.case.run_csv import worth_threads
from jaxmodel.data.tables.fields import from_lists, names_of_list, with_units
from jaxmodel.data.tables.known_formats import maker_in
from jaxmodel.data.tables.preamble import CLOCK, interval_of, is_sampled_so, lacks_times, row_counter
from jaxmodel.data.tables.raw_table import RawTable, repeated_names, to_numbers, unique_names, units_in
from jaxmodel.data.tables.sniffing import MISSING, Layout, layout_of

Keep = Callable[[Sequence[str]], Sequence[str]]
_BLOCK_BYTES = 1 << 23
_COLUMN = re.compile(r"CSV column #(\d+)")
_WORDS = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", " ": "blanks"}


def read_delimited(
    path: Path,
    *,
    keep: Keep | None = None,
    rows: int | None = None,
    encoding: str | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
) -> RawTable:
    """Read a table of text whose form is found.

    Args:
        path: the file.
        keep: chooses from the names of the columns those to be read; by default all.
        rows: the most rows to read.
        encoding: a codec of Python; by default found.
        delimiter: one character; by default found.
        decimal: '.' or ','; by default found.

    Raises:
        MeasurementError: the file is not a table of text.
    """
    layout = layout_of(path, encoding, delimiter)
    layout = dataclasses.replace(layout, decimal=decimal or layout.decimal)
    names = unique_names(layout.names)
    lists = {name: names_of_list(name, width) for name, width in zip(names, layout.widths, strict=True) if width}
    owner = {one: name for name in names for one in lists.get(name, [name])}
    interval_s = interval_of(layout.before, layout.names, layout.units)
    made = [CLOCK] if interval_s is not None and lacks_times(names, layout.units) else []
    chosen = list([*made, *owner] if keep is None else keep([*made, *owner]))
    wanted = list(dict.fromkeys(owner[one] for one in chosen if one in owner))
    remarks: list[str] = []
    losses: list[str] = []
    if layout.indented:
        frame, remarks = _read_indented(path, layout, names, rows)
        frame = pd.DataFrame(frame[[name for name in frame if name in wanted or name not in names]])
    elif _for_pandas(layout, rows):
        frame, losses = _read_by_pandas(path, layout, names, wanted, rows)
    else:
        frame, losses = _read_by_arrow(path, layout, names, wanted)
    frame, repeats = _without_names(frame, names, layout)
    frame, in_fields, more = _numbers(frame, dict(zip(names, layout.texts, strict=True)), layout)
    frame, in_lists = _spread(frame, {name: lists[name] for name in lists if name in frame}, chosen)
    units = units_in(names) | {name: unit for name, unit in zip(names, layout.units, strict=False) if unit}
    units |= in_fields | {one: units[name] for one, name in in_lists.items() if name in units}
    left_out = tuple(name for name in owner if name not in chosen)
    # Those of columns that were not read may speak for them.
    units = {name: unit.strip("[](){}") for name, unit in units.items() if name in frame or name in left_out}
    remarks = [_form(layout), *remarks]
    if interval_s is not None and not made and (counter := row_counter(frame, units)):
        frame = frame.assign(**{counter: interval_s * frame[counter]})
        units[counter] = "s"
        remarks.append(f"'{counter}' counts rows, each of the {interval_s:g} s that the head states.")
    if interval_s is not None and made and CLOCK in chosen and not is_sampled_so(frame, interval_s):
        frame.insert(0, CLOCK, np.arange(len(frame)) * interval_s)
        units[CLOCK] = "s"
        remarks.append(
            f"No column has times; '{CLOCK}' counts the {interval_s:g} s from row to row that its head states."
        )
    if maker := maker_in(layout.before):
        remarks.append(f"{maker}: its current is positive on charge.")
    return RawTable(
        frame,
        units,
        path,
        "text",
        tuple(remarks),
        layout.first_line + 1,
        left_out=left_out,
        losses=(*losses, *repeats, *more),
        repeated=repeated_names(layout.names),
        current_positive_on="charge" if maker else None,
    )


def _form(layout: Layout) -> str:
    """Return the form of the file in one sentence."""
    header = "no line of names" if layout.header_line is None else f"the names in line {layout.header_line + 1}"
    mark = "a decimal comma" if layout.decimal == "," else "a decimal point"
    return (
        f"Text in {layout.encoding}, fields between {_WORDS.get(layout.delimiter, layout.delimiter)}, {mark}, {header}."
    )


def _for_pandas(layout: Layout, rows: int | None) -> bool:
    return (
        rows is not None
        or layout.broken
        or layout.delimiter == " "
        or layout.thousands is not None
        or layout.decimal == layout.delimiter
    )


def _read_by_arrow(path: Path, layout: Layout, names: list[str], wanted: list[str]) -> tuple[pd.DataFrame, list[str]]:
    import pyarrow as pa
    import pyarrow.csv as arrow_csv

    types: dict[str, Any] = {
        name: pa.string() if text else pa.float64() for name, text in zip(names, layout.texts, strict=True)
    }
    bad: list[Any] = []

    def skip(row: Any) -> str:
        bad.append(row)
        return "skip"

    for _ in range(len(names) + 1):
        bad.clear()
        try:
            table = arrow_csv.read_csv(
                path,
                arrow_csv.ReadOptions(
                    use_threads=worth_threads(path),
                    skip_rows=layout.first_line,
                    column_names=names,
                    encoding=layout.encoding,
                    block_size=_BLOCK_BYTES,
                ),
                arrow_csv.ParseOptions(delimiter=layout.delimiter, invalid_row_handler=skip),
                arrow_csv.ConvertOptions(
                    column_types=types,
                    include_columns=wanted,
                    null_values=[*MISSING, " "],
                    strings_can_be_null=True,
                    decimal_point=layout.decimal,
                ),
            )
            break
        except UnicodeDecodeError:  # beyond the part from which the encoding was found
            return _read_by_pandas(path, layout, names, wanted, None)
        except pa.ArrowInvalid as error:
            found = _COLUMN.search(str(error))
            if found and "conversion error to double" in str(error):
                types[names[int(found[1])]] = pa.string()  # text among numbers: looked at field by field afterwards
                continue
            return _read_by_pandas(path, layout, names, wanted, None)
    else:
        return _read_by_pandas(path, layout, names, wanted, None)
    columns = {}
    for name in wanted:
        column = table.column(name)
        table = table.drop_columns([name])
        columns[name] = column.to_numpy() if pa.types.is_floating(column.type) else column.to_pandas(use_threads=False)
    frame = pd.DataFrame(columns, copy=False)
    return frame, _skipped(len(bad), str(bad[0].text)[:60] if bad else "", len(names))


def _skipped(count: int, first: str, fields: int) -> list[str]:
    if not count:
        return []
    lines = "1 line was" if count == 1 else f"{count:,} lines were"
    return [f"{lines} left out for another number of fields than {fields}; the first: {first!r}."]


def _read_by_pandas(
    path: Path, layout: Layout, names: list[str], wanted: list[str], rows: int | None
) -> tuple[pd.DataFrame, list[str]]:
    options: dict[str, Any] = {"sep": r"\s+" if layout.delimiter == " " else layout.delimiter}
    texts = dict(zip(names, layout.texts, strict=True))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        frame = _pandas_table(
            path,
            layout,
            names,
            rows,
            skiprows=layout.first_line,
            decimal=layout.decimal,
            thousands=layout.thousands,
            na_values=list(MISSING),
            dtype={name: "string" for name in wanted if texts[name]},
            on_bad_lines="warn",
            low_memory=False,
            **options,
        )
    skipped = [line for one in caught for line in str(one.message).splitlines() if "Skipping line" in line]
    return pd.DataFrame(frame[wanted]), _skipped(len(skipped), skipped[0] if skipped else "", len(names))


def _pandas_table(path: Path, layout: Layout, names: list[str], rows: int | None, **options: Any) -> pd.DataFrame:
    """Return the rows of a text below its header, as pandas reads them.

    Raises:
        MeasurementError: pandas finds no table there.
    """
    try:
        return pd.read_csv(
            path, header=None, names=names, nrows=rows, encoding=layout.encoding, encoding_errors="replace",
            skipinitialspace=True, engine="c", **options,
        )  # fmt: skip
    except (pd.errors.ParserError, csv.Error, ValueError) as error:
        what = reason(error)
        raise MeasurementError(f"{file_label(path)} cannot be read as a table ({what}); export it again.") from error


def _without_names(frame: pd.DataFrame, names: Sequence[str], layout: Layout) -> tuple[pd.DataFrame, list[str]]:
    """Return a table without the rows that are its line of names again, as of a log that was begun anew."""
    header = dict(zip(names, layout.names, strict=True))
    of_text = dict(zip(names, layout.texts, strict=True))
    texts = [str(name) for name in frame if frame[name].dtype.kind not in "iufb" and header.get(str(name))]
    # A name among numbers makes text of them: where there is none, no row is looked at.
    texts.sort(key=lambda name: of_text[name])
    if not texts or of_text[texts[0]]:
        return frame, []
    again = np.ones(len(frame), dtype=bool)
    for name in texts:
        again &= frame[name].astype("string").str.strip().eq(header[name]).fillna(False).to_numpy(dtype=bool)
        if not again.any():
            return frame, []
    count = int(again.sum())
    lines = "1 line that repeats" if count == 1 else f"{count:,} lines that repeat"
    were = "was" if count == 1 else "were"
    return frame[~again].reset_index(drop=True), [f"{lines} the names of the columns {were} left out."]


def _spread(
    frame: pd.DataFrame, lists: Mapping[str, Sequence[str]], chosen: Sequence[str]
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return a table with a column for each number of a list, and the name of the lists by those columns."""
    if not lists:
        return frame, {}
    columns: dict[str, Any] = {}
    for name in map(str, frame):
        if name in lists:
            columns |= dict(zip(lists[name], from_lists(frame[name], len(lists[name])), strict=True))
        else:
            columns[name] = frame[name]
    there = [name for name in columns if name in chosen or name in frame]
    return pd.DataFrame({name: columns[name] for name in there}), {one: name for name in lists for one in lists[name]}


def _numbers(
    frame: pd.DataFrame, texts: dict[str, bool], layout: Layout
) -> tuple[pd.DataFrame, dict[str, str], list[str]]:
    """Return a table with text turned into numbers, the units that fields state by column, and what was no number.

    Text becomes numbers where the first rows have numbers, with or without a unit behind them.
    """
    remarks, units, columns = [], {}, {}
    for name in frame:
        column = frame[name]
        if column.dtype.kind == "f":
            columns[name] = column
            continue
        if texts.get(str(name), False):
            columns[name] = column
            if (found := with_units(column, layout.decimal)) is not None:
                columns[name], units[str(name)] = found
            continue
        text = column.astype("string")
        if layout.thousands:
            text = text.str.replace(layout.thousands, "", regex=False)
        if layout.decimal == ",":
            text = text.str.replace(",", ".", regex=False)
        values = to_numbers(text.str.strip())
        lost = np.isnan(values) & column.notna().to_numpy()
        if lost.any():
            row = int(lost.argmax())
            count = int(lost.sum())
            what = "1 field is" if count == 1 else f"{count:,} fields are"
            remarks.append(
                f"Column '{name}': {what} no number and taken as missing, the first in row {row + 1} "
                f"({str(column.iloc[row])[:30]!r})."
            )
        columns[name] = values
    return pd.DataFrame(columns, copy=False), units, remarks


def _read_indented(
    path: Path, layout: Layout, names: list[str], rows: int | None
) -> tuple[pd.DataFrame, list[str]]:  # fmt: skip
    """Read tables of cycles, steps and records in one file: the records, with number of cycle and step beside them."""
    assert layout.header_line is not None
    below = layout.header_line + 1
    frame = _pandas_table(
        path, layout, names, rows, sep=layout.delimiter, skiprows=below, dtype="string", on_bad_lines="skip"
    )
    first, second = frame.columns[:2]
    cycles, steps = frame[first].str.strip().replace("", pd.NA), frame[second].str.strip().replace("", pd.NA)
    state = frame[frame.columns[2]].where(steps.notna()).ffill()
    records = cycles.isna() & steps.isna()
    frame = pd.DataFrame(frame[records]).drop(columns=[first, second])
    for place, (name, marks) in enumerate({"Cycle": cycles, "Step": steps}.items()):
        frame.insert(place, name, to_numbers(pd.Series(marks.ffill()[records])))
    frame.insert(2, "Step Type", state[records])
    remark = (
        f"Tables of {int(cycles.notna().sum())} cycles and {int(steps.notna().sum())} steps stand between the records; "
        "the records were read, with the numbers of their cycle and step."
    )
    return frame.reset_index(drop=True), [remark]
