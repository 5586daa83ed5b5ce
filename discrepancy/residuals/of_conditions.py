"""What is told of a condition: in which stretch of it, by how much, over which currents, and what that means."""

from __future__ import annotations

from typing import Any

import numpy as np

from discrepancy.residuals import wording
from discrepancy.residuals.cells import cells_of
from discrepancy.residuals.regimes import Bins, least_span
from discrepancy.residuals.statement import (
    OPEN_CIRCUIT_VOLTAGE,
    RESISTANCE,
    TEMPERATURE_DEPENDENCE,
    Explanation,
    Statement,
    View,
    in_runs,
    make,
)
from discrepancy.residuals.stories import Stretch, stretches
from discrepancy.residuals.table import Bools, Floats
from jaxmodel.units import unit_of

# By how much a later condition must explain more than one before it; more for what is nearly the clock.
_LATER, _NEARLY_TIME = 0.95, 0.8
_MOST_PLACES = 5
# Share of the time of a stretch that a level of the drive, or a run, must have to be told.
_COUNTS = 0.03
# Part of the constant that a line in the drive may add over its span and still be called hardly any.
_HARDLY = 0.5


def condition_told(view: View, name: str) -> Explanation | None:
    """Return what is told of a condition; None where no story holds."""
    r, bins, drive = view.residuals, view.cuts[name], view.drive
    warmth = next((c for c in view.conditions if unit_of(c) == "degC" and c not in (name, r.channel)), None)
    if r.unit == "K":
        warmth = None  # a thermometer's own error
    values = None if drive is None else r.conditions[drive]
    levels = None if drive is None or drive == name else view.cuts[drive]
    cells = cells_of(r, bins, levels, drive, warmth)
    # Each of the ranges may have two terms, and each of the conditions is tried.
    found = stretches(r, cells, view.most_p / (2.0 * bins.count * len(view.conditions)))
    if not found:
        return None
    columns = np.ones((r.error.size, 3))
    columns[:, 1] = 0.0 if values is None else values
    if warmth is not None:
        columns[:, 2] = r.conditions[warmth] - np.average(r.conditions[warmth], weights=r.weight_s)
    told, statements, parts = np.zeros(r.error.size), [], []
    for stretch in found:
        rows = (bins.code >= stretch.first) & (bins.code <= stretch.last)
        story = stretch.told(columns[rows])
        seen, present = _seen(view, story, rows)
        if 3 * seen < 2 * present:
            continue
        told[rows] = story
        statements.append(_made(view, bins, stretch, told, rows, columns, warmth, (seen, present)))
        parts.append(rows)
    place = view.conditions.index(name)
    preference = _NEARLY_TIME if name == "time_since_load_changed_s" else _LATER**place
    return Explanation(tuple(statements), tuple(parts), told, sum((one.share for one in statements), 0.0), preference)


def _made(
    view: View,
    bins: Bins,
    stretch: Stretch,
    told: Floats,
    rows: Bools,
    columns: Floats,
    warmth: str | None,
    seen: tuple[int, int],
) -> Statement:
    """Return the statement of one stretch, seen in so many of the runs that were there."""
    r = view.residuals
    values = dict(zip(stretch.terms, stretch.value, strict=True))
    what = _means(view, bins, stretch, rows)
    cause, meaning, value, unit = _meaning(view, bins.name, values, columns[rows])
    meaning += " there" if meaning and stretch.last - stretch.first < bins.count - 1 else ""
    if 2 in values and warmth is not None:
        what += f", {wording.with_unit(abs(values[2]), r.unit)} {'more' if values[2] > 0.0 else 'less'} for every K"
    where = wording.sentence(wording.within(bins, stretch.first, stretch.last), what)
    text = f"{where}{meaning} ({in_runs(*seen, len(r.runs))})."
    if view.beside:
        text = f"{view.beside}{text if text.startswith('SOC') else text[0].lower() + text[1:]}"
    words: dict[str, Any] = dict(
        condition=bins.name,
        lower=float(bins.lower[stretch.first]),
        upper=float(bins.upper[stretch.last]),
        text=text,
        cause=cause,
        value=value,
        unit=unit,
        runs_seen=seen[0],
    )
    return make(view, told, rows, **words)[0]


