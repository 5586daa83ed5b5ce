"""Statements on a channel's residuals: where, by how much, with which sign, in how many runs, and the likely cause.

The explanation that explains most comes first: missing heat, one run that differs, runs that follow a condition, or
segments of a condition. The next is searched in what remains. Only what is significant against the scatter of runs, or
of their blocks, is stated. Before them comes a range of a condition that holds most of the error and is not explained.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jaxmodel.diagnosis.residuals.concentration import concentration
from jaxmodel.diagnosis.residuals.of_conditions import condition_explanation
from jaxmodel.diagnosis.residuals.of_runs import heat_explanation, outlying_run, run_explanations
from jaxmodel.diagnosis.residuals.statement import Explanation, Statement, View, view_of
from jaxmodel.diagnosis.residuals.table import ChannelResiduals

MOST = 4
# Share of the channel's mean square from which a statement is made.
LEAST_SHARE = 0.03
# Share of the tolerance below which an error, as a root mean square where it holds, is not stated (design).
OF_TOLERANCE = 0.1
# Probability of a false statement, over all ranges, terms and conditions of a channel. In simulations with AR(1) noise
# of correlation times up to 100 s, in 2 to 5 runs of up to an hour, 0 to 4 % of channels had one.
CHANCE = 0.03


@dataclass(frozen=True, eq=False)
class Account:
    """The statements on a channel, and the residuals that they leave.

    Attributes:
        statements: the one that explains most first; none if nothing is significant.
        left: the residuals minus the explained part.
        mostly: the range that holds most of what is not explained, in words; "" for none.
    """

    statements: tuple[Statement, ...]
    left: ChannelResiduals
    mostly: str = ""


def statements(
    residuals: ChannelResiduals, *, capacity_Ah: float | None = None, most: int = MOST
) -> tuple[Statement, ...]:
    """Return the statements on one channel, the one that explains most first; arguments as `account`."""
    return account(residuals, capacity_Ah=capacity_Ah, most=most).statements


def account(residuals: ChannelResiduals, *, capacity_Ah: float | None = None, most: int = MOST) -> Account:
    """Return the statements on where a model fails in one channel, and the residuals that they leave.

    Args:
        residuals: of the channel; all statements but that on heat need at least two runs.
        capacity_Ah: of the cell: currents are then given as C rates.
        most: largest number of statements.
    """
    said: list[Statement] = []
    explained = np.zeros(residuals.error.size)
    if residuals.mean_square == 0.0:
        return Account((), residuals)
    view, rows = view_of(residuals, capacity_Ah, CHANCE), np.ones(explained.size, dtype=bool)
    while len(said) < most:
        found = [one for one in _explanations(view) if one.statements]
        best = max(found, key=lambda one: one.share * one.preference, default=None)
        if best is not None:
            said += sorted(best.statements, key=lambda one: -one.share)[: most - len(said)]
            explained[rows] += best.explained
            view = view.less(best.explained)
            continue
        # One run with a large unexplained error hides what the others share.
        apart = outlying_run(view)
        if apart is None:
            break
        if not any(one.condition == "run" and one.lower == apart.lower for one in said):
            said.append(apart)
        view, rows = view.without_run(int(apart.lower)), rows & (residuals.run != apart.lower)
    left = residuals.less(explained)
    # Where most of the error is has been said if it is explained.
    concentrated = concentration(view_of(left, capacity_Ah, CHANCE), of=residuals.mean_square)
    if concentrated is None:
        return Account(tuple(said), left)
    return Account((concentrated.statement, *said)[:most], left, concentrated.where)


def _explanations(view: View) -> Iterator[Explanation]:
    """Give every explanation, with those of its statements that are material."""
    found = [
        heat_explanation(view),
        *run_explanations(view),
        *(condition_explanation(view, name) for name in view.conditions),
    ]
    for one in found:
        if one is not None:
            yield one.only(lambda statement: _is_material(view, statement))


def _is_material(view: View, statement: Statement) -> bool:
    """Return whether a statement is material: above twice the noise of its mean, and a share of the tolerance."""
    residuals = view.residuals
    noise = 2.0 * residuals.noise_sd / np.sqrt(max(statement.readings, 1))
    limit = max(noise if np.isfinite(noise) else 0.0, OF_TOLERANCE * (residuals.tolerance or 0.0))
    least = LEAST_SHARE * (view.counted or view.total) / view.total
    return bool(statement.share >= least and statement.size > limit)
