"""How far a job is, in a file of the session's folder; and its end where the user stops it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from jaxmodel.app.browser.files import PROGRESS, STOP, write_json

# Usual share of a job that is done when a part of it starts, by the first words of the part. Assumed.
DONE_BY = {
    "diagnose": {"refitting": 0.1, "adding": 0.4, "dropping": 0.6, "comparing": 0.8, "searching": 0.9},
    "open": {"calibrating": 0.05, "scoring": 0.85, "writing": 0.95},
    "upload": {"calibrating": 0.1, "scoring": 0.85, "writing": 0.95},
    "compare": {"calibrating": 0.05, "scoring": 0.85, "writing": 0.95},
    "add": {"calibrating": 0.0, "refitting": 0.05, "scoring": 0.8, "writing": 0.95},
    "drop": {"calibrating": 0.0, "refitting": 0.05, "scoring": 0.8, "writing": 0.95},
    "keep": {"concluding": 0.0, "pictures": 0.4},
}
# No time left is named before this share of the work is done and so many seconds have passed: it would be a guess.
_LEAST_SHARE, _LEAST_S = 0.04, 1.5


class Stopped(Exception):
    """The user has stopped the job."""


class Progress:
    """What a job does now, since when, and how much of it is done."""

    def __init__(self, folder: Path, job: dict[str, Any], usual_s: float | None = None) -> None:
        """Begin a job; `usual_s` is how long such a job took before."""
        self._folder, self._job, self._usual_s = folder, job, usual_s
        self._began, self._share = time.time(), 0.0
        (folder / STOP).unlink(missing_ok=True)
        self._write("running", "starting")

    @property
    def job(self) -> str:
        """Return the name of the job, which no other has."""
        return self._job["id"]

    @property
    def elapsed_s(self) -> float:
        """Return how long the job has taken."""
        return time.time() - self._began

    def __call__(self, now: str, share: float | None = None) -> None:
        """Say what is done next, and the share of the job that is done, if it is known.

        Raises:
            Stopped: the user has stopped the job.
        """
        if (self._folder / STOP).exists():
            raise Stopped
        known = [start for start in DONE_BY.get(self._job["do"], {}) if now.startswith(start)]
        if share is None and known:
            share = DONE_BY[self._job["do"]][max(known, key=len)]
        if share is None and self._usual_s:
            share = min(self.elapsed_s / self._usual_s, 0.95)
        self._share = max(self._share, share or 0.0)
        self._write("running", now)

    def counted(self, what: str, unit: str):
        """Return a function of (done, total) that reports a counted part of the job."""

        def tell(done: int, total: int) -> None:
            self(f"{what}: {done:,} of {total:,} {unit}", done / max(total, 1))

        return tell

    def end(self, state: str, sentence: str = "") -> None:
        """Say how the job ended: "done", "stopped", or "failed" with the sentence that says why."""
        self._write(state, sentence)

    def _write(self, state: str, now: str) -> None:
        left = None
        if state == "running" and self._usual_s:
            left = max(self._usual_s - self.elapsed_s, 0.0)
        elif state == "running" and self._share > _LEAST_SHARE and self.elapsed_s > _LEAST_S:
            left = self.elapsed_s * (1.0 - self._share) / self._share
        content = {"id": self._job["id"], "do": self._job["do"], "state": state, "now": now, "share": self._share}
        write_json(self._folder / PROGRESS, content | {"began": self._began, "ended": time.time(), "left_s": left})
