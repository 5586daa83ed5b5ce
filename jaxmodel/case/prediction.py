"""What a case predicts for a table of new inputs: a column `run` tells several runs apart."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, instead
from jaxmodel.case import plausible
from jaxmodel.case.entries import entry_of
from jaxmodel.case.forms import RunEntry
from jaxmodel.case.known import Known
from jaxmodel.case.measurements import measurements_of
from jaxmodel.case.reading import run_of
from jaxmodel.case.records import Case, Run
from jaxmodel.case.servo import refuse_driven_speed
from jaxmodel.case.simulation import simulate_case
from jaxmodel.model.parameters import TABLE

RUN = "run"
# The name of a run in messages, where the table has no column for it.
_ALONE = "new"
# What a run states of its own, beside its inputs and the parameters of the model.
_OF_A_RUN = ("initial_soc", "initial_cell_temperature_degC", "specimen")


def predict(case: Case, frame: pd.DataFrame, stated: Mapping[str, Any]) -> pd.DataFrame:
    """Return the readings of a table of new inputs, as `Case.predict`."""
    runs, places = zip(*runs_of_frame(case, frame, stated), strict=True)
    tables = [one.table.drop(columns="time_s") for one in simulate_case(with_runs(case, runs), progress=False)]
    found = pd.concat(tables, ignore_index=True)
    return found.iloc[np.argsort(np.concatenate(places))].set_axis(frame.index)


def with_runs(case: Case, runs: tuple[Run, ...]) -> Case:
    """Return a case with other runs, which are checked as those of a case are.

    Raises:
        MeasurementError: a column is in another unit, or a run cannot be what the case says of its drive.
    """
    refuse_driven_speed(case.servo, runs, case.label)
    found = dataclasses.replace(case, runs=runs)
    plausible.check(found)
    return found


def runs_of_frame(case: Case, frame: pd.DataFrame, stated: Mapping[str, Any]) -> Iterator[tuple[Run, np.ndarray]]:
    """Give each run of a table, with the places of its rows.

    A run with the name of one of the case is stated as that one is. What it states of its own may be a column, with one
    number in all rows of a run, or be stated for all runs. The latter comes first.

    Args:
        case: whose kind, load and drive say which columns there are.
        frame: the columns of a run's CSV, `time_s` being one or the index, and `run`, if there are several.
        stated: entries of [[runs]] in case.toml, for all runs.

    Raises:
        MeasurementError: the table cannot be used, or an entry has the wrong form.
        ParameterError: a parameter is unknown, out of its bounds or of the wrong form.
    """
    if not isinstance(frame, pd.DataFrame):
        raise MeasurementError(f"{_label(case)}: predict takes a pandas DataFrame, and not a {type(frame).__name__}.")
    if frame.columns.has_duplicates:
        twice = frame.columns[frame.columns.duplicated()][0]
        raise MeasurementError(f"{_label(case)}: there are two columns '{twice}'; remove or rename one.")
    places = _places(case, frame)
    known = {run.name: run for run in case.runs}
    own = [name for name in frame.columns if _is_stated(case, name)]
    table = frame.drop(columns=[*own, *([RUN] if RUN in frame.columns else [])])
    entries = {
        name: {one: _constant(frame[one].iloc[at], f"{_label(case)}, run '{name}'") for one in own} | dict(stated)
        for name, at in places.items()
    }
    for entry in entry_of(_label(case), entries, (), entries, kind=case.kind).runs:
        at = places[entry.file]
        yield _run(case, entry, table.iloc[at], known.get(entry.file)), at


def _label(case: Case) -> str:
    """Return the name of a case in messages: it is the table that is wrong, and not the file of the case."""
    return f"case '{case.name}'"


def _places(case: Case, frame: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the rows of each run by name."""
    if len(frame) == 0:
        raise MeasurementError(f"{_label(case)}: the table has no rows; a run needs at least two.")
    if RUN not in frame.columns:
        return {_ALONE: np.arange(len(frame))}
    if (missing := frame[RUN].isna()).any():
        raise MeasurementError(
            f"{_label(case)}: 'run' is empty in row {int(missing.argmax())}; name the run of each row."
        )
    codes, names = pd.factorize(frame[RUN].astype(str))
    rows = np.split(np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))[:-1])
    return dict(zip(names, rows, strict=True))


def _is_stated(case: Case, name: Any) -> bool:
    """Return True for a column that is not read over time, and that a run may state of its own."""
    return name not in case.vocabulary.columns and (name in _OF_A_RUN or name in TABLE)


def _constant(column: pd.Series, where: str) -> Any:
    """Return what a run states in a column."""
    if column.nunique(dropna=False) != 1:
        raise MeasurementError(f"{where}: '{column.name}' is stated once for a run, and it changes; make it constant.")
    return column.iloc[0]


def _run(case: Case, entry: RunEntry, table: pd.DataFrame, known: Run | None) -> Run:
    """Return a run of a table, stated as the known one is where it states nothing itself."""
    where = f"{_label(case)}, run '{entry.file}'"
    has_ambient = "ambient_degC" in table.columns
    if known is not None and entry.ambient_degC is None and not has_ambient:
        entry = entry.model_copy(update={"ambient_degC": known.ambient_degC})

    def measured():
        return measurements_of(table, case.kind, entry.ambient_degC, where, case.load, case.servo)

    made = run_of(entry, None, case.kind, case.vocabulary, Known(1.0), measured, where)
    if known is not None:
        made = dataclasses.replace(
            made,
            initial_soc=known.initial_soc if entry.initial_soc is None else made.initial_soc,
            overrides=known.overrides | made.overrides,
            initial_cell_temperature=made.initial_cell_temperature or known.initial_cell_temperature,
            specimen=made.specimen or known.specimen,
            tolerance=known.tolerance,
        )
    if made.specimen not in (case.specimens or ("",)):
        remedy = instead(made.specimen, case.specimens)
        raise MeasurementError(f"{where}: the case knows no specimen '{made.specimen}'.{remedy}")
    return made
