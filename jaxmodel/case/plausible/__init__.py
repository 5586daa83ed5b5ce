"""Which numbers of a case cannot be: wrong units, reversed signs, and what would mend them."""

from __future__ import annotations

from collections.abc import Iterator

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.remark import Remark
from jaxmodel.case.plausible.cell import wrong_cell
from jaxmodel.case.plausible.finding import Finding
from jaxmodel.case.plausible.motor import odd_load, wrong_motor
from jaxmodel.case.plausible.ranges import fahrenheit, wrong_columns, wrong_tables
from jaxmodel.case.records import Case


def findings(case: Case) -> Iterator[Finding]:
    """Yield what cannot be in a case, and what is not likely, single columns first.

    The relations between columns are looked at only where no single column is wrong.
    """
    yield from wrong_tables(case)
    for run in case.runs:
        yield from wrong_columns(case, run)
    yield from fahrenheit(case)
    yield from wrong_cell(case)
    wrong = tuple(wrong_motor(case))
    yield from wrong or odd_load(case)


def check(case: Case) -> None:
    """Refuse a case that holds what cannot be.

    Args:
        case: with what its preset states.

    Raises:
        MeasurementError: a column or parameter is in another unit or has the wrong sign; the sentence names it, what
            was read, what is possible, and what mends it.
    """
    for finding in findings(case):
        if finding.certain:
            raise MeasurementError(finding.sentence())


def doubts(case: Case) -> tuple[Remark, ...]:
    """Return a remark on everything in a case that is not likely, and yet can be."""
    return tuple(
        Remark(f"{finding.sentence()[:-1]}, unless that is so.", "not_likely", finding.name or finding.mends[0].name)
        for finding in findings(case)
        if not finding.certain
    )
