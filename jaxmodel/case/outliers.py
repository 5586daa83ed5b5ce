"""Outliers: one to three readings far from their neighbours, which no input explains; at rest and on ramps.

Causes are a loose contact, a lost message, or a converter without a reading. One such reading at 0 V can outweigh
thousands of others in a sum of squares. It has no physical cause, so it is excluded, and a remark says so. Import,
parameterisation and diagnosis all use this module.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from jaxmodel.base.remark import Remark
from jaxmodel.base.units import unit_of
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import (
    Rows,
    Values,
    after_pauses,
    detect_quantum,
    off_the_neighbours,
    robust_sd,
    white_sd,
    without_readings,
)

# Distance of an outlier from the readings before and after it, in sd; these differ by less than half of that. It has at
# most so many rows. White noise has none in 1e20 readings.
FAR = 10.0
MOST_ROWS = 3
# A larger share of a channel's rows is said; above the second, of one run, they are no single events, and kept: a
# converter whose bit flips back and forth. Assumed.
NOTED_SHARE = 0.005
MOST_OF_RUN = 0.05
# Rows before and after in which a change of an input may cause what a reading does.
_BESIDE = 2
# An outlier is so many times as far away as the rows on its quieter side are from each other.
_SUDDEN = 3.0
# Quantities of something that is stored, rotation or heat: they do not come back within a row while an input stays
# where it went. A current and a voltage may: a motor's inrush.
_STORED = ("rad/s", "degC")
# Range of so many noisy readings of an input that was held, in sd of its noise.
_NOISE_RANGE = 6.0
# Steps of an input from which it is known how far another reading follows, and the share of that which is no answer.
_FEWEST_STEPS, _UNFOLLOWED = 2, 0.3
# A change of an input by this share of its largest value explains any reading; a smaller one explains a reading that is
# away by so many times the same share of the channel's range. Assumed.
_ANY_CHANGE, _AMPLIFIED = 0.1, 10.0


def without_outliers(case: Case) -> tuple[Case, tuple[Remark, ...]]:
    """Return a case with outliers of its outputs as missing readings, and of its inputs as their neighbours.

    There is a remark on each channel with some.
    """
    case, told = _without_unfollowed(case)
    remarks, runs = list(told), {run.name: run for run in case.runs}
    channels = dict.fromkeys(name for run in case.runs for name in run.measured.outputs)
    for channel in channels:
        with_it = [run for run in case.runs if channel in run.measured.outputs]
        found = {run.name: outliers(run, channel, case.sensors.get(channel, 0.0)) for run in with_it}
        kept = {run: found.pop(run.name) for run in with_it if is_frequent(found[run.name])}
        if kept:
            run, rows = next(iter(kept.items()))
            count = sum(int(rows.sum()) for rows in kept.values())
            remarks.append(
                Remark(
                    f"{count} readings of {channel} in {', '.join(run.name for run in kept)} are far from the "
                    "neighbouring readings, with no input that explains them: "
                    f"{_said(run, *_first(run, channel, rows))} and others. That is {rows.mean():.1%} of its rows, too "
                    "many for outliers, so they are kept; look at the sensor.",
                    "outliers_kept",
                    channel,
                    readings=float(count),
                    share=rows.mean(),
                )
            )
        count = sum(int(rows.sum()) for rows in found.values())
        if not count:
            continue
        first = next(run for run in with_it if run.name in found and found[run.name].any())
        share = count / sum(rows.size for rows in found.values())
        value, time_s = _first(first, channel, found[first.name])
        remarks.append(
            Remark(
                f"{count} reading{'s' * (count > 1)} of {channel} excluded as outlier{'s' * (count > 1)}, far from the "
                f"neighbouring readings although no input changed with {'them' if count > 1 else 'it'}: "
                f"{_said(first, value, time_s)}{' and others' * (count > 1)}{share_said(count, share)}.",
                "outliers_excluded",
                channel,
                readings=float(count),
                share=share,
                value=value,
                time_s=time_s,
            )
        )
        for name, rows in found.items():
            runs[name] = without_readings(runs[name], channel, rows)
    return dataclasses.replace(case, runs=tuple(runs.values())), tuple(remarks)


def _first(run: Run, channel: str, rows: Rows) -> tuple[float, float]:
    """Return the first of some readings, and its time [s]."""
    row = int(np.argmax(rows))
    return float(run.measured.outputs[channel][row]), float(run.measured.time_s[row])


def _said(run: Run, value: float, time_s: float) -> str:
    return f"{value:.4g} at {time_s:g} s of {run.file}"


def _without_unfollowed(case: Case) -> tuple[Case, tuple[Remark, ...]]:
    """Return a case with outliers of its inputs taken as their neighbours, and a remark on each input with some."""
    remarks, runs = [], []
    for run in case.runs:
        for name, values in run.measured.inputs.items():
            rows = unfollowed(run.measured.time_s, name, values, run.measured.outputs)
            if not rows.any():
                continue
            row, count = int(np.argmax(rows)), int(rows.sum())
            remarks.append(
                Remark(
                    f"{count} reading{'s' * (count > 1)} of the input {name} of {run.file} taken as the neighbouring "
                    f"ones, because no reading followed: {values[row]:.4g} at {run.measured.time_s[row]:g} s"
                    f"{' and others' * (count > 1)}.",
                    "input_outliers_replaced",
                    f"{name}@{run.name}",
                    readings=float(count),
                    value=values[row],
                    time_s=run.measured.time_s[row],
                )
            )
            time_s = run.measured.time_s
            held = np.interp(time_s, time_s[~rows], values[~rows])
            run = run.driven_by(run.measured.inputs | {name: held})
        runs.append(run)
    return dataclasses.replace(case, runs=tuple(runs)), tuple(remarks)


def unfollowed(time_s: Values, name: str, values: Values, outputs: Mapping[str, Values]) -> Rows:
    """Return which readings of an input are outliers: they are far off, and what follows its steps did not, (rows,).

    A voltage follows a current, and a current a voltage. Where the run has too few steps to tell how far, none is one.

    Args:
        time_s: of the rows.
        name: of the input.
        values: its readings.
        outputs: readings by column.
    """
    found = np.zeros(values.size, dtype=bool)
    asked = {"A": "V", "V": "A"}.get(unit_of(name))
    follows = next((read for column, read in outputs.items() if asked and unit_of(column) == asked), None)
    if follows is None or not (suspect := outlying(time_s, {}, name, values)).any():
        return found
    steady = ~np.convolve(suspect, np.ones(3), "same").astype(bool)
    largest = float(np.abs(values[~suspect]).max(initial=0.0))
    step, answer = np.diff(values), np.diff(follows)
    plain = steady[1:] & steady[:-1] & np.isfinite(answer) & (np.abs(step) > _ANY_CHANGE * largest)
    if plain.sum() < _FEWEST_STEPS:
        return found
    slope, noise = float(np.median(answer[plain] / step[plain])), FAR * robust_sd(off_the_neighbours(follows))
    edges = np.flatnonzero(np.diff(suspect.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    for first, end in edges.tolist():
        # The row after counts too: the two may be read one after the other.
        read = follows[first : min(end + 1, values.size)] - follows[first - 1]
        asked_for = abs(slope * float(np.median(values[first:end]) - values[first - 1]))
        if np.isfinite(read).all() and max(noise, float(np.abs(read).max())) < _UNFOLLOWED * asked_for:
            found[first:end] = True
    return found


def is_frequent(rows: Rows) -> bool:
    """Return whether readings of a run that look like outliers are too many to be single events."""
    return bool(rows.sum() > 1 and rows.mean() > MOST_OF_RUN)


def share_said(count: int, share: float) -> str:
    """Return the share of a channel's readings that outliers are, for a sentence; "" where it is small."""
    return f"; that is {share:.1%} of its readings, so look at the sensor" * (count > 1 and share > NOTED_SHARE)


