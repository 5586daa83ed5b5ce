"""The unit of a clock that states none: by its name, time stamps beside it, size and steps, or by asking."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.findings import Ask, Finding, Question
from jaxmodel.data.importing.options import Kind
from jaxmodel.data.importing.roles import Role
from jaxmodel.data.tables import RawTable
from jaxmodel.data.tables.times import Times, counted_in, parse_times, unit_by_stamps, unit_in_words

_MAY_BE_MS = 2.0  # whole numbers that rise by so much per row


def other_stamp(table: RawTable, role: Role, units: Mapping[str, str]) -> tuple[Role, Times] | None:
    """Return the first of the further columns of time stamps that holds some; None where none does."""
    for name in role.others:
        if name in table.frame:
            times = parse_times(pd.Series(table.frame[name]), units.get(name, ""))
            if times is not None and times.absolute:
                return dataclasses.replace(role, column=name, others=()), times
    return None


def with_units_of_time(
    table: RawTable, chosen: Mapping[str, Role], units: Mapping[str, str], kind: Kind, ask: Ask | None
) -> tuple[dict[str, str], list[Finding]]:
    """Return units with those of clocks that state none, by name, stamps, size and steps, and what is said.

    Raises:
        MeasurementError: one may be seconds or something else, and nobody is there to ask.
    """
    units, found = dict(units), []
    for name in dict.fromkeys(chosen[target].column for target in ("time_s", "stamp", "step_time") if target in chosen):
        column = pd.Series(table.frame[name])
        if name in units or column.dtype.kind not in "iuf":
            continue
        if named := unit_in_words(name):
            units[name] = named
        elif (told := _unit_by_stamps(table, chosen, units, name)) is not None:
            units[name] = told
        elif counted := counted_in(column.to_numpy(dtype=float), kind != "cell"):
            units[name] = counted.unit if counted.sure else _asked_unit(table.label, name, column, counted.why, ask)
            if counted.sure:
                sentence = (
                    f"{table.label}: column '{name}' states no unit; it is taken as {counted.unit} ({counted.why}). "
                    f'Correct it with --unit "{name}=s" if it is another.'
                )
                found.append(Finding("unit assumed", table.label, sentence, "warning", "time_s"))
    return units, found


def _unit_by_stamps(
    table: RawTable, chosen: Mapping[str, Role], units: Mapping[str, str], name: str
) -> str | None:  # fmt: skip
    """Return the unit of a clock that states none, by time stamps in another column."""
    role = chosen.get("stamp")
    if role is None or role.column == name:
        return None
    stamps = parse_times(pd.Series(table.frame[role.column]), units.get(role.column, ""))
    if stamps is None or not stamps.absolute:
        return None
    return unit_by_stamps(table.frame[name].to_numpy(dtype=float), stamps.seconds)


def _asked_unit(where: str, name: str, column: pd.Series, why: str, ask: Ask | None) -> str:
    span = float(column.max() - column.min())
    lasts = " or ".join(f"{_duration(span * by)} if in {unit}" for unit, by in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)))
    sentence = f"{where}: column '{name}' states no unit ({why}), and the log lasts {lasts}"
    if ask is None:
        raise MeasurementError(f'{sentence}; state --unit "{name}=ms", "{name}=s" or "{name}=us".')
    return ask(Question(f"{sentence}. What is it?", f'--unit "{name}=UNIT"', ("ms", "s", "us"), "ms"))


def _duration(seconds: float) -> str:
    for size, name in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {name}"
    return f"{seconds:.2g} s"


def about_unit(role: Role, elapsed: np.ndarray, where: str) -> list[Finding]:
    """Return what is to be said of a clock that is taken as seconds, as nothing tells its unit."""
    steps = np.diff(elapsed[np.isfinite(elapsed)])
    step = float(np.median(steps)) if steps.size else 0.0
    whole = not np.any(steps != np.round(steps))
    others = ["ms"] if whole and step >= _MAY_BE_MS and step % 60.0 else ["ms", "min"] if whole else ["min"]
    instead = " or ".join(f'--unit "{role.column}={other}"' for other in others)
    sentence = f"{where}: column '{role.column}' states no unit; it is taken as seconds ({instead})."
    return [Finding("unit assumed", where, sentence, "warning", "time_s")]
