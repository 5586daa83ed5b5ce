"""The answer file of a diagnosis, in the form of the case contract, and the history of such files beside it."""

from __future__ import annotations

import datetime
import hashlib
import inspect
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.provenance import digest_of
from jaxmodel.base.remark import Remark
from jaxmodel.base.schema import with_schema
from jaxmodel.base.version import __version__
from jaxmodel.case.records import Case, Run
from jaxmodel.diagnosis.headline import possible, undetectable
from jaxmodel.diagnosis.result import ChannelError, Diagnosis, Removed
from jaxmodel.diagnosis.wording import verdict_title

ANSWER, HISTORY = "answer.json", "history"


def number(value: float) -> float | None:
    """Return a number with six digits, ready for JSON; None if it is not finite."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _split(error: ChannelError | Removed) -> dict[str, float | None]:
    return {"fit": number(error.fit), "check": number(error.check)}


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the answer in the form of the case contract, ready for JSON; undefined numbers are null."""
    before, after = diagnosis.base.errors, diagnosis.final.errors
    return {
        "verdict": diagnosis.verdict,
        "title": verdict_title(diagnosis),
        "effects": [
            {
                "name": effect.name,
                "probability": number(effect.probability),
                "parameters": {
                    **{n: {"value": number(e.value), "sd": number(e.sd)} for n, e in effect.parameters.items()},
                    **({"column": effect.column} if effect.column else {}),
                },
                "cannot_tell_apart_from": list(effect.cannot_tell_apart_from),
                "removes": {c: _split(one) for c, one in effect.removes.items()},
                **({"rests_on": effect.rests_on} if effect.rests_on else {}),
            }
            for effect in diagnosis.effects
        ],
        "possible": unnamed(diagnosis),
        "model": list(diagnosis.final.added),
        "parameters": {
            name: {"value": number(one.value), "sd": number(one.sd), "unit": one.unit}
            for name, one in diagnosis.final.estimates.items()
        },
        "candidates": [{"name": name, "probability": number(p)} for name, p in diagnosis.candidates],
        "unexplained": diagnosis.unexplained,
        "blind_to": list(undetectable(diagnosis)),
        "error": {
            channel: {
                "noise_floor": number(diagnosis.noise[channel].sd),
                "before": _split(before[channel]),
                "after": _split(after[channel]),
                "check_prediction_sd": number(after[channel].prediction_sd),
                "check_as_stated": {
                    "before": number(before[channel].stated),
                    "after": number(after[channel].stated),
                },
            }
            for channel in diagnosis.noise
        },
        "tolerance": {
            channel: {"rms": number(one.rms), "max": one.largest and number(one.largest), "assumed": one.assumed}
            for channel, one in diagnosis.tolerance.items()
        },
        "fit_for_purpose": {channel: dict(of_run) for channel, of_run in diagnosis.fit_for_purpose.items()},
        "curves": [
            {
                "port": curve.port,
                "over": curve.over,
                "at": [number(x) for x in curve.at],
                "value": [number(x) for x in curve.value],
                "sd": [number(x) for x in curve.sd],
                "unit": curve.unit or "log of a factor",
                "removes": {c: _split(one) for c, one in curve.removes.items()},
            }
            for curve in diagnosis.curves
        ],
        **({"specimens": _specimens(diagnosis)} if diagnosis.specimens else {}),
        "runs": [
            {
                "file": run.file,
                "parameter": run.parameter,
                "value": number(run.value),
                "sd": number(run.sd),
                "unit": run.unit,
                "removes": {c: _split(one) for c, one in run.removes.items()},
            }
            for run in diagnosis.runs
        ],
        "immaterial": [
            {"name": one.name, "removes": {c: _split(r) for c, r in one.removes.items()}} for one in possible(diagnosis)
        ],
        "remaining": {
            channel: {
                "rms": number(one.rms),
                "tau_s": number(one.tau_s),
                "where": list(one.where),
                **({"mostly": one.mostly} if one.mostly else {}),
            }
            for channel, one in diagnosis.remaining.items()
        },
        "extrapolated": [
            {
                "file": one.file,
                "condition": one.condition,
                "span_fitted": [number(x) for x in one.span_fitted],
                "span": [number(x) for x in one.span],
            }
            for one in diagnosis.extrapolated
        ],
        "errors_by_run": [] if diagnosis.errors is None else rows_of(diagnosis.errors),
        "remarks": list(diagnosis.remarks),
        "findings": findings(diagnosis.remarks),
    }


