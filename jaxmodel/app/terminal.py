"""Talking to a person at a terminal: tables, progress with an estimate, and plain lines where nobody watches."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from jaxmodel.app.left import Left

_PLAIN_WIDTH = 140
PLAIN_PAUSE_S = 30.0  # after which a part of some work that lasts is named again
_STILL = "still "
_PLAIN_SHARE = 0.25  # of the work, between two plain lines


def console(stderr: bool = False) -> Console:
    """Return a console on today's stdout or stderr, wide where its output goes to a file."""
    stream = sys.stderr if stderr else sys.stdout
    return Console(
        file=stream, width=None if stream.isatty() else _PLAIN_WIDTH, highlight=False, soft_wrap=not stream.isatty()
    )


def say(sentence: str) -> None:
    """Print a sentence to stdout, as it is."""
    console().print(sentence, markup=False)


def complain(sentence: str) -> None:
    """Print a sentence to stderr, on one line."""
    print(" ".join(sentence.split()), file=sys.stderr)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> None:
    """Print a table; `right` are the numbers of the columns to align to the right."""
    shown = Table(title=Text(title), title_justify="left", title_style="bold", header_style="bold")
    for number, name in enumerate(columns):
        shown.add_column(Text(name), justify="right" if number in right else "left", overflow="fold")
    for row in rows:
        shown.add_row(*map(Text, row))  # a unit in brackets is no markup
    console().print(shown)


class Pace:
    """How fast work of known size goes, from its second report on: the first comes before anything is compiled."""

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._reports = 0
        self._base = (0.0, 0)

    def sentence(self, done: int, total: int) -> str:
        """Return the rate and the time left, "" while they are not known."""
        now, self._reports = time.perf_counter(), self._reports + 1
        if self._reports == 2:
            self._base = (now, done)
        seconds, more = now - self._base[0], done - self._base[1]
        if self._reports <= 2 or more <= 0 or seconds <= 0.0:
            return ""
        return f"{more / seconds:,.0f} {self._unit}/s, about {duration((total - done) * seconds / more)} left"


def words_left(left: Left, now: str) -> str:
    """Return what is left where a part begins or lasts ("still ..."), as the end of a sentence; "" if not known."""
    if not now.startswith(_STILL):
        left.begin(now)
    seconds = left.seconds()
    return "" if seconds is None else f", about {duration(float(round(seconds)))} left"


def duration(seconds: float) -> str:
    """Return a time for a person: 42 s, 12 min, 3.4 h, 2.1 days."""
    for limit, size, unit in ((120.0, 1.0, "s"), (7200.0, 60.0, "min"), (172_800.0, 3600.0, "h")):
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 86_400.0:.3g} days"


@contextlib.contextmanager
def counted(what: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Show how far some work of known size is, how fast it goes, and the time left.

    Yields:
        A function to be called with (done, total): at the start, and then as work is done.
    """
    pace = Pace(unit)
    if sys.stderr.isatty():
        columns = (
            TextColumn(what),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn(unit),
            TimeElapsedColumn(),
            TextColumn("{task.fields[pace]}"),
        )
        with Progress(*columns, console=console(stderr=True), transient=True) as bar:
            task = bar.add_task(what, total=None, pace="")
            yield lambda done, total: bar.update(task, completed=done, total=total, pace=pace.sentence(done, total))
        return
    said: float | None = None

    def tell(done: int, total: int) -> None:
        nonlocal said
        share, at_pace = done / total, pace.sentence(done, total)
        said = share if said is None else said
        if share >= said + _PLAIN_SHARE and done < total:
            say(f"{what}: {done:,} of {total:,} {unit}{at_pace and ', '}{at_pace}")
            said = share

    yield tell


@contextlib.contextmanager
def stages(what: str, shares: Mapping[str, float] | None = None) -> Iterator[Callable[[str], None]]:
    """Show what some work is doing now, since when, and roughly how long it may still take.

    Args:
        what: the work.
        shares: by the first words of a stage, the share of the work that is usually done by then.

    Yields:
        A function to be called with what is done next.
    """
    left = Left(shares or {})
    if sys.stderr.isatty():
        columns = (SpinnerColumn(), TextColumn(what), TextColumn("{task.fields[now]}"), TimeElapsedColumn())
        with Progress(*columns, console=console(stderr=True), transient=True) as bar:
            task = bar.add_task(what, total=None, now="")
            yield lambda now: bar.update(task, now=f"{now}{words_left(left, now)}")
        return
    with _heard_of(lambda now: say(f"{what}: {now} ({left.elapsed_s:.0f} s{words_left(left, now)})")) as tell:
        yield tell


@contextlib.contextmanager
def _heard_of(line: Callable[[str], None]) -> Iterator[Callable[[str], None]]:
    """Print a line when work goes on to its next part, and again every half minute while that lasts.

    Yields:
        A function to be called with what is done next.
    """
    moved, now = threading.Event(), ""
    ended = False

    def watch() -> None:
        while not ended:
            if moved.wait(PLAIN_PAUSE_S):
                moved.clear()
            elif now:
                line(f"{_STILL}{now}")

    def tell(next_part: str) -> None:
        nonlocal now
        now = next_part
        line(next_part)
        moved.set()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield tell
    finally:
        ended = True
        moved.set()
        watcher.join()
