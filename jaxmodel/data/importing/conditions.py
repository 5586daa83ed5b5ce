"""Under which condition each run was measured, and a proposal that holds out a whole condition."""

from __future__ import annotations

import dataclasses
import fnmatch
import re
from collections.abc import Sequence

import numpy as np

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.units import unit_of
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log

# Ambient temperatures within so much [K] are one condition, and currents within this factor.
_SAME_K, _SAME_RATE, _CHANGING_K = 4.0, 1.25, 8.0
_CONSTANT = 0.7  # share of loaded rows near the middle current, from which a run has one constant current
_OF_LEVELS = 0.8
_SPECIMEN = re.compile(
    r"(?<![a-z])(cell|specimen|sample|battery|b|s|motor|module)[_ -]?(\d{1,4})(?![a-z0-9])", re.IGNORECASE
)


@dataclasses.dataclass(frozen=True)
class Condition:
    """How a run was measured.

    Attributes:
        ambient_degC: of its first row; None where nothing tells.
        profile: "constant current", "pulses", "dynamic" or "rest".
        rate: typical load: the median of the loaded currents [A]; of a motor the voltage [V], of a robot the duty where
            no current was measured.
        direction: "discharge", "charge", or "" for both.
        changing: whether the ambient temperature changes in the run.
        unit: of the rate.
    """

    ambient_degC: float | None
    profile: str
    rate: float
    direction: str
    changing: bool = False
    unit: str = "A"

    def words(self, capacity_Ah: float | None = None) -> str:
        """Return the condition for a label: '25 degC, constant current, 1C discharge'."""
        parts = [] if self.ambient_degC is None else [f"{self.ambient_degC:.3g} degC"]
        parts.append(self.profile)
        if self.rate and capacity_Ah:
            parts.append(f"{_of_capacity(self.rate / capacity_Ah)} {self.direction}".rstrip())
        elif self.rate:
            parts.append(f"{self.rate:.3g} {self.unit}".rstrip())
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
    elif rests > 3 and _share_of_levels(load[loaded], weight[loaded], largest) > _OF_LEVELS:
        profile = "pulses"
    charge, discharge = float(np.sum(load[loaded] < 0.0)), float(np.sum(load[loaded] > 0.0))
    mixed = min(charge, discharge) > 0.05 * (charge + discharge)
    direction = "" if not name.endswith("_A") or mixed else "charge" if charge > discharge else "discharge"
    return Condition(warmth, profile, middle, direction, changing, unit_of(name))


def _share_of_levels(load: np.ndarray, weight: np.ndarray, largest: float) -> float:
    """Return the share of the loaded time that is spent at the six commonest levels of load."""
    levels = np.round(load / (0.02 * largest)).astype(int)
    times = np.sort(np.bincount(levels - levels.min(), weights=weight))[::-1]
    return float(times[:6].sum() / max(times.sum(), 1e-12))


def splits_of(
    runs: Sequence[Log], conditions: Sequence[Condition], stated: Sequence[str] | None
) -> tuple[list[str], list[Finding | Decision]]:  # fmt: skip
    """Return "fit" or "check" for each run, and why.

    Args:
        runs: in their order.
        conditions: of each.
        stated: names of the check runs, if the user states them; a pattern such as `*_n20degC` names several.

    Raises:
        MeasurementError: a name is of no run, or no run would be left to fit.
    """
    names = [run.name for run in runs]
    if stated is not None:
        check = _named(names, stated)
        splits = ["check" if name in check else "fit" for name in names]
        return splits, [Decision("check runs", "", _some(sorted(check)) or "none", "stated", "user")]
    if len(runs) < 2:
        sentence = "There is one run only, so none is held out; --split-at rests, or a further file, gives a check run."
        return ["fit"] * len(runs), [Finding("no check run", "", sentence, "warning")]
    what, groups = _groups(runs, conditions)
    levels = sorted(groups)
    if len(levels) < 2:
        splits = ["fit"] * (len(runs) - 1) + ["check"]
        sentence = (
            "All runs were measured under one condition; the last one is held out, which shows less "
            "than another condition would."
        )
        return splits, [
            Decision("check runs", "", names[-1], "the last run", "assumed"),
            Finding("no check condition", "", sentence, "warning"),
        ]
    # Between other conditions where there are three: that is what a model is asked for first.
    inner = levels[1:-1] or levels[::-1]
    held = min(inner, key=lambda level: len(groups[level]))
    splits = ["check" if number in groups[held] else "fit" for number in range(len(runs))]
    between = "which lies between others" if len(levels) > 2 else "one of two"
    why = f"all of {what} {_level(held)}, {between}; hold out another with --check"
    chosen = _some([names[number] for number in groups[held]])
    return splits, [Decision("check runs", "", chosen, why, "assumed")]


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _level(level: float | str) -> str:
    return level if isinstance(level, str) else f"{level:.3g}"


def _named(names: Sequence[str], stated: Sequence[str]) -> set[str]:
    check: set[str] = set()
    for pattern in stated:
        plain = pattern.removesuffix(".csv")
        found = [name for name in names if fnmatch.fnmatchcase(name, plain)]
        if not found:
            hint = nearest(plain, names) or f" The runs are {', '.join(names[:20])}."
            raise MeasurementError(f"check: no run is called '{pattern}'.{hint}")
        check.update(found)
    if len(check) == len(names):
        raise MeasurementError("check: every run would be held out, and none left to fit; name fewer.")
    return check


def _groups(runs: Sequence[Log], conditions: Sequence[Condition]) -> tuple[str, dict]:
    """Return what tells the runs apart best, and their numbers by its levels: temperature, then rate, then profile."""
    steady = [number for number, condition in enumerate(conditions) if not condition.changing]
    warmth = [conditions[number].ambient_degC for number in steady]
    known = [value for value in warmth if value is not None]
    if known and len(known) == len(warmth):
        groups = _clusters(known, lambda a, b: b - a > _SAME_K)
        if len(groups) > 1:
            return "ambient temperature [degC]", {level: [steady[n] for n in some] for level, some in groups.items()}
    rates = [condition.rate for condition in conditions]
    groups = _clusters(rates, lambda a, b: b > _SAME_RATE * max(a, 1e-12))
    if len(groups) > 1 and all(condition.profile != "dynamic" for condition in conditions):
        return "load", groups
    profiles: dict[str, list[int]] = {}
    for number, condition in enumerate(conditions):
        profiles.setdefault(condition.profile, []).append(number)
    return "profile", profiles


def _clusters(values: Sequence[float], apart) -> dict[float, list[int]]:
    """Return the numbers of the values by level: a new level begins where the next value is apart."""
    order = sorted(range(len(values)), key=lambda number: values[number])
    groups: list[list[int]] = []
    for number in order:
        if not groups or apart(values[groups[-1][0]], values[number]):
            groups.append([])
        groups[-1].append(number)
    return {float(np.median([values[n] for n in group])): sorted(group) for group in groups}


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
        f"The names of the files speak of {len(found)} pieces of hardware ({some}), and a case is one: "
        "import the files of each "
        "apart, unless they are as alike as you need."
    )
    return Finding("several specimens", "", sentence, "warning")
