"""Columns that a user computes from those of a file, and the rows that a user keeps."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable

import numpy as np
import pandas as pd

from importing.findings import Decision, Finding
from importing.options import Options
from importing.roles import target_unit
from jaxmodel.errors import MeasurementError
from jaxmodel.tables import RawTable

_SIGNS = re.compile(r"[-+*/%<>=&|()]")


def wanted(options: Options, names: Iterable[str]) -> bool:
    """Return whether a file of these columns may need others than those of the case."""
    known = set(names)
    return bool(options.rows) or any(_SIGNS.search(text) and text not in known for text in options.columns.values())


def computed(table: RawTable, options: Options) -> tuple[RawTable, list[Finding | Decision]]:
    """Return a table with the rows that the user keeps and a column for each formula, named as the formula.

    A formula is of the form of `pandas.DataFrame.eval`: names of columns (in backticks where they hold blanks),
    arithmetic, comparisons, `sin`, `cos`, `abs`, `sqrt`. Its unit is that of the column of the case. One that names
    columns which the file does not have says nothing about it.

    Args:
        table: with all columns of the file.
        options: `rows` and `columns`.

    Raises:
        MeasurementError: a formula cannot be read, or no row is kept.
    """
    frame, units, found = table.frame, dict(table.units), []
    if options.rows:
        kept = _value(frame, options.rows, "rows")
        if kept is None:
            raise MeasurementError(f"rows: {table.label} lacks a column of '{options.rows}'; it has {_some(frame)}.")
        frame = pd.DataFrame(frame[kept.fillna(False).astype(bool)]).reset_index(drop=True)
        if frame.empty:
            raise MeasurementError(f"rows: '{options.rows}' holds for no row of {table.label}; correct it.")
        why = f"{len(frame):,} of {len(table.frame):,} rows"
        found.append(Decision("rows", table.label, options.rows, why, "user"))
    for target, text in options.columns.items():
        if text in frame or not _SIGNS.search(text):
            continue
        values = _value(frame, text, f"column {target}")
        if values is not None:
            frame = frame.assign(**{text: values.astype(float)})
            units[text] = target_unit(target)
    return dataclasses.replace(table, frame=frame, units={n: u for n, u in units.items() if u}), found


def _value(frame: pd.DataFrame, text: str, option: str) -> pd.Series | None:
    """Return a formula's value by row; None where the file lacks one of its columns.

    Raises:
        MeasurementError: it is no formula.
    """
    try:
        value = frame.eval(text, engine="python", local_dict={}, global_dict={})
    except pd.errors.UndefinedVariableError:
        return None
    except Exception as error:  # pandas raises what Python's parser and the operators raise
        raise MeasurementError(f"{option}: '{text}' cannot be computed ({error}); {_HELP}") from error
    if np.ndim(value) == 0:
        return pd.Series(value, index=frame.index)
    return pd.Series(value)


_HELP = "write it with names of columns, as duty * supply_V, and with names that hold blanks in `backticks`."


def _some(frame: pd.DataFrame) -> str:
    return ", ".join(map(str, frame.columns[:12]))
