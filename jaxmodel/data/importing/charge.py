"""The capacity of a cell and the state of charge at the start of each run, as far as the files tell them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log
from jaxmodel.data.importing.options import Options
from jaxmodel.data.importing.sign import evidence

# Highest voltage at rest of LFP, the range of its middle and the width between the quartiles of its charge (assumed).
_LFP_MOST_V, _LFP_MIDDLE_V, _LFP_SPREAD_V = 3.85, (2.8, 3.5), 0.25
# Layered oxides are charged to 4.2 V (4.20 +- 0.05 V: Samsung, specification of the INR18650-30Q); a full one rests at
# 4.1 V or more, and at 4.18 V where the files show none (assumed).
_LAYERED_FULL_V, _LAYERED_RESTS_V = 4.1, 4.18
# Under the load of a charge that ends, a cell of LFP is full from so much on (charged to 3.6 V: A123, data sheet of the
# ANR26650M1), one of LTO, which never shows more than the second number, from the third (2.7 V: Toshiba, SCiB).
_LFP_CHARGED_V, _LTO_MOST_V, _LTO_CHARGED_V = 3.5, 2.9, 2.6
# A charge whose current falls to this share of its own largest, within so much [V] of its end, ends at a full cell.
_TAPERED, _TAPER_V, _TAPER_S = 0.35, 0.015, 300.0
# A rested cell within so much [V] of the voltage of a full one is full; sd of its SOC for that.
_FULL_V, _FULL_SD = 0.06, 0.02
_NEARLY_FULL_V = 0.2
# sd of the SOC that a log states by itself, and by how much more it may differ from the count (assumed).
_LOGGED_SD, _DISAGREES = 0.05, 0.05
_CHARGED_ABOVE_V = 0.15  # a charge that ends so far above every rest was not followed by one
_FULL_LOADED_V, _FULL_LOADED_SD = 0.1, 0.04
_LFP_FULL_V, _LFP_FULL_SD = 3.38, 0.02
# The voltage under load within so much [V] of the lowest of the files is the cut-off, if it is no higher than makers of
# such cells state: 2.5 to 3.2 V of layered oxides, 2.0 to 2.8 V of LFP.
_EMPTY_V = 0.15
_EMPTY_RESTS_V = 0.4  # above the cut-off, an empty cell rests (assumed)
_MOST_EMPTY_V, _MOST_EMPTY_LFP_V = 3.3, 2.9
# A current below this share of the run's largest, or of that of all runs, is a rest.
_REST, _FLOOR = 0.02, 0.0025
_RESTED_S = 600.0
# A run that is loaded for less [h], or whose resting voltage changes by less [V], tells no capacity (assumed).
_PULSE_H, _PULSE_V = 0.1, 0.1
# Of the SOC, from which what a log states of it tells the capacity, and is better than a guess.
_LEAST_SHARE, _LEAST_HINT = 0.2, 0.05
_LARGEST_GUESS_AH = 5000.0
_SLOW = 1.0 / 15.0  # of the capacity per hour: such a current hardly moves the voltage


@dataclasses.dataclass(frozen=True)
class Stated:
    """A number with its standard deviation, and what it rests on."""

    value: float
    sd: float | None
    why: str


@dataclasses.dataclass(frozen=True, eq=False)
class Count:
    """The charge of one run.

    Attributes:
        run: which.
        out_Ah: charge taken out since the first row [A h].
        full: rows at which the cell is full: at rest at the voltage of a full cell, or at the end of a charge.
        empty: rows at which the cut-off is reached under load.
        resting: rows without load.
        ambient_degC: of the run; None where nothing tells.
        rate_A: typical current of the run [A].
        below_full_V: how far below the voltage of a full cell it rests at its first row; NaN for a start under load,
            and where the chemistry does not tell.
        begins_empty: whether it rests at its first row at the voltage of an empty cell.
        flat: whether the files show the plateau of LFP, or of LTO.
    """

    run: Log
    out_Ah: np.ndarray
    full: np.ndarray
    empty: np.ndarray
    resting: np.ndarray
    ambient_degC: float | None
    rate_A: float
    below_full_V: float
    begins_empty: bool
    flat: bool = False


def counts(runs: Sequence[Log], ambient_degC: Sequence[float | None]) -> list[Count]:
    """Return the charge of each run that has current and voltage.

    Args:
        runs: of one cell, current positive on discharge.
        ambient_degC: of each.
    """
    usable = [
        (run, warmth)
        for run, warmth in zip(runs, ambient_degC, strict=True)
        if {"current_A", "voltage_V"} <= run.columns.keys()
    ]
    if not usable:
        return []
    floor = _FLOOR * max(float(np.nanmax(np.abs(run.columns["current_A"]))) for run, _ in usable)
    # At rest: a pulse of charge in the cold goes far above what a full cell has.
    rested = [_quantile(run.columns["voltage_V"][_resting(run, floor)], 0.995) for run, _ in usable]
    tops = [_quantile(run.columns["voltage_V"], 0.99) for run, _ in usable]
    high = max((value for value in rested if np.isfinite(value)), default=float(np.median(tops)))
    ends_V = [float(run.columns["voltage_V"][end]) for run, _ in usable for end in _charged(run)]
    lows = sorted(_quantile(run.columns["voltage_V"], 0.0) for run, _ in usable)
    low = float(np.median(lows[: max(len(lows) // 2, 1)]))
    full = _full_of([run for run, _ in usable], high, max(ends_V, default=-np.inf), low)
    return [_count(run, warmth, full, low, floor) for run, warmth in usable]


@dataclasses.dataclass(frozen=True)
class _Full:
    """How a full cell of these files shows: NaN where nothing does.

    Attributes:
        flat: whether the open-circuit voltage is, as that of LFP.
        high: the highest voltage at rest, or that of a full cell where it is known.
        rests_V: least voltage at rest of a full cell.
        charged_V: least voltage at which a charge ends there.
    """

    flat: bool
    high: float
    rests_V: float
    charged_V: float


def _full_of(runs: Sequence[Log], high: float, charged_V: float, low: float) -> _Full:
    """Return how a full cell shows, by the chemistry that the voltages tell: the highest of the files is no reason."""
    if high < _LTO_MOST_V:
        return _Full(True, high, np.nan, _LTO_CHARGED_V)
    middle, spread = _middle(runs)
    if 3.2 < high < _LFP_MOST_V and _LFP_MIDDLE_V[0] < middle < _LFP_MIDDLE_V[1] and spread < _LFP_SPREAD_V:
        # Nearly empty layered oxides have such voltages too; a plateau that ends at a cut-off or at a charge tells.
        known = low <= _MOST_EMPTY_LFP_V or charged_V >= _LFP_CHARGED_V
        return _Full(True, high, _LFP_FULL_V if known else np.nan, _LFP_CHARGED_V)
    # A cycler that goes from charge to discharge without a rest shows no full cell at rest.
    if charged_V > max(high + _CHARGED_ABOVE_V, _LAYERED_FULL_V):
        high = charged_V
    high = high if high >= _LAYERED_FULL_V else _LAYERED_RESTS_V
    return _Full(False, high, high - _FULL_V, max(high - 0.01, _LAYERED_FULL_V))


def _middle(runs: Sequence[Log]) -> tuple[float, float]:
    """Return median and width between the quartiles of the voltage, by the charge that is moved at it."""
    volts, charges = [], []
    for run in runs:
        there = np.isfinite(run.columns["voltage_V"])
        moved = np.abs(np.nan_to_num(run.columns["current_A"])) * np.diff(run.time_s, prepend=run.time_s[0])
        volts.append(run.columns["voltage_V"][there])
        charges.append(moved[there])
    volt, charge = np.concatenate(volts), np.concatenate(charges)
    if not charge.sum() > 0.0:
        return float(np.median(volt)) if volt.size else np.nan, 0.0
    order = np.argsort(volt)
    share = np.cumsum(charge[order]) / charge.sum()
    first, half, last = (float(volt[order][np.searchsorted(share, at)]) for at in (0.25, 0.5, 0.75))
    return half, last - first


def _charges(run: Log) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the last rows of the charges of a run."""
    charging = np.concatenate([[False], np.nan_to_num(run.columns["current_A"]) < 0.0, [False]])
    turns = np.flatnonzero(charging[1:] != charging[:-1])
    return turns[::2], turns[1::2] - 1


