"""`make bench`: ours against C by hand and against other solvers, as ratios on the same work in one run.

`python -m benchmarks derivatives` measures that part anew and keeps the rest. `python -m benchmarks check` measures
ratios to peers and fails if one has become larger; `check --keep` appends them to `history.csv`.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

# Before OpenMP starts: a thread that spins while it waits would take a core from the next contestant.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import jax

from benchmarks import growth, report
from benchmarks.accelerator import on_accelerator
from benchmarks.against_c import against_c
from benchmarks.check import check
from benchmarks.commands import times_of_commands
from benchmarks.derivatives import cost_of_derivatives, memory_of_a_long_gradient
from benchmarks.equal_accuracy import EqualAccuracy
from benchmarks.scaling import over_lanes, over_steps


def _against_c() -> list[dict[str, Any]]:
    counts = sorted({1, jax.device_count()})
    rows = [against_c(kind, devices=count, others=count == 1) for kind in ("cell", "robot") for count in counts]
    report.print_against_c("Full sweep of states against C by hand", rows)
    return rows


def _equal_accuracy() -> list[dict[str, Any]]:
    rows = EqualAccuracy().rows()
    report.print_equal_accuracy(rows)
    return rows


def _scaling(title: str, over: Callable[[int], list[dict[str, Any]]]) -> list[dict[str, Any]]:
    rows = over(jax.device_count())
    report.print_against_c(title, rows)
    return rows


def _derivatives() -> dict[str, Any]:
    found = {"cost": cost_of_derivatives(), "long_gradient": memory_of_a_long_gradient()}
    report.print_derivatives(found)
    return found


def _accelerator() -> dict[str, Any]:
    found = on_accelerator()
    report.print_accelerator(found)
    return found


def _growth() -> dict[str, Any]:
    found = {"lanes": growth.over_lanes(), "workers": growth.over_workers()}
    report.print_growth(found)
    return found


def _commands() -> list[dict[str, Any]]:
    rows = times_of_commands()
    report.print_commands(rows)
    return rows


PARTS: dict[str, Callable[[], Any]] = {
    "against_c": _against_c,
    "equal_accuracy": _equal_accuracy,
    "over_lanes": lambda: _scaling("Lanes", over_lanes),
    "over_steps": lambda: _scaling("Steps", over_steps),
    "derivatives": _derivatives,
    "growth": _growth,
    "commands": _commands,
    "accelerator": _accelerator,
}


def main(wanted: Sequence[str]) -> None:
    """Run all parts, or those that are named; print each table when it is done, and write the files.

    What is not run, or left out for want of a GPU, keeps the figures, and the machine, of the run before.
    """
    began, folder = time.perf_counter(), Path(__file__).parent
    if list(wanted) in (["check"], ["check", "--keep"]):
        raise SystemExit(check(keep="--keep" in wanted) or None)
    unknown = set(wanted) - set(PARTS) - {"check"} or set(wanted) & {"check"}
    if unknown:
        raise SystemExit(f"{', '.join(sorted(unknown))}: no such part; there are {', '.join(PARTS)}, or check alone")
    before = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    machine = report.machine()
    found = {name: run() for name, run in PARTS.items() if not wanted or name in wanted}
    left_out = [name for name, part in found.items() if "left_out" in part]
    kept: dict[str, Any] = before if wanted else {name: before[name] for name in left_out if name in before}
    results = kept | {name: part for name, part in found.items() if name not in left_out}
    results["machine"] = kept.get("machine", machine)
    named = [name for name in wanted if name not in left_out]
    of_others = {name: of for name, of in before.get("machine_of", {}).items() if name in kept}
    results["machine_of"] = of_others | dict.fromkeys(named, machine)
    results["took_s"] = kept.get("took_s", round(time.perf_counter() - began))
    report.write(folder, results)
    print(f"written: {folder.name}/results.json, results.png; took {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
