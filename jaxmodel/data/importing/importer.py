"""From files to a case: read, put on a clock, settle signs, split into runs, look for what is odd, propose the rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.progress import Stage, stages
from jaxmodel.case.measurements import COLUMNS_OF_LAWS, KINDS, file_label, vocabulary
from jaxmodel.case.presets import located, read_preset, why_not
from jaxmodel.data.importing import ageing, balance, charge, warm_start
from jaxmodel.data.importing.agreement import checked
from jaxmodel.data.importing.ambient import contradictions, fill, with_ambient
from jaxmodel.data.importing.check_runs import splits_of_motors
from jaxmodel.data.importing.checks import odd_things, without_unconnected
from jaxmodel.data.importing.clock import with_clock
from jaxmodel.data.importing.conditions import Condition, ambients_of, condition_of, specimens, with_specimens
from jaxmodel.data.importing.findings import Ask, Decision, Finding, Question
from jaxmodel.data.importing.formula_hints import hint_for
from jaxmodel.data.importing.formulas import unmatched
from jaxmodel.data.importing.headers import by_most, of_siblings
from jaxmodel.data.importing.imported import Imported, ImportedRun
from jaxmodel.data.importing.joining import copies, joined
from jaxmodel.data.importing.limits import by_limits
from jaxmodel.data.importing.listing import Listed, read_listing
from jaxmodel.data.importing.loading import NotALog, load
from jaxmodel.data.importing.logs import Log, columns_of
from jaxmodel.data.importing.mistakes import SWAPPED, exchanged, odd_units
from jaxmodel.data.importing.motor_constants import constants_of
from jaxmodel.data.importing.options import Kind, Options
from jaxmodel.data.importing.outliers import without_outliers
from jaxmodel.data.importing.roles import MARKS, ONLY_STATED, ROLES
from jaxmodel.data.importing.runs import split
from jaxmodel.data.importing.sign import motor_signs, robot_signs, settle
from jaxmodel.data.importing.speed import with_speed
from jaxmodel.data.importing.supply import odd_voltages

LOAD = "load_torque_Nm"
_LAWS = ", ".join(COLUMNS_OF_LAWS)
_ROBOT_SOC = charge.Stated(1.0, 0.05, "assumed: full")


def import_case(
    files: Sequence[str | Path] | str | Path,
    kind: Kind,
    *,
    out: str | Path | None = None,
    options: Options | None = None,
    ask: Ask | None = None,
    progress: bool | Stage = True,
    **decisions: Any,
) -> Imported:
    """Import raw files of a bench as a case.

    Args:
        files: of one piece of hardware, in any format that `jaxmodel.read_table` knows.
        kind: "cell", "motor" or "robot".
        out: folder that the case is written to; by default nothing is written.
        options: decisions of the user.
        ask: answers what the files leave open; by default that is an error which names the option to give.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with what is
            done next.
        decisions: fields of `Options`, as keywords: `ambient=23.0`, `sign="charge-positive"`.

    Returns:
        The case with everything that was found and decided.

    Raises:
        MeasurementError: a file cannot be used, or something is open that only the user can tell.

    Example:
        >>> from jaxmodel import import_case
        >>> log = "examples/samsung_30q/cc1C.csv"
        >>> imported = import_case(log, "cell", ambient=23.0, progress=False)
        >>> imported.case.runs[0].name, len(imported.decisions) > 5
        ('cc1C', True)
    """
    if kind not in KINDS:
        raise MeasurementError(f"kind: there is no '{kind}'; use cell, motor or robot.")
    known = {field.name for field in dataclasses.fields(Options)}
    if unknown := [name for name in decisions if name not in known]:
        raise MeasurementError(f"import_case: there is no decision '{unknown[0]}'.{nearest(unknown[0], known)}")
    options = checked(dataclasses.replace(options or Options(), **decisions), kind)
    if options.drive == "current":  # what is in V is then no voltage of the winding
        options = dataclasses.replace(options, columns={"voltage_V": "", **options.columns})
    if options.preset:
        options = dataclasses.replace(options, preset=located(options.preset, Path()))
        if problem := why_not(str(options.preset), kind):
            raise MeasurementError(f"preset: {problem}")
    paths = [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
    with stages(progress, "import") as tell:
        imported = _imported(paths, kind, options, ask, tell)
        if out is not None:
            tell(f"writing {len(imported.runs)} runs")
            imported.write(out)
    return imported


def _imported(paths: Sequence[Path], kind: Kind, options: Options, ask: Ask | None, tell: Stage) -> Imported:
    """Return what `import_case` does, of options that are checked."""
    logs, listed, general = _read(paths, kind, options, ask, tell)
    tell("clocks and signs")
    general += copies(logs)
    logs, clockless = _with_clocks(logs, options, ask)
    general += clockless
    logs = with_specimens(joined(logs), options.specimens)
    _refuse_no_voltage(logs, kind, options)
    if kind == "cell":
        logs = [log if (odd := exchanged(log)) is None else log.also(odd) for log in logs]
    logs = _signed(logs, kind, options, ask)
    known = vocabulary(kind, options.load or "", options.servo)
    runs = [run for log in logs for run in split(_scaled(log, kind, options), options)]
    runs = [
        _complete(with_speed(run, keep="position_rad" in known.outputs), kind, options, listed.get(run.source.name))
        for run in runs
    ]
    tell(f"checking {len(runs)} runs")
    runs = [run.also(*odd_things(run, kind)) for run in without_outliers([*map(without_unconnected, runs)], known)]
    return _assembled(runs, kind, options, ask, listed, general)


def _read(
    paths: Sequence[Path], kind: Kind, options: Options, ask: Ask | None, tell: Stage
) -> tuple[list[Log], dict[str, Listed], list[Finding | Decision]]:  # fmt: skip
    """Return the logs among the files, what a list among them says of each, and what is to be said of all."""
    if not paths:
        raise MeasurementError("There are no files to import; name at least one.")
    logs: list[Log] = []
    listed: dict[str, Listed] = {}
    found: list[Finding | Decision] = []
    readings = []
    for path in paths:
        others = [other.name for other in paths if other != path]
        if others and path.is_file() and (listing := read_listing(path, others, _inputs_of(kind))):
            listed |= listing
            found.append(Decision("list of files", "", file_label(path), "it names the other files", "file"))
        else:
            readings.append(path)
    headers = of_siblings(readings, options)
    for path in readings:
        tell(f"reading {path.name}")
        stated = _stated(path, listed)
        try:
            names, sibling = headers.get(path, ((), path))
            logs += load(path, kind, options, ask, stated, names)
            if names:
                why = "it has no line of names, and as many columns"
                found.append(Decision("names of columns", file_label(path), f"those of {sibling.name}", why, "file"))
        except NotALog as error:
            if len(readings) == 1:
                raise
            found.append(Finding("file left out", file_label(path), f"{error} It is left out.", "warning"))
    for path, beside in by_most(logs).items():
        again = load(path, kind, options, ask, _stated(path, listed), beside=beside)
        first = next(place for place, log in enumerate(logs) if log.source == path)
        logs = [log for log in logs if log.source != path]
        logs[first:first] = again
    if not logs:
        reason = next((one.sentence for one in found if isinstance(one, Finding)), "")
        raise MeasurementError(reason.removesuffix(" It is left out.") or "No file holds readings; name the logs.")
    header = {column: target for log in logs for column, target in log.header.items()}
    for target, column in options.columns.items():
        stated = any(d.about == target and d.source == "user" for log in logs for d in log.decisions)
        if column and (column not in header or not (stated or target in MARKS)):
            raise MeasurementError(unmatched(target, column, header))
    return logs, listed, found


def _stated(path: Path, listed: Mapping[str, Listed]) -> Mapping[str, float]:
    """Return the inputs that a list of files states of one of them."""
    return listed[path.name].inputs if path.name in listed else {}


def _inputs_of(kind: Kind) -> tuple[str, ...]:
    """Return the inputs that a list of files may state: a number that holds throughout."""
    known = KINDS[kind]
    chosen = (name for group in known.alternatives for name in group if name not in known.outputs)
    return (*known.required_inputs, *chosen)


def _with_clocks(logs: Sequence[Log], options: Options, ask: Ask | None) -> tuple[list[Log], list[Finding]]:
    """Return logs with their clocks; one without is left out where others have one and the user states no other way."""
    timed, found = [], []
    for log in logs:
        if (clocked := with_clock(log, options.seconds_per_row)) is not None:
            timed.append(clocked)
        else:
            sentence = (
                f"{file_label(log.source)} has no column of time and is left out; import it separately "
                "with --seconds-per-row."
            )
            found.append(Finding("file left out", file_label(log.source), sentence, "warning"))
    if timed:
        return timed, found
    return [_clocked(log, options, ask) for log in logs], []


def _clocked(log: Log, options: Options, ask: Ask | None) -> Log:
    timed = with_clock(log, options.seconds_per_row)
    if timed is not None:
        return timed
    where = file_label(log.source)
    question = Question(f"{where} has no clock. How many seconds are there from row to row?", "--seconds-per-row S")
    if ask is None:
        raise MeasurementError(
            f'{where} has no column of time; name it with --column time_s="NAME", or state --seconds-per-row S, which '
            "takes the rows as evenly spaced."
        )
    timed = with_clock(log, _number(ask(question), question))
    assert timed is not None
    return timed


def _refuse_no_voltage(logs: list[Log], kind: Kind, options: Options) -> None:
    """Raise MeasurementError for a cell without a voltage whose user has not said that it has none."""
    said = options.sign or options.accept_unsettled_sign or options.columns.get("voltage_V") == ""
    with_current = [log for log in logs if "current_A" in log.columns]
    if kind == "cell" and with_current and not said and not any("voltage_V" in log.columns for log in with_current):
        log = with_current[0]
        raise MeasurementError(
            f"{file_label(log.source)}: no column is voltage_V; {columns_of(log.header)}; name it with "
            '--column voltage_V="NAME".'
        )


def _signed(logs: list[Log], kind: Kind, options: Options, ask: Ask | None) -> list[Log]:
    for name in options.flip:
        if not any(name in log.columns for log in logs):
            raise MeasurementError(f"flip: no file has readings of {name}; name a column of the case.")
    if kind == "cell":
        with_current = [log for log in logs if "current_A" in log.columns]
        try:
            settled = settle(with_current, options.sign, options.accept_unsettled_sign) if with_current else []
        except MeasurementError as error:
            said = next((sentence for log in with_current if (sentence := _if_exchanged(log))), "")
            if ask is None:
                raise MeasurementError(said or str(error)) from error
            choices = ("discharge-positive", "charge-positive")
            open_one = f"{said} The readings do not settle the sign of the current. What is it?".strip()
            question = Question(open_one, "--sign", choices, choices[0])
            settled = settle(with_current, ask(question), True)
        by_name = {id(before): after for before, after in zip(with_current, settled, strict=True)}
        logs = [by_name.get(id(log), log) for log in logs]
    elif options.sign == "charge-positive":
        logs = [_flipped(log, ("current_A", "pack_current_A", "motor_current_A")) for log in logs]
    elif options.sign is None and kind == "robot":
        logs = [robot_signs(log) for log in logs]
    logs = [_flipped(log, options.flip) for log in logs]
    return [motor_signs(log) for log in logs] if kind == "motor" else logs


def _if_exchanged(log: Log) -> str:
    """Return the sentence that current and voltage of a log may be exchanged; "" where they do not look so."""
    return next((finding.sentence for finding in log.findings if finding.what == SWAPPED), "")


def _flipped(log: Log, names: Sequence[str]) -> Log:
    for name in names:
        if name in log.columns:
            log = dataclasses.replace(log, columns=log.columns | {name: -log.columns[name]})
            log = log.also(Decision(f"sign of {name}", log.name, "reversed", "stated", "user"))
    return log


def _scaled(log: Log, kind: Kind, options: Options) -> Log:
    """Return a module's log as that of one cell."""
    if kind != "cell":
        return log
    for name, count, how in (
        ("voltage_V", options.cells_in_series, "cells in series"),
        ("current_A", options.parallel_cells, "cells in parallel"),
    ):
        if count > 1 and name in log.columns:
            log = dataclasses.replace(log, columns=log.columns | {name: log.columns[name] / count})
            log = log.also(Decision(name, log.name, f"divided by {count} {how}", "stated", "user"))
    voltage = log.columns.get("voltage_V")
    if voltage is not None and (middle := float(np.nanmedian(voltage))) > 5.0:
        if said := _if_exchanged(log):
            raise MeasurementError(said)
        count = round(middle / 3.65) if middle < 1000.0 else 0
        todo = f"--cells-in-series {count}" if count else "--unit"
        raise MeasurementError(
            f"{file_label(log.source)}: voltage_V has {middle:.4g} V (median), more than one cell; state "
            f"{todo}, or name another "
            "column with --column."
        )
    return log


