"""A peer in a process of its own: a program that stays ready and runs its job whenever it is asked."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

_PROGRAMS = Path(__file__).with_name("peers")
PEERS = ("numba", "pybamm", "thevenin")


class NoPeer(Exception):
    """The peer is not installed or fails; the message says which."""


class Peer:
    """A program of benchmarks/peers with its job done once: what it found is in `soc` and `voltage_V`."""

    def __init__(self, name: str, job: dict[str, Any]) -> None:
        if importlib.util.find_spec(name) is None:
            raise NoPeer("not installed; run make bench-peers")
        self._process = subprocess.Popen(
            [sys.executable, str(_PROGRAMS / f"by_{name}.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        found = self._ask(json.dumps(job))
        self.soc, self.voltage_V = np.array(found["soc"]), np.array(found["voltage_V"])

    def __call__(self) -> None:
        """Run the job once."""
        self._ask("")

    def close(self) -> None:
        """End the program."""
        self._process.communicate()

    def _ask(self, line: str) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            errors = self._process.communicate()[1].strip().splitlines()
            raise NoPeer(errors[-1] if errors else "ended without a word")
        return json.loads(answer)
