"""Preparation of a case: bad readings are excluded, late ones moved, inputs unified, noisy held inputs averaged."""

from __future__ import annotations

from jaxmodel.base.remark import Remark
from jaxmodel.case.outliers import without_outliers
from jaxmodel.case.plausible import doubts
from jaxmodel.case.records import Case
from jaxmodel.fit.preparation.held_inputs import with_held_inputs
from jaxmodel.fit.preparation.inputs import check_sign_of_current, with_like_inputs
from jaxmodel.fit.preparation.late import without_delays
from jaxmodel.fit.preparation.saturated import without_saturated
from jaxmodel.fit.preparation.stuck import without_stuck


def prepared(case: Case) -> tuple[Case, tuple[Remark, ...]]:
    """Return the prepared case, and a remark on everything that is doubtful or was excluded.

    Raises:
        FitError: two runs have different inputs.
        MeasurementError: a cell's current has the wrong sign.
    """
    remarks = list(doubts(case))
    for without in (without_stuck, without_saturated, without_delays, without_outliers):
        case, more = without(case)
        remarks += more
    case = with_held_inputs(with_like_inputs(case))
    check_sign_of_current(case)
    return case, tuple(remarks)