def _complete(run: Log, kind: Kind, options: Options, listed: Listed | None) -> Log:
    """Return a run with every input of its kind but the ambient temperature, without gaps in them."""
    known = vocabulary(kind, options.load or "", options.servo)
    of_case = {
        name: values
        for name, values in run.columns.items()
        if name in known.columns or name not in (*ROLES[kind], *ONLY_STATED)
    }
    run = dataclasses.replace(run, columns=of_case)
    for name, value in options.constants.items():
        run = dataclasses.replace(run, columns=run.columns | {name: np.full(run.rows, float(value))})
        run = run.also(Decision(name, run.name, f"{value:g} throughout", "stated", "user"))
    for name, value in (listed.inputs if listed is not None else {}).items():
        if name not in run.columns and name != "ambient_degC":
            run = dataclasses.replace(run, columns=run.columns | {name: np.full(run.rows, value)})
            run = run.also(Decision(name, run.name, f"{value:g} throughout", "a list of files states it", "file"))
    groups = [(name,) for name in known.required_inputs if name != "ambient_degC"] + list(known.alternatives)
    for group in groups:
        if not any(name in run.columns for name in group):
            names = " or ".join(group)
            computed = hint_for(group[0], kind, run.header)
            raise MeasurementError(
                f"{file_label(run.source)}: no column is {names}, which a {kind} needs; {columns_of(run.header)}; "
                + (
                    f"{'it may be' if group[0] in ONLY_STATED else 'compute it with'} {computed}, or "
                    if computed
                    else ""
                )
                + f'name it with --column {group[0]}="NAME", or state --constant {group[0]}=VALUE for all of it'
                + (f", or what the load follows with --load {_LAWS}." if LOAD in group else ".")
            )
        present = [name for name in group if name in run.columns]
        for name in present[1:]:
            if name not in known.outputs:  # a robot is driven by duty or by set voltage, not by both
                columns = {key: values for key, values in run.columns.items() if key != name}
                run = dataclasses.replace(run, columns=columns)
        run = fill(run, present[0])
        if LOAD in group and present[0] == "speed_rad_s":
            if not options.load and (options.controller or options.drive == "current"):
                said = "--controller" if options.controller else "--drive current"
                raise MeasurementError(
                    f"{file_label(run.source)}: with {said} the speed is an answer of the model, and nothing tells the "
                    f"load; state what it follows with --load {_LAWS}, or --constant {LOAD}=VALUE for all of it."
                )
            why = "no load torque is measured: the speed drives the model, and its mechanics is not tested"
            run = run.also(Decision("load", run.name, "unknown", why, "user" if options.load else "assumed"))
    drives = {present for group in groups for present in [next(name for name in group if name in run.columns)]}
    if not any(name in run.columns and name not in drives for name in known.outputs):
        if {"current_A", "speed_rad_s"} <= drives and options.load == "unknown":
            return run  # for `jaxmodel torque`
        if {"current_A", "speed_rad_s"} <= drives:
            raise MeasurementError(
                f"{file_label(run.source)} has current and speed, and neither a voltage nor a load torque: nothing is "
                "left that a model could predict. Import it with --load unknown, and `jaxmodel torque` gives its "
                f"torque; or say what the load follows with --load {_LAWS}."
            )
        if "speed_rad_s" in drives and not options.load:
            raise MeasurementError(
                f"{file_label(run.source)} has no load torque, and no reading but the speed, which would drive the "
                f"model in its place; say what the load follows with --load {_LAWS}, or state --constant "
                f"{LOAD}=VALUE for all of it."
            )
        lacking = [name for name in known.outputs if name not in drives]
        driven = f" beside {', '.join(sorted(drives))}, which would drive the model" if drives else ""
        raise MeasurementError(
            f"{file_label(run.source)} has no reading that a {kind} predicts ({', '.join(lacking)}){driven}; "
            f'{columns_of(run.header)}; name one with --column, as --column {lacking[0]}="NAME".'
        )
    for name in known.optional_inputs:
        needs = known.only_with.get(name)
        if name in run.columns and needs is not None and needs not in run.columns:
            columns = {key: values for key, values in run.columns.items() if key != name}
            run = dataclasses.replace(run, columns=columns)
        elif name in run.columns:
            run = fill(run, name)
    return run


