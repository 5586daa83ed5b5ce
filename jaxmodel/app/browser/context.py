"""What every part of a page works with: its session, the workers, and how to ask for a job."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jaxmodel.app.browser.sessions import Session
from jaxmodel.app.browser.workers import Workers


class Context:
    """One page of one session."""

    def __init__(self, session: Session, workers: Workers, go: Callable[[str], None]) -> None:
        """Take what a page shows and how it moves on; `go` takes the name of a step."""
        self.session, self.workers, self.go = session, workers, go
        # What a form of this page holds until it is sent.
        self.form: dict[str, Any] = {}

    @property
    def view(self) -> dict[str, Any]:
        """Return what is to be shown."""
        return self.session.view

    @property
    def stage(self) -> str:
        """Return how far the session is: "empty", "opened" or "compared"."""
        return self.view["stage"]

    @property
    def is_busy(self) -> bool:
        """Return True while a job is running."""
        return self.session.wanted is not None

    @property
    def address(self) -> str:
        """Return the path of the session."""
        return f"/s/{self.session.name}"

    def do(self, job: str, **with_: Any) -> None:
        """Begin a job, unless one is running."""
        self.workers.do(self.session, job, **with_)

    def stop(self) -> None:
        """Stop the running job."""
        self.workers.stop(self.session)
