"""Compare, add, drop, undo and diagnose: the verbs of an investigation, each of which changes what the pages show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from jaxmodel.app.browser.worker import opening
from jaxmodel.app.browser.worker.answering import record
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress
from jaxmodel.app.browser.worker.view import verdict_view
from jaxmodel.app.browser.worker.words import title_of
from jaxmodel.base.errors import FitError
from jaxmodel.diagnosis import finish
from jaxmodel.diagnosis.advice.next_experiment import best_of_each, propose

# Rivals of the present model between which an experiment is to decide.
_MOST_RIVALS = 2


def open_case(place: Place, progress: Progress, path: str, how: str) -> None:
    """Open a case that is on this machine, show its measurements, and compare them with the model.

    Raises:
        UserError: the case cannot be used, or cannot be calibrated.
    """
    opening.open_case(place, progress, path, how)
    compare(place, progress)


def open_upload(place: Place, progress: Progress, kind: str, options: Mapping[str, Any]) -> None:
    """Open what was dropped. A case is compared at once; an import waits for a person to look at what it found.

    Raises:
        UserError: a file cannot be used, or the case cannot be calibrated.
    """
    opening.open_upload(place, progress, kind, options)
    if place.view["source"]["how"] == "upload":
        compare(place, progress)


def compare(place: Place, progress: Progress) -> None:
    """Calibrate the base model, and show how large the error is and where.

    Raises:
        UserError: the case cannot be calibrated.
    """
    opening.parameterised(place, progress)
    progress("calibrating the base model")
    place.show_model(progress, verdict=None, proposals=None)


def add(place: Place, progress: Progress, names: Sequence[str]) -> None:
    """Add candidates to the present model and refit it."""
    investigation = place.investigation(progress)
    progress(f"refitting with {' and '.join(names).replace('_', ' ')}")
    investigation.add(*names)
    _changed(place, progress, "add", names)


def drop(place: Place, progress: Progress, names: Sequence[str]) -> None:
    """Remove additions from the present model and refit it."""
    investigation = place.investigation(progress)
    progress(f"refitting without {' and '.join(names).replace('_', ' ')}")
    investigation.drop(*names)
    _changed(place, progress, "drop", names)


def undo(place: Place, progress: Progress) -> None:
    """Return to the model before."""
    place.investigation(progress).undo()
    _changed(place, progress, "undo", ())


def diagnose(place: Place, progress: Progress) -> None:
    """Add and remove automatically, and show every model as it is accepted; stopped, what was found so far stays."""
    investigation = place.investigation(progress)
    progress("scoring every candidate")

    def each() -> None:
        place.diagnosis = None
        # What a stop leaves behind is a session in which these were added by hand.
        place.show_model(progress, verdict=None, script=[*script, ["follow", [*map(list, investigation.path)]]])

    script = list(place.view["script"])
    place.diagnosis = finish(investigation, each=each)
    record(place, place.diagnosis)
    proposals = [{"what": one.what, "sigma": one.sigma, "repeats": one.repeats} for one in place.diagnosis.proposals]
    place.show_model(
        progress,
        verdict=verdict_view(place.diagnosis),
        proposals={"rivals": [name.replace("_", " ") for name in place.diagnosis.rivals], "found": proposals},
        script=[*script, ["finish", []]],
        done=progress.job,
    )


def next_experiment(place: Place, progress: Progress) -> None:
    """Show which experiment decides best between the present model and its best additions.

    Raises:
        FitError: no candidate is left to decide on.
    """
    investigation = place.investigation(progress)
    cache, present = investigation.cache, investigation.added
    candidates = cache.space.candidates
    likely = [one for one in cache.scores(present).gains() if candidates[one.label].group in ("effect", "sensor")]
    chosen = likely[:_MOST_RIVALS]
    if not chosen:
        raise FitError("Every candidate is in the model; remove one to ask for an experiment that tests it.")
    rivals = [cache.fit(present)]
    for gain in chosen:
        progress(f"refitting with {gain.label.replace('_', ' ')}")
        rivals.append(cache.fit((*present, gain.label)))
    progress("searching for an experiment that decides")
    found = best_of_each(propose(cache, rivals))
    names = ["the present model", *(f"the same with {title_of(candidates[gain.label]).lower()}" for gain in chosen)]
    listed = [{"what": one.what, "sigma": one.sigma, "repeats": one.repeats} for one in found]
    place.show(proposals={"rivals": names, "found": listed})


def _changed(place: Place, progress: Progress, verb: str, names: Sequence[str]) -> None:
    """Show a model that the user has changed; a verdict is that of the model before."""
    place.diagnosis = None
    script: list[Any] = [*place.view["script"], [verb, list(names)]]
    place.show_model(progress, verdict=None, proposals=None, script=script, done=progress.job)
