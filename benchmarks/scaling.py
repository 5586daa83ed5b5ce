"""How the time of ours and of C grows with lanes, steps and cores."""

from __future__ import annotations

from typing import Any

from benchmarks.against_c import against_c

# A million robots take minutes: their line ends earlier.
LANES = {"cell": (1, 64, 1024, 16_384, 131_072, 1_000_000), "robot": (1, 64, 1024, 16_384)}
STEPS = (10, 100, 1800, 10_000, 100_000, 1_000_000)
_LONG = 100_000_000  # lane-steps from which one run is enough


def over_lanes(cores: int) -> list[dict[str, Any]]:
    """Return a row for each kind and number of lanes, 1,800 s in steps of 1 s."""
    rows = []
    for kind, counts in LANES.items():
        for lanes in counts:
            rows.append(against_c(kind, lanes, cores, rounds=1 if lanes * 1800 > _LONG else 3))
    return rows


def over_steps(cores: int) -> list[dict[str, Any]]:
    """Return a row for each number of steps over 1,800 s: 4,096 lanes, fewer of many steps."""
    return [
        against_c(kind, min(4096, _LONG // steps), cores, rounds=3 if steps < 10_000 else 1, step_s=1800.0 / steps)
        for kind in LANES
        for steps in STEPS
    ]
