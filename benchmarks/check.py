"""`make bench-check`: has anything become slower? Each time is a ratio to a peer on this machine, in this run.

A step is held against C by hand, a derivative against a run, and a command against the imports of its libraries, which
no change of ours makes faster. `history.csv` keeps the ratios by commit, `history.png` draws them.
"""

from __future__ import annotations

import csv
import datetime
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.against_c import against_c
from benchmarks.commands import COMMANDS, ROOT
from benchmarks.derivatives import response_of
from benchmarks.timing import alternate
from jaxmodel.lanes.machine import vector_bits
from jaxmodel.sensitivity.by_vectors import answers, slopes

HISTORY = Path(__file__).parent / "history.csv"
FIELDS = ("commit", "date", "vector_bits", "what", "ratio")
# What a ratio may exceed the median of the last ones by: other work on the machine moves it.
BAND, BAND_OF_COMMANDS, LAST = 1.25, 1.4, 5
_LANES, _ROUNDS = 2048, 7
_LANES_OF_SLOPES, _ROUNDS_OF_SLOPES = 256, 3
# The libraries that every command needs, imported in a process of its own.
_PEER = [sys.executable, "-c", "import jax, equinox, pandas, matplotlib.pyplot"]
_COMMANDS = ("simulate, cell", "compare, cell", "import, a cell's logs", "diagnose, cell")


def step(kind: str) -> float | None:
    """Return the core time of a step over that of C by hand; None without a compiler."""
    row = against_c(kind, _LANES, rounds=_ROUNDS)
    return row.get("ratio_cpu")


def derivative(kind: str) -> float:
    """Return the core time of a derivative by one parameter, in runs: of all, less the run, by their number."""
    response = response_of(kind)
    at = np.tile(np.asarray(response.values()), (_LANES_OF_SLOPES, 1))
    count = len(response.names)
    times = alternate(
        {"run": lambda: answers(response, at), "slopes": lambda: slopes(response, at, count)}, _ROUNDS_OF_SLOPES
    )
    run, all_of_them = (min(times[name].cpu_s) for name in ("run", "slopes"))
    return (all_of_them - run) / run / count


def command(name: str) -> float:
    """Return the core time of a whole command, its kernels kept, over that of the imports of its libraries."""
    words = [sys.executable, "-m", "jaxmodel.app.cli", *COMMANDS[name]]
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as out:
        environment = {**os.environ, "JAXMODEL_CACHE": cache}
        _, warm = (_core_s([*words, "--out", f"{out}/{number}"], environment) for number in range(2))
    return warm / min(_core_s(_PEER, dict(os.environ)) for _ in range(3))


def _core_s(words: Sequence[str], environment: dict[str, str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(words, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


MEASURED: dict[str, Callable[[], float | None]] = {
    **{f"step, {kind}": lambda kind=kind: step(kind) for kind in ("cell", "robot")},
    **{f"derivative, {kind}": lambda kind=kind: derivative(kind) for kind in ("cell", "robot")},
    **{name: lambda name=name: command(name) for name in _COMMANDS},
}


def check(keep: bool = False, history: Path = HISTORY) -> str:
    """Measure all ratios and hold them against the last ones; return what has become slower, or "".

    Args:
        keep: append the ratios, with the commit, and draw all.
        history: the file.
    """
    rows = read(history)
    found, slower = {}, []
    for what, measure in MEASURED.items():
        ratio = measure()
        if ratio is None:
            print(f"{what}: not compared, there is no compiler for its peer")
            continue
        found[what] = ratio
        most, said = bound(rows, what)
        print(f"{what}: {ratio:.3g}; {said}", flush=True)
        if ratio > most:
            slower.append(f"{what} takes {ratio:.3g}, at most {most:.3g}")
    if keep:
        append(history, found)
        draw(read(history), history.with_suffix(".png"))
    return f"Slower than it was: {'; '.join(slower)}." if slower else ""


def bound(rows: Sequence[dict[str, Any]], what: str) -> tuple[float, str]:
    """Return what a ratio may be on this processor, and a sentence about it; infinity where none is kept."""
    kept = [row["ratio"] for row in rows if row["what"] == what and row["vector_bits"] == vector_bits()][-LAST:]
    if not kept:
        return float("inf"), f"none is kept of processors with vectors of {vector_bits()} bits"
    band = BAND_OF_COMMANDS if what in COMMANDS else BAND
    usual = statistics.median(kept)
    return band * usual, f"usually {usual:.3g}, at most {band * usual:.3g}"


def read(history: Path) -> list[dict[str, Any]]:
    """Return the rows of a history, the oldest first; none if there is no file."""
    if not history.exists():
        return []
    with history.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [{**row, "ratio": float(row["ratio"]), "vector_bits": int(row["vector_bits"])} for row in rows]


def append(history: Path, found: dict[str, float]) -> None:
    """Append ratios with the commit that they are of."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    is_new = not history.exists()
    with history.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if is_new:
            writer.writerow(FIELDS)
        today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
        writer.writerows([commit, today, vector_bits(), what, f"{ratio:.4g}"] for what, ratio in found.items())


def draw(rows: Sequence[dict[str, Any]], picture: Path) -> None:
    """Draw the ratios over commits: a panel for steps, derivatives and commands, marked by the bits of the vectors."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    commits = list(dict.fromkeys(row["commit"] for row in rows))
    panels = {"step": "step\n[times C]", "derivative": "derivative by a parameter\n[runs]", "": "command\n[imports]"}
    figure, axes = plt.subplots(len(panels), 1, figsize=(8.0, 7.0), sharex=True, layout="constrained")
    for (start, label), axis in zip(panels.items(), axes, strict=True):
        for what in dict.fromkeys(row["what"] for row in rows):
            if (what.partition(",")[0] if what not in COMMANDS else "") != start:
                continue
            for bits in dict.fromkeys(row["vector_bits"] for row in rows):
                of = [row for row in rows if row["what"] == what and row["vector_bits"] == bits]
                places = [commits.index(row["commit"]) for row in of]
                if of:
                    axis.plot(places, [row["ratio"] for row in of], "o-", label=f"{what}, {bits} bits")
        axis.set_ylabel(label)
        axis.set_ylim(0.0, 1.1 * axis.get_ylim()[1])
        if axis.lines:
            axis.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes[-1].set_xticks(range(len(commits)), commits, rotation=90)
    axes[-1].set_xlabel("commit")
    figure.savefig(picture, dpi=110)
