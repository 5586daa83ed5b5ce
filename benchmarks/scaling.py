"""How the time of ours and of C grows with lanes, steps and cores."""

from __future__ import annotations

from typing import Any

from benchmarks.against_c import against_c

# A million robots take minutes: their line ends earlier.
LANES = {"cell": (1, 64, 1024, 16_384, 131_072, 1_000_000), "robot": (1, 64, 1024, 16_384)}
STEPS_S = (60.0, 10.0, 1.0)
_LONG = 100_000_000  # lane-steps from which one run is enough


def over_lanes(cores: int) -> list[dict[str, Any]]:
    """Return a row for each kind and number of lanes, 1,800 s in steps of 1 s."""
    rows = []
    for kind, counts in LANES.items():
        for lanes in counts:
            rows.append(against_c(kind, lanes, cores, rounds=1 if lanes * 1800 > _LONG else 3))
    return rows


def over_steps(cores: int) -> list[dict[str, Any]]:
    """Return a row for each step, 4,096 lanes over 1,800 s."""
    return [against_c(kind, 4096, cores, rounds=3, step_s=step_s) for kind in LANES for step_s in STEPS_S]
