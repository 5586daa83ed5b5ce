"""What the worker of one session has at hand: its folder, its case, and the investigation, which stays warm."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from jaxmodel.app.browser.files import VIEW, read_json, write_json
from jaxmodel.app.browser.worker.arrays import BASE, MODEL, write_cells, write_previews, write_traces
from jaxmodel.app.browser.worker.progress import Progress
from jaxmodel.app.browser.worker.view import case_view, model_view, sweepable
from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.diagnosis import Investigation
from jaxmodel.diagnosis.result import Diagnosis


class Place:
    """The folder of one session, and what is computed from it."""

    def __init__(self, folder: Path) -> None:
        """Take up a session where its files say it was left."""
        self.folder = folder
        self.view: dict[str, Any] = read_json(folder / VIEW) or {"version": 0, "stage": "empty"}
        self.diagnosis: Diagnosis | None = None
        self._case: Case | None = None
        self._investigation: Investigation | None = None
        self._progress: Progress | None = None

    @property
    def case(self) -> Case:
        """Return the case of the session.

        Raises:
            MeasurementError: there is none yet.
        """
        if self._case is None:
            path = self.view.get("path")
            if not path:
                raise MeasurementError("There is no data yet; choose an example or drop files in step 1.")
            self._case = read_case(path)
        return self._case

    def show(self, **changes: Any) -> None:
        """Change what the pages show."""
        self._write(self.view | changes)

    def _write(self, view: dict[str, Any]) -> None:
        view["version"] = self.view["version"] + 1
        write_json(self.folder / VIEW, view)
        self.view = view

    def opened(self, path: Path, source: dict[str, Any], imported: dict[str, Any] | None = None) -> None:
        """Take a case in place of what was there before, and show its measurements."""
        case = read_case(path)
        write_traces(self.folder, case, {})
        self._write(
            {
                "durations": self.view.get("durations", {}),
                "stage": "opened",
                "path": str(path),
                "source": source,
                "case": case_view(case),
                "imported": imported,
                "script": [],
                "models": [[]],
            }
        )
        self._case, self._investigation, self.diagnosis = case, None, None

    def investigation(self, progress: Progress) -> Investigation:
        """Return the investigation with the models that the session has seen, fitted anew if the worker is new."""
        self._progress = progress
        if self._investigation is None:
            one = Investigation(self.case, progress=self._report).follow(self.view["models"])
            for labels in one.path[1:]:
                progress(f"refitting {' + '.join(labels) or 'the base model'}, as before")
                one.cache.fit(labels)
            self._investigation = one
        return self._investigation

    def as_shown(self) -> None:
        """Go back to the model that the pages show: a job that ended early may have been beyond it."""
        if self._investigation is not None:
            self._investigation.follow(self.view["models"])

    def _report(self, now: str) -> None:
        """Pass what the investigation does on to the job of the moment."""
        if self._progress is not None:
            self._progress(now)

    def show_model(self, progress: Progress, **changes: Any) -> None:
        """Write traces, previews, maps and words of the present model, and show them."""
        one = self.investigation(progress)
        progress("scoring every candidate")
        previews = one.preview()
        maps = [one.regime_map(channel) for channel in one.noise]
        view = model_view(one, previews, maps)
        progress("writing the traces")
        models = {BASE: one.models()[0].predictions}
        if one.added:
            models[MODEL] = one.present().predictions
        write_traces(self.folder, one.case, models)
        write_previews(self.folder, one.case, previews)
        write_cells(self.folder, maps)
        view |= {"case": case_view(one.case), "models": [list(labels) for labels in one.path]}
        view["sweepable"] = sweepable(one.extended_case())
        self.show(stage="compared", **view, **changes)

    def usual_s(self, job: str) -> float | None:
        """Return how long such a job took last time."""
        return self.view.get("durations", {}).get(job)

    def took(self, job: str, seconds: float) -> None:
        """Remember how long a job took."""
        self.view.setdefault("durations", {})[job] = round(seconds, 2)
        self.view["at"] = time.time()
        write_json(self.folder / VIEW, self.view)
