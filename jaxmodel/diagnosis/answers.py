"""Answers read again: of one diagnosis, of a folder of them, and every answer that a case has had."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.schema import without_schema
from jaxmodel.diagnosis.answer import ANSWER, HISTORY, answer, origin
from jaxmodel.diagnosis.result import Diagnosis

Answer = dict[str, Any]
_KEYS = {"verdict", "effects", "error"}


def answer_of(what: Diagnosis | Mapping[str, Any] | str | Path) -> Answer:
    """Return the answer of a diagnosis, with its origin where that is known.

    Args:
        what: a diagnosis, its answer, the folder that it was written to, or a JSON file: `answer.json`, or a file of
            the folder's history.

    Raises:
        MeasurementError: there is no answer, or it cannot be read.
    """
    if isinstance(what, Diagnosis):
        return {**answer(what), "origin": origin(what)}
    if isinstance(what, Mapping):
        return _checked(what, "the answer")
    path = Path(what)
    if path.is_dir():
        return _read(_newest(path))
    return _read(path)


def answers_below(folder: Path) -> dict[str, Path]:
    """Return the folders of the answers in a folder by name: its own under "", or those of the folders in it.

    Raises:
        MeasurementError: there is none.
    """
    if not folder.is_dir() or _has_answer(folder):
        return {"": folder}
    found = {child.name: child for child in sorted(folder.iterdir()) if child.is_dir() and _has_answer(child)}
    if not found:
        raise MeasurementError(f"{folder} holds no {ANSWER}; give the folder of a diagnosis, or the file itself.")
    return found


def history_files(folder: Path) -> list[Path]:
    """Return the files of a folder's history, the oldest first: they are named after their times."""
    return sorted((folder / HISTORY).glob("*.json"), key=lambda path: path.stem)


def history_of(folder: str | Path) -> list[Answer]:
    """Return every answer that was written to a folder, the oldest first; a file that cannot be read is left out.

    Raises:
        MeasurementError: there is none.
    """
    found = []
    for path in history_files(Path(folder)):
        try:
            found.append(_read(path))
        except MeasurementError:
            continue
    if not found:
        raise MeasurementError(f"{folder} has no history of diagnoses; give the folder that one was written to.")
    return found


def history(folder: str | Path) -> pd.DataFrame:
    """Return what was diagnosed when, a row for each diagnosis that was written to a folder, the oldest first.

    Columns: made (UTC), version, verdict, named, possible; then for each channel the RMS error of the final model on
    check runs, on fit runs where there are none; data, the start of a digest of all files.

    Args:
        folder: of the results of one case.

    Raises:
        MeasurementError: no diagnosis was written there.
    """
    return pd.DataFrame([_row(one) for one in history_of(folder)])


def _row(one: Answer) -> dict[str, Any]:
    made_from = one.get("origin", {})
    row = {name: made_from.get(name, "") for name in ("made", "version")}
    row |= {"verdict": one["verdict"], "named": ", ".join([*map(label_of, one["effects"]), *differences_of(one)])}
    row |= {"possible": ", ".join(one.get("possible", ()))}
    for channel, error in one["error"].items():
        check = error["after"]["check"]
        row[channel] = error["after"]["fit"] if check is None else check
    return row | {"data": data_in_short(one)}


def label_of(effect: Mapping[str, Any]) -> str:
    """Return the label of a named effect of an answer: its name, with its column where it has one."""
    column = effect["parameters"].get("column")
    return f"{effect['name']}:{column}" if column else effect["name"]


def differences_of(one: Answer) -> list[str]:
    """Return the labels of what single motors or cells of an answer have of their own."""
    return [f"{found['difference']}@{found['specimen']}" for found in one.get("specimens", ())]


def data_in_short(one: Answer) -> str:
    """Return eight letters that stand for the data of an answer; "" where they are not known."""
    digests = one.get("origin", {}).get("data")
    return hashlib.sha256("".join(sorted(digests.values())).encode()).hexdigest()[:8] if digests else ""


def _has_answer(folder: Path) -> bool:
    return (folder / ANSWER).is_file() or any(history_files(folder))


def _newest(folder: Path) -> Path:
    """Return the file of the last answer of a folder; that of its history has the origin too.

    Raises:
        MeasurementError: there is none.
    """
    files = history_files(folder)
    if files:
        return files[-1]
    if not (folder / ANSWER).is_file():
        raise MeasurementError(f"{folder} holds no {ANSWER}; give the folder of a diagnosis, or the file itself.")
    return folder / ANSWER


def _read(path: Path) -> Answer:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise MeasurementError(f"{path}: {error.strerror}; give an answer that a diagnosis has written.") from error
    except ValueError as error:
        raise MeasurementError(f"{path} is no JSON; give an {ANSWER} that a diagnosis has written.") from error
    return _checked(found, str(path))


def _checked(found: Any, where: str) -> Answer:
    """Return an answer; raise MeasurementError where it is none."""
    if not isinstance(found, Mapping) or not _KEYS <= found.keys():
        raise MeasurementError(f"{where} is no answer of a diagnosis; give the {ANSWER} that one has written.")
    return without_schema(found, where)
