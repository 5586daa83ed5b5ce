"""The case that a diagnosis ends with: calibrated numbers, added effects, ready for every other command."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from discrepancy.result import Diagnosis
from jaxmodel.case_schema import parse_case
from jaxmodel.cases import Case, Known, Run, Table
from jaxmodel.declaration import ParameterInfo, describe
from jaxmodel.effects import CATALOGUE
from jaxmodel.measurements import read_utf8
from jaxmodel.parameters import info
from jaxmodel.ports import Effect
from workbench import toml

_VALUE_KEYS = {"ocv": "voltage_V", "R_ints": "ohm", "R_TS": "ohm", "R_TL": "ohm", "C_TS": "farad", "C_TL": "farad"}


def extended_case(diagnosis: Diagnosis, catalogue: Mapping[str, type[Effect]] = CATALOGUE) -> tuple[Case, list[str]]:
    """Return the case with the final model's numbers and their sd, and its effects; and what of them it cannot hold.

    A wrong model may fit numbers beyond the bounds of their table: these are moved to the bound. Two faults of one kind
    on two columns have one name in a case file: the first is kept. Both are said in the second result.
    """
    case, estimates, notes = diagnosis.case, diagnosis.final.estimates, []

    def fitted(name: str, number: float, entry: ParameterInfo) -> float:
        value = estimates[name].value if name in estimates else number
        bounded = min(max(value, entry.lower), entry.upper)
        if bounded != value:
            notes.append(f"{name} was fitted as {value:g}, which is outside its range; here it is {bounded:g}.")
        return bounded

    def known_now(name: str, before: Known, entry: ParameterInfo) -> Known:
        return Known(fitted(name, before.value, entry), estimates[name].sd if name in estimates else before.sd)

    def of_run(run: Run) -> Run:
        known = run.overrides | {"initial_soc": run.initial_soc}
        values = {name: known_now(f"{name}[{run.name}]", before, info(name)) for name, before in known.items()}
        return dataclasses.replace(run, initial_soc=values.pop("initial_soc"), overrides=values)

    effects = dict(case.effects)
    for label in diagnosis.final.added:
        name, _, column = label.partition(":")
        if name in effects:
            notes.append(f"{label} is left out: a case file holds one effect of a name.")
            continue
        table = describe(catalogue[name])
        fields = [field for field in table if f"{label}.{field}" in estimates]
        effects[name] = {field: fitted(f"{label}.{field}", 0.0, table[field]) for field in fields}
        effects[name] |= {"column": column} if column else {}
    parameters = {name: known_now(name, before, info(name)) for name, before in case.parameters.items()}
    runs = tuple(of_run(run) for run in case.runs)
    return dataclasses.replace(case, parameters=parameters, effects=effects, runs=runs), notes


def write_case(case: Case, path: Path, comments: list[str] | None = None) -> None:
    """Write a case as a TOML file that `read_case` takes; its runs' files are named from the new file's folder.

    Args:
        case: whose `path` is the file it was read from.
        path: the new file.
        comments: lines to stand on top.
    """
    # A run's constant ambient temperature is in the case file alone, and read_case has made a column of it.
    entries = parse_case(read_utf8(case.path), case.path.name).runs
    constants = [{} if e.ambient_degC is None else {"ambient_degC": e.ambient_degC} for e in entries]
    soc = [{} if case.kind == "motor" else {"initial_soc": _known(run.initial_soc)} for run in case.runs]
    content: dict[str, Any] = {"title": case.title, "kind": case.kind, "preset": case.preset}
    content["parameters"] = {name: _known(known) for name, known in case.parameters.items()}
    content["parameters"] |= {name: _table(name, table) for name, table in case.tables.items()}
    content |= {name: t for name in ("effects", "sensors", "cutoff") if (t := getattr(case, name))}
    content["runs"] = [
        {"file": _from(path, run.source), "split": run.split, "label": run.label}
        | start
        | constant
        | {name: _known(known) for name, known in run.overrides.items()}
        for run, start, constant in zip(case.runs, soc, constants, strict=True)
    ]
    head = "".join(f"# {line}\n" for line in comments or [])
    path.write_text(head + toml.document(content), encoding="utf-8")


def _known(known: Known) -> float | dict[str, float]:
    return known.value if known.sd is None else {"value": known.value, "sd": known.sd}


def _table(name: str, table: Table) -> dict[str, Any]:
    entry: dict[str, Any] = {"soc": table.soc.tolist()}
    if table.temperature_degC is not None:
        entry["temperature_degC"] = table.temperature_degC.tolist()
    return entry | {_VALUE_KEYS[name]: table.values.tolist()}


def _from(path: Path, file: Path) -> str:
    """Return a file as seen from another's folder; as it is where there is no way between them (another drive)."""
    try:
        return Path(os.path.relpath(file, path.resolve().parent)).as_posix()
    except ValueError:
        return file.as_posix()
