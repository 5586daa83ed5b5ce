"""The processes that do the work: one for each session in use, and a spare one that has loaded everything."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from jaxmodel.app.browser.files import LOG, PROGRESS, WANTED, read_json
from jaxmodel.app.browser.sessions import Session

# A job that is asked to stop and has not after so many seconds is ended with its worker.
PATIENCE_S = 4.0
# A worker without a job for so long is ended; its session is taken up from its files.
IDLE_S = 900.0
# Workers at a time; the one idle for longest makes room. Where all have a job, a further job waits.
MOST = 4


class Worker:
    """One process, from its start to its end."""

    def __init__(self) -> None:
        """Start a process, which loads the model and then waits for a session."""
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
        root = str(Path(__file__).parents[3])
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "jaxmodel.app.browser.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,  # until the worker knows its session, whose log it then writes
            env=environment,
        )
        self.used_at = time.monotonic()

    @property
    def lives(self) -> bool:
        """Return True while the process runs."""
        return self.process.poll() is None

    def tell(self, line: dict[str, object]) -> None:
        """Send a line; one that has ended takes none."""
        assert self.process.stdin is not None
        self.used_at = time.monotonic()
        self.process.stdin.write(json.dumps(line).encode() + b"\n")
        self.process.stdin.flush()

    def end(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.wait()


class Workers:
    """The workers of all sessions."""

    def __init__(self, *, spare: bool = True) -> None:
        """Start the spare worker, unless none is wanted."""
        self._of: dict[Path, Worker] = {}
        self._stopping: dict[Path, float] = {}
        self._waiting: list[Session] = []
        self._keeps_spare = spare
        self._spare = Worker() if spare else None

    def do(self, session: Session, job: str, **with_: object) -> bool:
        """Begin a job of a session, at once or when a worker is free; False if another one of it has not ended."""
        if session.wanted is not None:
            return False
        session.want(job, **with_)
        self._waiting.append(session)
        self.begin_waiting()
        return True

    def take_up(self, session: Session) -> None:
        """Begin again what a session wanted when the server, or its worker, went away."""
        worker = self._of.get(session.folder)
        begun = session in self._waiting or (worker is not None and worker.lives)
        if session.wanted is not None and not begun:
            self._waiting.append(session)
            self.begin_waiting()

    def begin_waiting(self) -> None:
        """Begin the jobs that wait, the oldest first, while workers are free; say how many are before each other."""
        while self._waiting and self._busy() < MOST:
            session = self._waiting.pop(0)
            if session.wanted is not None:
                self._send(session, session.begins())
        for before, session in enumerate(self._waiting, self._busy()):
            session.waits(before)

    def _busy(self) -> int:
        waiting = {session.folder for session in self._waiting}
        at_work = {folder: worker for folder, worker in self._of.items() if folder not in waiting}
        return sum((folder / WANTED).exists() and worker.lives for folder, worker in at_work.items())

    def stop(self, session: Session) -> None:
        """Ask a session's job to stop; `look_after` ends its worker if it does not."""
        if session in self._waiting:
            self._waiting.remove(session)
            session.was_stopped()
        elif session.wanted is not None:
            session.ask_to_stop()
            self._stopping.setdefault(session.folder, time.monotonic())

    def look_after(self, session: Session) -> None:
        """End a job that was asked to stop and did not, say it where a worker has died, and begin jobs that wait."""
        worker = self._of.get(session.folder)
        since = self._stopping.get(session.folder)
        if session.wanted is None:
            self._stopping.pop(session.folder, None)
        elif since is not None and time.monotonic() - since > PATIENCE_S:
            self._forget(session.folder)
            session.was_stopped()
        elif session not in self._waiting and worker is not None and not worker.lives:
            self._forget(session.folder)
            session.was_stopped(
                f"The worker of this session ended unexpectedly; {LOG} in its folder has the rest. Try again.", "failed"
            )
        self.begin_waiting()

    def end_idle(self) -> None:
        """End workers that had nothing to do for long."""
        for folder, worker in self._of.items():
            if (folder / WANTED).exists():
                worker.used_at = time.monotonic()
        for folder, worker in self._idle():
            if time.monotonic() - worker.used_at > IDLE_S:
                self._forget(folder)

    def _idle(self) -> list[tuple[Path, Worker]]:
        """Return the workers without a job, the one that had none for longest first."""
        idle = [(folder, worker) for folder, worker in self._of.items() if _has_ended(folder)]
        return sorted(idle, key=lambda pair: pair[1].used_at)

    def end_all(self) -> None:
        """End every worker."""
        for folder in list(self._of):
            self._forget(folder)
        if self._spare is not None:
            self._spare.end()
            self._spare = None

    def _send(self, session: Session, job: dict[str, object]) -> None:
        worker = self._of.get(session.folder)
        if worker is None or not worker.lives:
            worker = self._new_for(session)
        worker.tell(job)

    def _new_for(self, session: Session) -> Worker:
        worker = self._spare if self._spare is not None and self._spare.lives else Worker()
        self._spare = None
        for folder, _ in self._idle()[: max(0, len(self._of) - MOST + 1)]:
            self._forget(folder)
        worker.tell({"folder": str(session.folder)})
        self._of[session.folder] = worker
        return worker

    def keep_spare(self) -> None:
        """Start a spare worker again where it was used and the others are idle."""
        if self._keeps_spare and self._spare is None and len(self._of) < MOST:
            self._spare = Worker()

    def _forget(self, folder: Path) -> None:
        self._stopping.pop(folder, None)
        worker = self._of.pop(folder, None)
        if worker is not None:
            worker.end()


def _has_ended(folder: Path) -> bool:
    """Return whether a session's job has ended, and its worker has said so, which it does last."""
    return not (folder / WANTED).exists() and (read_json(folder / PROGRESS) or {}).get("state") != "running"
