"""Several like pieces of hardware in one case, such as left and right motor: what each has of its own."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from jaxmodel.base.errors import MeasurementError, instead
from jaxmodel.case.forms import EffectEntry, SpecimenEntry
from jaxmodel.case.known import Known, Specimen, scalars
from jaxmodel.case.records import Case, Run
from jaxmodel.effects.differences import DIFFERENCES
from jaxmodel.model.declaration import describe

# Names of places on a vehicle, which stand before the word.
_SIDE = re.compile(r"(^|_)(left|right|front|rear|back|middle)(_|$)")


def specimens_of(entries: Mapping[str, SpecimenEntry], named: Sequence[str], where: str) -> dict[str, Specimen]:
    """Return the specimens of a case by name, those without anything of their own too.

    Args:
        entries: `[specimens]` of the case.
        named: the specimen of each run, "" for none.
        where: file, for messages.

    Raises:
        MeasurementError: no run is of a specimen, or only some runs say of which they are.
        ParameterError: a parameter is unknown or outside its bounds.
        EffectError: a difference is unknown, or lacks its column.
    """
    names = [name for name in dict.fromkeys(named) if name]
    for name in entries:
        if name not in names:
            raise MeasurementError(
                f'{where}: specimens.{name} is of no run; write specimen = "{name}" in the [[runs]] that were '
                f"measured on it.{instead(name, names)}"
            )
    if names and "" in named:
        raise MeasurementError(
            f"{where}: some runs state their specimen and others do not; state it in each of [[runs]], or in none."
        )
    return {name: _specimen(entries.get(name, SpecimenEntry()), f"{where}: specimens.{name}") for name in names}


def _specimen(entry: SpecimenEntry, where: str) -> Specimen:
    for name, effect in entry.effects.items():
        if name not in DIFFERENCES:
            raise MeasurementError(f"{where}.effects knows no '{name}'.{instead(name, DIFFERENCES)}")
        _check(name, effect, where)
    return Specimen(
        scalars(entry.__pydantic_extra__ or {}, where),
        {name: _values(effect) for name, effect in entry.effects.items()},
        {name: sd for name, effect in entry.effects.items() if (sd := _sd(effect))},
    )


def _check(name: str, effect: EffectEntry, where: str) -> None:
    table = describe(DIFFERENCES[name])
    for field, known in effect.__pydantic_extra__.items():
        if field not in table:
            raise MeasurementError(f"{where}: '{name}' has no parameter '{field}'.{instead(field, table)}")
        table[field].check(known.value, f"{where}, '{name}'")


def _values(entry: EffectEntry) -> dict[str, float | str]:
    column: dict[str, float | str] = {} if entry.column is None else {"column": entry.column}
    return column | {name: known.value for name, known in entry.__pydantic_extra__.items()}


def _sd(entry: EffectEntry) -> dict[str, float]:
    return {name: known.sd for name, known in entry.__pydantic_extra__.items() if known.sd is not None}


def runs_of(case: Case, specimen: str) -> tuple[int, ...]:
    """Return the numbers of the runs of one specimen."""
    return tuple(number for number, run in enumerate(case.runs) if run.specimen == specimen)


def together(name: str, specimen: str) -> str:
    """Return what runs of several specimens that were logged together have in common: their name without the specimen.

    Args:
        name: of a run, as 'ride_left'.
        specimen: of the run, as 'left'.
    """
    before, mark, after = name.rpartition(f"_{specimen}") if specimen else ("", "", name)
    return f"{before}{after}" if mark else name


def in_words(kind: str, specimen: str) -> str:
    """Return what a sentence calls a specimen: 'the left motor', 'motor 2', 'cell B07'."""
    if kind in specimen:
        return re.sub(rf"({kind})[ _-]?(?=\d)", r"\1 ", specimen)
    if _SIDE.search(specimen):
        return f"the {specimen.replace('_', ' ')} {kind}"
    return f"{kind} {specimen}"


def own_parameters(case: Case, run: Run | None) -> dict[str, Known]:
    """Return the parameters that a run's specimen has of its own."""
    specimen = None if run is None else case.specimens.get(run.specimen)
    return {} if specimen is None else specimen.parameters


def difference_label(name: str, values: Mapping[str, Any]) -> str:
    """Return what tells a difference from others: its name, and its column where it has one."""
    return f"{name}:{values['column']}" if values.get("column") else name


def differences(case: Case, run: Run | None) -> list[tuple[str, dict[str, float | str]]]:
    """Return name and numbers of every difference that some specimen states: in runs of another it is at its null.

    So the models of all runs have the same effects, in the same order.
    """
    own = case.specimens.get(run.specimen) if run is not None else None
    found: dict[str, tuple[str, dict[str, float | str]]] = {}
    for specimen in case.specimens.values():
        for name, values in specimen.effects.items():
            label = difference_label(name, values)
            absent: dict[str, float | str] = {
                field: float(info.null or 0.0) for field, info in describe(DIFFERENCES[name]).items()
            }
            column = {"column": values["column"]} if "column" in values else {}
            found.setdefault(label, (name, column | absent))
            if specimen is own:
                found[label] = (name, dict(values))
    return list(found.values())


def stated_differences(case: Case) -> set[str]:
    """Return the labels of the differences that some specimen of a case states."""
    return {difference_label(*one) for one in differences(case, None)}


def specimen_entry(specimen: Specimen) -> dict[str, Any]:
    """Return what `[specimens.NAME]` holds of one specimen."""
    entry: dict[str, Any] = {name: _known(known.value, known.sd) for name, known in specimen.parameters.items()}
    effects = {
        name: {
            field: value if isinstance(value, str) else _known(value, specimen.effect_sd.get(name, {}).get(field))
            for field, value in values.items()
        }
        for name, values in specimen.effects.items()
    }
    return entry | ({"effects": effects} if effects else {})


def _known(value: float, sd: float | None) -> float | dict[str, float]:
    return value if sd is None else {"value": value, "sd": sd}
