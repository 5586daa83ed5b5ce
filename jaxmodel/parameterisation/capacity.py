"""The capacity of a cell: charge of a slow discharge, of its test from full to empty, or as stated."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jaxmodel.case.records import Case
from jaxmodel.parameterisation.result import Extraction, absent
from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.segments import slow

FULL, EMPTY_SHARE = 0.95, 0.85  # a start that is full; the least share of a stated capacity that empties a cell
NEAR_V = 0.1  # of the highest and the lowest voltage of all runs: full and empty. Assumed.
COUNTER_SD = 0.005  # share: gain of a current sensor. Assumed.
TEST = "A discharge at C/20 from full to the cut-off voltage would give it."


def capacity(case: Case, runs: Sequence[Rows]) -> Extraction:
    """Return the capacity in A h: eq. 1 between full and empty.

    The mean over slow discharges and charges that pass the whole range; without any, the largest charge drawn from
    full by one run, if it reaches as low a voltage as any run and at least `EMPTY_SHARE` of what is stated; else what
    the case states. A capacity that the case states as exact is kept.
    """
    stated = case.parameters.get("capacity_Ah")
    if stated is not None and stated.sd is None:
        return absent("capacity_Ah", stated.value, "A h", "the case, which states it as exact", "")
    largest = max((float(np.max(np.abs(rows.drawn_Ah))) for rows in runs), default=0.0)
    guess = stated.value if stated is not None else largest
    passed: dict[str, float] = {}
    for rows in runs:
        for span in slow(rows, guess):
            start = rows.run.initial_soc.value - rows.drawn_Ah[span.first] / guess
            charge = abs(rows.drawn_Ah[span.last] - rows.drawn_Ah[max(span.first - 1, 0)])
            if charge >= EMPTY_SHARE * guess and (start >= FULL or start <= 1.0 - FULL):
                passed[rows.name] = max(charge, passed.get(rows.name, 0.0))
    if passed:
        values = np.array(list(passed.values()))
        sd = math.hypot(COUNTER_SD * values.mean(), values.std(ddof=1) if values.size > 1 else 0.0)
        said = "charge passed by slow discharges and charges, by counting the current"
        return Extraction(
            "capacity_Ah", float(values.mean()), sd, "A h", tuple(passed), "from full to the cut-off", said
        )
    lowest = min((float(np.nanmin(rows.voltage_V)) for rows in runs), default=math.nan)
    emptied = [rows for rows in runs if _is_full(rows, runs) and np.nanmin(rows.voltage_V) <= lowest + NEAR_V]
    if emptied:
        best = max(emptied, key=_discharged)
        drawn = _discharged(best)
        if stated is None or drawn >= EMPTY_SHARE * stated.value:
            sd = max(0.02, COUNTER_SD) * drawn
            said = (
                "charge drawn from full to the lowest voltage, under load: a little less than that of a slow discharge"
            )
            return Extraction("capacity_Ah", drawn, sd, "A h", (best.name,), "all of the run", said)
    if stated is not None:
        return absent("capacity_Ah", stated.value, "A h", "the case's stated value", TEST, stated.sd or math.nan)
    return absent("capacity_Ah", largest, "A h", "the largest charge that any run has drawn", TEST, 0.2 * largest)


def _is_full(rows: Rows, runs: Sequence[Rows]) -> bool:
    """Return True for a run that starts full, or is charged to as high a voltage as any."""
    highest = max(float(np.nanmax(one.voltage_V)) for one in runs)
    return rows.run.initial_soc.value >= FULL or float(np.nanmax(rows.voltage_V)) >= highest - NEAR_V


def _discharged(rows: Rows) -> float:
    """Return the largest charge that a run draws after any of its rows [A h]."""
    return float(np.max(rows.drawn_Ah - np.minimum.accumulate(rows.drawn_Ah)))
