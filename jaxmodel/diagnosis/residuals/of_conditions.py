"""Sentences on residuals over one condition: range, size, dependence on the drive, and the likely cause."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxmodel.base.units import unit_of
from jaxmodel.diagnosis.residuals import wording
from jaxmodel.diagnosis.residuals.cells import cells_of
from jaxmodel.diagnosis.residuals.regimes import Bins, least_span
from jaxmodel.diagnosis.residuals.segments import Segment, segments
from jaxmodel.diagnosis.residuals.statement import (
    OPEN_CIRCUIT_VOLTAGE,
    RESISTANCE,
    TEMPERATURE_DEPENDENCE,
    Explanation,
    Statement,
    View,
    in_runs,
    make,
)
from jaxmodel.diagnosis.residuals.table import Bools, Floats

# Weight of each later condition against the one before it; less for what is nearly the clock.
_LATER, _NEARLY_TIME = 0.95, 0.8
_MOST_PLACES = 5
# Share of the time of a segment that a level of the drive, or a run, needs in order to be listed.
_COUNTS = 0.03
# A line in the drive that changes by less than this share of the constant is described as almost independent of it.
_HARDLY = 0.5


def condition_explanation(view: View, name: str) -> Explanation | None:
    """Return the explanation over a condition; None if no segment is significant."""
    r, bins, drive = view.residuals, view.cuts[name], view.drive
    temperature = next((c for c in view.conditions if unit_of(c) == "degC" and c not in (name, r.channel)), None)
    if r.unit == "K":
        temperature = None  # the channel is a temperature itself
    values = None if drive is None else r.conditions[drive]
    levels = None if drive is None or drive == name else view.cuts[drive]
    cells = cells_of(r, bins, levels, drive, temperature)
    # Corrects for all tests: each range may have two terms, and every condition is tried.
    found = segments(r, cells, view.most_p / (2.0 * bins.count * len(view.conditions)))
    if not found:
        return None
    columns = np.ones((r.error.size, 3))
    columns[:, 1] = 0.0 if values is None else values
    if temperature is not None:
        columns[:, 2] = r.conditions[temperature] - np.average(r.conditions[temperature], weights=r.weight_s)
    explained, statements, parts = np.zeros(r.error.size), [], []
    for segment in found:
        rows = (bins.code >= segment.first) & (bins.code <= segment.last)
        values = segment.values_at(columns[rows])
        seen, present = _seen(view, values, rows)
        if 3 * seen < 2 * present:
            continue
        explained[rows] = values
        statements.append(_made(view, bins, segment, explained, rows, columns, temperature, (seen, present)))
        parts.append(rows)
    place = view.conditions.index(name)
    preference = _NEARLY_TIME if name == "time_since_load_changed_s" else _LATER**place
    return Explanation(
        tuple(statements), tuple(parts), explained, sum((one.share for one in statements), 0.0), preference
    )


def _made(
    view: View,
    bins: Bins,
    segment: Segment,
    explained: Floats,
    rows: Bools,
    columns: Floats,
    temperature: str | None,
    seen: tuple[int, int],
) -> Statement:
    """Return the statement on one segment, seen in so many of the runs that cover it."""
    r = view.residuals
    values = dict(zip(segment.terms, segment.value, strict=True))
    what = _means(view, bins, segment, rows)
    cause, meaning, value, unit = _meaning(view, bins.name, values, columns[rows])
    meaning += " there" if meaning and segment.last - segment.first < bins.count - 1 else ""
    if 2 in values and temperature is not None:
        what += f", {'rising' if values[2] > 0.0 else 'falling'} by {wording.with_unit(abs(values[2]), r.unit)} per K"
    where = wording.sentence(wording.within(bins, segment.first, segment.last), what)
    text = f"{where}{meaning} ({in_runs(*seen, len(r.runs))})."
    if view.prefix:
        text = f"{view.prefix}{text if text.startswith('SOC') else text[0].lower() + text[1:]}"
    words: dict[str, Any] = dict(
        condition=bins.name,
        lower=float(bins.lower[segment.first]),
        upper=float(bins.upper[segment.last]),
        text=text,
        cause=cause,
        value=value,
        unit=unit,
        runs_seen=seen[0],
    )
    return make(view, explained, rows, **words)[0]


def _means(view: View, bins: Bins, segment: Segment, rows: Bools) -> str:
    """Say how far the measurement is from the model at each level of the drive, and how that depends on the drive."""
    r, drive = view.residuals, view.drive
    weight = r.weight_s[rows]
    if drive is None or drive not in view.cuts:
        return wording.difference([float(np.average(r.error[rows], weights=weight))], r.unit)
    code = view.cuts[drive].code[rows]
    spent = np.bincount(code, weight)
    levels = np.flatnonzero(spent >= _COUNTS * spent.sum())
    at = [float(np.average(r.conditions[drive][rows][code == k], weights=weight[code == k])) for k in levels]
    means = [float(np.average(r.error[rows][code == k], weights=weight[code == k])) for k in levels]
    if len(at) < 2:
        return wording.difference([float(np.average(r.error[rows], weights=weight))], r.unit)
    shown_levels = np.unique(np.linspace(0, len(at) - 1, _MOST_PLACES).round().astype(int))
    name = wording.plain_name(drive)
    shown = f"{wording.difference([means[k] for k in shown_levels], r.unit)} at "
    unit = unit_of(drive)
    shown += "" if unit else f"{name} "
    shown += wording.values_of([at[k] for k in shown_levels], drive, view.capacity_Ah)
    return shown + _goes_with(view, segment, at, means)


def _goes_with(view: View, segment: Segment, at: list[float], means: list[float]) -> str:
    """Say how the error depends on the drive, if the drive varies in the segment."""
    drive = view.drive or ""
    name = wording.plain_name(drive)
    if np.ptp(at) < least_span(view.residuals, drive):
        return ""
    if segment.terms == (0,):
        slope = np.polyfit(at, means, 1)[0]
        return (
            f", almost independent of the {name}" if abs(slope) * np.ptp(at) < _HARDLY * abs(segment.value[0]) else ""
        )
    if 1 not in segment.terms:
        return ""
    if segment.terms[0] == 1:
        return f", proportional to the {name}"
    return f", {'rising' if segment.value[1] > 0.0 else 'falling'} with the {name}"


def _meaning(view: View, name: str, values: dict[int, float], columns: Floats) -> tuple[str, str, float, str]:
    """Return the cause, its description, and the value that represents it with its unit."""
    r = view.residuals
    size = {term: abs(values[term]) * np.sqrt(np.mean(columns[:, term] ** 2)) for term in values if term < 2}
    first = max(size, key=lambda term: size[term])
    slope_unit = wording.ratio(r.unit, unit_of(view.drive or ""))
    of_temperature = unit_of(name) == "degC"
    if r.unit != "V":
        cause = TEMPERATURE_DEPENDENCE if of_temperature else ""
        return cause, "", values[first], r.unit if first == 0 else slope_unit
    parts = []
    terms = [term for term in size if name == "soc" or term == 1]
    for term in sorted(terms, key=lambda term: -size[term]):
        # A small second term belongs to the fit and is not worth a sentence.
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


def _seen(view: View, values: Floats, rows: Bools) -> tuple[int, int]:
    """Return in how many runs the error has the sign of the explanation, and how many runs cover the segment."""
    r = view.residuals
    run, weight = r.run[rows], r.weight_s[rows]
    spent = np.bincount(run, weight)
    along = np.bincount(run, weight * values * r.error[rows])
    present = spent >= _COUNTS * spent.sum()
    return int(np.sum((along > 0.0) & present)), int(np.sum(present))
