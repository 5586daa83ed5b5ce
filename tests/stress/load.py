"""`python -m tests.stress.load --count 1000`: diagnose and sweep again and again in one process, and watch it grow.

Every round is a case of its own: other noise, other numbers, in turn other effects that are hidden. What is compiled
serves them all; memory, threads, open files and the caches of JAX must not grow with the rounds.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

import numpy as np

from jaxmodel import sweeps
from jaxmodel.case.reading import read_case
from jaxmodel.diagnosis import diagnose
from jaxmodel.sweeps import Study
from tests.made_up import write_case

# The first rounds compile, and fill caches of limited size.
SETTLED = 0.2
# Growth over the settled rounds that a process may show: allocators return memory in lumps.
MOST_GROWTH = 0.05


def _state() -> dict[str, float]:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {
        "memory_MiB": pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
        "objects": len(gc.get_objects()),
        "threads": threading.active_count(),
        "files": len(os.listdir("/proc/self/fd")),
    }


def _round(number: int, folder: Path) -> str:
    """Diagnose a fresh case, and sweep it; return the verdict."""
    rng = np.random.default_rng(number)
    hidden = {"self_heating": {"C_th": float(rng.uniform(50.0, 120.0)), "hA": 0.1}} if number % 2 else {}
    case = read_case(write_case(folder / f"case-{number}", hidden))
    verdict = diagnose(case).verdict
    currents = rng.uniform(0.5, 4.0, 50).tolist()
    study = Study(
        kind="cell",
        profile={"duration_s": 600, "step_s": 10, "ambient_degC": 20.0},
        axes={"current_A": sorted(currents), "cycles": [0.0, 200.0]},
    )
    sweeps.run(study)
    return verdict


def main() -> int:
    """Run the rounds; return 1 if the process has grown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    given = parser.parse_args()
    seen, verdicts = [], {}
    warnings.simplefilter("ignore")
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="load") as name:
        for number in range(given.count):
            verdict = _round(number, Path(name))
            verdicts[verdict] = verdicts.get(verdict, 0) + 1
            if number % max(1, given.count // 20) == 0 or number == given.count - 1:
                seen.append(_state() | {"round": number})
                told = ", ".join(f"{key} {value:.0f}" for key, value in seen[-1].items())
                print(f"{time.perf_counter() - began:.0f} s: {told}; {verdicts}", flush=True)
    settled = [one for one in seen if one["round"] >= SETTLED * given.count]
    grown = {key: settled[-1][key] / settled[0][key] - 1.0 for key in ("memory_MiB", "objects", "threads", "files")}
    print("grown by", {key: f"{100 * value:.1f} %" for key, value in grown.items()})
    return int(max(grown.values()) > MOST_GROWTH)


if __name__ == "__main__":
    sys.exit(main())
