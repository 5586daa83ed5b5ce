"""The case that a diagnosis ends with: calibrated numbers, added effects, ready for every other command."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

from discrepancy.result import Diagnosis, Estimate
from jaxmodel.case_schema import parse_case
from jaxmodel.cases import Case, Known, Run, Table
from workbench import toml

_VALUE_KEYS = {"ocv": "voltage_V", "R_ints": "ohm", "R_TS": "ohm", "R_TL": "ohm", "C_TS": "farad", "C_TL": "farad"}


def extended_case(diagnosis: Diagnosis) -> Case:
    """Return the case with the final model's numbers, known exactly, and its effects.

    Two faults of one kind on two columns have one name in a case file: of those only the first is kept, see `left_out`.
    """
    case, estimates = diagnosis.case, diagnosis.final.estimates
    effects = dict(case.effects)
    for label in diagnosis.final.added:
        name, _, column = label.partition(":")
        if name not in effects:
            effects[name] = _values(label, estimates) | ({"column": column} if column else {})
    return dataclasses.replace(
        case,
        parameters={name: _fitted(name, known, estimates) for name, known in case.parameters.items()},
        effects=effects,
        runs=tuple(_with_fitted_start(run, estimates) for run in case.runs),
    )


def left_out(diagnosis: Diagnosis) -> list[str]:
    """Return the labels of effects that a case file cannot hold beside another of the same name."""
    seen: dict[str, str] = {name: name for name in diagnosis.case.effects}
    return [label for label in diagnosis.final.added if seen.setdefault(label.partition(":")[0], label) != label]


def _values(label: str, estimates: dict[str, Estimate]) -> dict[str, float | str]:
    prefix = f"{label}."
    return {name.removeprefix(prefix): e.value for name, e in estimates.items() if name.startswith(prefix)}


def _fitted(name: str, known: Known, estimates: dict[str, Estimate]) -> Known:
    return Known(estimates[name].value) if name in estimates else Known(known.value)


def _with_fitted_start(run: Run, estimates: dict[str, Estimate]) -> Run:
    def of_run(name: str, known: Known) -> Known:
        return _fitted(f"{name}[{run.name}]", known, estimates)

    overrides = {name: of_run(name, known) for name, known in run.overrides.items()}
    return dataclasses.replace(run, initial_soc=of_run("initial_soc", run.initial_soc), overrides=overrides)


def write_case(case: Case, path: Path, comments: list[str] | None = None) -> None:
    """Write a case as a TOML file that `read_case` takes; its runs' files are named from the new file's folder.

    Args:
        case: whose `path` is the file it was read from.
        path: the new file.
        comments: lines to stand on top.
    """
    # A run's constant ambient temperature is in the case file alone, and read_case has made a column of it.
    entries = parse_case(case.path.read_text(encoding="utf-8"), case.path.name).runs
    constants = [{} if e.ambient_degC is None else {"ambient_degC": e.ambient_degC} for e in entries]
    soc = [{} if case.kind == "motor" else {"initial_soc": run.initial_soc.value} for run in case.runs]
    content: dict[str, Any] = {"title": case.title, "kind": case.kind, "preset": case.preset}
    content["parameters"] = {name: known.value for name, known in case.parameters.items()}
    content["parameters"] |= {name: _table(name, table) for name, table in case.tables.items()}
    content |= {name: t for name in ("effects", "sensors", "cutoff") if (t := getattr(case, name))}
    content["runs"] = [
        {"file": _from(path, run.source), "split": run.split, "label": run.label}
        | start
        | constant
        | {name: known.value for name, known in run.overrides.items()}
        for run, start, constant in zip(case.runs, soc, constants, strict=True)
    ]
    head = "".join(f"# {line}\n" for line in comments or [])
    path.write_text(head + toml.document(content), encoding="utf-8")


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
