"""The diagnoses of a session, each kept as it was, and what changed from one to another."""

from __future__ import annotations

from typing import Any

from jaxmodel.app.browser.files import ANSWERS
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress
from jaxmodel.app.browser.worker.words import error_text, in_words
from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.units import split_unit
from jaxmodel.diagnosis.answer import write_answer
from jaxmodel.diagnosis.answers import answer_of, history_files
from jaxmodel.diagnosis.changes import AnswerChanges, bands, beside_tables, compare_answers
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.diagnosis.wording import VERDICT_TITLES, effect_name, number
from jaxmodel.effects import CATALOGUE


def record(place: Place, diagnosis: Diagnosis) -> None:
    """Add a diagnosis to those of the session, and list them; a comparison tests nothing and is no answer."""
    if diagnosis.verdict:
        folder = place.folder / ANSWERS
        folder.mkdir(exist_ok=True)
        write_answer(diagnosis, folder)
        place.show(answers=[_listed(file.stem, answer_of(file)) for file in history_files(folder)][::-1])


def changes(place: Place, progress: Progress, before: str, after: str) -> None:
    """Show what changed from one diagnosis of the session to another.

    Raises:
        MeasurementError: there is no such diagnosis.
    """
    progress("comparing two diagnoses")
    files = {file.stem: file for file in history_files(place.folder / ANSWERS)}
    if before not in files or after not in files:
        raise MeasurementError("This diagnosis is not one of the session; choose another.")
    place.show(changes={"before": before, "after": after} | _shown(compare_answers(files[before], files[after])))


def _listed(name: str, answer: dict[str, Any]) -> dict[str, Any]:
    """Return one diagnosis as the list of a page has it."""
    made_from, found = answer["origin"], bands(answer)
    return {
        "name": name,
        "case": made_from["title"],
        "made": made_from["made"],
        "verdict": answer.get("title") or VERDICT_TITLES[answer["verdict"]],
        "named": [_words(label) for label, (band, _) in found.items() if band == "named"],
        "possible": [_words(label) for label, (band, _) in found.items() if band == "possible"],
    }


def _shown(found: AnswerChanges) -> dict[str, Any]:
    """Return what changed in words."""
    errors = [
        {
            "reading": split_unit(row["channel"])[0],
            "run": row["run"],
            "before": error_text(row["channel"], row["before"]),
            "after": error_text(row["channel"], row["after"]),
            "is_worse": bool(row["change"] > 0.0),
        }
        for row in found.errors.to_dict("records")
    ]
    names = [
        {
            "name": _words(row["name"]),
            "before": _band(row["before"], row["probability_before"]),
            "after": _band(row["after"], row["probability_after"]),
        }
        for row in found.names.to_dict("records")
    ]
    origin = found.origin.to_dict("records")
    for row in origin:
        if row["what"] == "model":  # options stay as they are typed
            row |= {when: in_words(row[when], CATALOGUE) for when in ("before", "after")}
    return {
        "verdict": [VERDICT_TITLES[one] for one in found.verdict],
        "origin": origin,
        "names": names,
        "errors": errors,
        "sentences": [in_words(sentence, CATALOGUE) for sentence in beside_tables(found)],
    }


def _words(label: str) -> str:
    """Return an effect of an answer as the pages call it: 'voltage offset of voltage'."""
    name, _, column = label.partition(":")
    return in_words(effect_name(f"{name}:{split_unit(column)[0]}" if column else name), CATALOGUE)


def _band(band: str, probability: float) -> str:
    return f"{band} ({number(probability, 2)})" if probability > 0.0 else band
