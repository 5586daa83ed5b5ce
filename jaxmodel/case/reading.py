"""Cases from files (case.toml and one CSV per run) and from DataFrames, read and checked by the same rules."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jaxmodel import effects
from jaxmodel.base.errors import MeasurementError, ParameterError, instead, nearest
from jaxmodel.case import plausible
from jaxmodel.case.brushless import armature
from jaxmodel.case.build import case_model, with_preset
from jaxmodel.case.entries import entry_of
from jaxmodel.case.forms import CaseEntry, EffectEntry, RunEntry, ToleranceEntry, parse_case
from jaxmodel.case.known import Known, Tolerance, motor_tables, scalars, tables
from jaxmodel.case.load import stated_load, with_law
from jaxmodel.case.measurements import (
    AMBIENT_RANGE_DEGC,
    Kind,
    Measured,
    Servo,
    file_label,
    measurements_of,
    read_measurements,
    read_utf8,
    vocabulary,
)
from jaxmodel.case.presets import located, why_not
from jaxmodel.case.records import Case, Run
from jaxmodel.case.servo import refuse_driven_speed, stated_servo
from jaxmodel.case.specimens import specimens_of
from jaxmodel.model.ports import Effect


def read_case(path: str | Path, *, own_effects: Iterable[type[Effect]] = ()) -> Case:
    """Read a case and all its runs.

    Args:
        path: a folder with a `case.toml`, or a TOML file of that form; CSV paths are relative to the TOML file.
        own_effects: your own effect classes, used like those of the catalogue.

    Raises:
        MeasurementError: a file is missing or cannot be used as it is, or a column is in another unit; the message
            says where and what to do.
        ParameterError: a parameter is unknown, out of its bounds or of the wrong form.

    Example:
        >>> from jaxmodel import read_case
        >>> read_case("examples/samsung_30q")
        <Case samsung_30q: cell, 3 fit and 1 check runs>
    """
    toml = _toml_file(Path(path))
    where = file_label(toml)
    entry = parse_case(read_utf8(toml), where)

    files = _files(entry.runs, toml, where)
    sources = {run.file: file for run, file in zip(entry.runs, files, strict=True)}

    def measured(run: RunEntry, load: str, servo: Servo) -> Measured:
        return read_measurements(sources[run.file], entry.kind, run.ambient_degC, load, servo)

    return _case(entry, toml.parent.name, toml, where, files, measured, own_effects)


def case_of_frames(
    frames: Mapping[Any, pd.DataFrame],
    name: str,
    check: Collection[Any],
    runs: Mapping[Any, Mapping[str, Any]],
    stated: Mapping[str, Any],
    own_effects: Iterable[type[Effect]] = (),
) -> Case:
    """Return a case of one DataFrame per run, as `Case.from_dataframes`; `stated` are the tables of case.toml.

    Raises:
        MeasurementError: a table or entry cannot be used; the message says where and what to do.
        ParameterError: a parameter is unknown, out of its bounds or of the wrong form.
    """
    where = f"case '{name}'"
    if not isinstance(frames, Mapping):
        raise MeasurementError(f"{where}: give a dict of one DataFrame for each run, by the name of the run.")
    frames = {str(run): frame for run, frame in frames.items()}
    entry = entry_of(where, frames, check, runs, **stated)

    def measured(run: RunEntry, load: str, servo: Servo) -> Measured:
        label = f"{where}, run '{run.file}'"
        return measurements_of(frames[run.file], entry.kind, run.ambient_degC, label, load, servo)

    case = _case(entry, name, None, where, [None] * len(entry.runs), measured, own_effects)
    for run in case.runs:
        case_model(case, run)  # an unknown preset or effect is refused here, and not when it is first used
    return case


def _case(
    entry: CaseEntry,
    name: str,
    path: Path | None,
    where: str,
    sources: Sequence[Path | None],
    measured: Callable[[RunEntry, str, Servo], Measured],
    own: Iterable[type[Effect]],
) -> Case:
    """Return the case of a checked form.

    Args:
        entry: the form.
        name: of the case.
        path: of its file.
        where: its name in messages.
        sources: the CSV of each run.
        measured: returns the readings of a run, under what the case says of its load and drive.
        own: the user's own effect classes.
    """
    numbers = scalars(entry.parameters.__pydantic_extra__, f"{where}: [parameters]")
    numbers |= armature(entry.brushless, entry.kind, numbers, where)
    default_soc = numbers.pop("initial_soc", Known(1.0))
    load = stated_load(entry.load, entry.effects, entry.kind, where)
    servo = stated_servo(entry.drive, entry.controller, entry.effects, entry.kind, load, where)
    known = vocabulary(entry.kind, load, servo)
    _check_sensors(entry.sensors, entry.kind, known, where)
    runs = tuple(
        run_of(
            run,
            file,
            entry.kind,
            known,
            default_soc,
            functools.partial(measured, run, load, servo),
            f"{where}, the run of {run.file}: runs[{number}]",
        )
        for number, (run, file) in enumerate(zip(entry.runs, sources, strict=True), start=1)
    )
    refuse_driven_speed(servo, runs, where)
    case = Case(
        name=name,
        path=path,
        title=entry.title or name,
        kind=entry.kind,
        preset=located(entry.preset, Path() if path is None else path.parent),
        parameters=numbers,
        tables=tables(entry.parameters),
        effects={name: _effect_values(effect) for name, effect in entry.effects.items()},
        sensors=dict(entry.sensors),
        runs=runs,
        cutoff=entry.cutoff.model_dump(exclude_none=True),
        tolerance=_tolerance(entry.tolerance, entry.kind, known, f"{where}: [tolerance]"),
        effect_sd={name: sd for name, effect in entry.effects.items() if (sd := _effect_sd(effect))},
        own_effects=effects.own_effects(own),
        motor_tables=motor_tables(entry.parameters),
        load=load,
        servo=servo,
        brushless=entry.brushless.current if entry.brushless else "",
        specimens=specimens_of(entry.specimens, [run.specimen for run in entry.runs], where),
    )
    # An unknown preset is refused when a model is built; reading the measurements needs none.
    case = with_law(case if why_not(case.preset, case.kind) else with_preset(case))
    plausible.check(case)
    return case


def _toml_file(path: Path) -> Path:
    """Return the TOML file of a path to a folder or file."""
    toml = path / "case.toml" if os.path.isdir(path) else path
    if not os.path.isfile(toml):  # where a name is too long or a link leads to itself, methods of `Path` raise
        raise MeasurementError(
            f"There is no {file_label(toml)}; give a folder that has a case.toml, or the TOML file itself."
        )
    if toml.suffix != ".toml":
        raise MeasurementError(f"{file_label(toml)} is not a TOML file; give the case.toml that lists this run.")
    real = Path(os.path.realpath(path))
    return real / toml.name if os.path.isdir(path) else real


def run_of(
    entry: RunEntry,
    file: Path | None,
    kind: str,
    known: Kind,
    default_soc: Known,
    measured: Callable[[], Measured],
    where: str,
) -> Run:
    """Return one run with its readings.

    Args:
        entry: the form of the run.
        file: its CSV; None for a table in memory.
        kind: of the case.
        known: the columns that its runs may have.
        default_soc: the state of charge at its start, if it states none.
        measured: returns its readings.
        where: its name in messages.

    Raises:
        MeasurementError: as `measured`, or a tolerance is of no reading.
        ParameterError: a parameter is unknown, out of its bounds or of the wrong form.
    """
    stated_soc = {} if entry.initial_soc is None else {"initial_soc": entry.initial_soc}
    return Run(
        name=entry.file if file is None else file.stem,
        file=entry.file,
        split=entry.split,
        label=entry.label,
        initial_soc=scalars(stated_soc, where).get("initial_soc", default_soc),
        overrides=scalars(entry.__pydantic_extra__, where),
        measured=measured(),
        source=file,
        initial_cell_temperature=_initial_cell_temperature(entry, kind, where),
        tolerance=_tolerance(entry.tolerance, kind, known, f"{where}.tolerance"),
        ambient_degC=entry.ambient_degC,
        specimen=entry.specimen,
    )


def _initial_cell_temperature(entry: RunEntry, kind: str, where: str) -> Known | None:
    """Return the cell's temperature at the first row, in degC; raise ParameterError if it is invalid."""
    stated = entry.initial_cell_temperature_degC
    if stated is None:
        return None
    name = f"'initial_cell_temperature_degC' = {stated.value:g}"
    if kind == "motor":
        raise ParameterError(f"{where}: {name}, but a motor has no cell; remove it, or state 'initial_case_rise_K'.")
    if "initial_temperature_rise_K" in (entry.__pydantic_extra__ or {}):
        raise ParameterError(
            f"{where}: {name}, but 'initial_temperature_rise_K' states the same quantity; keep one of them."
        )
    coldest, warmest = AMBIENT_RANGE_DEGC
    if not coldest <= stated.value <= warmest:
        raise ParameterError(
            f"{where}: {name} is outside {coldest:g} to {warmest:g}; temperatures are in degC: "
            "if this is kelvin, subtract 273.15."
        )
    return Known(stated.value, stated.sd)


