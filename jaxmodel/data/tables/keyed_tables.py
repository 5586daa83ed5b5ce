"""Several tables of one file, by name: which of them are read, and how they become one with a column of the names."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, listed, nearest
from jaxmodel.data.tables.raw_table import unique_names

Sheets = str | Sequence[str] | None
"""Names of tables of a file, or patterns of them such as 'run*'; None for no choice."""

_NAMED = 8  # tables that a sentence names
# What the column of the names is called: the first that no column is called already.
_KEYS = ("run", "table", "key of the run")


class Keyed(NamedTuple):
    """Tables as one: its rows, the column of the names ('' for one table), and sentences on what was read."""

    frame: pd.DataFrame
    key: str
    remarks: tuple[str, ...]
    losses: tuple[str, ...]


def patterns_of(sheets: Sheets) -> tuple[str, ...]:
    """Return what a user states as names or patterns; empty for no choice."""
    if sheets is None:
        return ()
    return (sheets,) if isinstance(sheets, str) else tuple(sheets)


def matching(names: Iterable[str], sheets: Sheets, label: str, what: str) -> list[str]:
    """Return those names that the user states, by themselves or by a pattern; all of them without a choice.

    Args:
        names: of the tables of a file.
        sheets: names or patterns, as 'run*'; the case of letters counts.
        label: how messages name the file.
        what: how messages call a table of it.

    Raises:
        MeasurementError: a name or pattern fits none.
    """
    names, patterns = list(names), patterns_of(sheets)
    for pattern in patterns:
        if not any(_fits(name, pattern) for name in names):
            hint = nearest(pattern, names) or f" It has {listed(names, _NAMED)}."
            raise MeasurementError(f"{label} has no {what} '{pattern}'.{hint}")
    return [name for name in names if not patterns or any(_fits(name, pattern) for pattern in patterns)]


def _fits(name: str, pattern: str) -> bool:
    return name == pattern or fnmatch.fnmatchcase(name, pattern)


def put_together(tables: Mapping[str, pd.DataFrame], chosen_by_user: bool) -> Keyed:
    """Return tables of one bench as one, with the name of each row's table in a column of its own.

    They are those with the same columns as most rows have, or with two names in common.

    Args:
        tables: by name; not empty.
        chosen_by_user: whether the user has named them.
    """
    headers = {name: tuple(map(str, table)) for name, table in tables.items()}
    rows: Counter[tuple[str, ...]] = Counter()
    for name, table in tables.items():
        rows[headers[name]] += len(table)
    header = rows.most_common(1)[0][0]
    chosen = {name: table for name, table in tables.items() if _goes_with(headers[name], header)}
    remarks = () if list(chosen) == [""] else (f"Read {listed(chosen, _NAMED)}.",)
    left = [f"'{name}'" for name in tables if name not in chosen]
    help_ = "import it separately" if chosen_by_user else "--sheet"
    losses = (f"{listed(left, _NAMED)} has other columns and was not read ({help_}).",) if left else ()
    frame = pd.concat(list(chosen.values()), ignore_index=True)
    key = next((name for name in _KEYS if name not in frame), "") if len(chosen) > 1 else ""
    if key:
        frame[key] = np.repeat(list(chosen), [len(table) for table in chosen.values()])
    return Keyed(frame, key, remarks, losses)


def _goes_with(header: Sequence[str], main: Sequence[str]) -> bool:
    """Return whether a table is of the same bench as the main one: by two names, or as many columns without names."""
    nameless = all(name.startswith("column ") for name in main)
    return header == main or (not nameless and len({*header} & {*main}) > 1)


def short_labels(paths: Sequence[tuple[str, ...]]) -> list[str]:
    """Return what tells paths apart, each once: without the parts with which all begin or end."""
    first, shortest = paths[0], min(map(len, paths))
    same = [len({path[n] for path in paths}) == 1 for n in range(shortest)]
    begin = same.index(False) if False in same else shortest
    same = [len({path[-1 - n] for path in paths}) == 1 for n in range(shortest - begin)]
    end = same.index(False) if False in same else shortest - begin
    if len(paths) == 1:
        return [".".join(first)]
    return unique_names(".".join(path[begin : len(path) - end]) or ".".join(path) for path in paths)