def _assembled(
    runs: list[Log],
    kind: Kind,
    options: Options,
    ask: Ask | None,
    listed: dict[str, Listed],
    general: list[Finding | Decision],
) -> Imported:
    """Return runs with ambient temperature, state of charge, label and split, and what the case states."""
    warmed: list[tuple[Log, float | None]] = []
    stated = options.ambient
    of_files = ambients_of(runs, options.ambients)
    contradicted = [] if stated is None else [*contradictions(runs, stated, kind == "cell")]
    for run, of_file in zip(runs, of_files, strict=True):
        of_list = listed.get(run.source.name)
        of_run = stated if of_file is None else of_file
        run, ambient = with_ambient(run, of_run, of_list.ambient_degC if of_list else None)
        if ambient is None and "ambient_degC" not in run.columns:
            question = Question(
                f"At which ambient temperature was {run.name} measured [degC]?", "--ambient DEGC", (), "23"
            )
            if ask is None:
                raise MeasurementError(
                    f"{file_label(run.source)} has no ambient temperature, neither in a column nor in its "
                    "name, and no thermometer; state --ambient DEGC, or that of some files: "
                    f'--ambient "{run.source.stem}*=DEGC".'
                )
            stated = _number(ask(question), question)
            run, ambient = with_ambient(run, stated, None)
        warmed.append((run, ambient))
    cycles = ageing.cycles_of([run for run, _ in warmed]) if kind == "cell" else [None] * len(warmed)
    conditions = [
        dataclasses.replace(condition_of(run, ambient), cycles=number)
        for (run, ambient), number in zip(warmed, cycles, strict=True)
    ]
    splits, why = splits_of_motors([run for run, _ in warmed], conditions, options.check)
    general = [*general, *contradicted, *why]
    capacity, full = None, False
    capacities: dict[str, charge.Stated | None] = {}
    starts: list[charge.Stated | None] = [None] * len(warmed)
    if kind == "cell":
        counts = by_limits(charge.counts([run for run, _ in warmed], [one.ambient_degC for one in conditions]))
        capacity, full = charge.capacity_of(counts, options.capacity_Ah, _of_preset(options.preset))
        first = charge.starts_of(counts, capacity, full)
        general += charge.against_the_log(counts, first, capacity, full)
        of_run = {run.name: pair for (run, _), pair in zip(warmed, zip(cycles, splits, strict=True), strict=True)}
        of_counts = [of_run[count.run.name] for count in counts]
        left, faded = ageing.capacities_of(counts, [number for number, _ in of_counts], [one for _, one in of_counts])
        capacities = {count.run.name: one for count, one in zip(counts, left, strict=True)}
        if not ageing.has_law(cycles, capacity.value):
            conditions = [dataclasses.replace(one, cycles=None) for one in conditions]
        general += ageing.told(cycles, [one.cycles for one in conditions])
        capacity, apart = (ageing.as_aged(capacity, left), faded) if faded else balance.capacities(counts, capacity)
        first, capacity, unbalanced = balance.starts(counts, first, capacity, full)
        general += [*apart, *unbalanced]
        known = {count.run.name: start for count, start in zip(counts, first, strict=True)}
        starts = [known.get(run.name) for run, _ in warmed]
    if kind == "robot":
        starts = [_ROBOT_SOC] * len(warmed)
    if options.initial_soc is not None and kind != "motor":
        starts = [charge.Stated(options.initial_soc, 0.02, "stated")] * len(warmed)
    if several := specimens([run for run, _ in warmed if not run.specimen]):
        general.append(several)
    done = []
    for (run, ambient), condition, start, part in zip(warmed, conditions, starts, splits, strict=True):
        of_list = listed.get(run.source.name)
        label = _label(condition, of_list, None if capacity is None else capacity.value)
        rises = {} if kind == "cell" else warm_start.rises_of(run, ambient)
        run = warm_start.told(run if start is None else charge.told(run, start), rises)
        run = charge.without_estimate(run, options)
        done.append(ImportedRun(run, part, label, ambient, start, condition, rises, capacities.get(run.name)))
    general += _about_capacity(capacity, full, options)
    warmth = [one.ambient_degC for one in done]
    general += odd_units([one.log for one in done], warmth, capacity, full, options)
    general += odd_voltages([one.log for one in done], options) if kind == "motor" else []
    constants = {} if kind != "motor" or options.preset else constants_of([run for run, _ in warmed])
    general += [Decision(n, "", f"{k.value:.4g} ± {k.sd:.2g}", k.why, "assumed") for n, k in constants.items()]
    return Imported(kind, tuple(done), options, capacity, full, constants, tuple(general))


