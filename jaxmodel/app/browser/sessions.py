"""Sessions on disk: a folder each, below the folder of its user, readable by the owner of the server alone."""

from __future__ import annotations

import re
import secrets
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxmodel.app.browser.files import PROGRESS, STOP, UPLOADS, VIEW, WANTED, read_json, write_json

# A file, and all files of a session (bytes).
MOST_OF_A_FILE, MOST_OF_A_SESSION = 500 * 2**20, 2 * 2**30
MOST_FILES = 200
_NAME = re.compile(r"[0-9a-f]{32}")
_CODE = (".py", ".pyc", ".so", ".dll", ".sh", ".exe", ".bat", ".pickle", ".pkl", ".html", ".svg", ".js")


class UploadRefused(ValueError):
    """A file cannot be taken; the text is one sentence for the page."""


class Session:
    """The folder of one session, as the server sees it: its worker writes there, its pages read."""

    def __init__(self, folder: Path) -> None:
        """Take a session's folder."""
        self.folder = folder
        self._seen: dict[str, tuple[tuple[int, int], Any]] = {}

    @property
    def name(self) -> str:
        """Return the session's name, which is part of its address."""
        return self.folder.name

    @property
    def view(self) -> dict[str, Any]:
        """Return what its pages show."""
        return self.content(VIEW) or {"version": 0, "stage": "empty"}

    @property
    def progress(self) -> dict[str, Any] | None:
        """Return how far its present or last job is; None before the first."""
        return self.content(PROGRESS)

    @property
    def wanted(self) -> dict[str, Any] | None:
        """Return the job that was asked for and has not ended."""
        return self.content(WANTED)

    def content(self, name: str) -> Any:
        """Return what a JSON file of the folder holds, read anew only when it has changed."""
        path = self.folder / name
        try:
            state = path.stat()
        except OSError:
            return None
        key = (state.st_mtime_ns, state.st_ino)
        if name not in self._seen or self._seen[name][0] != key:
            self._seen[name] = (key, read_json(path))
        return self._seen[name][1]

    def has(self, job: Mapping[str, Any]) -> bool:
        """Return True if the session is of the data that a first job would open, or is about to open them."""
        asked, wanted = job["with"], self.wanted
        if wanted is not None and wanted["do"] == job["do"] and wanted["with"] == asked:
            return True
        if "path" not in self.view:
            return False
        if job["do"] == "open":
            return Path(asked["path"]) in (Path(self.view["path"]), Path(self.view["path"]).parent)
        source = self.view["source"]
        return source.get("paths") == asked["files"] and source.get("kind") == asked["kind"]

    def want(self, job: str, **with_: Any) -> dict[str, Any]:
        """Write down a job that is to be done, and return it."""
        wanted = {"id": secrets.token_hex(8), "do": job, "with": with_}
        (self.folder / STOP).unlink(missing_ok=True)
        write_json(self.folder / WANTED, wanted)
        return self.begins()

    def begins(self, now: str = "starting") -> dict[str, Any]:
        """Write down that the job that is wanted begins, or what it waits for, and return it."""
        wanted = self.wanted
        assert wanted is not None
        began = {"id": wanted["id"], "do": wanted["do"], "state": "running", "now": now, "share": 0.0, "left_s": None}
        write_json(self.folder / PROGRESS, began | {"began": time.time(), "ended": time.time()})
        return wanted

    def waits(self, before: int) -> None:
        """Write down that the job waits until some others have ended."""
        now = f"waiting for {before} jobs of other sessions"
        if (self.progress or {}).get("now") != now:
            self.begins(now)

    def ask_to_stop(self) -> None:
        """Ask the worker to end its job where it next reports."""
        (self.folder / STOP).touch(mode=0o600)

    def was_stopped(self, sentence: str = "", state: str = "stopped") -> None:
        """Write down that the job has ended with its worker."""
        last = self.progress or {"id": "", "do": "", "share": 0.0, "began": time.time()}
        (self.folder / WANTED).unlink(missing_ok=True)
        (self.folder / STOP).unlink(missing_ok=True)
        ended = {"state": state, "now": sentence, "ended": time.time(), "left_s": None}
        write_json(self.folder / PROGRESS, last | ended)

    @property
    def uploads(self) -> list[tuple[str, int]]:
        """Return name and size of every file that was dropped."""
        folder = self.folder / UPLOADS
        found = sorted(path for path in folder.glob("*") if path.is_file() and not path.name.startswith("."))
        return [(path.name, path.stat().st_size) for path in found]

    def place_for(self, name: str, size: int) -> Path:
        """Return where an upload of some bytes goes.

        Raises:
            UploadRefused: it is too large, it is code, or there are too many.
        """
        safe = safe_name(name)
        if safe.lower().endswith(_CODE):
            raise UploadRefused(f"{safe} is code or a page, which the workbench does not take; drop measurements.")
        others = [bytes_ for other, bytes_ in self.uploads if other != safe]
        if size > MOST_OF_A_FILE:
            raise UploadRefused(f"{safe} is larger than {MOST_OF_A_FILE // 2**20} MB; import it on the command line.")
        if sum(others) + size > MOST_OF_A_SESSION or len(others) >= MOST_FILES:
            raise UploadRefused(
                f"{safe} does not fit: a session takes {MOST_FILES} files and {MOST_OF_A_SESSION // 2**30} GB; "
                "remove others first."
            )
        folder = self.folder / UPLOADS
        folder.mkdir(mode=0o700, exist_ok=True)
        return folder / safe

    def remove_uploads(self) -> None:
        """Remove every file that was dropped."""
        shutil.rmtree(self.folder / UPLOADS, ignore_errors=True)


