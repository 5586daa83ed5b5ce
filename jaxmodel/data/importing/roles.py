"""Which column of a file is which column of a case: by name and synonym, by unit, and by what it looks like."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.units import unit_of
from jaxmodel.case.measurements import OPEN, REFERENCES, Servo, vocabulary
from jaxmodel.data.tables.names import is_set, matches, says_another
from jaxmodel.data.tables.times import parse_times
from jaxmodel.data.tables.units import conversion, spelled

# By kind and column of the case, the quantities that it may be.
ROLES: dict[str, dict[str, str]] = {
    "cell": {
        "current_A": "current",
        "voltage_V": "voltage",
        "cell_temperature_degC": "cell_temperature",
        "ambient_degC": "ambient_temperature",
        "soc": "soc",
    },
    "motor": {
        "voltage_V": "motor_voltage",
        "current_A": "motor_current",
        "load_torque_Nm": "load_torque",
        "incline_deg": "incline",
        "speed_rad_s": "speed",
        "position_rad": "angle",
        "winding_temperature_degC": "winding_temperature",
        "case_temperature_degC": "case_temperature",
        "ambient_degC": "ambient_temperature",
    },
    "robot": {
        "duty": "duty",
        "V_set": "set_voltage",
        "load_torque_Nm": "load_torque",
        "incline_deg": "incline",
        "acceleration_m_s2": "acceleration",
        "pack_voltage_V": "pack_voltage",
        "pack_current_A": "pack_current",
        "motor_current_A": "motor_current",
        "speed_rad_s": "speed",
        "cell_temperature_degC": "cell_temperature",
        "winding_temperature_degC": "winding_temperature",
        "case_temperature_degC": "case_temperature",
        "ambient_degC": "ambient_temperature",
        "soc": "soc",
    },
}
# Columns of a motor's case that only their own names tell: a log may have several references.
ONLY_STATED = tuple(REFERENCES.values())
# Columns that are no readings and yet tell how a file is to be read.
MARKS = {
    "time_s": "time",
    "step_time": "step_time",
    "stamp": "stamp",
    "state": "state",
    "step": "step",
    "cycle": "cycle",
    "discharged_Ah": "discharged_charge",
    "charged_Ah": "charged_charge",
}
# Words of names that tell a clock, and of such that are none though they rise (a word ends at an underscore).
_WORD = r"(?i)(?<![a-zµ])(?:{})(?![a-z])"
_CLOCK = re.compile(
    _WORD.format(
        "ms|msecs?|milli(?:s|sec|seconds?)?|us|µs|usecs?|micro(?:s|sec|seconds?)|ticks?|uptime|time|seconds|secs?"
    )
)
_NO_CLOCK = re.compile(
    _WORD.format(
        "t?temp(?:erature)?s?|degc?|celsius|[mkµu]?a_?h|[mkµu]?w_?h|amp_?hours?|watt_?hours?|charged?|capacity|energy|soc|"
        "soh|dod|q|dist(?:ance)?|odo(?:meter)?|trip|km|tacho(?:meter)?|position|angle|count(?:er|s)?|cnt|index|idx|id|no|"
        "nr|number|row|record|point|cycles?|steps?|samples?|volts?(?:age)?|current|amps?|power|watts?|speed|rpm"
    )
)
# Units that stand for one quantity of a bench: the only column in V is the voltage. Of temperatures there are several,
# and a frequency is no speed.
_TELLING = ("A", "V", "rad/s", "N m")
# A column that is called by one of these units alone is the clock.
_OF_CLOCKS = frozenset(["s", "ms", "us", "µs"])
# Units of an energy, which is no torque though it has its dimension.
_ENERGY = re.compile(r"[WJwj]|cal")
_UNSURE = 100  # ranks of `matches` from here on are of names that only contain a word of the quantity
_COMMANDED = 200


@dataclasses.dataclass(frozen=True)
class Role:
    """A column of a file and the column of the case that it becomes.

    Attributes:
        target: the column of the case, or a key of `MARKS`.
        column: its name in the file.
        why: "named", "like it in name", "only one in its unit", "stated", "looks like it" or "beside".
        others: further columns of the file that could be it as well.
        commanded: the name says that it is set, and not measured.
    """

    target: str
    column: str
    why: str
    others: tuple[str, ...] = ()
    commanded: bool = False


def roles_of(
    names: Sequence[str],
    units: Mapping[str, str],
    kind: str,
    stated: Mapping[str, str],
    plain: Mapping[str, str] | None = None,
) -> dict[str, Role]:
    """Return the columns of a file by what they become: by their names, else as the only one in a telling unit.

    A name whose unit nobody knows comes last; the unit is then asked for.

    Args:
        names: of the file's columns.
        units: by column, as the file or the user states them.
        kind: of the case.
        stated: by column of the case, the column of the files that the user names; '' for none. A name that this
            file does not have says nothing about it.
        plain: by column of a known format, what it is called in plain words; '' for nothing of a case.

    Raises:
        MeasurementError: the user names a column of the case that there is not.
    """
    targets = {**ROLES[kind], **MARKS}
    told = ONLY_STATED if kind == "motor" else ()
    for target in stated:
        if target not in targets and target not in told:
            known = [*targets, *told]
            hint = nearest(target, known) or f" They are {', '.join(known)}."
            raise MeasurementError(f"column: a {kind} has no column '{target}'.{hint}")
    found: dict[str, Role] = {}
    for target, column in stated.items():
        if column in names:
            found[target] = Role(target, column, "stated")
    for target in told:
        if target in names and stated.get(target) is None:
            found[target] = Role(target, target, "named")
    plain = plain or {}
    taken = {role.column for role in found.values()}
    names = [name for name in names if plain.get(name) != ""]
    open_targets = [target for target in targets if target not in found and stated.get(target) != ""]
    ranked: dict[str, list[tuple[int, int, str]]] = {target: [] for target in open_targets}
    unknown: dict[str, list[tuple[int, int, str]]] = {target: [] for target in open_targets}
    by_quantity = {quantity: target for target, quantity in targets.items() if target in ranked}
    for position, name in enumerate(names):
        if name in taken:
            continue
        called = "time" if name.strip("[](){} ") in _OF_CLOCKS else name
        for match in matches(plain.get(name, called), units.get(name, "")):
            if match.quantity in by_quantity:
                some = unknown if match.unit_unknown else ranked
                some[by_quantity[match.quantity]].append((match.rank, position, name))
    _take(ranked, found, taken)
    _take_by_unit(names, units, kind, open_targets, found, taken)
    _take(unknown, found, taken)
    for target, role in found.items():
        others = [name for _, _, name in sorted(ranked.get(target, [])) if name not in taken]
        found[target] = dataclasses.replace(role, others=tuple(dict.fromkeys(others)))
    return found


def _take(ranked: Mapping[str, Sequence[tuple[int, int, str]]], found: dict[str, Role], taken: set[str]) -> None:
    """Give columns to what their names mean, the surest names first, so that a column goes to what it fits best."""
    order = sorted((rank, target, position, name) for target, some in ranked.items() for rank, position, name in some)
    for rank, target, _, name in order:
        if target in found or name in taken:
            continue
        taken.add(name)
        why = "named" if rank < _UNSURE else "like it in name"
        found[target] = Role(target, name, why, commanded=rank >= _COMMANDED)


def _take_by_unit(
    names: Sequence[str],
    units: Mapping[str, str],
    kind: str,
    targets: Sequence[str],
    found: dict[str, Role],
    taken: set[str],
) -> None:
    """Give a column to what only it has the unit of, if its name does not say another quantity."""
    quantities = {target: (target_unit(target), quantity) for target, quantity in ROLES[kind].items()}
    for target in targets:
        unit, quantity = quantities.get(target, ("", ""))
        if target in found or unit not in _TELLING or sum(other == unit for other, _ in quantities.values()) > 1:
            continue
        # To a cell its pack is itself; of a motor or robot it is another thing.
        same = [quantity, f"pack_{quantity}", f"motor_{quantity}"] if kind == "cell" else [quantity]
        fits = [
            name
            for name in names
            if name not in taken
            and (of := units.get(name))
            and spelled(of) != "hertz"
            and conversion(of, unit)
            and not (unit == "N m" and _ENERGY.search(of))
            and not says_another(name, same, of)
        ]
        measured = [name for name in fits if not is_set(name)] or fits
        if len(measured) == 1:
            found[target] = Role(target, measured[0], "only one in its unit", commanded=is_set(measured[0]))
            taken.add(measured[0])


def looks_like(
    frame: pd.DataFrame,
    units: Mapping[str, str],
    kind: str,
    missing: Sequence[str],
    beside: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Role]:
    """Return what columns look like, for those columns of a case that no name tells; only a cell's and the time.

    A name that says another quantity is believed, and so is a unit.

    Args:
        frame: the first rows of the columns that no name tells.
        units: by column, as the file states them.
        kind: of the case.
        missing: columns of the case, or `time_s`, that are sought.
        beside: by column of the case, the column that it is in files beside this one, which have no names either.
    """
    found: dict[str, Role] = {}
    silent = [str(name) for name in frame if not says_another(str(name)) and not is_set(str(name))]
    numbers = {name: frame[name].to_numpy(dtype=float) for name in silent if frame[name].dtype.kind in "iuf"}
    numbers = {name: values for name, values in numbers.items() if np.isfinite(values).sum() > 4}
    timed = {name: name in units and conversion(units[name], "s") is not None for name in numbers}
    numbers = {name: values for name, values in numbers.items() if timed[name] or name not in units}
    if "time_s" in missing:
        rising = [n for n, v in numbers.items() if _rises(v) and (timed[n] or _may_be_a_clock(n, v))]
        rising = [name for name in rising if timed[name]] or rising
        rising.sort(key=lambda name: (not _CLOCK.search(name), bool(np.all(np.diff(numbers[name]) == 1.0))))
        stamped = [name for name in silent if name not in numbers and _is_stamp(pd.Series(frame[name]))]
        if stamped and not (rising and (timed[rising[0]] or _CLOCK.search(rising[0]))):
            found["stamp"] = Role("stamp", stamped[0], "looks like it", tuple(stamped[1:]))
        elif rising:
            found["time_s"] = Role("time_s", rising[0], "looks like it", tuple(rising[1:]))
            del numbers[rising[0]]
    numbers = {name: values for name, values in numbers.items() if not timed[name]}
    if kind != "cell":
        return found
    for target, test in (("voltage_V", _is_voltage), ("current_A", _is_current), ("cell_temperature_degC", is_warmth)):
        fitting = [name for name, values in numbers.items() if target in missing and test(values)]
        if target in missing and beside.get(target) in numbers:
            found[target] = Role(target, beside[target], "beside")
            del numbers[beside[target]]
        elif fitting:
            found[target] = Role(target, fitting[0], "looks like it", tuple(fitting[1:]))
            del numbers[fitting[0]]
    return found


def _is_stamp(column: pd.Series) -> bool:
    """Return whether a column holds dates with a time of day that go on, whatever it is called."""
    if column.dtype.kind in "iufb":
        return False
    times = parse_times(column, "")
    if times is None or not times.absolute:
        return False
    there = times.seconds[np.isfinite(times.seconds)]
    return there.size > 0.9 * len(column) and bool(np.all(np.diff(there) >= 0.0)) and float(np.ptp(there)) > 0.0


def _may_be_a_clock(name: str, values: np.ndarray) -> bool:
    """Return whether a rising column can be a clock: its name is of nothing else, and it counts more than rows."""
    if name.startswith("column ") or _CLOCK.search(name):
        return True
    if _NO_CLOCK.search(name) or any(match.quantity not in ("time", "step_time", "stamp") for match in matches(name)):
        return False
    # Whole numbers that rise by one count rows, tests, cycles; a clock rises by more, and evenly.
    steps = np.diff(values[np.isfinite(values)])
    even = bool(np.mean(steps == np.median(steps)) > 0.9 and np.median(steps) > 1.0)
    return even or bool(np.any(values != np.round(values)))


def _rises(values: np.ndarray) -> bool:
    there = values[np.isfinite(values)]
    return bool(np.all(np.diff(there) >= 0.0) and np.ptp(there) > 0.0)


def _is_voltage(values: np.ndarray) -> bool:
    """Return whether a column can be the voltage of one cell, in V or mV."""
    there = values[np.isfinite(values)]
    scale = 1e-3 if np.median(there) > 100.0 else 1.0
    low, high = np.quantile(there * scale, [0.02, 0.98])
    return bool(1.0 < low <= high < 4.7 and high - low < 3.2)


def _is_current(values: np.ndarray) -> bool:
    """Return whether a column rests at zero for a while, or changes its sign."""
    there = values[np.isfinite(values)]
    largest = float(np.max(np.abs(there)))
    rests = np.mean(np.abs(there) < 0.02 * largest) if largest else 0.0
    return bool(largest > 0.0 and not _rises(there) and (rests > 0.02 or (there.min() < 0.0 < there.max())))


def is_warmth(values: np.ndarray) -> bool:
    """Return whether a column moves as a temperature in degC does."""
    there = values[np.isfinite(values)]
    low, high = float(there.min()), float(there.max())
    steps = np.abs(np.diff(there))
    return bool(-45.0 < low <= high < 95.0 and high - low < 70.0 and np.quantile(steps, 0.99) < 3.0 and high > 4.7)


def target_unit(target: str) -> str:
    """Return the unit of a column of a case."""
    if target in ("discharged_Ah", "charged_Ah"):
        return "A h"
    return {"V_set": "V"}.get(target) or ("rad" if target.endswith("_rad") else unit_of(target))


def required(kind: str, load: str | None, servo: Servo = OPEN) -> tuple[tuple[str, ...], ...]:
    """Return groups of columns of which a case needs one each, but for the ambient temperature."""
    known = vocabulary(kind, load or "", servo)
    single = tuple((name,) for name in known.required_inputs if name != "ambient_degC")
    return single + tuple(known.alternatives)
