"""The numbers of a parameterised case to the digits that a person reads; what a case states as exact is left."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from jaxmodel.case.known import Known, Table
from jaxmodel.case.records import Case, Run

DIGITS, SD_DIGITS = 6, 3


def rounded(case: Case) -> Case:
    """Return a case whose uncertain numbers have `DIGITS` significant digits, and their sd `SD_DIGITS`."""
    sd = case.effect_sd
    return dataclasses.replace(
        case,
        parameters=_knowns(case.parameters),
        tables={name: _table(table) for name, table in case.tables.items()},
        effects={
            name: {
                key: value if key not in sd.get(name, {}) else _to(float(value), DIGITS) for key, value in one.items()
            }
            for name, one in case.effects.items()
        },
        effect_sd={name: {key: _to(value, SD_DIGITS) for key, value in one.items()} for name, one in sd.items()},
        sensors={name: _to(value, SD_DIGITS) for name, value in case.sensors.items()},
        runs=tuple(_run(run) for run in case.runs),
    )


def _run(run: Run) -> Run:
    return dataclasses.replace(run, initial_soc=_known(run.initial_soc), overrides=_knowns(run.overrides))


def _knowns(knowns: Mapping[str, Known]) -> dict[str, Known]:
    return {name: _known(known) for name, known in knowns.items()}


def _known(known: Known) -> Known:
    return known if known.sd is None else Known(_to(known.value, DIGITS), _to(known.sd, SD_DIGITS))


def _table(table: Table) -> Table:
    if table.sd is None:
        return table
    values = np.array([_to(float(value), DIGITS) for value in table.values.ravel()]).reshape(table.values.shape)
    soc = np.round(table.soc, DIGITS)
    return dataclasses.replace(table, soc=soc, values=values, sd=_to(table.sd, SD_DIGITS))


def _to(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
