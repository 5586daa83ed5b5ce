"""Stuck sensors: an output that repeats one reading for a long time under load, as it does nowhere else.

If a thermometer is stuck for the rest of a run, the calibration would conclude that the temperature is constant. Coarse
sensors at rest, a motor at standstill, a voltage held by a charger and a body in thermal equilibrium repeat a reading
too. They are distinguished from stuck sensors by their readings elsewhere under load, and by how abruptly the readings
stop changing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from jaxmodel.base.remark import Remark
from jaxmodel.base.units import unit_of
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import (
    Rows,
    Values,
    calm,
    detect_quantum,
    loaded,
    loads,
    off_the_neighbours,
    robust_sd,
    without_readings,
)

# Smallest number of rows, and share of the run's time, of a suspicious stretch of one reading.
LEAST_ROWS, LEAST_SHARE = 30, 0.05
# Factor by which it must be longer, in rows and in time, than any other under load.
LONGER = 8.0
# Chance that a stretch is so long by itself, from which it is suspicious where noise is visible. Assumed.
BY_CHANCE = 1e-6
# Share of the stretch, in time or in rows, in which the hardware must be loaded.
WHILE_LOADED = 0.1
# Share of a sensor's changes that reverse at once while no input steps, from which its noise is visible: a constant
# reading is then suspicious.
GOES_BACK = 0.15
# Share of readings under load that must differ from the previous one if noise always reaches the rounding step.
MOVES = 0.3
# A body that approaches equilibrium slows down: ratio of the durations of its last and earlier steps.
SLOWER = 2.5
# A trend is seen where half of it is so many sd of the readings about it.
TREND = 5.0
# Scatter elsewhere, in rounding steps, from which readings within one step are suspicious.
FINE = 2.0
# If more than this share of a channel's readings is suspicious, it is not stuck.
MOST_OF_CHANNEL = 0.5
# A width, with rounding errors.
_ROUNDED = 1.001
# Quantities that read exactly zero at standstill.
_MAY_REST = ("rad/s", "A")


@dataclass(frozen=True)
class Stretch:
    """Readings of one channel in one run that repeat one value.

    Attributes:
        first: row of the first.
        last: row of the last.
        rows: how many were read.
        seconds: time from the first to the last.
        value: what they read.
    """

    first: int
    last: int
    rows: int
    seconds: float
    value: float


@dataclass(frozen=True)
class _Behaviour:
    """Behaviour of a sensor elsewhere under load.

    Attributes:
        rows: of its longest stretch of one reading.
        seconds: of its longest.
        shows_noise: whether its noise is visible, and always reaches the rounding step.
        readings: number of readings.
        stretches: number of stretches of one reading.
    """

    rows: float
    seconds: float
    shows_noise: bool
    readings: int
    stretches: int

    @property
    def longer(self) -> float:
        """Return the factor by which a suspicious stretch is longer than the longest of m stretches elsewhere.

        Noise ends a stretch in each row with some chance, so that lengths have an exponential tail: one that is r times
        as long as the longest of m has a chance of m^(1 - r).
        """
        if not self.shows_noise or self.stretches < 2:
            return LONGER
        return min(LONGER, 1.0 - float(np.log(BY_CHANCE) / np.log(self.stretches)))


def without_stuck(case: Case) -> tuple[Case, tuple[Remark, ...]]:
    """Return a case with the readings of stuck sensors as missing, and a remark on each stretch."""
    remarks, runs = [], {run.name: run for run in case.runs}
    for channel in dict.fromkeys(name for run in case.runs for name in run.measured.outputs):
        found = stuck(case, channel)
        for name, stretch in found:
            run = runs[name]
            read = np.flatnonzero(np.isfinite(run.measured.outputs[channel]))
            rows = np.zeros(run.measured.time_s.size, dtype=bool)
            rows[stretch.first : stretch.last + 1] = True
            runs[name] = without_readings(run, channel, rows)
            from_s, to_s = run.measured.time_s[[stretch.first, stretch.last]].tolist()
            until = "the end" if stretch.last == read[-1] else f"{to_s:g} s"
            remarks.append(
                Remark(
                    f"{channel} in {name} repeats {stretch.value:g} {unit_of(channel)}".rstrip()
                    + f" from {from_s:g} s to {until} under load: the sensor is stuck; these readings are excluded.",
                    "sensor_stuck",
                    f"{channel}@{name}",
                    value=stretch.value,
                    from_s=from_s,
                    to_s=to_s,
                )
            )
    return dataclasses.replace(case, runs=tuple(runs.values())), tuple(remarks)


def stuck(case: Case, channel: str) -> list[tuple[str, Stretch]]:
    """Return the stretches over which a channel's sensor is stuck, each with the name of its run.

    One value is repeated or, for a sensor that scatters over several rounding steps elsewhere, readings stay within
    one.
    """
    runs = [run for run in case.runs if channel in run.measured.outputs]
    readings = np.concatenate([run.measured.outputs[channel] for run in runs] or [np.zeros(0)])
    readings = readings[np.isfinite(readings)]
    if np.unique(readings).size < 3:
        return []
    quantum = detect_quantum(readings)
    # The run with the stuck sensor may scatter least.
    scatter = max(robust_sd(off_the_neighbours(run.measured.outputs[channel])[calm(run)[1:-1]]) for run in runs)
    found = _stuck_within(case, channel, 0.0, quantum)
    if 0.0 < FINE * quantum <= scatter / np.sqrt(1.5):
        known = {name for name, _ in found}
        found += [one for one in _stuck_within(case, channel, quantum, quantum) if one[0] not in known]
    return found


def _stuck_within(case: Case, channel: str, within: float, quantum: float) -> list[tuple[str, Stretch]]:
    """Return the stretches over which a channel's readings stay within a width for unusually long under load."""
    runs = [run for run in case.runs if channel in run.measured.outputs]
    readings = np.concatenate([run.measured.outputs[channel] for run in runs])
    held = [float(np.nanmin(readings)), float(np.nanmax(readings))] if unit_of(channel) == "V" else []
    largest = _largest(case)
    suspects = [
        (run, stretch)
        for run in runs
        for stretch in stretches(run, channel, within, LEAST_ROWS)
        if _is_long(run, stretch)
        and not (abs(stretch.value) <= within and unit_of(channel) in _MAY_REST)
        and all(abs(stretch.value - one) > 3.0 * quantum for one in held)
        and _while_loaded(run, largest, np.array([stretch.first]), np.array([stretch.last]))[0] >= WHILE_LOADED
    ]
    if not suspects:
        return []
    by_run = {run.name: [one for other, one in suspects if other is run] for run in runs}
    behaviour = _behaviour(runs, channel, by_run, within, largest)
    if behaviour.readings < LEAST_ROWS or sum(one.rows for _, one in suspects) > MOST_OF_CHANNEL * readings.size:
        return []
    return [
        (run.name, one)
        for run, one in suspects
        if one.rows > behaviour.longer * behaviour.rows
        and one.seconds > behaviour.longer * behaviour.seconds
        and (behaviour.shows_noise or _ends_abruptly(run, channel, one) or _trend_ends(run, channel, one))
    ]


