"""Under which condition each run was measured."""

from __future__ import annotations

import dataclasses
import fnmatch
import re
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.base.errors import MeasurementError, listed
from jaxmodel.base.units import unit_of
from jaxmodel.case.measurements import file_label
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log

# An ambient temperature that moves by more [K] is no condition.
_CHANGING_K = 8.0
_CONSTANT = 0.7  # share of loaded rows near the middle current, from which a run has one constant current
_OF_LEVELS = 0.8
_SLOW_S = 8.0 * 3600.0  # of one constant current, from which it shows the open-circuit voltage. Assumed: C/8.
_STRAIGHT = 0.995  # correlation of load and time from which a run is a ramp
_SPECIMEN = re.compile(
    r"(?<![a-z])(cell|specimen|sample|battery|b|s|motor|module)[_ -]?(\d{1,4})(?![a-z0-9])", re.IGNORECASE
)


@dataclasses.dataclass(frozen=True)
class Condition:
    """How a run was measured.

    Attributes:
        ambient_degC: of its first row; None where nothing tells.
        profile: "constant current", "constant voltage", "ramp", "pulses", "dynamic" or "rest".
        rate: typical load: the median of the loaded currents [A]; of a motor the voltage [V], of a robot the duty where
            no current was measured.
        direction: "discharge" or "charge" of a cell, "forward" or "reverse" of a motor; "" for both.
        changing: whether the ambient temperature changes in the run.
        unit: of the rate.
        slow: one constant current for so long that it shows the open-circuit voltage of a cell.
        cycles: that the cell had done; None where nothing tells, or where it did not age.
    """

    ambient_degC: float | None
    profile: str
    rate: float
    direction: str
    changing: bool = False
    unit: str = "A"
    slow: bool = False
    cycles: float | None = None

    def words(self, capacity_Ah: float | None = None) -> str:
        """Return the condition for a label: '25 degC, constant current, 1C discharge'."""
        parts = [] if self.ambient_degC is None else [f"{self.ambient_degC:.3g} degC"]
        parts.append(self.profile)
        if self.rate and capacity_Ah:
            parts.append(f"{_of_capacity(self.rate / capacity_Ah)} {self.direction}".rstrip())
        elif self.rate:
            parts.append(f"{self.rate:.3g} {self.unit}".rstrip())
        if self.cycles is not None:
            parts.append(f"cycle {self.cycles:g}")
        return ", ".join(parts)


def _of_capacity(rate: float) -> str:
    return f"{rate:.2g}C" if rate >= 0.2 else f"C/{1.0 / rate:.0f}"


def condition_of(run: Log, ambient: float | None) -> Condition:
    """Return the condition of a run, whose constant ambient temperature is given where it has no column."""
    column = run.columns.get("ambient_degC")
    warmth = float(np.nanmedian(column)) if column is not None else ambient
    changing = column is not None and float(np.ptp(column[np.isfinite(column)])) > _CHANGING_K
    # A cell is driven by its current and a motor, which may have a load, by its voltage.
    drives = ("voltage_V",) * ("load_torque_Nm" in run.columns) + ("current_A", "pack_current_A", "motor_current_A")
    name = next((n for n in (*drives, "voltage_V", "duty") if n in run.columns), None)
    if name is None:
        return Condition(warmth, "dynamic", 0.0, "", changing)
    load = run.columns[name]
    there = np.isfinite(load)
    if not there.any() or not np.any(load[there]):
        return Condition(warmth, "rest", 0.0, "", changing)
    # By time and not by row, as a thinned log has few rows where little happens.
    weight = np.diff(run.time_s, prepend=run.time_s[0])
    weight = np.minimum(weight, 100.0 * float(np.median(weight)))
    largest = float(np.quantile(np.abs(load[there]), 0.995))
    loaded = there & (np.abs(load) > 0.05 * largest)
    if not loaded.any():
        return Condition(warmth, "rest", 0.0, "", changing)
    middle = float(np.median(np.abs(load[loaded])))
    near = float(weight[loaded & (np.abs(np.abs(load) - middle) < 0.1 * middle)].sum()) / max(
        float(weight[loaded].sum()), 1e-12
    )
    rests = int(np.sum(np.diff(loaded.astype(np.int8)) == 1))
    profile = "dynamic"
    if near > _CONSTANT and rests <= 3:
        profile = "constant current" if name.endswith("_A") else "constant voltage"
    elif rests <= 1 and loaded.sum() > 2 and abs(np.corrcoef(run.time_s[loaded], load[loaded])[0, 1]) > _STRAIGHT:
        profile = "ramp"
    elif rests > 3 and _share_of_levels(load[loaded], weight[loaded], largest) > _OF_LEVELS:
        profile = "pulses"
    below, above = float(np.sum(load[loaded] < 0.0)), float(np.sum(load[loaded] > 0.0))
    turns = "speed_rad_s" in run.columns or not name.endswith("_A")
    ways = ("reverse", "forward") if turns else ("charge", "discharge")
    direction = "" if min(below, above) > 0.05 * (below + above) else ways[above > below]
    slow = profile == "constant current" and float(weight[loaded].sum()) > _SLOW_S
    return Condition(warmth, profile, middle, direction, changing, unit_of(name), slow)


