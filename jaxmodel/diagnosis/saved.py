"""A diagnosis as files that are read again: its case, its numbers as JSON, its predictions as one table.

No file can run anything when it is read. JSON has no NaN and no infinity: they are written as text.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import math
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.parquet as parquet

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.provenance import digest_of
from jaxmodel.base.remark import Remark
from jaxmodel.base.schema import with_schema, without_schema
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.writing import write_case
from jaxmodel.diagnosis.advice.next_experiment import Proposal
from jaxmodel.diagnosis.result import Diagnosis, Rung
from jaxmodel.model.ports import Effect

DIAGNOSIS, CASE, PREDICTIONS = "diagnosis.json", "diagnosed.toml", "predictions.parquet"
# Fields that have a form of their own in the files.
_APART = ("case", "errors", "proposals")


def write_saved(diagnosis: Diagnosis, folder: Path) -> None:
    """Write a diagnosis so that `read_diagnosis` returns it; until all of it is there, there is none."""
    (folder / DIAGNOSIS).unlink(missing_ok=True)
    write_case(diagnosis.case, folder / CASE, [f"The case '{diagnosis.case.name}', as it was diagnosed."])
    write_whole(folder / PREDICTIONS, _predictions(diagnosis))
    fields = {
        one.name: _plain(getattr(diagnosis, one.name))
        for one in dataclasses.fields(diagnosis)
        if one.name not in _APART
    }
    content = {
        "case": {
            "name": diagnosis.case.name,
            "files": [run.file for run in diagnosis.case.runs],
            "runs": [_digest(run.source) for run in diagnosis.case.runs],
        },
        "predictions": digest_of(folder / PREDICTIONS),
        "diagnosis": fields
        | {
            "errors": None if diagnosis.errors is None else _plain(diagnosis.errors.to_dict("records")),
            "proposals": [_plain(one) for one in diagnosis.proposals],
        },
    }
    write_whole(folder / DIAGNOSIS, json.dumps(with_schema(content), indent=1) + "\n")


def read_diagnosis(folder: str | Path, *, own_effects: Iterable[type[Effect]] = ()) -> Diagnosis:
    """Return the diagnosis or comparison that was written to a folder, with its pictures, tables and extended case.

    Args:
        folder: that `Diagnosis.write` or the command `diagnose` has written. The runs of the case are read from where
            they were.
        own_effects: your own effect classes with which the case was diagnosed.

    Raises:
        MeasurementError: there is none, its files are damaged, or a run of its case has changed since.
        ParameterError: its case has a parameter that this version does not know.
    """
    folder = Path(folder)
    content = _content(folder)
    case = _case(folder, content["case"], own_effects)
    try:
        fields = content["diagnosis"]
        found = {
            one.name: _typed(_hints(Diagnosis)[one.name], fields[one.name])
            for one in dataclasses.fields(Diagnosis)
            if one.name not in _APART and one.name in fields
        }
        found["ladder"] = _with_predictions(found["ladder"], folder / PREDICTIONS, case)
        found["errors"] = None if fields["errors"] is None else _errors(fields["errors"])
        found["proposals"] = tuple(_typed(Proposal, one) for one in fields["proposals"])
        return Diagnosis(case=case, **found)
    except (KeyError, TypeError, ValueError, AttributeError, OSError) as error:
        raise MeasurementError(f"{folder / DIAGNOSIS} is damaged ({error}); diagnose the case again.") from error


def _content(folder: Path) -> dict[str, Any]:
    """Return what the files of a diagnosis hold, after a check that they belong together."""
    file = folder / DIAGNOSIS
    if not file.is_file():
        raise MeasurementError(f"{folder} holds no {DIAGNOSIS}; give the folder that a diagnosis was written to.")
    try:
        content = without_schema(json.loads(file.read_text(encoding="utf-8")), str(file))
        whole = digest_of(folder / PREDICTIONS) == content["predictions"]
    except MeasurementError:
        raise
    except (OSError, ValueError, KeyError, AttributeError) as error:
        raise MeasurementError(f"{file} is damaged ({error}); diagnose the case again.") from error
    if not whole:
        raise MeasurementError(f"{folder / PREDICTIONS} is not that of {DIAGNOSIS}; diagnose the case again.")
    return content


def _case(folder: Path, about: Mapping[str, Any], own_effects: Iterable[type[Effect]]) -> Case:
    """Return the case of a diagnosis, after a check that its runs are still those that were diagnosed."""
    case = dataclasses.replace(read_case(folder / CASE, own_effects=own_effects), name=about["name"])
    for run, digest in zip(case.runs, about["runs"], strict=True):
        if digest is not None and _digest(run.source) != digest:
            raise MeasurementError(f"{run.source} has changed since it was diagnosed; diagnose the case again.")
    # The case beside the diagnosis finds its runs from there; findings name them as the diagnosed case does.
    named = zip(case.runs, about["files"], strict=True)
    return dataclasses.replace(case, runs=tuple(dataclasses.replace(run, file=file) for run, file in named))


def _digest(file: Path | None) -> str | None:
    """Return the SHA-256 of a run's file; None for a run without one, which is written beside with the diagnosis."""
    return digest_of(file) if file is not None and file.is_file() else None