def outliers(run: Run, channel: str, stated_sd: float = 0.0) -> Rows:
    """Return which rows of a run are outliers of a channel, (rows,) booleans."""
    measured = run.measured
    return outlying(measured.time_s, measured.inputs, channel, measured.outputs[channel], stated_sd)


def outlying(
    time_s: Values, inputs: Mapping[str, Values], channel: str, values: Values, stated_sd: float = 0.0
) -> Rows:
    """Return which readings of a channel are outliers, (rows,) booleans.

    Args:
        time_s: of the rows.
        inputs: that drive the hardware; temperatures of surroundings among them are ignored, as they act slowly.
        channel: name of the column, which tells its unit.
        values: its readings; NaN is a missing one.
        stated_sd: of its noise; 0 if it is not known.
    """
    there = np.flatnonzero(np.isfinite(values))
    found = np.zeros(values.size, dtype=bool)
    if there.size < 5:
        return found
    read, pause = values[there], after_pauses(time_s[there])
    off = off_the_neighbours(read)
    off = off[off != 0.0]  # a coarse sensor shows its noise only when it changes
    scale = max(stated_sd, robust_sd(off) / np.sqrt(1.5), detect_quantum(read))
    if not scale:
        return found
    loads = [given for name, given in inputs.items() if not name.endswith("degC")]
    low, high = np.quantile(read, (0.01, 0.99))
    step = np.pad(np.abs(np.diff(read)), 1, constant_values=np.inf)
    jumps = np.flatnonzero(step[1:-1] > FAR * scale) + 1
    for length in range(1, MOST_ROWS + 1):
        first = jumps[jumps + length < read.size]
        rows = first[:, None] + np.arange(length)
        away = np.concatenate([read[rows] - read[first - 1, None], read[rows] - read[first + length, None]], axis=1)
        nearest, furthest = np.abs(away).min(axis=1), np.abs(away).max(axis=1)
        back = np.abs(read[first + length] - read[first - 1]) < 0.5 * nearest
        one_way = np.all(away > FAR * scale, axis=1) | np.all(away < -FAR * scale, axis=1)
        together = ~np.any(pause[first[:, None] + np.arange(length + 1)], axis=1)
        # The top of a smooth curve without noise is as far from its neighbours as these are from theirs.
        beside = np.minimum(step[first - 1], step[first + length + 1])
        sudden = nearest > _SUDDEN * np.where(np.isfinite(beside), beside, 0.0)
        first, furthest = (each[back & one_way & together & sudden] for each in (first, furthest))
        moved = _moved(loads, there[first - 1], there[first + length], unit_of(channel) in _STORED)
        explained = (moved > _ANY_CHANGE) | (furthest <= _AMPLIFIED * moved * (high - low))
        found[there[first[~explained, None] + np.arange(length)]] = True
    return found


def _moved(loads: list[Values], before: np.ndarray, after: np.ndarray, comes_back: bool) -> np.ndarray:
    """Return how far inputs move around some rows, as a share of their largest values: of each the largest.

    Args:
        loads: the inputs.
        before: row before each suspect.
        after: row after each suspect.
        comes_back: count only how far an input comes back again, and not how far it goes.
    """
    most = np.zeros(before.size)
    for given in loads:
        largest = float(np.abs(given).max(initial=0.0))
        if not largest or not before.size:
            continue
        noise = _NOISE_RANGE * white_sd(given)
        begin, end = np.maximum(before - _BESIDE, 0), np.minimum(after + _BESIDE, given.size - 1)
        for place, (one, last) in enumerate(zip(begin.tolist(), end.tolist(), strict=True)):
            window = given[one : last + 1]
            goes = float(np.ptp(window)) - (abs(float(window[-1] - window[0])) if comes_back else 0.0)
            most[place] = max(most[place], (goes - noise) / largest)
    return most
