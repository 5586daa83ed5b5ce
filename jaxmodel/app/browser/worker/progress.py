"""How far a job is, in a file of the session's folder; and its end where the user stops it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from jaxmodel.app.browser.files import PROGRESS, STOP, write_json
from jaxmodel.app.left import Left, of_part

# Usual share of a job that is done when a part of it starts, by the first words of the part. Assumed.
DONE_BY = {
    "open": {"calibrating": 0.05, "scoring": 0.85, "writing": 0.95},
    "upload": {"calibrating": 0.1, "scoring": 0.85, "writing": 0.95},
    "compare": {"calibrating": 0.05, "scoring": 0.85, "writing": 0.95},
    "add": {"calibrating": 0.0, "refitting": 0.05, "scoring": 0.8, "writing": 0.95},
    "drop": {"calibrating": 0.0, "refitting": 0.05, "scoring": 0.8, "writing": 0.95},
    "keep": {"concluding": 0.0, "pictures": 0.4},
}
# No time left is named before so many seconds have passed: it would be a guess.
_LEAST_S = 1.5
# How long these take follows from what they meet, and not from how long they took before.
_ESTIMATED = ("diagnose", "sweep", "forecast")


class Stopped(Exception):
    """The user has stopped the job."""


class Progress:
    """What a job does now, since when, how much of it is done, and how long it may still take."""

    def __init__(self, folder: Path, job: dict[str, Any], usual_s: float | None = None) -> None:
        """Begin a job; `usual_s` is how long such a job took before."""
        self._folder, self._job = folder, job
        self._usual_s = None if job["do"] in _ESTIMATED else usual_s
        self._began, self._share = time.time(), 0.0
        self._left = Left(DONE_BY.get(job["do"], {}))
        self._counted: tuple[float, float] | None = None
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
        self._left.begin(now)
        if share is None:
            share = self._left.share
        if share is None:
            share = of_part(DONE_BY.get(self._job["do"], {}), now)
        if share is None and self._usual_s:
            share = min(self.elapsed_s / self._usual_s, 0.95)
        self._share = max(self._share, share or 0.0)
        self._write("running", now)

    def counted(self, what: str, unit: str):
        """Return a function of (done, total) that reports a counted part of the job."""

        def tell(done: int, total: int) -> None:
            share = done / max(total, 1)
            # From the second report on: the first comes before anything is compiled, and after what was done before.
            if self._counted is None or share < self._counted[1]:
                self._counted = time.time(), share
            self(f"{what}: {done:,} of {total:,} {unit}", share)

        return tell

    def end(self, state: str, sentence: str = "") -> None:
        """Say how the job ended: "done", "stopped", or "failed" with the sentence that says why."""
        self._write(state, sentence)

    def _write(self, state: str, now: str) -> None:
        left = self._left_s() if state == "running" else None
        content = {"id": self._job["id"], "do": self._job["do"], "state": state, "now": now, "share": self._share}
        write_json(self._folder / PROGRESS, content | {"began": self._began, "ended": time.time(), "left_s": left})

    def _left_s(self) -> float | None:
        """Return the time left; None where it is not known."""
        if self._usual_s:
            return self._usual_s - self.elapsed_s if self.elapsed_s < self._usual_s else None
        if self._counted:
            began, at_first = self._counted
            done = self._share - at_first
            return (time.time() - began) * (1.0 - self._share) / done if done > 0.0 else None
        return self._left.seconds() if self.elapsed_s > _LEAST_S else None
