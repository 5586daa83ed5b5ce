"""`make bench-check`: has the step become slower than it was, measured against C by hand?"""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.against_c import against_c

# What the ratio of core times to C may exceed the committed one by: other work on the machine moves it by some percent,
# and so does a processor with other vectors.
BAND = 1.25
_LANES, _ROUNDS = 2048, 7


def check(folder: Path) -> str:
    """Compare ours with C, on one core, with the ratios of `results.json`; return what has become slower, or ""."""
    committed = json.loads((folder / "results.json").read_text(encoding="utf-8"))["against_c"]
    slower = []
    for kind in ("cell", "robot"):
        row = against_c(kind, _LANES, rounds=_ROUNDS)
        if "left_out" in row:
            print(f"{kind}: not compared, {row['left_out']}")
            continue
        was = next(old["ratio_cpu"] for old in committed if (old["kind"], old["cores"]) == (kind, 1))
        print(f"{kind}: {row['ratio_cpu']:.2f} times the core time of C; committed {was:.2f}, at most {BAND * was:.2f}")
        if row["ratio_cpu"] > BAND * was:
            slower.append(f"a {kind} takes {row['ratio_cpu']:.2f} times the core time of C, and took {was:.2f}")
    return f"The step has become slower: {'; '.join(slower)}." if slower else ""
