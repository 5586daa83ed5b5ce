"""What an engineer would say of a channel's residuals: where, by how much, in which sign, in how many runs, and why.

What explains most is told first: heat that a thermometer shows, one run that is off, runs in the order of a condition,
or a story over a condition; the next is sought in what is left. Nothing is said that the scatter of the runs, or of
their blocks, makes by chance, nor of a condition that spans nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from discrepancy.residuals.of_conditions import condition_told
from discrepancy.residuals.of_runs import heat_told, outsize_told, runs_told
from discrepancy.residuals.statement import Explanation, Statement, View, view_of
from discrepancy.residuals.table import ChannelResiduals

MOST = 4
# Of the channel's mean square: what says less is not worth a sentence.
LEAST_SHARE = 0.03
# Of the tolerance: what is smaller, as a root mean square where it is told, matters to nobody (design).
OF_TOLERANCE = 0.1
# Chance of a statement on a condition where there is none, over all ranges and terms and conditions of the channel.
# Simulated with AR(1) noise of up to 100 s of memory in 2 to 5 runs of up to an hour: 0 to 4 % of channels have one.
CHANCE = 0.03


@dataclass(frozen=True, eq=False)
class Account:
    """What is said of a channel, and what is left when that is taken off.

    Attributes:
        statements: what explains most first; none where the model fails nowhere that could be told.
        left: the residuals without what they explain.
    """

    statements: tuple[Statement, ...]
    left: ChannelResiduals


def statements(
    residuals: ChannelResiduals, *, capacity_Ah: float | None = None, most: int = MOST
) -> tuple[Statement, ...]:
    """Return what is to be said of one channel, what explains most first; arguments as `account`."""
    return account(residuals, capacity_Ah=capacity_Ah, most=most).statements


def account(residuals: ChannelResiduals, *, capacity_Ah: float | None = None, most: int = MOST) -> Account:
    """Say where a model fails in one channel, and return what that leaves.

    Args:
        residuals: of the channel, on any runs; at least two of them, but for heat.
        capacity_Ah: of the cell: currents are then told as rates.
        most: statements.
    """
    told: list[Statement] = []
    explained = np.zeros(residuals.error.size)
    if residuals.mean_square == 0.0:
        return Account((), residuals)
    view, rows = view_of(residuals, capacity_Ah, CHANCE), np.ones(explained.size, dtype=bool)
    while len(told) < most:
        found = [one for one in _explanations(view) if one.statements]
        best = max(found, key=lambda one: one.share * one.preference, default=None)
        if best is not None:
            told += sorted(best.statements, key=lambda one: -one.share)[: most - len(told)]
            explained[rows] += best.told
            view = view.less(best.told)
            continue
        # Where one run is off in no order it hides what the others share.
        apart = outsize_told(view)
        if apart is None:
            break
        if not any(one.condition == "run" and one.lower == apart.lower for one in told):
            told.append(apart)
        view, rows = view.without_run(int(apart.lower)), rows & (residuals.run != apart.lower)
    return Account(tuple(told), residuals.less(explained))


def _explanations(view: View) -> Iterator[Explanation]:
    """Give every explanation that holds, with those of its statements that are material."""
    found = [heat_told(view), *runs_told(view), *(condition_told(view, name) for name in view.conditions)]
    for one in found:
        if one is not None:
            yield one.only(lambda statement: _is_material(view, statement))


def _is_material(view: View, statement: Statement) -> bool:
    """Return whether a statement is worth a sentence: beyond twice the noise of its mean, and of the user's matter."""
    residuals = view.residuals
    noise = 2.0 * residuals.noise_sd / np.sqrt(max(statement.readings, 1))
    limit = max(noise if np.isfinite(noise) else 0.0, OF_TOLERANCE * (residuals.tolerance or 0.0))
    least = LEAST_SHARE * (view.counted or view.total) / view.total
    return bool(statement.share >= least and statement.size > limit)
