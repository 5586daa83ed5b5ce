"""One case, diagnosed in a process of its own: `python -m benchmarks.planted.one CASE [LABEL ...]` prints JSON.

Beside the answer it says what the search held of each candidate, and why it refused those that are given: the fields of
`jaxmodel.diagnosis.search.Test`.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.apart import ROOT, plain, run_apart
from benchmarks.real.one import KEPT_PROGRAMS


def diagnosed(folder: Path, labels: Sequence[str]) -> dict[str, Any]:
    """Return the answer on a case, with all tests of the search, and a test of each of some candidates beside it."""
    from jaxmodel.case.reading import read_case
    from jaxmodel.diagnosis.diagnosis import conclude
    from jaxmodel.diagnosis.search import Search
    from jaxmodel.fit.cache import FitCache
    from jaxmodel.fit.lanes import one_thread_of_blas

    def whole() -> dict[str, Any]:
        search = Search(FitCache(read_case(folder)))
        found = search.run()
        answer = conclude(search, found).answer()
        final = found.final.added
        held = {label: _plain(test) for label, test in (*found.tests.items(), *found.refused.items())}
        return {
            "answer": answer,
            "path": [list(path) for path in found.path],
            "noise_alone": search.is_noise(found.final),
            "tests": held,
            "asked": {label: _asked(search, final, label) for label in labels},
        }

    return one_thread_of_blas(whole)()


def _plain(test: Any) -> dict[str, Any]:
    return dataclasses.asdict(test) | {"named": test.named, "why_not": test.why_not()}


def _asked(search: Any, final: tuple[str, ...], label: str) -> dict[str, Any]:
    """Return the place of a candidate among the scores over the final model, and its test beside that.

    An unknown law of the final model is left out: the search looks for one when no candidate is left, and a law does
    the work of whatever was refused.
    """
    cache = search.cache
    if label not in cache.space.candidates:
        return {"no_candidate": True}
    laws = {name for name, one in cache.space.candidates.items() if one.group == "law"}
    lacking = tuple(one for one in final if one != label and one not in laws)
    found: dict[str, Any] = {"in_final": label in final}
    for name, scores in (("own", cache.scores(lacking)), ("tolerance", cache.scores_by_tolerance(lacking))):
        gains = scores.gains()
        place = next((n for n, one in enumerate(gains) if one.label == label), None)
        found[f"place_by_{name}"] = place
        found[f"gain_by_{name}"] = None if place is None else gains[place].log_evidence
    model = (*lacking, label)
    test = search.test(model, label)
    # The test of a final model takes two more fits, and finds no more evidence.
    found["test"] = _plain(search.final_test(model, label) if test.significant else test)
    fit, places = cache.fit(model), cache.space.layout.of[label]
    numbers = zip(cache.space.candidates[label].coordinates, places, strict=True)
    found["numbers"] = {one.name: float(one.number(fit.x[place])) for one, place in numbers}
    return found


def fingerprint(folder: Path, labels: Sequence[str]) -> str:
    """Return a name for what an answer depends on: the case's files, the labels and the sources of the diagnosis."""
    found = hashlib.sha256("\n".join(labels).encode())
    sources = sorted((ROOT / "jaxmodel").rglob("*.py")) + sorted((ROOT / "jaxmodel").rglob("*.toml"))
    for path in [*sorted(folder.iterdir()), *sources]:
        if path.is_file():
            found.update(path.name.encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


def diagnose_cached(folder: Path, labels: Sequence[str], limit_s: float, answers: Path) -> dict[str, Any]:
    """Return what `diagnosed` says in a process of its own, with `seconds`, or `failed`; kept until its causes change.

    Args:
        folder: of the case.
        labels: of candidates that are tested beside the final model.
        limit_s: most seconds.
        answers: file that keeps it.
    """
    mark = fingerprint(folder, labels)
    if answers.is_file():
        kept = json.loads(answers.read_text(encoding="utf-8"))
        if kept["fingerprint"] == mark and "failed" not in kept:
            return kept
    environment = {name: value for name, value in os.environ.items() if name not in KEPT_PROGRAMS}
    said = run_apart("benchmarks.planted.one", [str(folder.resolve()), *labels], limit_s, environment)
    found: dict[str, Any] = {"fingerprint": mark}
    found |= {"failed": said.complaint} if said.failed else json.loads(said.output.strip().splitlines()[-1])
    found["seconds"] = said.seconds
    answers.parent.mkdir(parents=True, exist_ok=True)
    answers.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return found


if __name__ == "__main__":
    print(json.dumps(plain(diagnosed(Path(sys.argv[1]), sys.argv[2:]))))
