"""What is told of heat and of whole runs: a thermometer that rises, one run that is off, runs in an order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from discrepancy.residuals import wording
from discrepancy.residuals.heat import heat
from discrepancy.residuals.runs import Order, RunLines, odd_run, order, run_lines, standing_out
from discrepancy.residuals.statement import (
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
from discrepancy.residuals.table import Bools, ChannelResiduals, Floats
from jaxmodel.units import unit_of

# Where explanations explain nearly the same, by how much more than its share each counts.
_PREFER = {"heat": 2.0, "order": 1.3, "run": 1.05}
_MOST_PLACES = 5
# How many times as large as the others, and as the noise, one run's error must be to be set aside; of all squares.
_OUTSIZE, _OUTSIZE_SHARE = 2.0, 0.1
_MOST_OF_IT = 0.8  # of the squares of a difference: what says so much of it says it alone
_ONE_SIGN = 0.6  # of a root mean square: a mean of this size has a sign worth telling


def heat_told(view: View) -> Explanation | None:
    """Return the heat that a thermometer shows."""
    r = view.residuals
    drive = next((name for name in DRIVES if name in r.conditions), None)
    if r.unit != "K" or drive is None or view.given:
        return None
    found = heat(r, drive)
    if found is None:
        return None
    way = np.sign(max(found.rise.values(), key=abs))
    alike = sorted((k for k, rise in found.rise.items() if rise * way > 0.0), key=lambda k: -abs(found.rise[k]))
    named = sorted(alike[:_MOST_PLACES])
    texts, unit = wording.numbers([abs(found.rise[k]) for k in named], "K")
    goes, cause = ("rises", "heat is missing") if way > 0.0 else ("stays", "too much heat, or too little given off")
    text = (
        f"Measured {goes} {', '.join(texts)} {unit} {'above' if way > 0.0 else 'below'} the model by the end of "
        f"{wording.listed([r.run_names[k] for k in named])}, with the square of the {wording.spoken(drive)}: {cause} "
        f"({in_runs(len(alike), len(r.runs), len(r.runs))})."
    )
    value = max((found.rise[k] for k in named), key=abs)
    words: dict[str, Any] = dict(
        condition=drive, lower=-np.inf, upper=np.inf, text=text, cause=HEAT, value=value, unit="K"
    )
    made = make(view, found.told, np.ones(r.error.size, dtype=bool), runs_seen=len(alike), **words)
    return alone(made, found.told, _PREFER["heat"])


def runs_told(view: View) -> Iterator[Explanation | None]:
    """Give the run that is off, and the order of runs."""
    r = view.residuals
    if len(r.runs) < 3:
        return
    lines = run_lines(r, view.drive)
    yield _odd(view, lines)
    found = order(r, lines, list(view.conditions))
    if found is not None:
        yield _in_order(view, lines, found)


def _odd(view: View, lines: RunLines) -> Explanation | None:
    """Return the one run that is off."""
    r, odd, drive = view.residuals, odd_run(lines), view.drive or ""
    if odd is None:
        return None
    place, rows = lines.runs.index(odd.run), r.run == odd.run
    line = lines.value[place] - np.delete(lines.value, place, axis=0).mean(axis=0)
    told = np.full(r.error.size, line[0])
    if line.size == 2:
        told = told + line[1] * (r.conditions[drive] - lines.middle)
    told = np.where(rows, told, 0.0)
    what, off, unit = _difference(view, lines, line, told[rows], rows)
    name = r.run_names[odd.run]
    text = (
        f"{view.beside}{name}: {what}, compared with the other {len(r.runs) - 1} runs, in this run only"
        f"{_why(view, odd.run)}."
    )
    words: dict[str, Any] = dict(
        condition="run", lower=float(odd.run), upper=float(odd.run), text=text, cause=ONE_RUN, value=off, unit=unit
    )
    return alone(make(view, told, rows, runs_seen=1, **words), told, _PREFER["run"])


def _difference(view: View, lines: RunLines, line: Floats, told: Floats, rows: Bools) -> tuple[str, float, str]:
    """Say by what a run differs from the others, with the value that stands for it and its unit.

    A constant, or something in proportion to the drive, where that is most of it; else both.
    """
    r, drive = view.residuals, view.drive or ""
    weight = r.weight_s[rows]
    mean = float(np.average(told, weights=weight))
    square = float(np.average(told**2, weights=weight))
    if line.size == 1 or mean**2 > _MOST_OF_IT * square:
        return wording.lies([mean], r.unit), mean, r.unit
    values, unit = r.conditions[drive][rows], wording.ratio(r.unit, unit_of(drive))
    slope = float(np.sum(weight * told * values) / np.sum(weight * values**2))
    name = wording.spoken(drive)
    if slope**2 * np.average(values**2, weights=weight) > _MOST_OF_IT * square:
        side = "above" if slope > 0.0 else "below"
        what = f"measured lies {wording.with_unit(abs(slope), unit)} x {name} {side} the model"
    else:
        slope = float(line[1])
        rest = wording.with_unit(float(line[0] - slope * lines.middle), r.unit)
        sign = "+" if slope > 0.0 else "-"
        what = f"measured minus model is {rest} {sign} {wording.with_unit(abs(slope), unit)} x {name}"
    return what, -slope if unit == "ohm" else slope, unit


def _why(view: View, run: int) -> str:
    """Say what one run is alone in; '' for nothing."""
    r = view.residuals
    where = [
        f"{wording.places([_mean_in(r, one, r.run == run)], one, view.capacity_Ah)} of {wording.spoken(one)}"
        for one in standing_out(r, run, list(view.conditions))
    ]
    return f"; it is the only one at {wording.listed(where)}" if where else ""


def outsize_told(view: View) -> Statement | None:
    """Return that one run has most of what is left, in no order that was found; None where none has."""
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
    sign = "in no one sign"
    if abs(mean) > _ONE_SIGN * size[run]:
        sign = f"{texts[3]} {unit} {'above' if mean > 0.0 else 'below'} the model on average"
    between = texts[1] if texts[1] == texts[2] else f"{texts[1]} to {texts[2]}"
    text = (
        f"{view.beside}{r.run_names[run]}: measured is off by {texts[0]} {unit} as a root mean square, {sign}; "
        f"the other {len(others)} runs by {between} {unit}{_why(view, run)}."
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
    """Return the runs in the order of a condition."""
    r = view.residuals
    told = np.zeros(r.error.size)
    for place, run in enumerate(lines.runs):
        rows = r.run == run
        for term, intercept, slope in zip(found.terms, found.intercept, found.slope, strict=True):
            column = 1.0 if term == 0 else r.conditions[view.drive or ""][rows] - lines.middle
            told[rows] += (intercept + slope * found.at[place]) * column
    term = found.terms[-1]
    slope, sequence = found.slope[-1], np.argsort(found.at)
    sequence = sequence[np.unique(np.linspace(0, sequence.size - 1, _MOST_PLACES).round().astype(int))]
    at = wording.places(found.at[sequence].tolist(), found.condition, view.capacity_Ah)
    values, name, unit = lines.value[sequence, term], wording.spoken(found.condition), r.unit
    if term == 0:
        what, tail = wording.lies(values.tolist(), r.unit), f"it {'rises' if slope > 0.0 else 'falls'} with {name}"
    else:
        unit = wording.ratio(r.unit, unit_of(view.drive or ""))
        per = -values if unit == "ohm" else values
        texts, shown = wording.numbers(per.tolist(), unit)
        quantity = "the resistance" if unit == "ohm" else f"the slope over {wording.spoken(view.drive or '')}"
        what = f"{quantity} lies {', '.join(texts)} {shown} above the model's"
        tail = f"its dependence on {name} is off"
        slope = -slope if unit == "ohm" else slope
    if found.condition == view.drive and unit == "V":
        tail += f": resistance {_off(slope, 'ohm')}"
    of_temperature = unit_of(found.condition) == "degC"
    per_unit = wording.ratio(unit, "K" if of_temperature else unit_of(found.condition) or "1")
    text = f"{view.beside}{what} at {name} {at}: {tail} ({in_runs(len(lines.runs), len(lines.runs), len(lines.runs))})."
    words: dict[str, Any] = dict(
        condition=found.condition,
        lower=float(found.at.min()),
        upper=float(found.at.max()),
        text=text[0].upper() + text[1:],
        cause=TEMPERATURE_DEPENDENCE if of_temperature else RESISTANCE if per_unit == "ohm" else "",
        value=-slope if per_unit == "ohm" else slope,
        unit=per_unit,
    )
    made = make(view, told, np.ones(r.error.size, dtype=bool), runs_seen=len(lines.runs), **words)
    return alone(made, told, _PREFER["order"])


def _off(wrong: float, unit: str) -> str:
    """Say by how much a quantity of the model is off, of which so much is missing: '2 mohm too low'."""
    return f"{wording.with_unit(abs(wrong), unit)} too {'low' if wrong > 0.0 else 'high'}"