def _predictions(diagnosis: Diagnosis) -> bytes:
    """Return the predictions of all models as a Parquet file: a row for each row of each run.

    A column is named after the place of its model in the ladder and its reading, as `3 voltage_V`. A reading that a
    model does not predict in a run is null there.
    """
    ladder, runs = diagnosis.ladder, diagnosis.case.runs
    names = [
        (place, name)
        for place, rung in enumerate(ladder)
        for name in dict.fromkeys(name for of_run in rung.predictions.values() for name in of_run)
    ]
    columns: dict[str, Any] = {"run": np.repeat(range(len(runs)), [run.measured.time_s.size for run in runs])}
    for place, name in names:
        parts = []
        for run in runs:
            values = ladder[place].predictions.get(run.name, {}).get(name)
            rows = run.measured.time_s.size
            parts.append(pyarrow.nulls(rows, pyarrow.float64()) if values is None else _column(values))
        columns[f"{place} {name}"] = pyarrow.chunked_array(parts)
    written = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), written, compression="zstd")
    return written.getvalue()


def _column(values: np.ndarray) -> Any:
    return pyarrow.array(np.asarray(values, float), from_pandas=False)


def _with_predictions(ladder: tuple[Rung, ...], file: Path, case: Case) -> tuple[Rung, ...]:
    table = parquet.read_table(file)
    numbers = table.column("run").to_numpy()
    found: list[dict[str, dict[str, np.ndarray]]] = [{} for _ in ladder]
    for column in table.column_names[1:]:
        place, _, name = column.partition(" ")
        values = table.column(column).combine_chunks()
        for number, run in enumerate(case.runs):
            first, last = np.searchsorted(numbers, (number, number + 1))
            of_run = values.slice(first, last - first)
            if of_run.null_count == 0:
                found[int(place)].setdefault(run.name, {})[name] = of_run.to_numpy(zero_copy_only=False)
    return tuple(dataclasses.replace(one, predictions=own) for one, own in zip(ladder, found, strict=True))


def _errors(rows: list[dict[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame([{name: _number(value) for name, value in row.items()} for row in rows])


def _plain(value: Any) -> Any:
    """Return a record, or what one holds, as JSON has it; predictions are in a file of their own."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [one.name for one in dataclasses.fields(value) if one.name != "predictions"]
        return {name: _plain(getattr(value, name)) for name in names}
    if isinstance(value, Remark):
        return _plain(value.record())
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(one) for one in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    return value if not isinstance(value, float) or math.isfinite(value) else {"float": str(value)}


def _number(value: Any) -> Any:
    """Return a value of JSON, with what stands for NaN and infinity as a number."""
    return float(value["float"]) if isinstance(value, dict) and value.keys() == {"float"} else value


@functools.cache
def _hints(record: type) -> dict[str, Any]:
    return typing.get_type_hints(record)


def _typed(hint: Any, value: Any) -> Any:
    """Return what JSON holds as the record, tuple, mapping or array that a type asks for."""
    value, origin, inner = _number(value), typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        return None if value is None else _typed(next(one for one in inner if one is not type(None)), value)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        hints = _hints(hint)
        given = {name: _typed(hints[name], one) for name, one in value.items()}
        return hint(**given, **({"predictions": {}} if "predictions" in hints else {}))
    if origin is tuple:
        each = (inner[0] for _ in value) if inner[-1] is Ellipsis else inner
        return tuple(_typed(one, item) for one, item in zip(each, value, strict=True))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {name: _typed(inner[1], item) for name, item in value.items()}
    if hint is Remark:
        return _remark(value)
    if hint is np.ndarray:
        return np.array([_number(item) for item in value], float)
    return float(value) if hint is float else value


def _remark(written: str | dict[str, Any]) -> Remark:
    """Return a remark, which older files have as its sentence alone."""
    if isinstance(written, str):
        return Remark(written)
    numbers = {name: _number(value) for name, value in written["numbers"].items()}
    return Remark(written["text"], written["code"], written["subject"], **numbers)
