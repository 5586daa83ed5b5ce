"""The single cells of a pack that a battery monitor logs side by side: their mean is a cell, their sum the pack."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.one_specimen import OneSpecimen
from jaxmodel.data.importing.options import Kind, Options
from jaxmodel.data.importing.roles import Role, roles_of
from jaxmodel.data.tables import RawTable
from jaxmodel.data.tables.names import is_set, parse_name
from jaxmodel.data.tables.units import conversion, spelled

# Words without their number: "cell 1", "cell voltage 1", "vcell1", "cell 01 volt".
_CELL = re.compile(r"(.* )?(v ?)?(cell|cp|zelle|单体|电芯)s?( ?(v|volts?|voltages?|spannung|电压))?|v ?(c|cell)")
_NUMBER = re.compile(r"\d+")
_FEWEST = 2
# A column without a reading within these is of a cell that the pack does not have [V].
_LOWEST_V, _HIGHEST_V = 0.5, 5.5
OF_CELLS = "of single cells"
_TARGETS = {"cell": "voltage_V", "robot": "pack_voltage_V"}


def single_cells(names: Sequence[str], units: Mapping[str, str]) -> list[str]:
    """Return the columns that hold the voltage of one cell each, empty where fewer than two do.

    Args:
        names: of the columns of a file.
        units: by column, as the file states them.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        words, unit = parse_name(name)
        unit = units.get(name, unit)
        number = _NUMBER.findall(words)
        bare = " ".join(_NUMBER.sub(" ", words).split())
        if (
            len(number) == 1
            and _CELL.fullmatch(bare)
            and not is_set(name)
            and (not unit or conversion(unit, "V") is not None)
        ):
            groups.setdefault(bare, []).append(name)
    found = max(groups.values(), key=len, default=[])
    return found if len(found) >= _FEWEST else []


def by_cell(table: RawTable, options: Options) -> list[OneSpecimen]:
    """Return the single cells of a log, each with a table of its own in which its voltage is the only one.

    Args:
        table: of a file.
        options: decisions of the user.

    Raises:
        MeasurementError: it has no columns of single cells.
    """
    cells = single_cells([str(name) for name in table.frame if table.frame[name].dtype.kind in "iuf"], table.units)
    volts = {name: _volts(table.frame[name].to_numpy(dtype=float), table.units.get(name, "")) for name in cells}
    there = [name for name in cells if float(np.mean(_inside(volts[name]))) > 0.5]
    if len(there) < _FEWEST:
        raise MeasurementError(
            f"{table.label}: each cell: no columns hold voltages of single cells, as cell_1_V and cell_2_V do; leave "
            "--each-cell out."
        )
    others = table.frame.drop(columns=cells)
    of_pack = [role.column for target, role in roles_of([*map(str, others)], table.units, "cell", {}).items()
               if target == "voltage_V"]  # fmt: skip
    others = others.drop(columns=of_pack)
    units = {name: unit for name, unit in table.units.items() if name in others} | {"voltage_V": "V"}
    done = Decision("cells", table.label, f"{there[0]} to {there[-1]}", "each is a run of a cell of its own", "user")
    found = [
        OneSpecimen(
            f"cell{int(_NUMBER.findall(parse_name(name).words)[0])}",
            dataclasses.replace(table, frame=others.assign(voltage_V=volts[name]), units=units),
        )
        for name in there
    ]
    return [dataclasses.replace(found[0], found=(done,)), *found[1:]]


def with_single_cells(
    table: RawTable, chosen: Mapping[str, Role], kind: Kind, options: Options
) -> tuple[RawTable, dict[str, Role], list[Finding | Decision]]:
    """Return a table with the voltage that its columns of single cells make, and its role.

    Of a cell it is their mean, unless the user names a voltage or states cells in series; of a robot it is their sum,
    where the file has no voltage of the pack.

    Args:
        table: with the columns of the single cells.
        chosen: what the columns are by their names.
        kind: of the case.
        options: decisions of the user.
    """
    target = _TARGETS.get(kind, "")
    role = chosen.get(target)
    numbers = [str(name) for name in table.frame if table.frame[name].dtype.kind in "iuf"]
    cells = single_cells(numbers, table.units) if target else []
    if cells:
        chosen = _of_pack(dict(chosen), kind)
    stated = target in options.columns or (role is not None and role.why == "stated")
    has_pack = kind == "robot" and role is not None and role.column not in cells
    if not cells or stated or has_pack or (kind == "cell" and options.cells_in_series > 1):
        return table, dict(chosen), []
    values = np.stack([_volts(table.frame[name].to_numpy(dtype=float), table.units.get(name, "")) for name in cells])
    inside = _inside(values)
    there = np.flatnonzero(inside.mean(axis=1) > 0.5)
    whole = np.isfinite(values[there]).all(axis=0)
    if len(there) < _FEWEST or not whole.any():
        return table, dict(chosen), []
    used = [cells[place] for place in there]
    volts = values[there]
    what = "mean" if kind == "cell" else "sum"
    name = f"{what} of {len(used)} cells"
    made = np.mean(volts, axis=0) if kind == "cell" else np.sum(volts, axis=0)
    frame = pd.concat([table.frame, pd.Series(made, name=name, index=table.frame.index)], axis=1)
    table = dataclasses.replace(table, frame=frame, units={**table.units, name: "V"})
    spread = np.ptp(volts[:, whole], axis=0)
    lowest = used[int(np.argmin(np.mean(volts[:, whole], axis=1)))]
    sentence = (
        f"{table.label}: {target} is the {what} of the {len(used)} columns '{used[0]}' to '{used[-1]}'; they differ by "
        f"{1e3 * float(np.median(spread)):.3g} mV (median), and '{lowest}' is the lowest."
    )
    if kind == "cell":
        sentence += f' One of them alone is --column {target}="{lowest}".'
    found = Finding("single cells", table.label, sentence, column=target)
    return table, {**chosen, target: Role(target, name, OF_CELLS)}, [found]


def _of_pack(chosen: dict[str, Role], kind: Kind) -> dict[str, Role]:
    """Return roles in which the one current beside single cells is that of the pack, unless its name is of a motor."""
    role = chosen.get("motor_current_A")
    if kind != "robot" or role is None or role.why == "stated" or "pack_current_A" in chosen:
        return chosen
    if "motor" in parse_name(role.column).words:
        return chosen
    others = {target: one for target, one in chosen.items() if target != "motor_current_A"}
    return others | {"pack_current_A": dataclasses.replace(role, target="pack_current_A")}


def _inside(volts: np.ndarray) -> np.ndarray:
    """Return where readings are of a cell that is there."""
    return (volts > _LOWEST_V) & (volts < _HIGHEST_V)


def _volts(values: np.ndarray, unit: str) -> np.ndarray:
    """Return readings of one cell in V; without a unit, such above 100 are mV."""
    values = np.abs(values)  # some monitors mark a cell that they balance by a minus
    change = conversion(unit, "V") if unit and spelled(unit) else None
    if change is not None:
        return values * change.factor + change.offset
    there = values[np.isfinite(values)]
    return values * (1e-3 if there.size and float(np.median(there)) > 100.0 else 1.0)
