"""What is odd in the readings of a run: gaps, saturation, coarse digits, stuck sensors, wrong units, a loaded start."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from jaxmodel.base.units import unit_of
from jaxmodel.data.importing.findings import Finding
from jaxmodel.data.importing.logs import Log, spans

# A gap lasts so many times as long as rows usually are apart, and so long at least [s].
_GAP, _GAP_S = 20.0, 30.0
# Where so large a share of the rows is evenly spaced, so many spacings are a gap.
_EVEN, _GAP_OF_EVEN = 0.95, 5.0
# Below this share of the largest current a cell rests.
_REST = 0.02
# Least share of the range that one digit of a sensor is, to be told.
_COARSE = 0.01
_NOTED_RESOLUTION = {"V": 0.004, "degC": 0.4, "A": 0.2}
# A limit is met so often, for so many rows at a time, by a reading that was moving.
_VISITS, _ROWS_AT_LIMIT = 3, 5
_MOST_ROWS = 2_000_000
# A thermometer that never reads more is none: no bench is colder (assumed), and an input without a sensor is.
_COLDEST_DEGC = -60.0
# Ranges beyond which a unit is wrong, by column.
_POSSIBLE = {
    "voltage_V": (0.0, 1000.0),
    "cell_temperature_degC": (-60.0, 150.0),
    "ambient_degC": (-60.0, 120.0),
    "winding_temperature_degC": (-60.0, 250.0),
    "case_temperature_degC": (-60.0, 250.0),
}


def without_unconnected(run: Log) -> Log:
    """Return a run without thermometers that are not there: their input reads far below what any bench has."""
    off = {
        name: float(np.nanmax(values))
        for name, values in run.columns.items()
        if name.endswith("_degC") and np.isfinite(values).any() and np.nanmax(values) < _COLDEST_DEGC
    }
    if not off:
        return run
    said = [
        Finding(
            "no thermometer",
            run.name,
            f"{run.name}: {name} reads {value:.0f} degC at most: no thermometer is connected; the column is left out.",
            "warning",
            name,
        )
        for name, value in off.items()
    ]
    return dataclasses.replace(run, columns={n: v for n, v in run.columns.items() if n not in off}).also(*said)


def odd_things(run: Log, kind: str) -> Iterator[Finding]:
    """Yield what is odd in the readings of a run."""
    current = run.columns.get("current_A", run.columns.get("pack_current_A"))
    yield from _gaps(run, current)
    for name, values in run.columns.items():
        if not np.isfinite(values).any():
            continue
        if name == "ambient_degC" and np.ptp(values[np.isfinite(values)]) == 0.0:
            continue
        if kind == "cell" or name != "voltage_V":  # a motor's is what drives it
            yield from _impossible(run, name, values)
        yield from _resolution(run, name, values)
        yield from _saturation(run, name, values)
    yield from _stuck(run, current)
    if current is not None and kind in ("cell", "robot"):
        yield from _under_load(run, current)
    yield from _counter(run)


def _gaps(run: Log, current: np.ndarray | None) -> Iterator[Finding]:
    apart = np.diff(run.time_s)
    if apart.size == 0:
        return
    usual = float(np.median(apart))
    even = float(np.mean(np.abs(apart - usual) < 0.1 * usual)) > _EVEN
    gap = apart > (_GAP_OF_EVEN * usual if even else max(_GAP * usual, _GAP_S))
    if current is not None and not even:
        # A log that is thinned while nothing happens has no gaps there.
        largest = float(np.nanmax(np.abs(current))) if np.isfinite(current).any() else 0.0
        loaded = np.nan_to_num(np.abs(current)) > _REST * largest
        jumped = np.nan_to_num(np.abs(np.diff(current))) > 0.02 * largest
        gap &= loaded[:-1] & loaded[1:] & (jumped | (apart > max(100.0 * usual, 10.0 * _GAP_S)))
    if not gap.any():
        return
    longest = int(np.argmax(np.where(gap, apart, 0.0)))
    count = int(gap.sum())
    under = " under load" if current is not None and not even else ""
    sentence = (
        f"{run.name}: {count} {'gap' if count == 1 else 'gaps'}{under}, the longest of {apart[longest]:.5g} s from "
        f"{run.time_s[longest]:.6g} s (rows are usually {usual:.3g} s apart); the input is taken as that "
        "of the row after it."
    )
    places = tuple((float(run.time_s[n]), float(run.time_s[n + 1])) for n in np.flatnonzero(gap)[:50])
    yield Finding(
        "gap",
        run.name,
        sentence,
        "warning",
        "time_s",
        places,
        {"longest_s": float(apart[longest]), "gaps": float(count)},
    )


def _impossible(run: Log, name: str, values: np.ndarray) -> Iterator[Finding]:
    if name not in _POSSIBLE:
        return
    low, high = _POSSIBLE[name]
    middle = float(np.nanmedian(values))
    outside = np.isfinite(values) & ((values < low) | (values > high))
    if not low <= middle <= high:
        sentence = (
            f"{run.name}: {name} has {middle:.5g} (median), and {low:g} to {high:g} {unit_of(name)} "
            "is possible; state its unit with --unit."
        )
        yield Finding("wrong unit", run.name, sentence, "warning", name, numbers={"median": middle})
    elif outside.any():
        count, row = int(outside.sum()), int(outside.argmax())
        sentence = (
            f"{run.name}: {name} is outside {low:g} to {high:g} {unit_of(name)} in {count} "
            f"{'row' if count == 1 else 'rows'}, first with "
            f"{values[row]:.5g} at {run.time_s[row]:.6g} s; the readings are kept."
        )
        yield Finding("impossible reading", run.name, sentence, "warning", name, spans(outside, run.time_s))


def _thinned(values: np.ndarray) -> np.ndarray:
    there = values[np.isfinite(values)]
    return there[:_MOST_ROWS]


def resolution(values: np.ndarray) -> float:
    """Return the smallest difference of two readings: one digit of the sensor; 0 where all are equal."""
    steps = np.diff(np.unique(_thinned(values)))
    steps = steps[steps > 1e-9 * max(float(np.nanmax(np.abs(values))), 1e-30)]
    return float(steps.min()) if steps.size else 0.0


def _resolution(run: Log, name: str, values: np.ndarray) -> Iterator[Finding]:
    digit, extent = resolution(values), float(np.ptp(_thinned(values)))
    unit = unit_of(name)
    limit = _NOTED_RESOLUTION.get(unit, np.inf)
    if digit <= 0.0 or (digit < limit and digit < _COARSE * extent):
        return
    if digit < limit and unit in ("V", "degC") and digit <= 0.25 * limit:
        return
    sentence = (
        f"{run.name}: the resolution of {name} is {digit:.3g} {unit}, and all its readings lie within "
        f"{extent:.3g} {unit}."
    )
    yield Finding("coarse resolution", run.name, sentence, "note", name, numbers={"resolution": digit, "range": extent})


def _saturation(run: Log, name: str, values: np.ndarray) -> Iterator[Finding]:
    """Yield a limit that a moving reading meets again and again and stays at, to the last digit."""
    there = np.isfinite(values)
    if there.sum() < 100 or np.ptp(values[there]) == 0.0:
        return
    digit = resolution(values)
    for limit, side in ((float(np.nanmax(values)), "upper"), (float(np.nanmin(values)), "lower")):
        if limit == 0.0:
            continue
        at = values == limit
        edges = np.flatnonzero(np.diff(at.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        long = edges[(edges[:, 1] - edges[:, 0] >= _ROWS_AT_LIMIT) & (edges[:, 0] > 2)]
        if long.shape[0] < _VISITS:
            continue
        # It was moving towards the limit for a while when it met it; what is controlled jumps there.
        begin = long[:, 0]
        steps = np.stack([values[begin - n] - values[np.maximum(begin - n - 1, 0)] for n in range(3)])
        same_way = np.all(np.sign(steps) == np.sign(steps[0]), axis=0)
        moving = same_way & np.all(np.abs(steps) > 3.0 * digit, axis=0) & (np.abs(steps[0]) < 3.0 * np.abs(steps[1]))
        if np.sum(moving) < max(_VISITS, long.shape[0] // 2):
            continue
        lasting = run.time_s[long[:, 1] - 1] - run.time_s[begin]
        if name.endswith(("_A", "_V", "_Nm", "duty")) and np.std(lasting) < 0.2 * np.mean(lasting):
            continue  # steps of a programme, all of one length
        share = float(at.mean())
        sentence = (
            f"{run.name}: {name} stays at its {side} limit {limit:.5g} {unit_of(name)} {long.shape[0]} "
            f"times ({share:.1%} of the "
            "rows): the sensor is saturated there, and these readings measure nothing."
        )
        yield Finding(
            "saturation", run.name, sentence, "warning", name, spans(at, run.time_s), {"limit": limit, "share": share}
        )


def _stuck(run: Log, current: np.ndarray | None) -> Iterator[Finding]:
    for name, values in run.columns.items():
        if not name.endswith("_degC") or name == "ambient_degC":
            continue
        there = values[np.isfinite(values)]
        if there.size < 20 or np.ptp(there) > 0.0 or current is None:
            continue
        if np.nanmax(np.abs(current)) == 0.0:
            continue
        sentence = (
            f"{run.name}: {name} is {there[0]:g} in all {there.size:,} readings, while a current flows: "
            "the thermometer never "
            "moves; leave it out with --column " + f'{name}="".'
        )
        yield Finding("stuck sensor", run.name, sentence, "warning", name, numbers={"reading": float(there[0])})


def _under_load(run: Log, current: np.ndarray) -> Iterator[Finding]:
    there = np.flatnonzero(np.isfinite(current))
    largest = float(np.max(np.abs(current[there]))) if there.size else 0.0
    if largest == 0.0 or abs(float(current[there[0]])) < 0.05 * largest:
        return
    sentence = (
        f"{run.name}: it begins with {current[there[0]]:.4g} A: a start under load. The model begins a run "
        "at rest, so the "
        "first minutes may differ."
    )
    yield Finding(
        "start under load", run.name, sentence, "warning", "current_A", numbers={"current_A": float(current[there[0]])}
    )


def _counter(run: Log) -> Iterator[Finding]:
    """Yield a tester's count of charge that the current and the clock do not give."""
    counted, current = run.discharged_Ah, run.columns.get("current_A")
    if (
        counted is None
        or current is None
        or not np.isfinite(counted).all()
        or np.any(np.diff(counted) < -1e-3 * np.ptp(counted))
    ):
        return
    current = np.where(np.isfinite(current), current, 0.0)
    interval = np.diff(run.time_s, prepend=run.time_s[0]) / 3600.0
    only_out = float(np.sum(np.maximum(current, 0.0) * interval))
    read = float(counted[-1] - counted[0])
    net = float(np.sum(current * interval))  # some testers count charge back
    gross = float(np.sum(np.abs(current) * interval))  # a charge beside which some mA s of discharge are nothing
    if gross <= 0.0 or min(abs(read - only_out), abs(read - net)) <= 0.03 * max(read, only_out, 0.1 * gross):
        return
    sentence = (
        f"{run.name}: the tester counts {read:.4g} A h of discharge, and current and clock give {only_out:.4g} A h; "
        "rows are missing, or a unit is wrong."
    )
    yield Finding(
        "charge count", run.name, sentence, "warning", "current_A", numbers={"tester_Ah": read, "counted_Ah": only_out}
    )