def _charged(run: Log) -> np.ndarray:
    """Return the last rows of charges that put back at least half of all the charge that the run moves."""
    out = np.cumsum(np.nan_to_num(run.columns["current_A"]) * np.diff(run.time_s, prepend=run.time_s[0]))
    begins, ends = _charges(run)
    put_back = out[np.maximum(begins - 1, 0)] - out[ends]
    ends = ends[put_back >= 0.5 * float(np.ptp(out))] if ends.size else ends
    return ends[np.isfinite(run.columns["voltage_V"][ends])]


def _tapered(run: Log) -> np.ndarray:
    """Return the last rows of charges that end at constant voltage, the current fallen to a small share."""
    current, voltage = run.columns["current_A"], run.columns["voltage_V"]
    found = []
    for begin, end in zip(*_charges(run), strict=True):
        part, volts = np.abs(current[begin : end + 1]), voltage[begin : end + 1]
        held = np.abs(volts - voltage[end]) < _TAPER_V
        # From its last row not held, it is held to the end.
        first = int(np.flatnonzero(~held)[-1]) + 1 if (~held).any() else 0
        falls = part[-1] <= _TAPERED * part.max() and part[-1] <= 1.01 * part[first:].min()
        if falls and run.time_s[end] - run.time_s[begin + first] >= _TAPER_S:
            found.append(end)
    return np.array(found, dtype=int)


