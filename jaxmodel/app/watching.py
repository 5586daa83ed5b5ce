"""Progress for a person who calls from Python: a line in a notebook's cell, or that of the terminal.

The line of a notebook is HTML of its own and needs no widgets, so that every front end shows it; it goes when the work
is done.
"""

from __future__ import annotations

import contextlib
import html
import importlib
import time
from collections.abc import Iterator, Mapping
from typing import Any

from jaxmodel.app import terminal
from jaxmodel.app.left import Left
from jaxmodel.base.progress import Count, Stage, notebook

_PAUSE_S = 0.2  # between two changes of a cell: each is a message to the browser


@contextlib.contextmanager
def stages(what: str, shares: Mapping[str, float]) -> Iterator[Stage]:
    """Show what some work is doing now; arguments as those of `jaxmodel.app.terminal.stages`."""
    if notebook() is None:
        with terminal.stages(what, shares) as tell:
            yield tell
        return
    left = Left(shares)
    with _cell() as line:

        def tell_line(now: str) -> None:
            line.show(None, f"{what}: {now}{terminal.words_left(left, now)}", always=True)

        yield tell_line


@contextlib.contextmanager
def counted(what: str, unit: str) -> Iterator[Count]:
    """Show how far some work of known size is; arguments as those of `jaxmodel.app.terminal.counted`."""
    if notebook() is None:
        with terminal.counted(what, unit) as tell:
            yield tell
        return
    pace = terminal.Pace(unit)
    with _cell() as line:

        def tell_line(done: int, total: int) -> None:
            at_pace = pace.sentence(done, total)
            line.show(done / max(total, 1), f"{what}: {done:,} of {total:,} {unit}{at_pace and ', '}{at_pace}")

        yield tell_line


class _Line:
    """One line in the output of a cell."""

    def __init__(self) -> None:
        self._display = importlib.import_module("IPython.display")
        self._handle: Any = self._display.display(self._display.HTML(""), display_id=True)
        self._shown_at = 0.0

    def show(self, share: float | None, words: str, *, always: bool = False) -> None:
        """Show words, beside a bar where the share that is done is known; not always more than five times a second."""
        now = time.monotonic()
        if not always and share != 1.0 and now < self._shown_at + _PAUSE_S:
            return
        self._shown_at = now
        bar = "" if share is None else f"<progress value='{share:.4f}' max='1'></progress> "
        self._handle.update(self._display.HTML(f"{bar}<small>{html.escape(words)}</small>"))

    def clear(self) -> None:
        """Show nothing more."""
        self._handle.update(self._display.HTML(""))


@contextlib.contextmanager
def _cell() -> Iterator[_Line]:
    line = _Line()
    try:
        yield line
    finally:
        line.clear()
