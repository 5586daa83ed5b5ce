"""Preparation of a case: bad readings are excluded, inputs unified, and noisy held inputs averaged."""

from __future__ import annotations

from discrepancy.preparation.held_inputs import with_held_inputs
from discrepancy.preparation.inputs import check_sign_of_current, with_like_inputs
from discrepancy.preparation.outliers import without_outliers
from discrepancy.preparation.saturated import without_saturated
from discrepancy.preparation.stuck import without_stuck
from jaxmodel.case import Case
from jaxmodel.plausible import doubts


def prepared(case: Case) -> tuple[Case, tuple[str, ...]]:
    """Return the prepared case, and a sentence for everything that is doubtful or was excluded.

    Raises:
        FitError: two runs have different inputs.
        MeasurementError: a cell's current has the wrong sign.
    """
    remarks = list(doubts(case))
    for without in (without_stuck, without_saturated, without_outliers):
        case, more = without(case)
        remarks += more
    case = with_held_inputs(with_like_inputs(case))
    check_sign_of_current(case)
    return case, tuple(remarks)