def _share_of_levels(load: np.ndarray, weight: np.ndarray, largest: float) -> float:
    """Return the share of the loaded time that is spent at the six commonest levels of load."""
    _, level = np.unique(np.round(load / (0.02 * largest)), return_inverse=True)
    times = np.sort(np.bincount(level, weights=weight))[::-1]
    return float(times[:6].sum() / max(times.sum(), 1e-12))


def with_specimens(logs: Sequence[Log], stated: Mapping[str, str]) -> list[Log]:
    """Return logs with the motor or cell that each is of, as the user states it.

    Args:
        logs: of files.
        stated: by name of a specimen, a pattern of file names.

    Raises:
        MeasurementError: a file is of none or of two of them, or a pattern is of no file.
    """
    if not stated:
        return list(logs)
    for name, pattern in stated.items():
        if not any(is_meant(log, pattern) for log in logs):
            files = listed(dict.fromkeys(log.source.name for log in logs), 6)
            raise MeasurementError(
                f"specimen: no file is called '{pattern}'; correct the pattern of {name}. The files are {files}."
            )
    found = []
    for log in logs:
        mine = [name for name, pattern in stated.items() if is_meant(log, pattern)]
        if log.specimen:
            raise MeasurementError(
                f"{file_label(log.source)}: specimen: the file is of several motors by itself; choose one of them with "
                f"--motor, as --motor {log.specimen}, or leave --specimen out."
            )
        if len(mine) != 1:
            raise MeasurementError(
                f"{file_label(log.source)}: specimen: the file is of {' and '.join(mine) or 'none of them'}; state "
                "--specimen so that each is of one."
            )
        decision = Decision("specimen", log.name, mine[0], "stated", "user")
        found.append(dataclasses.replace(log, specimen=mine[0]).also(decision))
    return found


def ambients_of(logs: Sequence[Log], stated: Mapping[str, float]) -> list[float | None]:
    """Return the ambient temperature [degC] that the user states of each run; None where no pattern is its name.

    Args:
        logs: of the runs.
        stated: by pattern of the files.

    Raises:
        MeasurementError: a pattern is of no file, or a file is of two.
    """
    for pattern in stated:
        if not any(is_meant(log, pattern) for log in logs):
            files = listed(dict.fromkeys(log.source.name for log in logs), 6)
            raise MeasurementError(
                f"ambient: no file is called '{pattern}'; correct the pattern. The files are {files}."
            )
    found: list[float | None] = []
    for log in logs:
        mine = {pattern: value for pattern, value in stated.items() if is_meant(log, pattern)}
        if len(set(mine.values())) > 1:
            said = " and ".join(f"{pattern}={value:g}" for pattern, value in mine.items())
            raise MeasurementError(f"{file_label(log.source)}: ambient: it is of {said}; keep one of them.")
        found.append(next(iter(mine.values()), None))
    return found


def is_meant(log: Log, pattern: str) -> bool:
    """Return True if a pattern is the name of a run or of its file."""
    return any(fnmatch.fnmatchcase(name, pattern) for name in (log.name, log.source.stem, log.source.name))


def specimens(runs: Sequence[Log]) -> Finding | None:
    """Return what names of files say of several pieces of hardware, which a case does not hold."""
    found: dict[str, list[str]] = {}
    for run in runs:
        if match := _SPECIMEN.search(run.source.stem):
            found.setdefault(f"{match[1]}{match[2]}".lower(), []).append(run.name)
    if len(found) < 2 or sum(map(len, found.values())) < len(runs):
        return None
    some = ", ".join(sorted(found))
    sentence = (
        f"The file names point to {len(found)} pieces of hardware ({some}), and the runs of a case are taken to be of "
        'one: state each with --specimen NAME="PATTERN" to have them compared, or import each of them separately.'
    )
    return Finding("several specimens", "", sentence, "warning")
