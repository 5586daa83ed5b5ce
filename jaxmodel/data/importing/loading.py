"""Files as logs in the columns and units of a case: which column is which, in which unit, and what was left out."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, listed
from jaxmodel.base.units import LARGEST
from jaxmodel.data.importing.bare_units import ONLY as ONLY_WARM
from jaxmodel.data.importing.bare_units import WHY as OF_A_UNIT
from jaxmodel.data.importing.bare_units import bare_temperatures, only_temperature, with_bare_temperatures
from jaxmodel.data.importing.findings import Ask, Decision, Finding, Question
from jaxmodel.data.importing.formula_hints import of_a_controller
from jaxmodel.data.importing.formulas import computed, unmatched, wanted
from jaxmodel.data.importing.logs import Log, columns_of
from jaxmodel.data.importing.motors import by_motor, meant, motors_in
from jaxmodel.data.importing.one_specimen import OneSpecimen
from jaxmodel.data.importing.options import Kind, Options
from jaxmodel.data.importing.roles import MARKS, Role, looks_like, required, roles_of, target_unit
from jaxmodel.data.importing.single_cells import OF_CELLS, by_cell, single_cells, with_single_cells
from jaxmodel.data.importing.spectra import OnlySpectra, of_spectra, without_spectra
from jaxmodel.data.importing.units_of_time import about_unit, other_stamp, with_units_of_time
from jaxmodel.data.tables import RawTable, read_table
from jaxmodel.data.tables.known_formats import known_format
from jaxmodel.data.tables.names import matches
from jaxmodel.data.tables.raw_table import to_numbers, units_in
from jaxmodel.data.tables.times import date_and_time, parse_times
from jaxmodel.data.tables.units import Conversion, conversion

# How a file is read, as `Options` and `read_table` call it.
FORM = ("sheet", "encoding", "delimiter", "decimal")
_SAMPLE_ROWS = 2000
_CLEAR = 10.0  # by so many times one of two counts of charge rises more than the other where it tells the direction
_NONE = "none"
BY_LOOKS = "column by its looks"  # what is found of a column that its readings told
_COUNTS = 20.0  # from which on whole numbers are seldom the torque of a small motor in N m (assumed)
_ABSOLUTE_ZERO_DEGC = -273.15
_SENSED = (
    "voltage_V",
    "pack_voltage_V",
    "pack_current_A",
    "motor_current_A",
    "speed_rad_s",
    "position_rad",
    "cell_temperature_degC",
    "winding_temperature_degC",
)
_WHY = {
    "named": "by its name",
    "like it in name": "by a word in its name",
    "only one in its unit": "the only column in its unit",
    "stated": "stated",
    "looks like it": "by its readings",
    "beside": "as in the files beside it",
    OF_A_UNIT: "its name is a unit",
    ONLY_WARM: "the only column in a unit of temperature",
    OF_CELLS: "of the columns of single cells",
}
_STATES = (
    (re.compile(r"^(d|dis|dchg|discharge.*|.*dchg.*|.*discharg.*|entlad.*|.*放电.*|dch)$", re.IGNORECASE), -1.0),
    (re.compile(r"^(c|cha|chg|charge.*|.*chg.*|.*charg.*|lad.*|.*充电.*|chr)$", re.IGNORECASE), 1.0),
)


class NotALog(MeasurementError):
    """A file that holds no readings of this kind of case, such as a list of files."""


def load(
    path: Path,
    kind: Kind,
    options: Options,
    ask: Ask | None = None,
    elsewhere: Collection[str] = (),
    names: Sequence[str] = (),
    beside: Mapping[str, str] = MappingProxyType({}),
) -> list[Log]:
    """Read a file in the columns and units of a case: a log for each of its tables.

    Args:
        path: the file.
        kind: of the case.
        options: decisions of the user.
        ask: answers which column is meant where none is found.
        elsewhere: columns of the case that a list of files states.
        names: of the columns of a file without a line of names.
        beside: by column of the case, the column that files beside it have there by their readings.

    Raises:
        NotALog: none of its columns is one of the case; the sentence lists them.
        MeasurementError: the file cannot be read, or a unit does not fit.
    """
    chosen: dict[str, Role] = {}
    in_order: list[str] = []

    def keep(names: Sequence[str]) -> Sequence[str]:
        names = meant(names, options) if kind == "motor" else names
        in_order[:] = names
        if options.each_cell or (kind == "motor" and (options.motors or motors_in(names, options))):
            return names
        known = known_format(names)
        columns = known.plain(names) if known else {}
        units = units_in(names) | {name: unit for name, (_, unit) in columns.items() if unit}
        plain = {name: called for name, (called, _) in columns.items()}
        chosen.update(roles_of(names, _units_to_match(names, units, options), kind, options.columns, plain))
        lacking = _lacking(chosen, kind, options)
        if wanted(options, names):
            return names
        if lacking and any(target not in options.columns for target in lacking):
            return names  # what no name tells is looked for in the readings
        of_roles = [role.column for role in chosen.values()]
        of_roles += chosen["stamp"].others if "stamp" in chosen else ()
        of_roles += [warm] if (warm := only_temperature(names, units)) else []
        return [*dict.fromkeys([*of_roles, *single_cells(names, units), *of_spectra(names), *bare_temperatures(names)])]

    form = {name: getattr(options, name) for name in FORM} | {"names": names}
    table = read_table(path, columns=keep, **form)
    motors = by_motor(table, options) if kind == "motor" else []
    if len(motors) > 1 or options.motors:
        return _of_specimens(motors, kind, options, ask, elsewhere)
    if options.each_cell:
        return _of_specimens(by_cell(table, options), kind, options, ask, elsewhere)
    return _logs(table, kind, options, ask, elsewhere, in_order, form, beside)


def _of_specimens(
    specimens: Sequence[OneSpecimen], kind: Kind, options: Options, ask: Ask | None, elsewhere: Collection[str]
) -> list[Log]:
    """Return the logs of the motors or cells of one file; what is found in each of them is told once."""
    logs: list[Log] = []
    told: set[str] = set()
    for one in _of_one_unit(specimens, kind, options):
        for log in _logs(one.table, kind, options, ask, elsewhere):
            new = tuple(finding for finding in log.findings if finding.sentence not in told)
            told |= {finding.sentence for finding in new}
            name = f"{log.name}_{one.name}" if one.name else log.name
            logs.append(dataclasses.replace(log, name=name, specimen=one.name, findings=new).also(*one.found))
    return logs


def _of_one_unit(specimens: Sequence[OneSpecimen], kind: Kind, options: Options) -> list[OneSpecimen]:
    """Return the motors or cells of one file with the units of columns that state none, by the readings of all of them.

    A propeller that turns slower than the others would else be in rad/s, where these are in 1/min.
    """
    tables = [one.table for one in specimens]
    first = tables[0]
    names = [str(name) for name in first.frame]
    known = _units_to_match(names, units_in(names) | dict(first.units), options)
    units, found = {}, []
    for target, role in roles_of(names, known, kind, options.columns, first.plain).items():
        columns = [table.frame[role.column] for table in tables if role.column in table.frame]
        if target in MARKS or role.column in known or not all(column.dtype.kind in "iuf" for column in columns):
            continue
        values = np.concatenate([column.to_numpy(dtype=float) for column in columns])
        unit, why = guess_unit(values, target_unit(target))
        if why:
            units[role.column] = unit
            found.append(_unit_assumed(first.label, role, unit, why))
    return [
        dataclasses.replace(
            one,
            table=dataclasses.replace(one.table, units={**units, **one.table.units}),
            found=(*one.found, *found) if one is specimens[0] else one.found,
        )
        for one in specimens
    ]


def _unit_assumed(where: str, role: Role, unit: str, why: str) -> Finding:
    sentence = f"{where}: column '{role.column}' states no unit; {why}. Correct it with --unit if it is another."
    target = target_unit(role.target)
    weight = "warning" if unit != target or target == "rad/s" else "note"
    return Finding("unit assumed", where, sentence, weight, role.target)


def _logs(
    table: RawTable,
    kind: Kind,
    options: Options,
    ask: Ask | None,
    elsewhere: Collection[str],
    in_order: Sequence[str] = (),
    form: Mapping[str, Any] | None = None,
    beside: Mapping[str, str] = MappingProxyType({}),
) -> list[Log]:
    """Return the logs of a table: as `load`.

    Args:
        table: of a file.
        kind: of the case.
        options: decisions of the user.
        ask: answers which column is meant where none is found.
        elsewhere: columns of the case that a list of files states.
        in_order: all columns of the file, those that were not read too.
        form: how the file was read, to read all of it.
        beside: as `load`.
    """
    path = table.source
    table, kept = computed(table, options)
    table, left_out = _without_spectra(table)
    seen = list(dict.fromkeys([*in_order, *(str(name) for name in table.frame if name != table.key)]))
    units = dict(table.units) | {name: unit for name, unit in options.units.items() if name in table.frame}
    to_match = _units_to_match(seen, units_in(seen) | dict(table.units), options)
    chosen = roles_of(seen, to_match, kind, options.columns, table.plain)
    if any(role.column in table.left_out for role in chosen.values()):  # units below the names speak for others
        table, kept = computed(read_table(path, **(form or {})), options)
        table, left_out = _without_spectra(table)
    if (lacking := _lacking(chosen, kind, options)) and _may_be_a_log(chosen, seen):
        named = {role.column for role in chosen.values()}
        free = [name for name in table.frame if name not in {*named, *table.plain, table.key}]
        chosen |= looks_like(pd.DataFrame(table.frame[free]).head(_SAMPLE_ROWS), units, kind, lacking, beside)
    chosen, of_names, unsure = with_bare_temperatures(table, chosen, kind, options.columns)
    units = of_names | units
    table, chosen, of_cells = with_single_cells(table, chosen, kind, options)
    units |= {name: unit for name, unit in table.units.items() if name not in units}
    if not any(target in chosen for target in _readings(kind)):
        header = _header(chosen, seen, units)
        wrong = next((one for one in options.columns.items() if one[1] and one[1] not in header), None)
        raise NotALog(
            unmatched(*wrong, header)
            if wrong
            else f"{table.label} has no reading of a {kind}; {columns_of(header)}; name one with --column."
        )
    if ask is not None:
        for target in _lacking(chosen, kind, options):
            if target not in elsewhere and target not in options.columns:
                chosen |= _asked(target, table, chosen, ask)
    table, units, told = with_units_of_time(table, chosen, units, kind, ask)
    header = _header(chosen, seen, units)
    logs = [_log(part, name, kind, chosen, units, header) for name, part in table.tables()]
    return [
        log.also(*kept, *left_out, *of_cells, *unsure, *told) if place == 0 else log for place, log in enumerate(logs)
    ]


def _without_spectra(table: RawTable) -> tuple[RawTable, list[Finding]]:
    """Return a table without its rows of impedance spectra, and what was left out.

    Raises:
        NotALog: no other rows are left.
    """
    try:
        return without_spectra(table)
    except OnlySpectra as error:
        raise NotALog(str(error)) from None


def _header(chosen: Mapping[str, Role], seen: Sequence[str], units: Mapping[str, str]) -> dict[str, str]:
    """Return what became of each column of a file."""
    became = {role.column: target for target, role in chosen.items()}
    for target, role in chosen.items():
        if role.why == OF_CELLS:
            became |= dict.fromkeys(single_cells(seen, units), target)
    return {name: became.get(name, "") for name in seen}


def _asked(target: str, table: RawTable, chosen: Mapping[str, Role], ask: Ask) -> dict[str, Role]:
    """Return what the user says that a column of the case is."""
    taken = {role.column for role in chosen.values()}
    free = [str(name) for name in table.frame if name not in taken]
    if not free:
        return {}
    question = Question(f"{table.label}: which column is {target}?", f'--column {target}="NAME"', (*free, _NONE), _NONE)
    answer = ask(question)
    return {} if answer == _NONE else {target: Role(target, answer, "stated")}


def _units_to_match(names: Sequence[str], units: Mapping[str, str], options: Options) -> dict[str, str]:
    """Return units by which names are matched: a stated one that its name contradicts is left to be refused."""
    known = {name: unit for name, unit in options.units.items() if name in names}
    stated = {name: unit for name, unit in known.items() if matches(name, unit) or not matches(name)}
    return {**units, **stated}


def _may_be_a_log(chosen: Mapping[str, Role], names: Sequence[str]) -> bool:
    """Return whether some column is known to be of a log, or the file names none: only then looks are asked."""
    known = {
        "time_s",
        "step_time",
        "stamp",
        "current_A",
        "voltage_V",
        "pack_current_A",
        "pack_voltage_V",
        "speed_rad_s",
    }
    return bool(chosen.keys() & known) or all(name.startswith("column ") for name in names)


def _readings(kind: Kind) -> tuple[str, ...]:
    groups = required(kind, None)
    return (*(name for group in groups for name in group), *_SENSED)


def _needed(kind: Kind) -> tuple[str, ...]:
    """Return the columns of a case that no import leaves out silently for a unit that nobody knows."""
    return tuple(name for name in _readings(kind) if not name.endswith("_degC"))


def _lacking(chosen: Mapping[str, Role], kind: Kind, options: Options) -> list[str]:
    """Return what a case cannot do without and no name tells."""
    timed = bool(chosen.keys() & {"time_s", "stamp", "step_time"}) or options.seconds_per_row is not None
    lacking = [] if timed else ["time_s"]
    wanted = [("current_A",), ("voltage_V",)] if kind == "cell" else required(kind, options.load, options.servo)
    given = chosen.keys() | options.constants.keys()
    # A torque may have an odd name: a speed stands in for it only where nobody knows of one.
    given -= {"speed_rad_s"} if not options.load else set()
    return lacking + [group[0] for group in wanted if not given.intersection(group)]


def _log(
    table: RawTable,
    name: str,
    kind: Kind,
    chosen: Mapping[str, Role],
    units: Mapping[str, str],
    header: Mapping[str, str],
) -> Log:
    where = table.label
    found: list[Finding | Decision] = []
    log = _clocked(table, chosen, units, found)
    columns: dict[str, np.ndarray] = {}
    for target, role in chosen.items():
        if target in MARKS:
            continue
        unit = units.get(role.column, "")
        if unit and role.why != "stated" and target not in _needed(kind) and not conversion(unit, target_unit(target)):
            sentence = (
                f"{where}: column '{role.column}' could be {target}, and '{unit}' is not a unit of it; it is left out. "
                f'State it with --unit "{role.column}={target_unit(target) or 1}".'
            )
            found.append(Finding("unit unknown", where, sentence, "warning", target))
            continue
        values = _converted(table, role, unit, target_unit(target), where, found)
        if not np.isfinite(values).any():
            found.append(
                Finding("empty column", where, f"{where}: column '{role.column}' is empty and left out.", column=target)
            )
            continue
        if target == "load_torque_Nm" and role.why == "named" and not unit and _is_counted(values):
            sentence = (
                f"{where}: column '{role.column}' states no unit and holds whole numbers up to "
                f"{np.nanmax(np.abs(values)):g}, as the load that a servo reports, which is its duty; it is left out. "
                f'If it is a torque, state --unit "{role.column}=N m".'
            )
            found.append(Finding("no torque", where, sentence, "warning", target))
            continue
        if target.endswith("_degC") and (no_sensor := _no_sensor(pd.Series(table.frame[role.column]), values)):
            sentence = (
                f"{where}: column '{role.column}' is {no_sensor}, as of a sensor that is not there; it is left out."
            )
            found.append(Finding("no sensor", where, sentence, "warning", target))
            continue
        columns[target] = values
        found += _about(role, unit, where)
        if role.column in table.repeated:
            sentence = (
                f"{where}: several columns are called '{role.column}'; the first is taken as {target}. The next is "
                f'--column {target}="{role.column} 2".'
            )
            found.append(Finding("repeated name", where, sentence, "warning", target))
    if kind == "motor" and not any(role.why == "stated" for role in chosen.values() if role.target == "voltage_V"):
        found += of_a_controller(where, header)
    counts: dict[str, np.ndarray] = {}
    for target in ("discharged_Ah", "charged_Ah") if kind == "cell" else ():  # of a pack, and not of a motor's current
        role = chosen.get(target)
        if role and conversion(unit := units.get(role.column, "A h"), "A h"):
            counts[target] = _converted(table, role, unit, "A h", where, [])
    log = Log(
        name,
        table.source,
        log.time_s,
        columns,
        {
            key: _marks(pd.Series(table.frame[chosen[key].column]), key)
            for key in ("step", "cycle", "state")
            if key in chosen
        }
        | ({"counted": _counted(counts)} if len(counts) == 2 else {}),
        log.stamp_s,
        counts.get("discharged_Ah"),
        log.time_is_of_step,
        header=header,
    )
    found += [Decision("reading", where, remark, table.format, "file") for remark in table.remarks]
    found += [Finding("not read", where, f"{where}: {loss}", "warning") for loss in table.losses]
    texts = " ".join(role.column for role in chosen.values() if role.why == "stated")  # names, and formulas of names
    used = {name for name in header if re.search(rf"(?<!\w){re.escape(name)}(?!\w)", texts)}
    if left := [column for column, target in header.items() if not target and column not in used]:
        found.append(Decision("not imported", where, listed(left, 20), "no column of the case holds it", "file"))
    if table.current_positive_on is not None:
        why = table.remarks[-1].split(". ")[0].rstrip(".")
        found.append(Decision("convention", where, table.current_positive_on, why, "file"))
    return log.also(*found)


def _is_counted(values: np.ndarray) -> bool:
    """Return whether readings are whole numbers of which some are large, as counts of a duty are."""
    there = values[np.isfinite(values)]
    return bool(np.all(there == np.round(there)) and np.max(np.abs(there), initial=0.0) >= _COUNTS)


def _no_sensor(raw: pd.Series, degC: np.ndarray) -> str:
    """Return what a thermometer that is not there reads: 0, or colder than all that is; "" for one that is there."""
    if not np.any(np.nan_to_num(raw.to_numpy(dtype=float))):
        return "0 throughout"
    return f"{np.nanmedian(degC):.4g} degC" if float(np.nanmedian(degC)) < _ABSOLUTE_ZERO_DEGC else ""


def _about(role: Role, unit: str, where: str) -> list[Finding | Decision]:
    """Return what is to be said about a column that was chosen."""
    source = "user" if role.why == "stated" else "file"
    text = f"column '{role.column}'" + (f" in {unit}" if unit else "")
    about: list[Finding | Decision] = [Decision(role.target, where, text, _WHY[role.why], source)]
    if role.why == "looks like it":
        sentence = (
            f"{where}: no column is called {role.target}, and the readings of '{role.column}' look like it. "
            "State it with --column."
        )
        about.append(Finding(BY_LOOKS, where, sentence, "warning", role.target))
    if role.others:
        others = ", ".join(role.others[:6])
        sentence = f"{where}: {role.target} is column '{role.column}'; it could also be {others} (--column)."
        about.append(Finding("several columns", where, sentence, column=role.target))
    if role.commanded:
        sentence = (
            f"{where}: column '{role.column}' is by its name what was set or supplied, and not "
            "measured at the terminals."
        )
        about.append(Finding("commanded", where, sentence, "warning", role.target))
    return about


def _clocked(
    table: RawTable, chosen: Mapping[str, Role], units: Mapping[str, str], found: list[Finding | Decision]
) -> Log:
    """Return a log that has the clock only: elapsed time, and time stamps where the file has them."""
    where, elapsed, stamp, of_step = table.label, None, None, False
    unitless: Role | None = None  # the column of elapsed times that states no unit
    date, clock = chosen.get("stamp"), chosen.get("time_s")
    if date and clock and (both := date_and_time(table.frame[date.column], table.frame[clock.column])):
        found.append(Decision("clock", where, f"columns '{date.column}' and '{clock.column}'", both.form, "file"))
        return Log("", table.source, np.empty(0), {}, {}, both.seconds)
    for target in ("time_s", "stamp", "step_time"):
        role = chosen.get(target)
        if role is None or (target == "step_time" and elapsed is not None):
            continue
        unit = units.get(role.column, "")
        if unit and table.frame[role.column].dtype.kind in "iuf" and not conversion(unit, "s"):
            if chosen.keys() & {"time_s", "stamp", "step_time"} != {target}:
                continue
            raise MeasurementError(
                f"{where}: column '{role.column}' is in '{unit}', which is not a unit of time; state it with "
                f'--unit "{role.column}=s", or name another with --column {target}="NAME".'
            )
        times = parse_times(pd.Series(table.frame[role.column]), unit)
        if target == "stamp" and (times is None or not times.absolute):
            role, times = other_stamp(table, role, units) or (role, times)
        if times is None:
            continue
        times = times._replace(seconds=np.where(np.abs(times.seconds) > LARGEST, np.nan, times.seconds))
        found.append(Decision("clock", where, f"column '{role.column}'", times.form, "file"))
        if times.absolute:
            stamp = times.seconds if stamp is None else stamp
        elif elapsed is None:
            elapsed, of_step, unitless = times.seconds, target == "step_time", None if times.known_unit else role
        if role.why == "looks like it":
            found += [one for one in _about(role, "", where) if isinstance(one, Finding)]
    if unitless is not None and elapsed is not None:
        found += about_unit(unitless, elapsed, where)
    return Log("", table.source, np.empty(0) if elapsed is None else elapsed, {}, {}, stamp, None, of_step)


def _converted(
    table: RawTable, role: Role, unit: str, target: str, where: str, found: list[Finding | Decision]
) -> np.ndarray:
    """Return a column in the unit of the case.

    Raises:
        MeasurementError: the column holds text, or its unit is of another quantity.
    """
    column = table.frame[role.column]
    try:
        values = column.to_numpy(dtype=float, na_value=np.nan)
    except (TypeError, ValueError):
        raise MeasurementError(
            f"{where}: column '{role.column}' holds text and no numbers, and {role.target} needs numbers; name another "
            f'with --column {role.target}="NAME".'
        ) from None
    if not unit:
        unit, why = guess_unit(values, target)
        if why:
            found.append(_unit_assumed(where, role, unit, why))
    change = Conversion(1.0) if unit == target else conversion(unit, target)
    if change is None:
        raise MeasurementError(
            f"{where}: column '{role.column}' is in '{unit}', which is not a unit of {role.target} "
            f"({target or 'a fraction'}); "
            f'state it with --unit "{role.column}={target or 1}", or name another with --column.'
        )
    if change.factor != 1.0 or change.offset != 0.0:
        with np.errstate(over="ignore"):
            values = values * change.factor + change.offset
    beyond = np.abs(values) > LARGEST
    if beyond.any():
        values = np.where(beyond, np.nan, values)
        count = int(beyond.sum())
        found.append(
            Finding(
                "not finite",
                where,
                f"{where}: column '{role.column}' has {count} values that are infinite or beyond {LARGEST:g}, "
                "taken as missing.",
                "warning",
                role.target,
            )
        )
    return values


def guess_unit(values: np.ndarray, target: str) -> tuple[str, str]:
    """Return the unit of a column whose file states none, by the size of its values, and why; "" where it has none."""
    there = np.abs(values[np.isfinite(values)][:: max(values.size // 100_000, 1)])
    middle, largest = (float(np.median(there)), float(there.max())) if there.size else (0.0, 0.0)
    if target == "V" and middle > 1000.0:
        return "mV", f"its median is {middle:.4g}, taken as mV"
    if target == "A" and largest > 1000.0:
        return "mA", f"it goes up to {largest:.4g}, taken as mA"
    if target == "degC" and 200.0 < middle < 420.0:
        return "K", f"its median is {middle:.4g}, taken as K"
    if target == "" and largest > 1.5:
        return "%", f"it goes up to {largest:.4g}, taken as percent"
    if target == "rad/s":
        unit = "1/min" if largest > 1000.0 else target
        return unit, f"it goes up to {largest:.4g}, taken as {unit}"
    return target, f"taken as {target}" if target else ""


def _marks(column: pd.Series, key: str) -> np.ndarray:
    """Return step, cycle or state of each row as numbers: a state is 1 on charge, -1 on discharge, 0 otherwise."""
    if key != "state" and column.dtype.kind in "iuf":
        return column.to_numpy(dtype=float)
    codes, words = pd.factorize(column.astype("string"))
    if key != "state":
        numbers = to_numbers(pd.Series(words, dtype="string"))
        table = np.where(np.isnan(numbers), np.arange(len(words), dtype=float), numbers)
    else:
        table = np.array([_state(str(word)) for word in words], dtype=float)
    return np.append(table, 0.0 if key == "state" else np.nan)[codes]


def _counted(counts: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the state of each row by which of the two counts of charge rises: where neither does, as above it."""
    rises = (np.nan_to_num(np.diff(counts[n], prepend=counts[n][:1])) for n in ("charged_Ah", "discharged_Ah"))
    into, out = (np.maximum(one, 0.0) for one in rises)
    clear = np.maximum(into, out) > _CLEAR * np.minimum(into, out)
    state = pd.Series(np.where(clear, np.sign(into - out), np.nan))
    return state.replace(0.0, np.nan).ffill().bfill().fillna(0.0).to_numpy(dtype=float)


def _state(word: str) -> float:
    return next((sign for pattern, sign in _STATES if pattern.match(word.strip())), 0.0)
