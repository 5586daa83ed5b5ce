"""Charge that does not balance: full discharges and charges of one cell that contradict each other."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmodel.data.importing.charge import EMPTY, Count, Stated, full_discharges, read_from_rest, rest_curve
from jaxmodel.data.importing.findings import Finding

# By how much two full discharges may differ: at rates within a factor of three, and at any (assumed; a cell of
# dmegc_18650_electrothermal gives 9 % less at C/2 than at C/20).
_APART, _APART_BY_RATE, _ALIKE = 0.05, 0.12, 3.0
# Discharges in the cold, or faster than this rate per hour, leave what differs from cell to cell.
_WARM_DEGC, _WARMTH_K, _FASTEST = 15.0, 12.0, 1.2
# A load is steady where its 90 % quantile is at most so many medians: a peak meets the cut-off with charge left.
_STEADY = 1.3
# By how much the SOC that a start has by its resting voltage may differ from that counted back from a full charge.
_STARTS_APART = 0.08


class Amount(NamedTuple):
    """The charge between a full and an empty cell, as one run gives it."""

    count: Count
    charge_Ah: float


def capacities(found: Sequence[Count], capacity: Stated) -> tuple[Stated, list[Finding]]:
    """Return the capacity with an sd that covers what the full discharges give, and what contradicts what.

    Args:
        found: the charge of each run.
        capacity: of the largest full discharge, or stated.
    """
    amounts = [Amount(*pair) for one in found for pair in full_discharges(one) if comparable(one, capacity.value)]
    if len(amounts) < 2:
        return capacity, []
    charges = np.array([amount.charge_Ah for amount in amounts])
    warmth = [amount.count.ambient_degC for amount in amounts if amount.count.ambient_degC is not None]
    largest, smallest = amounts[int(charges.argmax())], amounts[int(charges.argmin())]
    if warmth and max(warmth) - min(warmth) > _WARMTH_K:
        return capacity, []
    rates = sorted((largest.count.rate_A, smallest.count.rate_A))
    # The slower one gives more; that the faster one does is no matter of the rate.
    slower_gives_more = largest.count.rate_A < smallest.count.rate_A
    least = _APART_BY_RATE if slower_gives_more and rates[1] > _ALIKE * rates[0] else _APART
    apart = float(charges.max() - charges.min())
    if apart <= least * charges.max():
        return capacity, []
    if capacity.why != "stated":
        capacity = dataclasses.replace(capacity, sd=max(capacity.sd or 0.0, apart))
    listed = ", ".join(f"{charge:.3g}" for charge in sorted(charges, reverse=True))
    odd = _odd_one(amounts)
    if odd is None and len(amounts) > 2:  # a cell that ages from run to run gives less and less
        return capacity, []
    if odd is None:
        who = f"the current or the clock of {largest.count.run.name} or {smallest.count.run.name}"
        off = apart / float(charges.max())
    else:
        rest = float(np.median([one.charge_Ah for one in amounts if one is not odd]))
        who, off = f"the current of {odd.count.run.name}, or its clock,", abs(odd.charge_Ah / rest - 1.0)
    sentence = (
        f"{len(amounts)} discharges from full to the cut-off give {listed} A h: {who} is {off:.0%} off, or rows are "
        "missing. Correct it with --unit or --column, or import without it."
    )
    where = "" if odd is None else odd.count.run.name
    numbers = {"largest_Ah": float(charges.max()), "smallest_Ah": float(charges.min())}
    finding = Finding("charge balance", where, sentence, "warning", "current_A", numbers=numbers)
    return capacity, [finding]


def comparable(count: Count, capacity_Ah: float) -> bool:
    """Return whether the charge of a run may be held against that of another: warm, steady, and not fast."""
    warm = count.ambient_degC is None or count.ambient_degC >= _WARM_DEGC
    current = np.abs(np.nan_to_num(count.run.columns["current_A"]))
    discharging = current[(count.run.columns["current_A"] > 0.0) & (current > 0.05 * current.max())]
    steady = bool(discharging.size and np.quantile(discharging, 0.9) <= _STEADY * np.median(discharging))
    return warm and steady and count.rate_A <= _FASTEST * capacity_Ah


def _odd_one(amounts: Sequence[Amount]) -> Amount | None:
    """Return the amount without which the others agree best, where there are others and they agree by far better."""
    if len(amounts) < 3:
        return None
    spreads = [float(np.ptp([one.charge_Ah for one in amounts if one is not odd])) for odd in amounts]
    best = int(np.argmin(spreads))
    whole = float(np.ptp([one.charge_Ah for one in amounts]))
    return amounts[best] if spreads[best] < 0.5 * whole else None


def starts(
    found: Sequence[Count], first: Sequence[Stated], capacity: Stated, known: bool
) -> tuple[list[Stated], Stated, list[Finding]]:
    """Return starts and capacity with sds that cover what goes in and comes out, and what is said of it.

    A run that begins at rest, is charged until full and then discharged has two starts: by its resting voltage, and
    counted back from the full charge. Where they are apart, the current of charge and discharge do not fit.

    Args:
        found: the charge of each run.
        first: the start of each.
        capacity: of the cell.
        known: whether it comes from a full discharge or from the user: a guess contradicts nothing.
    """
    if not known:
        return [*first], capacity, []
    curve = rest_curve(found, first, capacity.value)
    result, said, most = list(first), [], 0.0
    for number, (count, start) in enumerate(zip(found, first, strict=True)):
        if not start.why.startswith("counted back from the full"):
            continue
        read = EMPTY if count.begins_empty else None if curve is None else read_from_rest(count, *curve)
        if read is None:
            continue
        apart = abs(start.value - read.value)
        if apart <= _STARTS_APART + 2.0 * (read.sd or 0.0):
            continue
        full = int(np.flatnonzero(count.full)[0])
        into = float(-count.out_Ah[full])
        should = (1.0 - read.value) * capacity.value
        begin = "empty" if count.begins_empty else f"{read.value:.0%} (by its resting voltage)"
        out = capacity.value if count.begins_empty else should
        said.append(f"{count.run.name}: from {begin} to full {into:.3g} A h go in, and {out:.3g} A h come out again")
        most = max(most, abs(should - into))
        result[number] = dataclasses.replace(start, sd=max(start.sd or 0.0, apart))
    if not said:
        return result, capacity, []
    more = f" (and {len(said) - 1} more alike)" if len(said) > 1 else ""
    sentence = (
        f"{said[0]}{more}: the sensor reads one direction wrongly, or rows are missing. The start is counted back from "
        "the full charge."
    )
    where = said[0].split(":")[0]
    finding = Finding("charge balance", where, sentence, "warning", "current_A", numbers={"apart_Ah": most})
    if capacity.why != "stated":
        capacity = dataclasses.replace(capacity, sd=max(capacity.sd or 0.0, most))
    return result, capacity, [finding]
