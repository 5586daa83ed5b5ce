"""Sentences on heat and on whole runs: missing heat, one run that differs, runs that follow a condition."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxmodel.base.units import unit_of
from jaxmodel.diagnosis.residuals import wording
from jaxmodel.diagnosis.residuals.heat import heat
from jaxmodel.diagnosis.residuals.runs import Order, RunLines, odd_run, order, run_lines, standing_out
from jaxmodel.diagnosis.residuals.statement import (
    DRIVES,
    HEAT,
    ONE_RUN,
    RESISTANCE,
    TEMPERATURE_DEPENDENCE,
    Explanation,
    Statement,
    View,
    alone,
    in_runs,
    make,
)
from jaxmodel.diagnosis.residuals.table import Bools, ChannelResiduals, Floats

# Weight of each kind of explanation where several explain nearly the same share.
_PREFER = {"heat": 2.0, "order": 1.3, "run": 1.05}
_MOST_PLACES = 5
# A run is set aside if its error is so many times that of any other run and the noise, and at least this share of all
# squares.
_OUTSIZE, _OUTSIZE_SHARE = 2.0, 0.1
_MOST_OF_IT = 0.8  # of the squares of a difference: a term that explains so much is stated alone
_ONE_SIGN = 0.6  # of a root mean square: the sign of a mean of this size is stated


def heat_explanation(view: View) -> Explanation | None:
    """Return the missing or excess heat that a temperature channel shows."""
    r = view.residuals
    drive = next((name for name in DRIVES if name in r.conditions), None)
    if r.unit != "K" or drive is None or view.given:
        return None
    found = heat(r, drive)
    if found is None:
        return None
    way = np.sign(max(found.rise.values(), key=abs))
    same_sign = sorted((k for k, rise in found.rise.items() if rise * way > 0.0), key=lambda k: -abs(found.rise[k]))
    named = sorted(same_sign[:_MOST_PLACES])
    texts, unit = wording.numbers([abs(found.rise[k]) for k in named], "K")
    side, cause = ("above", "lacks heat") if way > 0.0 else ("below", "has too much heat or too little cooling")
    text = (
        f"At the end of {wording.listed([r.run_names[k] for k in named])} the measurement is {', '.join(texts)} {unit} "
        f"{side} the model; the error follows the square of the {wording.plain_name(drive)}: the model {cause} "
        f"({in_runs(len(same_sign), len(r.runs), len(r.runs))})."
    )
    value = max((found.rise[k] for k in named), key=abs)
    words: dict[str, Any] = dict(
        condition=drive, lower=-np.inf, upper=np.inf, text=text, cause=HEAT, value=value, unit="K"
    )
    made = make(view, found.explained, np.ones(r.error.size, dtype=bool), runs_seen=len(same_sign), **words)
    return alone(made, found.explained, _PREFER["heat"])


def run_explanations(view: View) -> Iterator[Explanation | None]:
    """Give the run that differs from all others, and the dependence of runs on a condition."""
    r = view.residuals
    if len(r.runs) < 3:
        return
    lines = run_lines(r, view.drive)
    yield _odd(view, lines)
    found = order(r, lines, list(view.conditions))
    if found is not None:
        yield _in_order(view, lines, found)


def _odd(view: View, lines: RunLines) -> Explanation | None:
    """Return the one run that differs from all others."""
    r, odd, drive = view.residuals, odd_run(lines), view.drive or ""
    if odd is None:
        return None
    place, rows = lines.runs.index(odd.run), r.run == odd.run
    line = lines.value[place] - np.delete(lines.value, place, axis=0).mean(axis=0)
    explained = np.full(r.error.size, line[0])
    if line.size == 2:
        explained = explained + line[1] * (r.conditions[drive] - lines.middle)
    explained = np.where(rows, explained, 0.0)
    what, off, unit = _difference(view, lines, line, explained[rows], rows)
    name = r.run_names[odd.run]
    text = (
        f"{view.prefix}{name}: {what}, relative to the other {len(r.runs) - 1} runs, in this run only"
        f"{_why(view, odd.run)}."
    )
    words: dict[str, Any] = dict(
        condition="run", lower=float(odd.run), upper=float(odd.run), text=text, cause=ONE_RUN, value=off, unit=unit
    )
    return alone(make(view, explained, rows, runs_seen=1, **words), explained, _PREFER["run"])


def _difference(view: View, lines: RunLines, line: Floats, explained: Floats, rows: Bools) -> tuple[str, float, str]:
    """Say how a run differs from the others, with the value that represents the difference and its unit.

    A constant, or a term proportional to the drive, if either explains most of the difference; else both.
    """
    r, drive = view.residuals, view.drive or ""
    weight = r.weight_s[rows]
    mean = float(np.average(explained, weights=weight))
    square = float(np.average(explained**2, weights=weight))
    if line.size == 1 or mean**2 > _MOST_OF_IT * square:
        return wording.difference([mean], r.unit), mean, r.unit
    values, unit = r.conditions[drive][rows], wording.ratio(r.unit, unit_of(drive))
    slope = float(np.sum(weight * explained * values) / np.sum(weight * values**2))
    name = wording.plain_name(drive)
    if slope**2 * np.average(values**2, weights=weight) > _MOST_OF_IT * square:
        side = "above" if slope > 0.0 else "below"
        what = f"the measurement is {wording.with_unit(abs(slope), unit)} x {name} {side} the model"
    else:
        slope = float(line[1])
        rest = wording.with_unit(float(line[0] - slope * lines.middle), r.unit)
        sign = "+" if slope > 0.0 else "-"
        what = f"measurement minus model is {rest} {sign} {wording.with_unit(abs(slope), unit)} x {name}"
    return what, -slope if unit == "ohm" else slope, unit


def _why(view: View, run: int) -> str:
    """Say in which conditions one run is alone; '' for none."""
    r = view.residuals
    where = [
        f"{wording.values_of([_mean_in(r, one, r.run == run)], one, view.capacity_Ah)} of {wording.plain_name(one)}"
        for one in standing_out(r, run, list(view.conditions))
    ]
    return f"; it is the only one at {wording.listed(where)}" if where else ""


def outlying_run(view: View) -> Statement | None:
    """Return the statement that one run has most of the remaining error; None if none has."""
    r = view.residuals
    if len(r.runs) < 3:
        return None
    size = {k: float(np.sqrt(np.average(r.error[r.run == k] ** 2, weights=r.weight_s[r.run == k]))) for k in r.runs}
    run = max(size, key=lambda k: size[k])
    rows, others = r.run == run, [size[k] for k in r.runs if k != run]
    share = float(np.sum((r.weight_s * r.error**2)[rows]) / view.total)
    left = float(np.sum(r.weight_s * r.error**2) / view.total)
    noise = r.noise_sd if np.isfinite(r.noise_sd) else 0.0
    if size[run] < _OUTSIZE * max(*others, noise) or share < 0.5 * left or share < _OUTSIZE_SHARE:
        return None
    mean = float(np.average(r.error[rows], weights=r.weight_s[rows]))
    texts, unit = wording.numbers([size[run], min(others), max(others), abs(mean)], r.unit)
    sign = "of changing sign"
    if abs(mean) > _ONE_SIGN * size[run]:
        sign = f"{texts[3]} {unit} {'above' if mean > 0.0 else 'below'} the model on average"
    between = texts[1] if texts[1] == texts[2] else f"{texts[1]} to {texts[2]}"
    text = (
        f"{view.prefix}{r.run_names[run]}: the RMS error is {texts[0]} {unit}, {sign}; in the other {len(others)} runs "
        f"it is {between} {unit}{_why(view, run)}."
    )
    return Statement(
        r.channel,
        "run",
        float(run),
        float(run),
        text,
        ONE_RUN,
        size[run],
        r.unit,
        1,
        share,
        size[run],
        readings=int(rows.sum()),
    )


def _mean_in(residuals: ChannelResiduals, name: str, rows: Bools) -> float:
    return float(np.average(residuals.conditions[name][rows], weights=residuals.weight_s[rows]))


def _in_order(view: View, lines: RunLines, found: Order) -> Explanation:
    """Return the explanation of runs that follow a condition."""
    r = view.residuals
    explained = np.zeros(r.error.size)
    for place, run in enumerate(lines.runs):
        rows = r.run == run
        for term, intercept, slope in zip(found.terms, found.intercept, found.slope, strict=True):
            column = 1.0 if term == 0 else r.conditions[view.drive or ""][rows] - lines.middle
            explained[rows] += (intercept + slope * found.at[place]) * column
    term = found.terms[-1]
    slope, sequence = found.slope[-1], np.argsort(found.at)
    sequence = sequence[np.unique(np.linspace(0, sequence.size - 1, _MOST_PLACES).round().astype(int))]
    at = wording.values_of(found.at[sequence].tolist(), found.condition, view.capacity_Ah)
    values, name, unit = lines.value[sequence, term], wording.plain_name(found.condition), r.unit
    if term == 0:
        what, tail = (
            wording.difference(values.tolist(), r.unit),
            f"the difference {'rises' if slope > 0.0 else 'falls'} with {name}",
        )
    else:
        unit = wording.ratio(r.unit, unit_of(view.drive or ""))
        per = -values if unit == "ohm" else values
        texts, shown = wording.numbers(per.tolist(), unit)
        quantity = "the resistance" if unit == "ohm" else f"the slope over {wording.plain_name(view.drive or '')}"
        what = f"{quantity} is {', '.join(texts)} {shown} above the model's"
        tail = f"the model's dependence on {name} is wrong"
        slope = -slope if unit == "ohm" else slope
    if found.condition == view.drive and unit == "V":
        tail += f": resistance {_off(slope, 'ohm')}"
    of_temperature = unit_of(found.condition) == "degC"
    per_unit = wording.ratio(unit, "K" if of_temperature else unit_of(found.condition) or "1")
    text = f"{view.prefix}{what} at {name} {at}: {tail} ({in_runs(len(lines.runs), len(lines.runs), len(lines.runs))})."
    words: dict[str, Any] = dict(
        condition=found.condition,
        lower=float(found.at.min()),
        upper=float(found.at.max()),
        text=text[0].upper() + text[1:],
        cause=TEMPERATURE_DEPENDENCE if of_temperature else RESISTANCE if per_unit == "ohm" else "",
        value=-slope if per_unit == "ohm" else slope,
        unit=per_unit,
    )
    made = make(view, explained, np.ones(r.error.size, dtype=bool), runs_seen=len(lines.runs), **words)
    return alone(made, explained, _PREFER["order"])


def _off(wrong: float, unit: str) -> str:
    """Say by how much a quantity of the model is wrong, given what is missing: '2 mohm too low'."""
    return f"{wording.with_unit(abs(wrong), unit)} too {'low' if wrong > 0.0 else 'high'}"
