"""Times taken in alternation: what else runs on the machine then slows each contestant alike."""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Mapping


@dataclasses.dataclass(frozen=True)
class Timing:
    """Seconds of several runs of the same work, compiled before.

    Attributes:
        wall_s: by the clock.
        cpu_s: of all cores together; other people's jobs do not count in it.
    """

    wall_s: tuple[float, ...]
    cpu_s: tuple[float, ...]

    def as_row(self, lane_steps: int | None = None) -> dict[str, float]:
        """Return best and median seconds, and per lane and step in ns where the work has such."""
        row = {"best_s": min(self.wall_s), "median_s": statistics.median(self.wall_s), "cpu_s": min(self.cpu_s)}
        if lane_steps:
            row |= {"ns_per_lane_step": 1e9 * row["best_s"] / lane_steps}
            row |= {"cpu_ns_per_lane_step": 1e9 * row["cpu_s"] / lane_steps}
        return row


def alternate(
    contestants: Mapping[str, Callable[[], object]], rounds: int = 5, warm: bool = False
) -> dict[str, Timing]:
    """Run each contestant once to compile and warm up, unless it is warm, then all in turn, so many rounds."""
    if not warm:
        for run in contestants.values():
            run()
    wall: dict[str, list[float]] = {name: [] for name in contestants}
    cpu: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            began, spent = time.perf_counter(), time.process_time()
            run()
            wall[name].append(time.perf_counter() - began)
            cpu[name].append(time.process_time() - spent)
    return {name: Timing(tuple(wall[name]), tuple(cpu[name])) for name in contestants}
