"""The files of a diagnosis: the answer, the extended case, an unknown law as an effect, and the whole of it."""

from __future__ import annotations

import json
from pathlib import Path

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.case.writing import write_case
from jaxmodel.diagnosis.answer import answer, write_answer
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.diagnosis.saved import write_saved
from jaxmodel.diagnosis.wording import final_name

LAW_FILE = "found_law.py"


def write_result(diagnosis: Diagnosis, folder: Path) -> None:
    """Write the answer, the extended case and the law of a diagnosis; of a comparison its errors and its case."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.html").unlink(missing_ok=True)  # of an earlier diagnosis: until its own is written there is none
    if diagnosis.verdict:
        write_answer(diagnosis, folder)
    else:
        errors = json.dumps(answer(diagnosis)["error"], indent=2)
        write_whole(folder / "errors.json", f"{errors}\n")
    extended, notes = diagnosis.extension
    name = "extended.toml" if diagnosis.verdict else "calibrated.toml"
    write_case(extended, folder / name, _comments(diagnosis, notes))
    write_saved(diagnosis, folder)
    if diagnosis.law_source:
        write_whole(folder / LAW_FILE, diagnosis.law_source)


def _comments(diagnosis: Diagnosis, notes: list[str]) -> list[str]:
    """Return the comments at the top of the extended case."""
    model = final_name(diagnosis) if diagnosis.final.added else "without any effect"
    lines = [f"The case '{diagnosis.case.name}', calibrated {model}.", *notes]
    if diagnosis.final.estimates:
        lines.append(
            "Each sd is the posterior of these runs. Replace the runs before a new diagnosis, or they count twice."
        )
    if needed := [label for label in diagnosis.final.added if label in diagnosis.case.own_effects]:
        lines.append(f"Give --effect FILE.py:CLASS again for {', '.join(needed)}.")
    return lines
