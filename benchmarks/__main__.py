"""`make bench`: ours against C by hand and against other solvers, as ratios on the same work in one run."""

from __future__ import annotations

import os
import time
from pathlib import Path

# Before OpenMP starts: a thread that spins while it waits would take a core from the next contestant.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import jax

from benchmarks import report
from benchmarks.against_c import against_c
from benchmarks.derivatives import derivatives
from benchmarks.equal_accuracy import EqualAccuracy
from benchmarks.scaling import over_lanes, over_steps

FLOAT32 = "left out: the engine runs in float64 alone (SOC to 1e-6 over hours is out of float32's reach)"


def main() -> None:
    """Run everything, print each table when it is done, and write the files."""
    began, folder = time.perf_counter(), Path(__file__).parent
    cores = sorted({1, jax.device_count()})
    results = {"machine": report.machine(), "float32": FLOAT32}
    results["against_c"] = [against_c(kind, devices=count) for kind in ("cell", "robot") for count in cores]
    report.print_against_c("Full sweep of states against C by hand", results["against_c"])
    print(f"float32: {FLOAT32}")
    results["equal_accuracy"] = EqualAccuracy().rows()
    report.print_equal_accuracy(results["equal_accuracy"])
    results["over_lanes"] = over_lanes(cores[-1])
    report.print_against_c("Lanes", results["over_lanes"])
    results["over_steps"] = over_steps(cores[-1])
    report.print_against_c("Steps", results["over_steps"])
    results["derivatives"] = derivatives()
    report.print_derivatives(results["derivatives"])
    results["took_s"] = round(time.perf_counter() - began)
    report.write(folder, results)
    print(f"written: {folder.name}/results.json, results.png; took {results['took_s']} s")


if __name__ == "__main__":
    main()
