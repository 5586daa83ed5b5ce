"""The sign of the current by physics: a cell's voltage falls when a discharge begins, and as charge leaves it."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log

# A step of the current is at least so large a share of the largest current, and rows are at most so far apart [s].
_STEP, _NEAR_S = 0.1, 120.0
# Evidence in favour of one sign over the other, as a ratio of votes, from which it counts as settled.
_SETTLED, _CERTAIN = 3.0, 20.0
_FEWEST_STEPS = 3
# Below this share of the largest current a cell rests, and below this one a number has no sign (an offset).
_REST, _NO_SIGN = 0.02, 0.01
# A step of the voltage by so much [V] is no noise of a tester (assumed).
_CLEAR_STEP_V = 0.01
# A block of load whose voltage moves by so much [V] tells its direction.
_CLEAR_V = 4e-3
# A single reading so far from both neighbours [V] is none of a cell's.
_SPIKE_V = 0.5
# A state column counts where it names the direction in so large a share of the loaded rows.
_TOLD_BY_STATE = 0.5
_ABOUT = "sign of the current"
_VALUES = {True: "positive on discharge", False: "positive on charge in the files, reversed"}
# Share of the product of voltage and speed or current that is negative on the whole, from which signs are doubted.
_OPPOSITE = 0.3


class Evidence(NamedTuple):
    """What readings say about the sign; positive numbers are for "positive on discharge".

    Attributes:
        steps: number of steps of the current seen in the voltage.
        agreeing: of those, how many fit "positive on discharge".
        resistance_ohm: median of -dV/dI over the steps; NaN without steps.
        trend: correlation of the voltage with the charge taken out, negated; 0 if there is none.
        clear: of the steps, how many move the voltage so far that no noise does; where they are few, each counts twice.
    """

    steps: int
    agreeing: int
    resistance_ohm: float
    trend: float
    clear: int = 0

    @property
    def strength(self) -> float:
        """Return how much the readings speak for one of the two signs, at least 1."""
        return max(self.odds, 1.0 / self.odds)

    @property
    def odds(self) -> float:
        """Return how much more the readings speak for "positive on discharge": above 1 for it, below 1 against."""
        weight = 2.0 if self.clear == self.steps < _FEWEST_STEPS else 1.0
        votes = (weight * self.agreeing + 1.0) / (weight * (self.steps - self.agreeing) + 1.0)
        return votes * 10.0 ** (2.0 * self.trend)

    def sentence(self) -> str:
        """Return the evidence in words, for the sign that it speaks for."""
        discharge = self.odds >= 1.0
        said = []
        if self.steps:
            fit = self.agreeing if discharge else self.steps - self.agreeing
            resistance = f" (median {1e3 * abs(self.resistance_ohm):.3g} mohm)"
            said.append(
                f"at {fit:,} of {self.steps:,} steps of the current the voltage moves as this sign demands{resistance}"
            )
        if abs(self.trend) > 0.2:
            said.append("the voltage falls as charge leaves the cell")
        return " and ".join(said) or "no step of the current shows in the voltage"


_NOTHING = Evidence(0, 0, np.nan, 0.0)


def evidence(log: Log) -> Evidence:
    """Return what a log of a cell says about the sign of its current."""
    current, voltage = log.columns["current_A"], log.columns.get("voltage_V")
    if voltage is None:
        return _NOTHING
    there = np.isfinite(current) & np.isfinite(voltage)
    time_s, current, voltage = log.time_s[there], current[there], voltage[there]
    if current.size < 3:
        return _NOTHING
    largest = float(np.quantile(np.abs(current[:: max(current.size // 1_000_000, 1)]), 0.99)) or float(
        np.abs(current).max()
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        change, moved, apart = np.diff(current), np.diff(voltage), np.diff(time_s)
        steps = (np.abs(change) > _STEP * largest) & (apart > 0.0) & (apart <= _NEAR_S) & (np.abs(moved) > 1e-4)
        resistance = -moved[steps] / change[steps]
    agreeing = int(np.sum(resistance > 0.0))
    median = float(np.median(resistance)) if resistance.size else np.nan
    clear = int(np.sum(np.abs(moved[steps]) >= _CLEAR_STEP_V))
    return Evidence(int(steps.sum()), agreeing, median, _trend(time_s, current, voltage, largest), clear)


def _trend(time_s: np.ndarray, current: np.ndarray, voltage: np.ndarray, largest: float) -> float:
    """Return the negated correlation of voltage and charge taken out; long gaps in the clock count nothing."""
    if largest == 0.0:
        return 0.0
    interval = np.diff(time_s, prepend=time_s[0])
    interval = np.where((interval >= 0.0) & (interval < 3600.0 * 6.0), interval, 0.0)
    charge = np.cumsum(current * interval)
    if np.ptp(charge) < 1e-3 * largest * max(float(time_s[-1] - time_s[0]), 1.0) or np.ptp(voltage) < 0.05:
        return 0.0
    found = np.corrcoef(charge, voltage)[0, 1]
    return float(-found) if np.isfinite(found) else 0.0


def pooled(parts: Sequence[Evidence]) -> Evidence:
    """Return the evidence of several logs together."""
    steps, agreeing = sum(one.steps for one in parts), sum(one.agreeing for one in parts)
    with_steps = [one for one in parts if one.steps]
    resistance = float(np.median([one.resistance_ohm for one in with_steps])) if with_steps else np.nan
    trends = [one.trend for one in parts if one.trend != 0.0]
    clear = sum(one.clear for one in parts)
    return Evidence(steps, agreeing, resistance, float(np.mean(trends)) if trends else 0.0, clear)


def with_state(log: Log) -> Log:
    """Return a log whose current has the sign of its state column, or of its counts of charge."""
    for key, what in (("state", "its state column"), ("counted", "its count of charge")):
        if key in log.marks and not _settled(log):
            log = _with_state(log, log.marks[key], what)
    return log


def _with_state(log: Log, state: np.ndarray, what: str) -> Log:
    current = log.columns["current_A"]
    loaded = np.nan_to_num(np.abs(current)) > _REST * _largest(current)
    charge, discharge = loaded & (state > 0.0), loaded & (state < 0.0)
    if not (charge.any() or discharge.any()) or np.mean((charge | discharge)[loaded]) < _TOLD_BY_STATE:
        return log
    if _of_one_sign(current):
        size = np.abs(current)
        # Where the state tells no direction, as in a step of constant voltage, the file's own number stays. The small
        # current at the end of a charge has its state too.
        signed = np.where(state > 0.0, -size, np.where(state < 0.0, size, current))
        value, why = "positive on discharge, by state", f"the current has no sign in the file, and {what} tells it"
    else:
        against = int(np.sum(current[discharge] < 0.0) + np.sum(current[charge] > 0.0))
        reverse = 2 * against > int(np.sum(charge | discharge))
        signed = -current if reverse else current
        value, why = _VALUES[not reverse], f"{what} tells charge from discharge"
    decision = Decision(_ABOUT, log.name, value, why, "file")
    return dataclasses.replace(log, columns=log.columns | {"current_A": signed}).also(decision)


def _largest(current: np.ndarray) -> float:
    return float(np.nanmax(np.abs(current))) if np.isfinite(current).any() else 0.0


def _of_one_sign(current: np.ndarray) -> bool:
    """Return whether a current never changes its sign: a discharge, a charge, or magnitudes of both."""
    there, noise = current[np.isfinite(current)], _NO_SIGN * _largest(current)
    return bool(there.size and (there.min() >= -noise or there.max() <= noise))


def blocks(log: Log) -> list[tuple[slice, float]]:
    """Return the blocks of load between rests or steps, each with what its voltage says in V.

    Where a block discharges, the voltage falls at its begin, on its way, and rises at its end: the sum is positive; in
    a charge it is negative.
    """
    current, voltage = log.columns["current_A"], log.columns.get("voltage_V")
    if voltage is None:
        return []
    there = np.flatnonzero(np.isfinite(current) & np.isfinite(voltage))
    size, volts, time_s = np.abs(current[there]), _without_spikes(voltage[there]), log.time_s[there]
    loaded = size > _REST * _largest(current)
    changes = np.diff(loaded.astype(np.int8)) != 0
    for key in ("step", "cycle"):
        if key in log.marks:
            changes |= np.diff(np.nan_to_num(log.marks[key][there])) != 0.0
    edges = [0, *(np.flatnonzero(changes) + 1).tolist(), there.size]
    result = []
    for begin, end in itertools.pairwise(edges):
        if begin == end or not loaded[begin]:
            continue
        said = float(volts[begin] - volts[end - 1])
        if begin and not loaded[begin - 1] and time_s[begin] - time_s[begin - 1] <= _NEAR_S:
            said += float(volts[begin - 1] - volts[begin])
        if end < there.size and not loaded[end] and time_s[end] - time_s[end - 1] <= _NEAR_S:
            said += float(volts[end] - volts[end - 1])
        result.append((slice(int(there[begin]), int(there[end - 1]) + 1), said))
    return result


def _without_spikes(volts: np.ndarray) -> np.ndarray:
    """Return voltages in which a reading far from both neighbours, as a first row of 0 V, is that of its neighbours."""
    if volts.size < 3:
        return volts
    places = np.clip(np.arange(volts.size), 1, volts.size - 2)
    middle = np.median([volts[places - 1], volts[places], volts[places + 1]], axis=0)
    return np.where(np.abs(volts - middle) > _SPIKE_V, middle, volts)


def _with_blocks(log: Log) -> Log:
    """Return a log of magnitudes with the sign of each block by its voltage; as it is if all are of one sort."""
    current = log.columns["current_A"]
    if not _of_one_sign(current):
        return log
    found = blocks(log)
    discharges = [said for _, said in found if said > _CLEAR_V]
    charges = [said for _, said in found if said < -_CLEAR_V]
    if not discharges or not charges:
        return log
    signed, last, unclear = np.abs(current), 1.0, 0
    for rows, said in found:
        clear = abs(said) > _CLEAR_V
        unclear += not clear
        last = float(np.sign(said)) if clear else last
        signed[rows] *= last
    value = "magnitudes in the file; charge made negative, block by block"
    why = (
        f"{len(discharges)} {'block' if len(discharges) == 1 else 'blocks'} of discharge and {len(charges)} of charge "
        "between rests, by the way in which the voltage moves"
    )
    why += f"; {unclear} too small to tell, taken as the block before" if unclear else ""
    log = dataclasses.replace(log, columns=log.columns | {"current_A": signed})
    return log.also(Decision(_ABOUT, log.name, value, why, "physics"))


def _by_looks(log: Log) -> bool:
    """Return whether nothing but their looks tells which columns are current and voltage: then steps must agree."""
    looks = {finding.column for finding in log.findings if finding.what == "column by its looks"}
    return {"current_A", "voltage_V"} <= looks


def _settled(log: Log) -> bool:
    return any(decision.about == _ABOUT for decision in log.decisions)


def settle(logs: Sequence[Log], stated: str | None, accept: bool) -> list[Log]:
    """Return logs of a cell whose current is positive on discharge.

    Each file that can decides for itself: by a column of states, as magnitudes whose blocks charge and discharge, or by
    its steps and its charge. The others follow all of them together.

    Args:
        logs: of one cell, each with a current.
        stated: "discharge-positive" or "charge-positive", if the user states it.
        accept: whether the sign of the file is kept where nothing settles it.

    Raises:
        MeasurementError: the readings do not tell, and the user does not.
    """
    logs = [with_state(log) for log in logs]
    if stated is None:
        logs = [log if _settled(log) or _by_looks(log) else _with_blocks(log) for log in logs]
    free = [log for log in logs if not _settled(log)]
    found = {id(log): evidence(log) for log in free}
    # What one-signed files say of themselves says nothing of the bench: it may log magnitudes.
    signed = [log for log in free if not _of_one_sign(log.columns["current_A"])]
    all_of_them = pooled([found[id(log)] for log in signed or free])
    fixed = [(d.value == "discharge", d.why) for log in free for d in log.decisions if d.about == "convention"]
    result = []
    for log in logs:
        if _settled(log):
            result.append(log)
            continue
        own = found[id(log)]
        discharge, source, why = _decided(log, own, all_of_them, fixed, stated, accept)
        current = log.columns["current_A"]
        if not discharge:
            log = dataclasses.replace(log, columns=log.columns | {"current_A": -current})
        charge_alone = not discharge and stated is None and bool(np.nanmin(current) >= 0.0)
        value = "a charge, positive in the file, reversed" if charge_alone else _VALUES[discharge]
        log = log.also(Decision(_ABOUT, log.name, value, why, source))
        against = own.odds if discharge else 1.0 / own.odds
        others = all_of_them.odds if discharge else 1.0 / all_of_them.odds
        if against < 1.0 / _SETTLED:
            log = log.also(_against(log, own, against))
        elif stated is None and others < 1.0 / _SETTLED and not _of_one_sign(current):
            log = log.also(_unlike_others(log, others))
        result.append(log)
    return result


def _decided(
    log: Log,
    own: Evidence,
    together: Evidence,
    fixed: Sequence[tuple[bool, str]],
    stated: str | None,
    accept: bool,
) -> tuple[bool, Literal["user", "physics", "file", "assumed"], str]:
    """Return whether the current of a file is positive on discharge, who says so, and why."""
    if stated is not None:
        return stated == "discharge-positive", "user", "stated"
    if not np.any(np.nan_to_num(log.columns["current_A"])):
        return True, "assumed", "no current flows in it"
    first = [(own, "")] if own.strength >= _CERTAIN else []
    for found, where in [*first, (together, "" if together == own else "in all files together, "), (own, "")]:
        if found.strength >= _SETTLED:
            return found.odds >= 1.0, "physics", f"{_surely(found)}: {where}{found.sentence()}"
    if fixed:
        discharge, why = fixed[0]
        return discharge, "file", why
    if accept:
        return True, "assumed", "the readings do not tell"
    raise MeasurementError(
        f"{file_label(log.source)}: the sign of the current is not settled: {own.sentence()}; "
        "state --sign discharge-positive or --sign charge-positive."
    )


def _surely(found: Evidence) -> str:
    """Return "certain" where steps of the current show it, nearly all of them in one way."""
    steps = max(found.agreeing, found.steps - found.agreeing) >= max(_FEWEST_STEPS, 0.9 * found.steps)
    return "certain" if steps and found.strength >= _CERTAIN else "likely"


def _against(log: Log, own: Evidence, odds: float) -> Finding:
    sentence = (
        f"{log.name}: by itself it speaks for the other sign of the current ({own.steps - own.agreeing:,} "
        f"of {own.steps:,} "
        "steps against positive on discharge); look at it, and import it separately with --sign if its bench "
        "writes otherwise."
    )
    return Finding("sign", log.name, sentence, "warning", "current_A", numbers={"odds": odds})


def _unlike_others(log: Log, odds: float) -> Finding:
    sentence = (
        f"{log.name}: its current has the other sign than in the other files, by its own voltage, and was turned "
        "alone; look at it, or state --sign for all."
    )
    return Finding("sign", log.name, sentence, "warning", "current_A", numbers={"odds": odds})


def robot_signs(log: Log) -> Log:
    """Return a robot's log whose pack current is positive on discharge where its format fixes it the other way.

    A robot uses more charge than it recovers: what was written otherwise than its format has it is kept, and a current
    that is negative on the whole is doubted.
    """
    name, current = "pack_current_A", log.columns.get("pack_current_A")
    if current is None:
        return log
    of_charge = any(d.about == "convention" and d.value == "charge" for d in log.decisions)
    net, gross = float(np.nansum(current)), float(np.nansum(np.abs(current)))
    if of_charge and net <= 0.0:
        log = dataclasses.replace(log, columns=log.columns | {name: -current})
        return log.also(
            Decision(f"sign of {name}", log.name, "reversed", "its format has it positive on charge", "file")
        )
    if of_charge:
        sentence = (
            f"{log.name}: its format has a current that is positive on charge, and {name} is positive on the whole, as "
            f"of a robot that discharges; it is kept. Reverse it with --flip {name} if the robot was charged."
        )
        return log.also(Finding("sign", log.name, sentence, "warning", name))
    if net < -_OPPOSITE * gross:
        sentence = (
            f"{log.name}: {name} is negative on the whole, and a robot that drives discharges its pack; reverse it "
            f"with --flip {name}, unless the robot was charged."
        )
        return log.also(Finding("sign", log.name, sentence, "warning", name))
    return log


def motor_signs(log: Log) -> Log:
    """Return a motor's log with what power says: a driven motor takes current of the sign of its voltage."""
    voltage, current, speed = (log.columns.get(name) for name in ("voltage_V", "current_A", "speed_rad_s"))
    found = []
    for name, one, other in (("current_A", voltage, current), ("speed_rad_s", voltage, speed)):
        if one is None or other is None:
            continue
        product = one * other
        product = product[np.isfinite(product)]
        if product.size and float(np.sum(product)) < -_OPPOSITE * float(np.sum(np.abs(product))):
            sentence = (
                f"{log.name}: voltage_V and {name} have opposite signs on the average, and a motor that is "
                "driven has the same; "
                f"reverse one with --flip {name}, unless it was braking."
            )
            found.append(Finding("sign", log.name, sentence, "warning", name))
    return log.also(*found)