def _label(condition: Condition, listed: Listed | None, capacity_Ah: float | None) -> str:
    if listed is None or not listed.label:
        return condition.words(capacity_Ah)
    warmth = "" if condition.ambient_degC is None else f", {condition.ambient_degC:.3g} degC"
    return f"{listed.label}{warmth}"


def _of_preset(preset: str | None) -> charge.Stated | None:
    """Return the capacity that a preset states; None without a preset, or where it states none."""
    known = read_preset(preset).parameters.get("capacity_Ah") if preset else None
    if known is None:
        return None
    why = f"of the preset '{Path(str(preset)).name}'; no discharge goes from full to the cut-off"
    return charge.Stated(known.value, known.sd or 0.02 * known.value, why)


def _about_capacity(capacity: charge.Stated | None, full: bool, options: Options) -> list[Finding | Decision]:
    if capacity is None:
        return []
    sd = capacity.sd or 0.0
    value = f"{capacity.value:.4g} ± {sd:.{2 if sd < 99.5 else 3}g} A h"
    source = "user" if options.capacity_Ah is not None else "file" if full else "assumed"
    about: list[Finding | Decision] = [Decision("capacity_Ah", "", value, capacity.why, source)]
    if not full and _of_preset(options.preset) is None:
        sentence = f"The capacity is not known ({capacity.why}): state --capacity ({value} is written)."
        about.append(Finding("capacity", "", sentence, "warning"))
    return about


def _number(answer: str, question: Question) -> float:
    try:
        return float(answer.replace(",", "."))
    except ValueError:
        raise MeasurementError(f"'{answer}' is not a number; give {question.option}.") from None
