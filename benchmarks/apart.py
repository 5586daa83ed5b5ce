"""A module of the benchmark in a process of its own, and what it says as JSON."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


@dataclasses.dataclass(frozen=True)
class Said:
    """What a process said.

    Attributes:
        output: its output; "" if it took too long.
        complaint: the last line of its errors, its exit status, or that it took too long.
        failed: it took too long, or its exit status is not 0.
        seconds: that it took.
    """

    output: str
    complaint: str
    failed: bool
    seconds: float


def run_apart(module: str, words: Sequence[str], limit_s: float, environment: Mapping[str, str]) -> Said:
    """Run `python -m module words` from the root of the checkout, and end it after `limit_s`."""
    command, began = [sys.executable, "-m", module, *words], time.perf_counter()
    try:
        done = subprocess.run(command, cwd=ROOT, env=dict(environment), capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        return Said("", f"not done after {limit_s:.0f} s", True, time.perf_counter() - began)
    complaint = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
    return Said(done.stdout, complaint, bool(done.returncode), time.perf_counter() - began)


def plain(what: Any) -> Any:
    """Return it with null for numbers that do not exist, and numbers of Python: JSON has neither NaN nor NumPy."""
    if isinstance(what, dict):
        return {name: plain(value) for name, value in what.items()}
    if isinstance(what, list | tuple):
        return [plain(value) for value in what]
    if hasattr(what, "item"):
        what = what.item()
    return None if isinstance(what, float) and not math.isfinite(what) else what
