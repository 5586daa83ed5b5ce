"""What every command takes as a user types it: the whole process, programs compiled anew (cold) and kept (warm)."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
_CELL, _ROBOT, _STUDY = "examples/samsung_30q", "examples/paper_experiment", "examples/paper_sweep.toml"
# By what a row is called: the words of the command, without its folder for results.
COMMANDS = {
    "import, a cell's logs": ["import", *(f"{_CELL}/cc{rate}C.csv" for rate in range(1, 5)), "--kind", "cell"],
    "simulate, cell": ["simulate", _CELL],
    "simulate, robot": ["simulate", _ROBOT],
    "compare, cell": ["compare", _CELL],
    "diagnose, cell": ["diagnose", _CELL],
    "diagnose, robot": ["diagnose", _ROBOT],
    "identify, cell": ["identify", _CELL],
    "parameterise, cell": ["parameterise", _CELL],
    "sweep, robots": ["sweep", _STUDY],
    "sensitivity, cell": ["sensitivity", "examples/pulsed_cell.toml"],
    "mission": ["mission", "examples/missions/house_search.toml"],
    "compensate": ["compensate"],
}
_WARM = 2
# As it was before the other parts: Dask sets malloc so that a command takes twice as long.
_ENVIRONMENT = dict(os.environ)


def _seconds(words: list[str], cache: Path) -> float:
    with tempfile.TemporaryDirectory() as out:
        began = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "jaxmodel.app.cli", *words, "--out", out],
            cwd=ROOT,
            env={**_ENVIRONMENT, "JAXMODEL_CACHE": str(cache)},
            stdout=subprocess.DEVNULL,
            check=True,
        )
        return time.perf_counter() - began


def times_of_commands() -> list[dict[str, Any]]:
    """Return the seconds of each command: the first run, and the shorter of the next two."""
    rows = []
    for name, words in COMMANDS.items():
        with tempfile.TemporaryDirectory() as cache:
            cold, *warm = [_seconds(words, Path(cache)) for _ in range(1 + _WARM)]
        rows.append({"name": name, "cold_s": cold, "warm_s": min(warm)})
    return rows