def safe_name(name: str) -> str:
    """Return the last part of a file name, without what could lead out of a folder or hide it.

    Raises:
        UploadRefused: nothing is left of it.
    """
    last = re.split(r"[\\/]", name)[-1]
    safe = re.sub(r"[^\w.+ ()\-]", "_", last).strip(" .")[:120].strip(" .")
    if not safe:
        raise UploadRefused("A file without a name cannot be taken; rename it.")
    return safe


class Sessions:
    """All sessions below one folder, by user."""

    def __init__(self, folder: Path) -> None:
        """Take a work folder, which is made if need be."""
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._folder = folder / "sessions"
        self._folder.mkdir(mode=0o700, exist_ok=True)
        self._open: dict[Path, Session] = {}

    def of(self, user: str, name: str) -> Session | None:
        """Return a session of a user; None if there is none of this name, or it is another user's."""
        if not (_NAME.fullmatch(user) and _NAME.fullmatch(name)):
            return None
        path = self._folder / user / name
        if not path.is_dir():
            return None
        return self._open.setdefault(path, Session(path))

    def new(self, user: str) -> Session:
        """Begin a session."""
        own = self._folder / user
        own.mkdir(mode=0o700, exist_ok=True)
        path = own / secrets.token_hex(16)
        path.mkdir(mode=0o700)
        return self._open.setdefault(path, Session(path))

    def latest(self, user: str) -> Session | None:
        """Return the session that a user worked on last."""
        found = self.all_of(user)
        return found[0] if found else None

    def all_of(self, user: str) -> list[Session]:
        """Return the sessions of a user, the last used first."""
        ordered = sorted(_sessions_in(self._folder / user), key=lambda path: -_used_at(path))
        return [self._open.setdefault(path, Session(path)) for path in ordered]

    def remove_unused(self, since_s: float) -> int:
        """Remove the sessions of all users that were last used before a time (s since 1970); return how many."""
        unused = [path for path in self._all() if _used_at(path) < since_s]
        for path in unused:
            self._open.pop(path, None)
            shutil.rmtree(path, ignore_errors=True)
        return len(unused)

    def size(self) -> tuple[int, int]:
        """Return how many sessions there are, and their bytes."""
        found = self._all()
        return len(found), sum(_size(file) for path in found for file in path.rglob("*"))

    def _all(self) -> list[Path]:
        return [path for user in self._folder.iterdir() for path in _sessions_in(user)]


def _sessions_in(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*") if _NAME.fullmatch(path.name) and path.is_dir()]


def _size(path: Path) -> int:
    try:
        return 0 if path.is_dir() else path.lstat().st_size
    except OSError:  # a worker has removed it meanwhile
        return 0


def _used_at(path: Path) -> float:
    view = path / VIEW
    return (view if view.exists() else path).stat().st_mtime
