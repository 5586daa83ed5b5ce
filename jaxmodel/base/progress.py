"""How far long work is, as its caller wants it: shown to a person, told to a function, or not at all.

What takes `progress=` takes True, which shows it where somebody watches (a terminal, a notebook), False, which shows
nothing, or a function that is told. It opens `stages` or `counted` around its work. Work within such work shows nothing
of its own: its caller has asked for the progress of the whole.
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from jaxmodel.base.late_binding import late_bound

Stage = Callable[[str], None]
"""Called with what is done next."""
Count = Callable[[int, int], None]
"""Called with what is done and all there is to do, at the start and then as work is done."""
_under_way: list[str] = []  # works that have begun and not ended, the outermost first


@dataclasses.dataclass(frozen=True)
class Shown:
    """What shows the progress of some work; the room `app` does, and is imported where somebody watches."""

    what: str

    def stages(self, shares: Mapping[str, float]) -> contextlib.AbstractContextManager[Stage]:
        """Return what shows parts of the work, one after the other."""
        return late_bound("jaxmodel.app.watching:stages")(self.what, shares)

    def counted(self, unit: str) -> contextlib.AbstractContextManager[Count]:
        """Return what shows work of known size."""
        return late_bound("jaxmodel.app.watching:counted")(self.what, unit)


@contextlib.contextmanager
def stages(progress: bool | Stage, what: str, shares: Mapping[str, float] | None = None) -> Iterator[Stage]:
    """Tell what some work is doing now to whom its caller wants.

    Args:
        progress: of the caller.
        what: the work.
        shares: by the first words of a stage, the share of the work that is usually done by then.

    Yields:
        A function to be called with what is done next.
    """
    with _one_of_all(what) as is_outermost:
        if callable(progress):
            yield progress
        elif progress and is_outermost and is_watched():
            with Shown(what).stages(shares or {}) as tell:
                yield tell
        else:
            yield lambda now: None


@contextlib.contextmanager
def counted(progress: bool | Count, what: str, unit: str) -> Iterator[Count]:
    """Tell how far some work of known size is to whom its caller wants.

    Args:
        progress: of the caller.
        what: the work.
        unit: of what is counted.

    Yields:
        A function to be called with (done, total): at the start, and then as work is done.
    """
    with _one_of_all(what) as is_outermost:
        if callable(progress):
            yield progress
        elif progress and is_outermost and is_watched():
            with Shown(what).counted(unit) as tell:
                yield tell
        else:
            yield lambda done, total: None


@contextlib.contextmanager
def _one_of_all(what: str) -> Iterator[bool]:
    """Take note of some work while it lasts; yields True if it is not within other work."""
    _under_way.append(what)
    try:
        yield len(_under_way) == 1
    finally:
        _under_way.remove(what)


def is_watched() -> bool:
    """Return True where somebody sees what is shown now: at a terminal or in a notebook."""
    return notebook() is not None or bool(sys.stderr and sys.stderr.isatty())


def notebook() -> Any:
    """Return the shell of the notebook in which this program runs; None if it runs in none."""
    ipython = sys.modules.get("IPython")  # a notebook has imported it
    shell = None if ipython is None else ipython.get_ipython()
    return shell if hasattr(shell, "kernel") else None
