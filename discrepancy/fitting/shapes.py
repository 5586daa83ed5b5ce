"""In which shapes runs are simulated: each shape is a program to be compiled, and short runs are padded to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Shapes are rounded up to these, so that cases of like size share a compiled program.
_ROWS, _STEPS = 512, 1024
# Steps that short runs would be padded with, above which a program of their own is worth the time to compile it.
_WORTH_A_PROGRAM = 30_000
# Runs that only judge, and are no more than so many times as long as those that calibrate, share their program. That
# takes longer then, in a robot's diagnosis some 4 s; to compile another takes 20 s, and to trace it 3 s.
_LITTLE_LONGER = 1.5


def shapes_of(lengths: Sequence[tuple[int, int]], fit_runs: np.ndarray) -> tuple[tuple[int, int, int], ...]:
    """Return in which blocks runs of such lengths are simulated, shorter first: their number, rows and steps.

    Those of the runs that may calibrate; longer ones fit in too where that saves a program.
    """
    ordered = sorted((lengths[run] for run in fit_runs), key=lambda length: length[1])

    def cost(blocks: Sequence[Sequence[tuple[int, int]]]) -> int:
        return sum(len(block) * block[-1][1] for block in blocks)

    halves = [[ordered[:place], ordered[place:]] for place in range(1, len(ordered))]
    best = min(halves, key=cost, default=[ordered])
    blocks = best if cost([ordered]) - cost(best) > _WORTH_A_PROGRAM else [ordered]
    shapes = [(len(block), max(rows for rows, _ in block), block[-1][1]) for block in blocks]
    count, rows, steps = shapes[-1]
    rows_of_all, steps_of_all = np.max([(rows, steps), *lengths], axis=0).tolist()
    if steps_of_all <= _LITTLE_LONGER * steps and count * (steps_of_all - steps) <= _WORTH_A_PROGRAM:
        shapes[-1] = (count, rows_of_all, steps_of_all)
    return tuple(shapes)


def rounded_length(last_step: np.ndarray) -> tuple[int, int]:
    """Return the rows and steps of the longest of some runs, rounded up, from the step that ends at each later row."""
    rows = int(np.max(np.argmax(last_step == last_step[:, -1:], axis=1))) + 2
    return rounded_rows(rows), rounded_steps(int(last_step.max()) + 1)


def rounded_rows(count: int) -> int:
    """Return the number of rows that so many are padded to."""
    return _round_up(count, _ROWS)


def rounded_steps(count: int) -> int:
    """Return the number of steps that so many are padded to."""
    return _round_up(count, _STEPS)


def _round_up(count: int, multiple: int) -> int:
    return -(-count // multiple) * multiple
