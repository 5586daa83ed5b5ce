"""Where the time of a command goes: what its main thread does, looked at two hundred times a second."""

from __future__ import annotations

import collections
import contextlib
import os
import sys
import threading
from collections.abc import Iterator
from time import perf_counter, process_time
from types import FrameType

from jaxmodel.app.terminal import table

# Seconds between two looks: short beside what a person notices, long beside a look.
_EVERY_S = 0.005
# Of the whole; what took less is in one row.
_LEAST_SHARE = 0.01
# What a frame of these files, or a function of one, stands for: of all frames the one that was called first decides.
_OF_FILES = (
    ("<frozen importlib", "", "importing Python modules"),
    ("jaxmodel/lanes/machine.py", "", "LLVM makes kernels"),
    ("jaxmodel/lanes/module.py", "_made", "tracing and writing kernels"),
    ("jaxmodel/lanes/pool.py", "", "running kernels"),
    ("jax/_src/compiler.py", "", "XLA compiles"),
    ("jax/_src/interpreters/mlir.py", "", "tracing for XLA"),
    ("jax/_src/interpreters/partial_eval.py", "", "tracing for XLA"),
    ("jaxmodel/plots/", "", "drawing pictures"),
    ("matplotlib/", "", "drawing pictures"),
)


class Timings:
    """A thread that looks at the main one until it is told to stop."""

    def __init__(self) -> None:
        """Begin; what the process has computed until now is the start of Python and of the command line."""
        self._spent = collections.defaultdict(float, {"Python and the command line": process_time()})
        self._main = threading.main_thread().ident
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def stop(self) -> dict[str, float]:
        """End, and return the seconds by what was done, the most first."""
        self._ended.set()
        self._thread.join()
        return dict(sorted(self._spent.items(), key=lambda one: -one[1]))

    def _look(self) -> None:
        before = perf_counter()
        while not self._ended.wait(_EVERY_S):
            frame, now = sys._current_frames().get(self._main or 0), perf_counter()
            self._spent[_what(frame)] += now - before
            before = now


def _what(frame: FrameType | None) -> str:
    """Return what a thread does: the outermost of its frames that stands for something, else the innermost room."""
    found, room = "", ""
    while frame is not None:
        file, function = frame.f_code.co_filename.replace(os.sep, "/"), frame.f_code.co_name
        found = next((what for part, name, what in _OF_FILES if part in file and function.startswith(name)), found)
        if not room and "jaxmodel/" in file:
            room = file.rpartition("jaxmodel/")[2].partition("/")[0].removesuffix(".py")
        frame = frame.f_back
    return found or f"computing in {room or 'other packages'}"


@contextlib.contextmanager
def told() -> Iterator[None]:
    """Look on while a command runs, and print where its time went."""
    timings = Timings()
    try:
        yield
    finally:
        spent = timings.stop()
        whole = sum(spent.values())
        rows = {what: seconds for what, seconds in spent.items() if seconds >= _LEAST_SHARE * whole}
        rows |= {"all else": whole - sum(rows.values()), "whole command": whole}
        table(
            "Time",
            ["what", "s", "share"],
            [[what, f"{seconds:.2f}", f"{seconds / whole:.0%}"] for what, seconds in rows.items()],
            right=(1, 2),
        )