def _effect_values(entry: EffectEntry) -> dict[str, float | str]:
    """Return an effect's parameters by name, and its column if it has one."""
    column: dict[str, float | str] = {} if entry.column is None else {"column": entry.column}
    return column | {name: known.value for name, known in entry.__pydantic_extra__.items()}


def _effect_sd(entry: EffectEntry) -> dict[str, float]:
    """Return the sd of those parameters of an effect that are not exact."""
    return {name: known.sd for name, known in entry.__pydantic_extra__.items() if known.sd is not None}


def _tolerance(entries: Mapping[str, ToleranceEntry], kind: str, known: Kind, where: str) -> dict[str, Tolerance]:
    """Return the tolerances by column; raise MeasurementError for a column that this kind cannot read."""
    readings = known.outputs
    for name in entries:
        if name not in readings:
            raise MeasurementError(f"{where}: a {kind} has no reading '{name}'.{instead(name, readings)}")
    return {name: Tolerance(entry.rms, entry.max) for name, entry in entries.items()}


def _check_sensors(sensors: Mapping[str, float], kind: str, known: Kind, where: str) -> None:
    """Raise MeasurementError for a sensor whose column this kind does not have."""
    columns = known.columns
    for name in sensors:
        if name not in columns:
            raise MeasurementError(f"{where}: [sensors]: a {kind} has no column '{name}'.{instead(name, columns)}")


def _files(runs: list[RunEntry], toml: Path, where: str) -> list[Path]:
    """Return the path of each run's CSV: it exists, and no two runs have the same name."""
    files: list[Path] = []
    for number, run in enumerate(runs, start=1):
        file = Path(os.path.realpath(toml.parent / run.file))
        if not os.path.isfile(file):
            hint = nearest(run.file, (other.name for other in toml.parent.glob("*.csv")))
            raise MeasurementError(
                f"{where}: runs[{number}].file: there is no '{run.file}' next to {toml.name};"
                f" correct the name or add the file.{hint}"
            )
        for earlier, other in enumerate(files, start=1):
            if other.stem == file.stem:
                raise MeasurementError(
                    f"{where}: runs[{earlier}].file and runs[{number}].file are both '{file.stem}'; "
                    "a run is named after its file, so list each file once, and give files different names."
                )
        files.append(file)
    return files
