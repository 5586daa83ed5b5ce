"""Columns whose unit alone says that they are temperatures: 'degC', 'Surface Ave. (C)', or 'C', which may be none."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from jaxmodel.case.measurements import file_label
from jaxmodel.data.importing.findings import Finding
from jaxmodel.data.importing.options import Kind
from jaxmodel.data.importing.roles import ROLES, Role, is_warmth
from jaxmodel.data.tables import RawTable
from jaxmodel.data.tables.names import matches, says_another
from jaxmodel.data.tables.units import conversion, spelled

WHY, ONLY = "its name is a unit", "the only one in a unit of temperature"
_NUMBERED = re.compile(r"\s*\d+$")  # the second of two columns of one name
# A letter alone may be a capacity, a constant or a force as well.
_DOUBTFUL = frozenset(["c", "k", "f"])


def bare_temperatures(names: Sequence[str]) -> dict[str, str]:
    """Return the columns that are called by a unit of temperature alone, each with that unit."""
    units = {name: _NUMBERED.sub("", name.strip("[](){} ")) for name in names}
    return {name: unit for name, unit in units.items() if unit and conversion(unit, "degC") is not None}


def only_temperature(names: Sequence[str], units: Mapping[str, str]) -> str:
    """Return the only column in a unit of temperature, if its name does not say what else is so warm; "" for none."""
    warm = [name for name in names if (unit := units.get(name, "")) and _is_celsius(unit)]
    silent = [name for name in warm if not says_another(name, ("cell_temperature", "case_temperature"), units[name])]
    return silent[0] if len(warm) == 1 and silent else ""


def _is_celsius(unit: str) -> bool:
    return spelled(unit) in ("degC", "degF")


def with_bare_temperatures(
    table: RawTable, chosen: Mapping[str, Role], kind: Kind, stated: Mapping[str, str]
) -> tuple[dict[str, Role], dict[str, str], list[Finding]]:
    """Return roles with that of a column called by a unit of temperature alone, its unit, and what is to be asked.

    Args:
        table: of a file.
        chosen: what its other columns are.
        kind: of the case.
        stated: by column of the case, what the user says of it.
    """
    taken = {role.column for role in chosen.values()}
    bare = {name: unit for name, unit in bare_temperatures([*map(str, table.frame)]).items() if name not in taken}
    by_quantity = {quantity: target for target, quantity in ROLES[kind].items()}
    targets = [by_quantity[match.quantity] for match in matches("temperature", "degC") if match.quantity in by_quantity]
    open_targets = [target for target in targets if target not in chosen and target not in stated]
    if not open_targets:
        return dict(chosen), {}, []
    target = open_targets[0]
    alone = only_temperature([*map(str, table.frame)], table.units)
    if not bare and alone and not any(name.endswith("_degC") for name in chosen):
        return {**chosen, target: Role(target, alone, ONLY)}, {}, []
    if not bare:
        return dict(chosen), {}, []
    sure = [name for name, unit in bare.items() if _is_sure(pd.Series(table.frame[name]), unit)]
    if sure:
        return {**chosen, target: Role(target, sure[0], WHY, tuple(sure[1:]))}, {sure[0]: bare[sure[0]]}, []
    name, unit = next(iter(bare.items()))
    sentence = (
        f"{file_label(table.source)}: column '{name}' may be a temperature and is not imported; if it is one, state "
        f'--column {target}="{name}" --unit "{name}={_spelled_out(unit)}".'
    )
    return dict(chosen), {}, [Finding("column of a unit", table.label, sentence, "warning", target)]


def _is_sure(column: pd.Series, unit: str) -> bool:
    """Return whether a column is a temperature: its unit says nothing else, or its readings move as one."""
    if column.dtype.kind not in "iuf":
        return False
    if unit.lower() not in _DOUBTFUL:
        return True
    change = conversion(unit, "degC")
    values = column.to_numpy(dtype=float)
    return change is not None and np.isfinite(values).sum() > 4 and is_warmth(values * change.factor + change.offset)


def _spelled_out(unit: str) -> str:
    return {"c": "degC", "f": "degF"}.get(unit.lower(), unit)