def _largest(case: Case) -> dict[str, float]:
    """Return the largest size of every input that loads the hardware."""
    found: dict[str, float] = {}
    for run in case.runs:
        for name, values in loads(run).items():
            found[name] = max(found.get(name, 0.0), float(np.abs(values).max(initial=0.0)))
    return found


def stretches(run: Run, channel: str, within: float = 0.0, least_rows: int = 1) -> list[Stretch]:
    """Return the stretches of a run in which a channel's readings stay within a width, missing readings ignored.

    Args:
        run: the run.
        channel: a column that it measured.
        within: the width; 0 for one value repeated.
        least_rows: shorter stretches are left out.
    """
    values, time_s = run.measured.outputs[channel], run.measured.time_s
    if within > 0.0 and not _may_be_long(values[np.isfinite(values)], within, least_rows):
        return []
    there, first, last = _bounds(values, within)
    long = np.flatnonzero(last - first + 1 >= least_rows)
    return [
        Stretch(
            first=int(there[first[k]]),
            last=int(there[last[k]]),
            rows=int(last[k] - first[k] + 1),
            seconds=float(time_s[there[last[k]]] - time_s[there[first[k]]]),
            value=float(values[there[first[k]]]),
        )
        for k in long
    ]


def _may_be_long(read: Values, within: float, least_rows: int) -> bool:
    """Return True if so many neighbouring readings stay within a width anywhere: a quick test of a long run."""
    spread = maximum_filter1d(read, least_rows) - minimum_filter1d(read, least_rows)
    inner = spread[least_rows // 2 : read.size - (least_rows - 1) // 2]
    return bool(np.any(inner <= _ROUNDED * within))


def _bounds(values: Values, within: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rows with readings, and the first and last of these for each stretch within a width."""
    there = np.flatnonzero(np.isfinite(values))
    read = values[there]
    first = np.flatnonzero(np.append(True, np.diff(read) != 0.0)[: read.size])
    if within > 0.0 and first.size:
        kept, low, high = [], np.inf, -np.inf
        for row, value in zip(first.tolist(), read[first].tolist(), strict=True):
            low, high = min(low, value), max(high, value)
            if not kept or high - low > _ROUNDED * within:
                kept.append(row)
                low = high = value
        first = np.array(kept)
    return there, first, np.append(first[1:], read.size) - 1 if first.size else first


def _while_loaded(run: Run, largest: dict[str, float], first: np.ndarray, last: np.ndarray) -> Values:
    """Return the share from some rows to others, the last included, in which the hardware is loaded.

    The larger of the shares of time and of rows: loggers have few rows under a steady load, or few in long rests.
    """
    lasting = np.diff(run.measured.time_s, append=2.0 * run.measured.time_s[-1] - run.measured.time_s[-2])
    shares = []
    for weight in (lasting, np.ones(lasting.size)):
        passed, on = (np.append(0.0, np.cumsum(one)) for one in (weight, weight * loaded(run, largest)))
        shares.append((on[last + 1] - on[first]) / np.maximum(passed[last + 1] - passed[first], 1e-300))
    return np.maximum(*shares)


def _is_long(run: Run, stretch: Stretch) -> bool:
    length = run.measured.time_s[-1] - run.measured.time_s[0]
    return bool(stretch.rows >= LEAST_ROWS and stretch.seconds >= LEAST_SHARE * length)


def _behaviour(
    runs: list[Run], channel: str, suspects: Mapping[str, list[Stretch]], within: float, largest: dict[str, float]
) -> _Behaviour:
    """Return the behaviour of a channel under load, without suspicious stretches."""
    rows, seconds, back, pairs, moves, readings, found = 0.0, 0.0, 0, 0, 0, 0, 0
    for run in runs:
        values, on, quiet = run.measured.outputs[channel], loaded(run, largest), calm(run)
        mine = np.isfinite(values)
        for one in suspects[run.name]:
            mine[one.first : one.last + 1] = False
        there, first, last = _bounds(values, within)
        spent = _while_loaded(run, largest, there[first], there[last])
        counted = mine[there[first]] & (spent >= WHILE_LOADED)
        found += int(counted.sum())
        rows = max(rows, float((last - first + 1)[counted].max(initial=0)))
        seconds = max(
            seconds,
            float((run.measured.time_s[there[last]] - run.measured.time_s[there[first]])[counted].max(initial=0.0)),
        )
        readings += int(np.sum(mine & on))
        step = np.diff(values, prepend=np.nan)
        moves += int(np.sum(mine & on & np.isfinite(step) & (step != 0.0)))
        moved = np.flatnonzero(mine & np.isfinite(step) & (step != 0.0))
        beside = moved[1:][np.diff(moved) <= 3]
        before = moved[:-1][np.diff(moved) <= 3]
        counted = quiet[beside] & quiet[before]
        pairs += int(counted.sum())
        back += int(np.sum((step[beside] * step[before] < 0.0) & counted))
    shows_noise = pairs >= LEAST_ROWS and back > GOES_BACK * pairs and moves > MOVES * readings
    return _Behaviour(rows, seconds, shows_noise, readings, found)


def _ends_abruptly(run: Run, channel: str, stretch: Stretch) -> bool:
    """Return whether a sensor changed at a steady rate until it was stuck, while the load did not fall."""
    before = [one for one in stretches(run, channel) if one.last < stretch.first]
    if len(before) < 5:
        return False
    time_s = run.measured.time_s
    began = np.array([time_s[one.first] for one in before[-4:]] + [time_s[stretch.first]])
    pace = np.diff(began)
    if pace[-1] > SLOWER * max(pace[0], pace[1]) or stretch.seconds < LONGER * pace.max():
        return False
    readings = np.array([one.value for one in before[-4:]] + [stretch.value])
    one_way = np.all(np.diff(readings) > 0.0) or np.all(np.diff(readings) < 0.0)
    window: Rows = (time_s >= began[0] - 2.0 * pace.sum()) & (time_s < began[-1])
    after: Rows = (time_s >= began[-1]) & (time_s <= time_s[stretch.last])
    return bool(one_way) and all(_goes_on(values, window, after) for values in loads(run).values())


def _trend_ends(run: Run, channel: str, stretch: Stretch) -> bool:
    """Return whether a sensor that scatters followed a trend until it was stuck, while the load did not fall.

    A body that comes to equilibrium slows down before it stops: within as many rows before, the later half of a trend
    that stops at once changes about as much as the earlier one, and by far more than the readings scatter.
    """
    values, time_s = run.measured.outputs[channel], run.measured.time_s
    before = np.flatnonzero(np.isfinite(values[: stretch.first]))[-stretch.rows :]
    if before.size < LEAST_ROWS:
        return False
    changes, scatter = [], 0.0
    for rows in np.array_split(before, 2):
        line = np.polynomial.Polynomial.fit(time_s[rows], values[rows], 1)
        changes.append(float(line(time_s[rows[-1]]) - line(time_s[rows[0]])))
        scatter = max(scatter, float(np.std(values[rows] - line(time_s[rows]))))
    earlier, later = changes
    goes_on = earlier * later > 0.0 and abs(later) > max(TREND * scatter, abs(earlier) / SLOWER)
    first, last = before[0], stretch.first
    window: Rows = (time_s >= time_s[first]) & (time_s < time_s[last])
    after: Rows = (time_s >= time_s[last]) & (time_s <= min(time_s[stretch.last], 2.0 * time_s[last] - time_s[first]))
    return goes_on and all(_goes_on(one, window, after) for one in loads(run).values())


def _goes_on(values: Values, before: Rows, after: Rows) -> bool:
    return bool(np.mean(np.abs(values[after])) >= 0.7 * np.mean(np.abs(values[before])))