def _resting(run: Log, floor: float) -> np.ndarray:
    current = np.nan_to_num(run.columns["current_A"])
    return np.abs(current) <= max(_REST * float(np.max(np.abs(current))), floor)


def _quantile(values: np.ndarray, share: float) -> float:
    there = values[np.isfinite(values)][:: max(values.size // 1_000_000, 1)]
    return float(np.quantile(there, share)) if there.size else np.nan


def _count(run: Log, ambient_degC: float | None, of_full: _Full, low: float, floor: float) -> Count:
    """Return the charge of a run.

    Args:
        run: current positive on discharge.
        ambient_degC: of it.
        of_full: how a full cell shows.
        low: the cut-off.
        floor: current below which every run rests [A].
    """
    current, voltage = np.nan_to_num(run.columns["current_A"]), run.columns["voltage_V"]
    interval = np.diff(run.time_s, prepend=run.time_s[0]) / 3600.0
    out = np.cumsum(current * interval)
    largest = float(np.max(np.abs(current))) or 1.0
    resting, high, flat = _resting(run, floor), of_full.high, of_full.flat
    with np.errstate(invalid="ignore"):
        full = resting & (voltage >= of_full.rests_V)
        most = _MOST_EMPTY_LFP_V if flat else _MOST_EMPTY_V
        empty = (voltage <= min(low + _EMPTY_V, most)) & (current > 0.0) & ~resting
        ends = _charged(run)
        full[ends[voltage[ends] >= of_full.charged_V]] = True
    full[_tapered(run)] = True
    if not resting[0] and not flat and np.isfinite(voltage[0]) and current[0] > 0.0:  # under load already
        seen = evidence(run)
        drop = current[0] * seen.resistance_ohm if seen.steps >= 3 and seen.resistance_ohm > 0.0 else 0.0
        full[0] |= bool(voltage[0] + drop >= high - (_FULL_LOADED_V if drop else 1.5 * _FULL_LOADED_V))
    elif not resting[0] and current[0] > 0.0:
        full[0] |= bool(voltage[0] >= of_full.rests_V)
    loaded = np.abs(current) > 0.05 * largest
    rate = float(np.median(np.abs(current[loaded]))) if loaded.any() else 0.0
    below = high - float(voltage[0]) if resting[0] and not flat else np.nan
    begins_empty = bool(resting[0] and voltage[0] <= min(low + _EMPTY_RESTS_V, most))
    return Count(run, out, full, empty, resting, ambient_degC, rate, below, begins_empty, of_full.flat)


def capacity_of(
    found: Sequence[Count], stated_Ah: float | None, of_preset: Stated | None = None
) -> tuple[Stated, bool]:
    """Return the capacity [A h], and whether a full discharge or the user gave it.

    Args:
        found: the charge of each run.
        stated_Ah: by the user.
        of_preset: that of the preset that the user chose.
    """
    if stated_Ah is not None:
        return Stated(stated_Ah, 0.02 * stated_Ah, "stated"), True
    discharges = [pair for count in found for pair in full_discharges(count)]
    if discharges:
        one, best = max(discharges, key=lambda pair: pair[1])
        # What a fast discharge leaves in the cell is not known.
        sd = (0.02 if one.rate_A < 0.25 * best else 0.05) * best
        count = len(discharges)
        which = "the only discharge" if count == 1 else f"the largest of {count} discharges"
        return Stated(best, sd, f"{which} from full to the cut-off, in {one.run.name}"), True
    if of_preset is not None:
        return of_preset, False
    if (logged := _by_logged_soc(found, _LEAST_SHARE)) is not None:
        return logged, True
    return _by_logged_soc(found, _LEAST_HINT) or _guess(found), False


def _by_logged_soc(found: Sequence[Count], least: float) -> Stated | None:
    """Return the capacity by the SOC that a log states and the charge that it moves meanwhile: more than a share."""
    parts = []
    for count in found:
        soc = count.run.columns.get("soc")
        there = np.flatnonzero(np.isfinite(soc)) if soc is not None else np.empty(0, dtype=int)
        if soc is None or not there.size:
            continue
        low, high = there[np.argmin(soc[there])], there[np.argmax(soc[there])]
        share, moved = float(soc[high] - soc[low]), float(count.out_Ah[low] - count.out_Ah[high])
        if share > 0.0 and moved > 0.0:
            parts.append((share, moved, count.run.name))
    if not parts:
        return None
    share, moved, where = max(parts)
    ends = 2  # of the SOC, each with its sd
    if share <= least:  # runs that each move little tell it together
        share, moved = sum(part[0] for part in parts), sum(part[1] for part in parts)
        where, ends = f"{len(parts)} runs", 2 * len(parts)
    if share <= least:
        return None
    capacity = moved / share
    return Stated(capacity, capacity * _LOGGED_SD * ends**0.5 / share, f"by the log's own state of charge, in {where}")


def _guess(found: Sequence[Count]) -> Stated:
    """Return a capacity that the files do not tell, with an sd that says so: half of it or more.

    On a plateau any share of the charge may have been moved: the cell has as much at least, and the sd is all of it.
    """
    moved, one = max(
        ((float(np.ptp(count.out_Ah)), count) for count in found), key=lambda pair: pair[0], default=(0, None)
    )
    if one is None or moved <= 0.0:
        return Stated(5.2, 5.2, "no charge was moved; that of the paper's cell is assumed")
    voltage = one.run.columns["voltage_V"]
    quiet, loaded = voltage[one.resting & np.isfinite(voltage)], voltage[~one.resting & np.isfinite(voltage)]
    swing = 0.0 if np.isnan(one.below_full_V) or not quiet.size else float(np.ptp(quiet[[0, -1]]))
    how = "its resting voltage changes"
    if not swing and loaded.size and not one.flat:  # it never rests
        swing, how = float(np.ptp(np.quantile(loaded, [0.02, 0.98]))), "its voltage changes under load"
    pulse = moved < _PULSE_H * one.rate_A or 0.0 < swing < _PULSE_V
    if one.flat and not pulse:
        value = max(2.0 * moved, one.rate_A)
        why = f"the plateau of the voltage does not tell it: {_in_words(moved)} is the least"
        return Stated(value, value, f"{why}, and twice that, or the charge of its current in one hour, is assumed")
    if not pulse:
        why = "assumed: 1.25 times the charge that the longest run moves; no discharge goes from full to the cut-off"
        return Stated(1.25 * moved, 0.625 * moved, why)
    why = f"a pulse of {_in_words(moved)} does not tell the capacity"
    if swing > 1e-3:  # layered oxides lose about 1 V per unit of SOC, the plateau of another cell far less
        value = min(moved / swing, max(_LARGEST_GUESS_AH, moved))
        return Stated(value, value, f"{why}; assumed by how {how}")
    return Stated(one.rate_A, one.rate_A, f"{why}; the charge of its current in one hour is assumed")


def _in_words(charge_Ah: float) -> str:
    """Return a charge in the unit in which it is said."""
    for size, unit in ((1.0, "A h"), (1e-3, "mA h"), (1e-6, "µA h")):
        if charge_Ah >= size:
            return f"{charge_Ah / size:.3g} {unit}"
    return f"{charge_Ah:.3g} A h"


def full_discharges(count: Count) -> list[tuple[Count, float]]:
    """Return the charge between a full cell and the cut-off that follows, for each such pair."""
    result = []
    full, empty = np.flatnonzero(count.full), np.flatnonzero(count.empty)
    while full.size and empty.size:
        after = empty[empty > full[0]]
        if not after.size:
            break
        end = int(after[0])
        before = full[full < end]
        begin = int(before[np.argmin(count.out_Ah[before])])  # a small pulse from full leaves it near full
        # The cut-off may last for rows: the charge up to the deepest point before the next full row.
        following = full[full > end]
        stop = int(following[0]) if following.size else count.out_Ah.size
        deepest = float(count.out_Ah[end:stop].max())
        result.append((count, deepest - float(count.out_Ah[begin])))
        full, empty = following, empty[empty > stop]
    largest = max((amount for _, amount in result), default=0.0)
    return [(one, amount) for one, amount in result if amount > 0.5 * largest and amount > 0.0]


def rest_curve(
    found: Sequence[Count], starts: Sequence[Stated | None], capacity_Ah: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return SOC and voltage of a cell at rest or nearly so, from runs whose start is known; None with fewer than four.

    The points increase in both.
    """
    socs, volts = [], []
    for count, start in zip(found, starts, strict=True):
        if start is None or (start.sd or 0.0) > 0.05:
            continue
        current, voltage, time_s = count.run.columns["current_A"], count.run.columns["voltage_V"], count.run.time_s
        slow = np.abs(current) <= _SLOW * capacity_Ah
        moving = np.where(count.resting, 0, np.arange(current.size))
        since = time_s - time_s[np.maximum.accumulate(moving)]
        quiet = np.isfinite(voltage) & slow & ((since > _RESTED_S) | (np.nan_to_num(current) > 0.01 * capacity_Ah))
        # Before the full charge from which a start is counted back, an error of that count is in each point.
        full = np.flatnonzero(count.full)
        rows = np.flatnonzero(quiet)
        rows = rows[rows >= full[0]] if full.size else rows
        rows = rows[np.linspace(0, rows.size - 1, min(rows.size, 2000)).astype(int)] if rows.size else rows
        socs.append(start.value - count.out_Ah[rows] / capacity_Ah)
        volts.append(voltage[rows])
    if not socs:
        return None
    soc, volt = np.concatenate(socs), np.concatenate(volts)
    bins = np.round(soc * 40.0)
    points = [(float(np.median(soc[bins == one])), float(np.median(volt[bins == one]))) for one in np.unique(bins)]
    points = [(s, v) for s, v in points if -0.05 <= s <= 1.05]
    if len(points) < 4:
        return None
    soc, volt = np.array(points).T
    volt = np.maximum.accumulate(volt)
    keep = np.diff(volt, prepend=-np.inf) > 0.0
    return (soc[keep], volt[keep]) if keep.sum() >= 4 else None


def starts_of(found: Sequence[Count], capacity: Stated, known: bool) -> list[Stated]:
    """Return the state of charge at the first row of each run.

    Args:
        found: the charge of each run.
        capacity: of the cell [A h].
        known: whether the capacity comes from a full discharge or from the user.
    """
    counted = [_counted(count, capacity.value, known) for count in found]
    curve = rest_curve(found, counted, capacity.value)
    result = []
    for count, start in zip(found, counted, strict=True):
        logged = _logged(count)
        # A run that only reaches the cut-off knows its end less well than a rested voltage knows its start; one that
        # reaches a full charge knows that better.
        sure = start is not None and (count.full.any() or (start.sd or 0.0) <= 0.03)
        read = None if curve is None or sure else read_from_rest(count, *curve)
        empty = EMPTY if count.begins_empty and not sure else None
        options = [one for one in (start, read, empty) if one is not None]
        best = logged or min([*options, _UNKNOWN], key=lambda one: one.sd or 0.0)
        result.append(best)
    return result


_UNKNOWN = Stated(
    0.5,
    0.3,
    "unknown: no full charge, no cut-off, no voltage of a full cell and no rested voltage tells it; "
    "state --initial-soc",
)


EMPTY = Stated(0.03, 0.04, "empty: it rests at the voltage of an empty cell, near the cut-off of the files")


def _logged(count: Count) -> Stated | None:
    """Return the SOC that a log states of its first row; None where it states none, or always the same."""
    soc = count.run.columns.get("soc")
    there = np.flatnonzero(np.isfinite(soc)) if soc is not None else np.empty(0, dtype=int)
    if soc is None or not there.size or not 0.0 <= soc[there[0]] <= 1.0:
        return None
    still = float(np.ptp(soc[there])) == 0.0 and float(np.ptp(count.out_Ah)) > 0.0
    if still and soc[there[0]] in (0.0, 1.0):  # a column that nobody filled in
        return None
    return Stated(_within(float(soc[there[0]])), _LOGGED_SD, "the log states it")


def without_estimate(run: Log, options: Options) -> Log:
    """Return a run without the state of charge of its log, unless the user names its column.

    It was counted or estimated by another program, and is no reading that a model could be judged by. What it says of
    capacity and start is known by now.
    """
    if "soc" not in run.columns or options.columns.get("soc"):
        return run
    why = (
        "another program has computed it: it tells the charge at the start at most, and is no reading; "
        "name its column with --column soc= to compare it with the model"
    )
    kept = {name: values for name, values in run.columns.items() if name != "soc"}
    return dataclasses.replace(run, columns=kept).also(Decision("soc", run.name, "left out", why, "file"))


def against_the_log(found: Sequence[Count], starts: Sequence[Stated], capacity: Stated, known: bool) -> list[Finding]:
    """Return where the SOC that a log states and the one that its charge and voltage give are apart.

    Args:
        found: the charge of each run.
        starts: of each, as `starts_of` returns them.
        capacity: of the cell [A h].
        known: whether the capacity comes from a full discharge or from the user.
    """
    result = []
    for count, start in zip(found, starts, strict=True):
        other = _counted(count, capacity.value, known)
        if start.why != "the log states it" or other is None:
            continue
        apart = abs(start.value - other.value)
        if apart > 2.0 * float(np.hypot(start.sd or 0.0, other.sd or 0.0)) + _DISAGREES:
            name = count.run.name
            sentence = (
                f"{name}: the log states a state of charge of {start.value:.0%} at its first row, and it is "
                f"{other.value:.0%} ({other.why}); that of the log is taken. State the right one with --initial-soc."
            )
            result.append(Finding("initial SOC", name, sentence, "warning", "soc", numbers={"apart": apart}))
    return result


def _counted(count: Count, capacity_Ah: float, known: bool) -> Stated | None:
    """Return the start by the voltage of a full cell, or counted back from the nearest full or empty row."""
    full, empty = np.flatnonzero(count.full), np.flatnonzero(count.empty)
    if full.size and abs(count.out_Ah[full[0]]) < 0.005 * capacity_Ah:
        loaded = not count.resting[0]
        why = "full: it begins at the voltage of a full cell" + (", under load" if loaded else "")
        return Stated(1.0, _FULL_LOADED_SD if loaded else _FULL_SD, why)
    if count.below_full_V < _NEARLY_FULL_V:
        # Near full, layered oxides lose about 1 V per unit of SOC; so much a rest after the charge takes by itself.
        start = 1.0 - max(count.below_full_V - 0.5 * _FULL_V, 0.0)
        return Stated(_within(start), 0.05, "nearly full: by the voltage at which it rests, at 1 V per unit of SOC")
    passed = np.cumsum(np.abs(np.diff(count.out_Ah, prepend=0.0))) / capacity_Ah
    options = []
    if full.size:
        first = int(full[0])
        start = 1.0 + float(count.out_Ah[first]) / capacity_Ah
        sd = _FULL_SD + (0.05 if not known else 0.01) + 0.02 * float(passed[first])
        options.append(Stated(_within(start), sd, "counted back from the full charge within the run"))
    if empty.size and known:
        last = int(empty[-1] if not full.size else empty[empty < full[0]][-1] if (empty < full[0]).any() else -1)
        if last >= 0:
            start = float(count.out_Ah[last]) / capacity_Ah
            # The faster and the colder, the more is left in the cell at the cut-off.
            cold = 0.0 if count.ambient_degC is None else max(20.0 - count.ambient_degC, 0.0)
            sd = 0.04 + 0.05 * count.rate_A / capacity_Ah + 0.01 * cold
            options.append(Stated(_within(start + 0.3 * sd), sd, "counted back from the cut-off within the run"))
    return min(options, key=lambda one: one.sd or 0.0, default=None)


def read_from_rest(count: Count, soc: np.ndarray, volt: np.ndarray) -> Stated | None:
    """Return the SOC at which a cell rests at the first voltage of a run; the flatter the curve, the larger its sd."""
    voltage = count.run.columns["voltage_V"]
    there = np.flatnonzero(np.isfinite(voltage))
    if not there.size or not count.resting[there[0]]:
        return None
    first = float(voltage[there[0]])
    if soc[0] < 0.1 and 0.0 < first < volt[0]:  # below the lowest rest of an empty cell
        return Stated(_within(float(soc[0])), 0.03, "it begins below the voltage at which the empty cell rests")
    if not volt[0] - 0.05 <= first <= volt[-1] + 0.05:
        return None
    low, high = (float(np.interp(first + step, volt, soc)) for step in (-0.015, 0.015))
    start = _within(float(np.interp(first, volt, soc)))
    return Stated(
        start, 0.02 + 0.5 * (high - low), "read from the voltage at which it begins, by the rests of other runs"
    )


def _within(soc: float) -> float:
    return round(min(max(soc, 0.0), 1.0), 4)


def told(run: Log, start: Stated) -> Log:
    """Return a run with what is said about its start."""
    source = "assumed" if start.why.startswith(("unknown", "assumed")) else "user" if start.why == "stated" else "file"
    value = f"{start.value:g}" if start.sd is None else f"{start.value:g} ± {start.sd:.2g}"
    run = run.also(Decision("initial_soc", run.name, value, start.why, source))
    if start.why.startswith("unknown"):
        rests = not np.any(np.nan_to_num(run.columns.get("current_A", np.ones(1))))
        what = "no current flows in it, and its" if rests else "its"
        sentence = (
            f"{run.name}: {what} state of charge at the start is unknown; {value} is written. "
            "State it with --initial-soc."
        )
        run = run.also(Finding("initial SOC", run.name, sentence, "warning", "soc"))
    return run
