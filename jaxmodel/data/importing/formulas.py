"""Columns that a user computes from those of a file, and the rows that a user keeps."""

from __future__ import annotations

import ast
import dataclasses
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import columns_of
from jaxmodel.data.importing.options import Options
from jaxmodel.data.importing.roles import target_unit
from jaxmodel.data.tables import RawTable

# What a formula may consist of: it comes from a form in a browser too, and pandas would call any method of a column.
_PARTS = (
    ast.Expression, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Call, ast.Name, ast.Constant, ast.List,
    ast.Load, ast.operator, ast.unaryop, ast.boolop, ast.cmpop,
)  # fmt: skip
_FUNCTIONS = ("sin", "cos", "abs", "sqrt", "exp", "log")
_LONGEST, _HIGHEST_POWER = 500, 10
_SIGNS = re.compile(r"[-+*/%<>=&|()]")


def wanted(options: Options, names: Iterable[str]) -> bool:
    """Return whether a file of these columns may need others than those of the case."""
    known = set(names)
    return bool(options.rows) or any(_SIGNS.search(text) and text not in known for text in options.columns.values())


def computed(table: RawTable, options: Options) -> tuple[RawTable, list[Finding | Decision]]:
    """Return a table with the rows that the user keeps and a column for each formula, named as the formula.

    A formula is of the form of `pandas.DataFrame.eval`: names of columns (in backticks where they hold blanks),
    arithmetic with powers up to 10, comparisons, and `sin`, `cos`, `abs`, `sqrt`, `exp`, `log`. Its unit is that of
    the column of the case. One that names columns which the file does not have says nothing about it.

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
        if text in frame or not _SIGNS.search(text) or not _is_formula(text):
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
    if not _is_formula(text):
        raise MeasurementError(f"{option}: '{text:.80}' is not a formula of columns; {_HELP}")
    try:
        value: Any = frame.eval(text, engine="python", local_dict={}, global_dict={})
    except pd.errors.UndefinedVariableError:
        return None
    except Exception as error:  # pandas raises what Python's parser and the operators raise
        raise MeasurementError(f"{option}: '{text}' cannot be computed ({error}); {_HELP}") from error
    if np.ndim(value) == 0:
        return pd.Series(value, index=frame.index)
    return pd.Series(value)


def unmatched(target: str, text: str, header: Mapping[str, str]) -> str:
    """Return why the files do not have what a user names as a column of the case, in one sentence.

    Args:
        target: the column of the case.
        text: a name or a formula.
        header: the columns of the files, and what became of each.
    """
    what = f"no file has a column '{text:.80}' with readings for {target}"
    if not _SIGNS.search(text):
        help_ = "check the name."
    elif _is_formula(text):
        what, help_ = f"{what}, or the columns of that formula", "check the names."
    else:
        what, help_ = f"'{text:.80}' is neither a column of the files nor a formula of columns", _HELP
    return f"column {target}: {what}; {columns_of(header)}; {help_}"


def _is_formula(text: str) -> bool:
    """Return whether a text is a formula, and none that would take for ever."""
    plain = re.sub(r"`[^`]*`", "column", text)  # names that hold blanks
    try:
        parts = list(ast.walk(ast.parse(plain.strip(), mode="eval"))) if len(plain) <= _LONGEST else []
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        parts = []
    allowed = bool(parts) and all(isinstance(part, _PARTS) for part in parts)
    for part in parts:
        if isinstance(part, ast.Call):
            allowed &= isinstance(part.func, ast.Name) and part.func.id in _FUNCTIONS and not part.keywords
        if isinstance(part, ast.BinOp) and isinstance(part.op, ast.Pow):
            power = part.right.operand if isinstance(part.right, ast.UnaryOp) else part.right
            number = power.value if isinstance(power, ast.Constant) else None
            allowed &= isinstance(number, int | float) and abs(number) <= _HIGHEST_POWER
    return allowed


_HELP = "write it with names of columns, as duty * supply_V, and with names that hold blanks in `backticks`."


def _some(frame: pd.DataFrame) -> str:
    return ", ".join(map(str, frame.columns[:12]))