def _means(view: View, bins: Bins, stretch: Stretch, rows: Bools) -> str:
    """Say where measured lies at each level of the drive, and how that goes with it."""
    r, drive = view.residuals, view.drive
    weight = r.weight_s[rows]
    if drive is None or drive not in view.cuts:
        return wording.lies([float(np.average(r.error[rows], weights=weight))], r.unit)
    code = view.cuts[drive].code[rows]
    spent = np.bincount(code, weight)
    levels = np.flatnonzero(spent >= _COUNTS * spent.sum())
    at = [float(np.average(r.conditions[drive][rows][code == k], weights=weight[code == k])) for k in levels]
    means = [float(np.average(r.error[rows][code == k], weights=weight[code == k])) for k in levels]
    if len(at) < 2:
        return wording.lies([float(np.average(r.error[rows], weights=weight))], r.unit)
    told = np.unique(np.linspace(0, len(at) - 1, _MOST_PLACES).round().astype(int))
    name = wording.spoken(drive)
    shown = f"{wording.lies([means[k] for k in told], r.unit)} at "
    unit = unit_of(drive)
    shown += "" if unit else f"{name} "
    shown += wording.places([at[k] for k in told], drive, view.capacity_Ah)
    return shown + _goes_with(view, stretch, at, means)


def _goes_with(view: View, stretch: Stretch, at: list[float], means: list[float]) -> str:
    """Say how the error goes with the drive, where the stretch spans it."""
    drive = view.drive or ""
    name = wording.spoken(drive)
    if np.ptp(at) < least_span(view.residuals, drive):
        return ""
    if stretch.terms == (0,):
        slope = np.polyfit(at, means, 1)[0]
        return f", hardly depending on the {name}" if abs(slope) * np.ptp(at) < _HARDLY * abs(stretch.value[0]) else ""
    if 1 not in stretch.terms:
        return ""
    if stretch.terms[0] == 1:
        return f", in proportion to the {name}" if min(at) < 0.0 else f", growing with the {name}"
    return f", {'rising' if stretch.value[1] > 0.0 else 'falling'} with the {name}"


def _meaning(view: View, name: str, values: dict[int, float], columns: Floats) -> tuple[str, str, float, str]:
    """Return the cause, what to say of it, and the value that stands for it with its unit."""
    r = view.residuals
    size = {term: abs(values[term]) * np.sqrt(np.mean(columns[:, term] ** 2)) for term in values if term < 2}
    first = max(size, key=lambda term: size[term])
    slope_unit = wording.ratio(r.unit, unit_of(view.drive or ""))
    of_temperature = unit_of(name) == "degC"
    if r.unit != "V":
        cause = TEMPERATURE_DEPENDENCE if of_temperature else ""
        return cause, "", values[first], r.unit if first == 0 else slope_unit
    parts = []
    told = [term for term in size if name == "soc" or term == 1]
    for term in sorted(told, key=lambda term: -size[term]):
        # What adds little beside the other is part of the fit, not of the story.
        if size[term] > 0.25 * size[first]:
            quantity, value, unit = (
                ("open-circuit voltage", values[0], "V") if term == 0 else ("resistance", -values[1], slope_unit)
            )
            parts.append(f"{quantity} {wording.with_unit(abs(value), unit)} too {'low' if value > 0.0 else 'high'}")
    cause = OPEN_CIRCUIT_VOLTAGE if first == 0 else RESISTANCE
    if name != "soc" and first == 0:
        cause, parts = "", []
    if of_temperature:
        cause = TEMPERATURE_DEPENDENCE
    meaning = f": {' and '.join(parts)}" if parts else ""
    return cause, meaning, (values[0] if first == 0 else -values[1]), (r.unit if first == 0 else slope_unit)


def _seen(view: View, story: Floats, rows: Bools) -> tuple[int, int]:
    """Return in how many runs the error goes the way of a story, and how many were there."""
    r = view.residuals
    run, weight = r.run[rows], r.weight_s[rows]
    spent = np.bincount(run, weight)
    along = np.bincount(run, weight * story * r.error[rows])
    present = spent >= _COUNTS * spent.sum()
    return int(np.sum((along > 0.0) & present)), int(np.sum(present))
