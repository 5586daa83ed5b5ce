"""Keeping a session: report, answer, extended model, pictures, and a script that repeats it."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from jaxmodel.app.browser.files import KEPT
from jaxmodel.app.browser.worker.answering import record
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress
from jaxmodel.app.browser.worker.view import verdict_view
from jaxmodel.app.report import write_report
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.diagnosis import conclusion

_WHAT = {
    "report.html": "the report: one page, opens offline",
    "session.py": "Python that repeats this session",
    "extended.toml": "the case with what was added",
    "calibrated.toml": "the case, calibrated",
    "answer.json": "the answer for programs",
    "errors.json": "the errors for programs",
    "found_law.py": "the unknown law as an effect",
    "diagnosis.json": "all numbers, for Python",
    "diagnosed.toml": "the case as it was",
    "predictions.parquet": "all predictions",
}


def keep(place: Place, progress: Progress) -> None:
    """Write report, answer, extended model, pictures and script to the session's folder."""
    progress("concluding")
    investigation = place.investigation(progress)
    diagnosis = place.diagnosis or conclusion(investigation)
    if diagnosis is not place.diagnosis:  # an automatic one is among those of the session since it ended
        place.diagnosis = diagnosis if diagnosis.verdict else None
        record(place, diagnosis)
    folder = place.folder / KEPT
    shutil.rmtree(folder, ignore_errors=True)
    progress("writing the answer")
    diagnosis.write(folder, pictures=False)
    progress("pictures and report")
    write_report(diagnosis, folder)
    write_whole(folder / "session.py", script_of(place.view))
    place.show(kept=_listed(folder), verdict=place.view.get("verdict") or verdict_view(diagnosis))


def _listed(folder: Path) -> list[dict[str, Any]]:
    """Return every file with what it is, the most useful first."""
    names = sorted(
        (path.name for path in folder.iterdir() if path.is_file()),
        key=lambda name: (list(_WHAT).index(name) if name in _WHAT else len(_WHAT), name),
    )
    return [
        {
            "name": name,
            "what": _WHAT.get(name, "picture" if name.endswith(".png") else "data of a run"),
            "bytes": (folder / name).stat().st_size,
        }
        for name in names
    ]


def script_of(view: dict[str, Any]) -> str:
    """Return Python that repeats a session."""
    source = view["source"]
    lines = ['"""What was done in the workbench, step by step."""', ""]
    verbs = {verb for verb, _ in view["script"]}
    names = ["Investigation", *(["finish"] if "finish" in verbs else [])]
    names.append("import_case" if source["how"] == "files" else "read_case")
    names += ["parameterise"] if source["how"] == "files" and source.get("parameterised") else []
    lines += [f"from jaxmodel import {', '.join(names)}", ""]
    if source["how"] == "files":
        options = "".join(f", {name}={value!r}" for name, value in source["options"].items())
        files = ", ".join(repr(name) for name in source["files"])
        lines.append(f"imported = import_case([{files}], {source['kind']!r}{options})")
        case = "parameterise(imported.case).case" if source.get("parameterised") else "imported.case"
        lines.append(f"case = {case}")
    else:
        place = view["path"] if source["how"] != "upload" else Path(view["path"]).name
        lines.append(f"case = read_case({place!r})")
    lines += ["investigation = Investigation(case)", "print(investigation.errors())", "print(investigation.where())"]
    for verb, labels in view["script"]:
        listed = ", ".join(repr(label) for label in labels)
        lines += {
            "follow": [f"investigation.follow([{listed}])"],
            "finish": ["diagnosis = finish(investigation)", "print(diagnosis.summary())"],
        }.get(verb, [f"investigation.{verb}({listed})"])
    lines += ["print(investigation.ladder())", 'investigation.extended_case().write("extended")']
    return "\n".join(lines) + "\n"
