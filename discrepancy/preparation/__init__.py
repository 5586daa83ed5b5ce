"""A case as the diagnosis takes it: bad readings left out, inputs made alike, noisy ones held."""

from __future__ import annotations

from discrepancy.preparation.held_inputs import with_held_inputs
from discrepancy.preparation.inputs import with_like_inputs
from discrepancy.preparation.outliers import without_outliers
from discrepancy.preparation.saturated import without_saturated
from discrepancy.preparation.stuck import without_stuck
from jaxmodel.case import Case
from jaxmodel.plausible import doubts


def prepared(case: Case) -> tuple[Case, tuple[str, ...]]:
    """Return the case as it is diagnosed, and a sentence for everything that is doubtful or was left out of it.

    Raises:
        FitError: two runs are driven in different ways.
    """
    told = list(doubts(case))
    for without in (without_stuck, without_saturated, without_outliers):
        case, more = without(case)
        told += more
    return with_held_inputs(with_like_inputs(case)), tuple(told)