def _specimens(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return what each motor or cell has of its own, ready for JSON."""
    return [
        {
            "specimen": one.specimen,
            "difference": one.name,
            "value": number(one.value),
            "sd": number(one.sd),
            "unit": one.unit or "log of a factor",
            "others": list(one.others),
            "cannot_tell_apart_from": list(one.cannot_tell_apart_from),
            "removes": {c: _split(removes) for c, removes in one.removes.items()},
        }
        for one in diagnosis.specimens
    ]


def findings(remarks: Iterable[Remark]) -> list[dict[str, Any]]:
    """Return code, subject, numbers and text of remarks, in their order, ready for JSON."""
    return [one.record() | {"numbers": {name: number(value) for name, value in one.numbers.items()}} for one in remarks]


def rows_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table, ready for JSON."""

    def plain(value: Any) -> Any:
        if isinstance(value, float | np.floating):
            return number(float(value))
        return value.item() if isinstance(value, np.generic) else value

    return [{str(key): plain(value) for key, value in row.items()} for row in table.to_dict("records")]


def unnamed(diagnosis: Diagnosis) -> list[str]:
    """Return the labels of the effects of the final model that are not named."""
    named = {effect.label for effect in diagnosis.effects}
    catalogue = diagnosis.case.catalogue
    effects = [label for label in diagnosis.final.added if "@" not in label and label.partition(":")[0] in catalogue]
    return [label for label in effects if label not in named]


def origin(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return where an answer made now comes from: the case, the time in UTC, the version, the data by SHA-256."""
    return {
        "case": diagnosis.case.name,
        "title": diagnosis.case.title,
        "made": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC"),
        "version": __version__,
        "data": data_digests(diagnosis.case),
        "options": list(diagnosis.ordered),
    }


def data_digests(case: Case) -> dict[str, str]:
    """Return the SHA-256 of what a case was read from, by file; of a run without a file, of its numbers."""
    own = dict.fromkeys(Path(inspect.getfile(effect)) for effect in case.own_effects.values())
    files = {} if case.path is None else {case.path.name: case.path}
    files |= {run.file: run.source for run in case.runs if run.source is not None}
    files |= {file.name: file for file in own}
    # A file may be gone by the time a diagnosis has come to its end: that is no reason to lose it.
    digests = {name: digest_of(file) for name, file in files.items() if file.is_file()}
    return digests | {run.file: _of_numbers(run) for run in case.runs if run.source is None}


def _of_numbers(run: Run) -> str:
    table = run.to_dataframe()
    found = hashlib.sha256(" ".join(table.columns).encode())
    found.update(np.ascontiguousarray(table.to_numpy(float)).tobytes())
    return found.hexdigest()


def write_answer(diagnosis: Diagnosis, folder: Path) -> None:
    """Write the answer as JSON to a folder, and with its origin to the folder's history, in a file of its own.

    The same case has the same answer, to the byte; what is of the moment is in the history alone. It comes first, and
    its files are never written again: whenever the process is killed, no answer is lost.
    """
    said, made_from = with_schema(answer(diagnosis)), origin(diagnosis)
    history = folder / HISTORY
    history.mkdir(parents=True, exist_ok=True)
    moment = made_from["made"].removesuffix(" UTC").replace(":", "-").replace(" ", "T")
    name, count = f"{moment}.json", 1
    while (history / name).exists():  # several within a second
        name, count = f"{moment}_{count + 1}.json", count + 1
    write_whole(history / name, json.dumps({**said, "origin": made_from}, indent=2) + "\n")
    write_whole(folder / ANSWER, json.dumps(said, indent=2) + "\n")
