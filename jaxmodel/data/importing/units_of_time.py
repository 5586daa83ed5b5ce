"""The unit of a clock that states none: by its name, time stamps beside it, size and steps, or by asking."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.clock_by_readings import rows_to_follow, seconds_of, unit_of_size
from jaxmodel.data.importing.findings import Ask, Finding, Question
from jaxmodel.data.importing.options import Kind
from jaxmodel.data.importing.roles import Role
from jaxmodel.data.tables import RawTable
from jaxmodel.data.tables.times import Counted, Times, counted_in, parse_times, unit_by_stamps, unit_in_words

_MAY_BE_MS = 2.0  # whole numbers that rise by so much per row
_SLOW_ROWS = 10  # of 1 s each, in which a motor seldom needs to come to half of its speed (assumed)


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
) -> tuple[RawTable, dict[str, str], list[Finding]]:
    """Return a table and units with those of clocks that state none, and what is said.

    They are told by name, stamps, readings that need a clock, size and steps. A clock that counts rows is in s then.

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
        elif (counts := seconds_of(table, chosen, units, name))[0]:
            seconds, why = counts
            units[name] = unit_of_size(seconds) or "s"
            if not unit_of_size(seconds):
                table = dataclasses.replace(table, frame=table.frame.assign(**{name: column * seconds}))
            if seconds != 1.0:
                what = unit_of_size(seconds) or f"counts of {seconds:g} s"
                found.append(_taken(table.label, name, what, why))
        elif counted := counted_in(column.to_numpy(dtype=float), kind != "cell") or _rows(table, chosen, column, kind):
            units[name] = counted.unit if counted.sure else _asked_unit(table.label, name, column, counted.why, ask)
            if counted.sure:
                found.append(_taken(table.label, name, counted.unit, counted.why))
    return table, units, found


def _taken(where: str, name: str, what: str, why: str) -> Finding:
    sentence = (
        f"{where}: column '{name}' states no unit; it is taken as {what} ({why}). Correct it with --unit "
        f'"{name}=s" if it is another.'
    )
    return Finding("unit assumed", where, sentence, "warning", "time_s")


def _rows(table: RawTable, chosen: Mapping[str, Role], column: pd.Series, kind: Kind) -> Counted | None:
    """Return that the clock of a motor counts rows and may be no seconds, as the speed needs many to follow a step."""
    if kind != "motor" or not np.all(np.diff(column.to_numpy(dtype=float)) == 1.0):
        return None
    rows = rows_to_follow(table, chosen)
    if rows < _SLOW_ROWS:
        return None
    return Counted("ms", f"it counts rows, and after a step of the voltage the speed needs {rows} of them", False)


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
        rows = " or --seconds-per-row S" if np.all(np.diff(column.to_numpy(dtype=float)) == 1.0) else ""
        raise MeasurementError(
            f'{sentence}; state --unit "{name}=ms", "{name}=s" or "{name}=us"{"," * bool(rows)}{rows}.'
        )
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
    instead += " or --seconds-per-row S" if whole and step == 1.0 else ""
    sentence = f"{where}: column '{role.column}' states no unit; it is taken as seconds ({instead})."
    return [Finding("unit assumed", where, sentence, "warning", "time_s")]
