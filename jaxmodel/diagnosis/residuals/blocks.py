"""The stretch of time of any run in which a model is furthest off on average, whatever its cause."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.case.records import Run
from jaxmodel.diagnosis.residuals.runs import BLOCKS
from jaxmodel.diagnosis.residuals.wording import difference

LEAST_READINGS = 3


@dataclasses.dataclass(frozen=True)
class Block:
    """A stretch of a run and the mean of a channel's errors there.

    Attributes:
        run: its name.
        split: "fit" or "check".
        from_s: its begin, in s from the first row of the run.
        to_s: its end.
        mean: measured minus predicted, in the channel's unit.
        conditions: by name, the lowest and highest value there.
    """

    run: str
    split: str
    from_s: float
    to_s: float
    mean: float
    conditions: dict[str, tuple[float, float]]


def worst_block(
    runs: Sequence[Run],
    errors: Mapping[str, np.ndarray],
    conditions: Mapping[str, Mapping[str, np.ndarray]],
) -> Block | None:
    """Return where a channel's mean error is the largest: in a twelfth of a run, or more where it has few readings.

    Args:
        runs: of the case.
        errors: by run, measured minus predicted (rows,); NaN for a reading that is missing or does not count.
        conditions: by run and name, (rows,).
    """
    worst: Block | None = None
    for run in runs:
        if run.name not in errors:
            continue
        time_s = run.measured.time_s - run.measured.time_s[0]
        read = np.isfinite(errors[run.name])
        count = int(np.clip(read.sum() // LEAST_READINGS, 1, BLOCKS))
        edges = np.linspace(0.0, float(time_s[-1]), count + 1)
        block = np.clip(np.searchsorted(edges, time_s, side="right") - 1, 0, count - 1)
        for number in range(count):
            mine = read & (block == number)
            if mine.sum() < LEAST_READINGS:
                continue
            mean = float(np.mean(errors[run.name][mine]))
            if worst is None or abs(mean) > abs(worst.mean):
                spans = {n: (float(v[mine].min()), float(v[mine].max())) for n, v in conditions[run.name].items()}
                worst = Block(run.name, run.split, float(edges[number]), float(edges[number + 1]), mean, spans)
    return worst


def block_sentence(block: Block, unit: str) -> str:
    """Say where a model is furthest off, and by how much: 'run-03 (check run), minute 21 to 24: ...'.

    Args:
        block: the stretch.
        unit: of its errors.
    """
    minutes = block.to_s > 600.0
    scale, name = (60.0, "minute") if minutes else (1.0, "second")
    soc = block.conditions.get("soc")
    there = f", state of charge {soc[0]:.2f} to {soc[1]:.2f}" if soc else ""
    time = f"{name} {block.from_s / scale:.3g} to {block.to_s / scale:.3g}"
    return f"{block.run} ({block.split} run), {time}{there}: {difference([block.mean], unit)} on average."
