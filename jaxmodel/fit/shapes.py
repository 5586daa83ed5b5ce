"""Shapes in which runs are simulated: each shape is one compiled program, and short runs are padded to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Shapes are rounded up to multiples of these, so that cases of similar size share a compiled program.
_ROWS, _STEPS = 512, 1024
# Padding steps of short runs above which a second program is worth its compile time.
_WORTH_A_PROGRAM = 8_000
# Check runs up to so many times as long as the fit runs share their program. For a robot this costs some 4 s per
# diagnosis; another program takes 20 s to compile and 3 s to trace.
_LITTLE_LONGER = 1.5


def shapes_of(lengths: Sequence[tuple[int, int]], fit_runs: np.ndarray) -> tuple[tuple[int, int, int], ...]:
    """Return the blocks in which runs are simulated, shorter first: number of runs, rows and steps.

    They are sized for the fit runs, and for longer runs too if that saves a program.
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
    """Return the rows and steps of the longest of some runs, rounded up, from the last step of each later row."""
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
