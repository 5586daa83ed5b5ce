"""A preset of what a parameterisation found: each number with sd and source, and its errors on check runs."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

from jaxmodel.base import toml
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.schema import with_schema
from jaxmodel.case.presets import PresetForm, read_form
from jaxmodel.case.writing import table_entry
from jaxmodel.effects.controllers import SERVO
from jaxmodel.effects.loads import LAW_EFFECTS
from jaxmodel.parameterisation.result import Parameterisation

KINDS = {"cell": ["cell", "robot"], "motor": ["motor"], "robot": ["robot"]}
# Effects that a case states and that no data find.
STATED = LAW_EFFECTS | SERVO.keys()
_REFIT = "joint refit of all curves"


def write_preset(found: Parameterisation, path: Path, data: str, licence: str) -> None:
    """Write a preset in the form of those of `jaxmodel.case.presets`.

    Args:
        found: with at least one check run: a preset states its errors on runs that it was not made from.
        path: of the TOML file; its stem is the name of the preset.
        data: where the measurements are from.
        licence: of the measurements.

    Raises:
        MeasurementError: the name cannot be one of a preset, or no run is held out.
    """
    checked_name(path.stem)
    case = found.case
    held_out = _held_out(found, "".join(f", with {name}" for name in case.effects))
    if case.effects.keys() - STATED:
        held_out = _held_out(_without_effects(found), "") + held_out
    if not held_out:
        raise MeasurementError(
            f"{case.label}: no run is held out, and a preset states its errors on such runs; "
            'set split = "check" for one.'
        )
    fitted = ", ".join(run.name for run in case.runs if run.split == "fit")
    content: dict[str, Any] = {"title": case.title, "kinds": KINDS[case.kind], "data": data, "licence": licence}
    content["parameters"] = {name: _entry(found, name) for name in case.parameters}
    for name, table in case.tables.items():
        content["parameters"][name] = {"source": f"{_REFIT} of {fitted}"} | table_entry(name, table)
    content["held_out"] = held_out
    PresetForm.model_validate(content)
    head = ["Made by jaxmodel parameterise; do not edit.", f"Made from: {fitted}."]
    for name, values in case.effects.items():
        numbers = ", ".join(f"{key} = {toml.value(one)}" for key, one in values.items())
        head.append(f"The numbers are those of a model with [effects] {name} = {{ {numbers} }}; add it.")
    head += [f"not identified: {one.name}; {one.method}." for one in found.extractions if not one.found]
    lines = "".join(f"# {line}\n" for line in head)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, lines + toml.document(with_schema(content)))


def _held_out(found: Parameterisation, added: str) -> list[dict[str, Any]]:
    """Return the errors of the check runs; `added` is said after their names."""
    return [
        {"run": f"{row['run']}{added}", "column": str(row["reading"]), "rms": _short(float(row["rms"]))}
        for row in found.errors.to_dict("records")
        if row["split"] == "check"
    ]


def _without_effects(found: Parameterisation) -> Parameterisation:
    """Return the numbers in a case without the effects that they were found with: what the preset alone is.

    The law of a load that is not measured stays, and so does a controller: without them there is nothing to compare.
    """
    runs = tuple(
        dataclasses.replace(run, overrides={n: k for n, k in run.overrides.items() if n != "initial_hysteresis"})
        for run in found.case.runs
    )
    effects = {name: values for name, values in found.case.effects.items() if name in STATED}
    effect_sd = {name: values for name, values in found.case.effect_sd.items() if name in STATED}
    case = dataclasses.replace(found.case, effects=effects, effect_sd=effect_sd, runs=runs)
    return dataclasses.replace(found, case=case)


def checked_name(name: str) -> str:
    """Return a name that a preset can have.

    Raises:
        MeasurementError: it cannot.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise MeasurementError(f"preset: '{name}' is no name; use small letters, digits and '_'.")
    return name


def _entry(found: Parameterisation, name: str) -> dict[str, Any]:
    """Return value, sd and source of a parameter."""
    known = found.case.parameters[name]
    preset = found.case.preset
    kept = None if preset == "paper" else (read_form(preset).parameters.__pydantic_extra__ or {}).get(name)
    if kept is not None and (kept.value, kept.sd) == (known.value, known.sd):
        return kept.model_dump(exclude_none=True)
    extracted = next((one for one in found.extractions if one.name == name), None)
    if extracted is not None and not extracted.found:
        source = extracted.method
    elif extracted is not None:
        source = f"{extracted.method}, from {', '.join(extracted.runs)}"
    elif name in ("cycles", "storage_months"):
        source = "the numbers are of the hardware as it was measured, age included"
    elif name == "nominal_cell_voltage_V":
        source = "mean of ocv over SOC"
    elif name.endswith("_scale"):
        source = f"{_REFIT}; sd: that of the mean of the curve"
    else:
        source = "stated in the case"
    return {"value": known.value} | ({} if known.sd is None else {"sd": _short(known.sd)}) | {"source": source}


def _short(value: float) -> float:
    return float(f"{value:.3g}")
