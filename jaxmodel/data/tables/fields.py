"""Fields of a text that hold more than a number: a number with its unit ('3.71 V'), and a list of numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pandas as pd

from jaxmodel.data.tables.raw_table import to_numbers
from jaxmodel.data.tables.units import conversion, is_unit

_WITH_UNIT = re.compile(r"\s*([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_]+[^\s\d]*|[°%Ω℃℉µ]\S*)\s*")
_LIST = re.compile(r"\s*[\[({]\s*([^\[\](){}]*?)\s*[\])}]\s*")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_BETWEEN = re.compile(r"\s*[,;|]\s*|\s+")
_WIDEST = 64  # numbers of a list that become columns
_SURE = 0.9  # of the first fields of a column
_FIRST = 400
# Units that fields of one column may be in by turns, as a meter that changes its range writes them.
_COMMON = ("A", "V", "W", "A h", "W h", "s", "degC", "N m", "rad/s")


def has_unit(field: str) -> bool:
    """Return whether a field is a number with a unit behind it."""
    found = _WITH_UNIT.fullmatch(field)
    return found is not None and is_unit(found[2])


def without_unit(field: str) -> str:
    """Return a field without the unit behind its number."""
    found = _WITH_UNIT.fullmatch(field)
    return found[1] if found is not None and is_unit(found[2]) else field


def with_units(text: pd.Series, decimal: str = ".") -> tuple[np.ndarray, str] | None:
    """Return the numbers of a column whose fields state their units, and the unit; None where they state none.

    Args:
        text: the fields; a field without a unit is missing.
        decimal: '.' or ','.
    """
    first = text.iloc[:_FIRST].dropna()
    if first.empty or np.mean([has_unit(str(field)) for field in first]) < _SURE:
        return None
    parts = text.astype("string").str.extract(_WITH_UNIT, expand=True)
    numbers = parts[0].str.replace(",", ".", regex=False) if decimal == "," else parts[0]
    values, units = to_numbers(numbers), parts[1].fillna("")
    there = [unit for unit in units.unique() if is_unit(unit)]
    values[~units.isin(there).to_numpy()] = np.nan
    if len(there) == 1:
        return values, there[0]
    for common in _COMMON:
        changes = {unit: change for unit in there if (change := conversion(unit, common)) is not None}
        if len(changes) == len(there):
            for unit, change in changes.items():
                rows = (units == unit).to_numpy()
                values[rows] = values[rows] * change.factor + change.offset
            return values, common
    return None


def width_of_lists(fields: Sequence[str]) -> int:
    """Return how many numbers each field lists, as '[3.71, 3.69]'; 0 where they list none, or not as many each."""
    there = [field for field in fields if field]
    widths = {len(_parts(field)) for field in there}
    width = widths.pop() if len(widths) == 1 else 0
    return width if 1 <= width <= _WIDEST else 0


def _parts(field: str) -> list[str]:
    found = _LIST.fullmatch(field)
    parts = [part for part in _BETWEEN.split(found[1]) if part] if found else []
    return parts if all(_NUMBER.fullmatch(part) for part in parts) else []


def names_of_list(name: str, width: int) -> list[str]:
    """Return names of the columns that the lists of one become: 'cell_voltages' holds 'cell_voltage 1', ..."""
    one = name[:-1] if name.endswith("s") and not name.endswith("ss") else name
    return [f"{one} {number}" for number in range(1, width + 1)]


def from_lists(text: pd.Series, width: int) -> list[np.ndarray]:
    """Return the numbers of lists, an array for each place; missing where a field has none or another number."""
    parts = text.str.extract(_LIST, expand=False).str.strip().str.split(_BETWEEN.pattern, regex=True, expand=True)
    parts = parts.reindex(columns=range(width))
    return [to_numbers(parts[place].astype("string")) for place in range(width)]
