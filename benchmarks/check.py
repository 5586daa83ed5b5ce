"""`make bench-check`: has the step become slower than it was, measured against C by hand?"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.against_c import against_c
from jaxmodel.lanes.machine import vector_bits

# What the ratio of core times to C may exceed the committed one by: other work on the machine moves it by some percent.
BAND = 1.25
_LANES, _ROUNDS = 2048, 7


def ratios_of(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return the ratios of core times on one core by kind, by the bits of this processor's vectors."""
    ratios = {row["kind"]: row["ratio_cpu"] for row in rows if row["cores"] == 1 and "ratio_cpu" in row}
    return {str(vector_bits()): ratios} if ratios else {}


def check(folder: Path) -> str:
    """Compare ours with C, on one core, with the ratios of `results.json`; return what has become slower, or ""."""
    committed = json.loads((folder / "results.json").read_text(encoding="utf-8"))["ratios_by_vectors"]
    of_like = committed.get(str(vector_bits()))
    if of_like is None:
        print(f"Not compared: no ratios of processors with vectors of {vector_bits()} bits are committed.")
        return ""
    slower = []
    for kind, was in of_like.items():
        row = against_c(kind, _LANES, rounds=_ROUNDS)
        if "left_out" in row:
            print(f"{kind}: not compared, {row['left_out']}")
            continue
        print(f"{kind}: {row['ratio_cpu']:.2f} times the core time of C; committed {was:.2f}, at most {BAND * was:.2f}")
        if row["ratio_cpu"] > BAND * was:
            slower.append(f"a {kind} takes {row['ratio_cpu']:.2f} times the core time of C, and took {was:.2f}")
    return f"The step has become slower: {'; '.join(slower)}." if slower else ""
