"""The sign of the current by physics: a cell's voltage falls when a discharge begins, and as charge leaves it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log

# A step of the current is at least so large a share of the largest current, and rows are at most so far apart [s].
_STEP, _NEAR_S = 0.1, 120.0
# Evidence in favour of one sign over the other, as a ratio of votes, from which it counts as settled.
_SETTLED, _CERTAIN = 3.0, 20.0
# Share of the product of voltage and speed or current that is negative on the whole, from which signs are doubted.
_OPPOSITE = 0.3


class Evidence(NamedTuple):
    """What readings say about the sign; positive numbers are for "positive on discharge".

    Attributes:
        steps: number of steps of the current seen in the voltage.
        agreeing: of those, how many fit "positive on discharge".
        resistance_ohm: median of -dV/dI over the steps; NaN without steps.
        trend: correlation of the voltage with the charge taken out, negated; 0 if there is none.
    """

    steps: int
    agreeing: int
    resistance_ohm: float
    trend: float

    @property
    def odds(self) -> float:
        """Return how much more the readings speak for "positive on discharge": above 1 for it, below 1 against."""
        votes = (self.agreeing + 1.0) / (self.steps - self.agreeing + 1.0)
        return votes * 10.0 ** (2.0 * self.trend)

    def sentence(self) -> str:
        """Return the evidence in words, for the sign that it speaks for."""
        discharge = self.odds >= 1.0
        said = []
        if self.steps:
            fit = self.agreeing if discharge else self.steps - self.agreeing
            resistance = f" (median {1e3 * abs(self.resistance_ohm):.3g} mohm)"
            said.append(
                f"in {fit:,} of {self.steps:,} steps of the current the voltage moves as it then must{resistance}"
            )
        if abs(self.trend) > 0.2:
            said.append("the voltage falls as charge leaves the cell")
        return " and ".join(said) or "no step of the current shows in the voltage"


def evidence(log: Log) -> Evidence:
    """Return what a log of a cell says about the sign of its current."""
    current, voltage = log.columns["current_A"], log.columns.get("voltage_V")
    if voltage is None:
        return Evidence(0, 0, np.nan, 0.0)
    there = np.isfinite(current) & np.isfinite(voltage)
    time_s, current, voltage = log.time_s[there], current[there], voltage[there]
    if current.size < 3:
        return Evidence(0, 0, np.nan, 0.0)
    largest = float(np.quantile(np.abs(current[:: max(current.size // 1_000_000, 1)]), 0.99)) or float(
        np.abs(current).max()
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        change, moved, apart = np.diff(current), np.diff(voltage), np.diff(time_s)
        steps = (np.abs(change) > _STEP * largest) & (apart > 0.0) & (apart <= _NEAR_S) & (np.abs(moved) > 1e-4)
        resistance = -moved[steps] / change[steps]
    agreeing = int(np.sum(resistance > 0.0))
    median = float(np.median(resistance)) if resistance.size else np.nan
    return Evidence(int(steps.sum()), agreeing, median, _trend(time_s, current, voltage, largest))


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
    return Evidence(steps, agreeing, resistance, float(np.mean(trends)) if trends else 0.0)


def with_state(log: Log) -> Log:
    """Return a log whose unsigned current has the sign of its state column: positive on discharge."""
    current, state = log.columns.get("current_A"), log.marks.get("state")
    if current is None or state is None or np.nanmin(current) < -0.01 * np.nanmax(np.abs(current)):
        return log
    if not (np.any(state > 0.0) and np.any((state > 0.0) & (current > 0.0))):
        return log
    signed = np.where(state > 0.0, -current, current)
    why = "the current has no sign in the file, and its state column tells charge from discharge"
    decision = Decision("sign of the current", log.name, "positive on discharge, by state", why, "file")
    return dataclasses.replace(log, columns=log.columns | {"current_A": signed}).also(decision)


def settle(logs: Sequence[Log], stated: str | None, accept: bool) -> list[Log]:
    """Return logs of a cell whose current is positive on discharge.

    Args:
        logs: of one cell, all written by the same bench.
        stated: "discharge-positive" or "charge-positive", if the user states it.
        accept: whether the sign of the file is kept where nothing settles it.

    Raises:
        MeasurementError: the readings do not tell, and the user does not.
    """
    logs = [with_state(log) for log in logs]
    found = [evidence(log) if "current_A" in log.columns else Evidence(0, 0, np.nan, 0.0) for log in logs]
    all_of_them = pooled(found)
    fixed = [d.why for log in logs for d in log.decisions if d.about == "convention" and d.value == "charge"]
    odds, why = all_of_them.odds, all_of_them.sentence()
    if stated is not None:
        discharge, source, said = stated == "discharge-positive", "user", "stated"
    elif max(odds, 1.0 / odds) >= _SETTLED:
        discharge, source, said = odds >= 1.0, "physics", f"{_surely(odds)}: {why}"
    elif fixed:
        discharge, source, said = False, "file", fixed[0]
    elif accept or not any(np.any(log.columns.get("current_A", np.zeros(1)) != 0.0) for log in logs):
        discharge, source, said = True, "assumed", "the readings do not tell"
    else:
        raise MeasurementError(
            f"{', '.join(file_label(log.source) for log in logs[:3])}: the sign of the current is not settled: {why}; "
            "state --sign discharge-positive or --sign charge-positive."
        )
    value = "positive on discharge" if discharge else "positive on charge in the files, reversed"
    result = []
    for log, own in zip(logs, found, strict=True):
        log = log.also(Decision("sign of the current", log.name, value, said, source))
        if not discharge and "current_A" in log.columns:
            log = dataclasses.replace(log, columns=log.columns | {"current_A": -log.columns["current_A"]})
        against = own.odds if discharge else 1.0 / own.odds
        if against < 1.0 / _SETTLED:
            log = log.also(_against(log, own, against))
        result.append(log)
    return result


def _surely(odds: float) -> str:
    return "certain" if max(odds, 1.0 / odds) >= _CERTAIN else "likely"


def _against(log: Log, own: Evidence, odds: float) -> Finding:
    sentence = (
        f"{log.name}: by itself it speaks for the other sign of the current ({own.steps - own.agreeing:,} "
        f"of {own.steps:,} "
        "steps against positive on discharge); look at it, and import it apart with --sign if its bench "
        "writes otherwise."
    )
    return Finding("sign", log.name, sentence, "warning", "current_A", numbers={"odds": odds})


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
