"""Writing a case as a TOML file that `read_case` takes."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxmodel.base import toml
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError, UserError
from jaxmodel.base.schema import with_schema
from jaxmodel.case import plausible
from jaxmodel.case.build import with_preset
from jaxmodel.case.forms import CELL_TABLES, MOTOR_TABLES, CurveEntry, parse_case
from jaxmodel.case.known import Known, MotorTable, Table, Tolerance, scalars
from jaxmodel.case.measurements import file_label
from jaxmodel.case.presets import why_not
from jaxmodel.case.records import Case, Run
from jaxmodel.case.specimens import specimen_entry


def write_case(case: Case, path: Path, comments: list[str] | None = None) -> None:
    """Write a case as a TOML file that `read_case` takes; paths of its runs are relative to the new file's folder.

    Args:
        case: from files or DataFrames; for a run without a file, a CSV is written next to the TOML file.
        path: the new file.
        comments: lines at the top.

    Raises:
        MeasurementError: `read_case` would refuse it; nothing is written.
    """
    files = [run.source or path.parent / f"{_file_name(run.name)}.csv" for run in case.runs]
    document = toml.document(with_schema(_content(case, path, files)))
    _read_back(document, file_label(path))
    for run, file in zip(case.runs, files, strict=True):
        if run.source is None:
            _write_csv(run, file)
    head = "".join(f"# {line}\n" for line in comments or [])
    write_whole(path, head + document)


def _content(case: Case, path: Path, files: list[Path]) -> dict[str, Any]:
    """Return what the TOML file of a case holds, with the CSV of each run."""
    content: dict[str, Any] = {"title": case.title, "kind": case.kind} | ({"load": case.load} if case.load else {})
    content |= {name: said for name, said in case.servo._asdict().items() if said}
    content |= {"brushless": {"current": case.brushless}} if case.brushless else {}
    content["preset"] = preset_entry(case.preset, path)
    content["parameters"] = {name: _known(known) for name, known in case.parameters.items()}
    content["parameters"] |= {name: table_entry(name, table) for name, table in case.tables.items()}
    content["parameters"] |= {name: _motor_table(name, table) for name, table in case.motor_tables.items()}
    content["effects"] = {name: _effect(values, case.effect_sd.get(name, {})) for name, values in case.effects.items()}
    content |= {"sensors": case.sensors, "tolerance": _tolerances(case.tolerance), "cutoff": case.cutoff}
    content["specimens"] = {name: own for name, one in case.specimens.items() if (own := specimen_entry(one))}
    content = {name: entry for name, entry in content.items() if entry or name in ("title", "parameters")}
    content["runs"] = [
        {"file": _from(path, file), "split": run.split, "label": run.label}
        | ({"specimen": run.specimen} if run.specimen else {})
        | ({} if case.kind == "motor" else {"initial_soc": _known(run.initial_soc)})
        | ({} if run.ambient_degC is None else {"ambient_degC": run.ambient_degC})
        | _stated_of(run)
        | {name: _known(known) for name, known in run.overrides.items()}
        for run, file in zip(case.runs, files, strict=True)
    ]
    return content


def _read_back(document: str, where: str) -> None:
    """Refuse to write what `read_case` would refuse.

    Raises:
        MeasurementError: a value or table is none that a case may have.
    """
    try:
        entry = parse_case(document, where)
        scalars(entry.parameters.__pydantic_extra__ or {}, f"{where}: [parameters]")
        for run in entry.runs:
            scalars(run.__pydantic_extra__ or {}, f"{where}, the run of {run.file}")
    except UserError as error:
        raise MeasurementError(f"{where} is not written, because it could not be read again: {error}") from error


def write_folder(case: Case, folder: Path) -> Path:
    """Write a case as a folder: `case.toml` and a CSV for each run; return the TOML file.

    Raises:
        MeasurementError: the folder is the one that the case was read from, or `read_case` would refuse the case.
    """
    toml_file = folder / "case.toml"
    if any(file.resolve().parent == folder.resolve() for file in case.files):
        raise MeasurementError(f"{folder}: the case was read from this folder; give another one.")
    plausible.check(case if why_not(case.preset, case.kind) else with_preset(case))  # as `read_case` does
    folder.mkdir(parents=True, exist_ok=True)
    toml_file.unlink(missing_ok=True)  # until its runs are written, the folder is no case
    write_case(dataclasses.replace(case, runs=tuple(dataclasses.replace(r, source=None) for r in case.runs)), toml_file)
    return toml_file


def _write_csv(run: Run, file: Path) -> None:
    table = run.to_dataframe()
    table = table.drop(columns=[] if run.ambient_degC is None else "ambient_degC")
    write_whole(file, table.to_csv(index=False))


def _file_name(name: str) -> str:
    """Return a run's name as a valid file name."""
    return re.sub(r"[^\w.+-]+", "_", name).strip(".") or "run"


def _motor_table(name: str, table: MotorTable) -> dict[str, Any]:
    form = MOTOR_TABLES[name]
    return {form.over_key: table.at.tolist()} | _values(form, table)


def _values(form: type[CurveEntry], table: Table | MotorTable) -> dict[str, Any]:
    return {form.value_key: table.values.tolist()} | ({} if table.sd is None else {form.sd_key: table.sd})


def _stated_of(run: Run) -> dict[str, Any]:
    stated: dict[str, Any] = {}
    if run.initial_cell_temperature is not None:
        stated["initial_cell_temperature_degC"] = _known(run.initial_cell_temperature)
    if run.tolerance:
        stated["tolerance"] = _tolerances(run.tolerance)
    return stated


def _known(known: Known) -> float | dict[str, float]:
    return known.value if known.sd is None else {"value": known.value, "sd": known.sd}


def _effect(values: Mapping[str, float | str], sd: Mapping[str, float]) -> dict[str, Any]:
    return {name: {"value": value, "sd": sd[name]} if name in sd else value for name, value in values.items()}


def _tolerances(tolerances: Mapping[str, Tolerance]) -> dict[str, Any]:
    return {name: one.rms if one.max is None else {"rms": one.rms, "max": one.max} for name, one in tolerances.items()}


def table_entry(name: str, table: Table) -> dict[str, Any]:
    """Return a table as `[parameters]` holds it."""
    entry: dict[str, Any] = {"soc": table.soc.tolist()}
    if table.temperature_degC is not None:
        entry["temperature_degC"] = table.temperature_degC.tolist()
    return entry | _values(CELL_TABLES[name], table)


def preset_entry(preset: str, path: Path) -> str:
    """Return a preset as a case's file states it: its name, or the path of its file from the folder of the case."""
    return _from(path, Path(preset)) if preset.endswith(".toml") else preset


def _from(path: Path, file: Path) -> str:
    """Return a path relative to another file's folder; unchanged if there is none (another drive)."""
    try:
        return Path(os.path.relpath(file, path.resolve().parent)).as_posix()
    except ValueError:
        return file.as_posix()
