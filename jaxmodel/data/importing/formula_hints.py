"""How a column that a file lacks is computed from others that it has: the option to be given, for messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from jaxmodel.case.measurements import REFERENCES
from jaxmodel.data.importing.findings import Finding
from jaxmodel.data.tables.known_formats import known_format
from jaxmodel.data.tables.names import matches, parse_name
from jaxmodel.data.tables.quantities import ELECTRICAL
from jaxmodel.data.tables.units import conversion

_WANTED = frozenset("reference ref goal target setpoint sp desired des commanded command cmd demand".split())
_DUTY = frozenset("duty throttle pwm".split())
# What a current in multiples of the capacity per hour is called.
_RATES = frozenset(["c rate", "crate", "c rates", "current c rate", "rate c", "current c", "c"])


def hint_for(target: str, kind: str, header: Mapping[str, str]) -> str:
    """Return the option that takes a column of the case from others of the file; "" where none does.

    The current of a cell is P / V, or its rate times its capacity. The mean voltage at a motor is the duty cycle times
    that of its supply, and its speed that of its field over the number of pole pairs.

    Args:
        target: the column of the case that is lacking.
        kind: of the case.
        header: the columns of the file, and what became of each.
    """
    known = known_format(list(header))
    if known and (said := re.search(rf'--column {target}="[^"]+"', known.remark)):
        return said[0]
    voltage = _first(header, lambda name: header[name] == "voltage_V")
    if kind == "cell" and target == "current_A":
        power = _first(header, lambda name: conversion(parse_name(name).unit, "W") is not None)
        if power and voltage:
            return _option(target, f"{_quoted(power)} / {_quoted(voltage)}")
        rate = _first(header, lambda name: parse_name(name).words in _RATES)
        return _option(target, f"{_quoted(rate)} * CAPACITY_AH") if rate else ""
    if kind == "motor" and target == "voltage_V":
        supply = voltage or _first(header, _is_supply)
        duty = _first(header, lambda name: bool(_DUTY & _words(name)))
        if not supply or not duty:
            return ""
        share = f"{_quoted(duty)} / 100" if parse_name(duty).unit == "%" else _quoted(duty)
        return _option(target, f"{share} * {_quoted(supply)}")
    if kind == "motor" and target == "speed_rad_s" and (field := _first(header, _is_electrical)):
        return _option(target, f"{_quoted(field)} * 0.10472 / PAIRS")
    if target in REFERENCES.values() and (wanted := _first(header, lambda name: _is_reference(name, target))):
        return _option(target, wanted)
    return ""


def of_a_controller(where: str, header: Mapping[str, str]) -> list[Finding]:
    """Return what is to be said of a motor's log that its controller wrote: of the supply, and of the field.

    Args:
        where: the file.
        header: its columns, and what became of each.
    """
    found = []
    of_voltage, of_speed = (hint_for(target, "motor", header) for target in ("voltage_V", "speed_rad_s"))
    if of_voltage and (voltage := _first(header, lambda name: header[name] == "voltage_V")):
        sentence = (
            f"{where}: voltage_V is column '{voltage}', beside a duty cycle; if it is that of the supply, that of the "
            f"motor is {of_voltage}."
        )
        found.append(Finding("voltage of the supply", where, sentence, "warning", "voltage_V"))
    if of_speed and "speed_rad_s" not in header.values():
        sentence = (
            f"{where}: column '{_first(header, _is_electrical)}' is the speed of the field in 1/min, and not imported; "
            f"with the number of pole pairs, {of_speed} states that of the shaft."
        )
        found.append(Finding("speed of the field", where, sentence, "warning", "speed_rad_s"))
    return found


def _first(header: Mapping[str, str], holds: Callable[[str], bool]) -> str | None:
    return next((name for name in header if holds(name)), None)


def _is_supply(name: str) -> bool:
    return any(match.quantity == "pack_voltage" for match in matches(name))


def _is_reference(name: str, target: str) -> bool:
    """Return whether a column's name is of what a loop is to follow, and of no other quantity than that one."""
    words = _words(name)
    of_speed = bool(words & {"speed", "velocity", "rpm", "vel", "w", "omega"})
    of_angle = bool(words & {"position", "angle", "pos", "theta", "q"})
    other = of_angle if target == REFERENCES["speed"] else of_speed
    return bool(words & _WANTED) and not other and not words & {"current", "voltage", "torque", "pwm", "duty", "error"}


def _is_electrical(name: str) -> bool:
    words = _words(name)
    return "erpm" in words or bool(words & ELECTRICAL and words & {"rpm", "speed", "velocity"})


def _words(name: str) -> frozenset[str]:
    return frozenset(parse_name(name).words.split())


def _quoted(name: str) -> str:
    return name if name.isidentifier() else f"`{name}`"


def _option(target: str, formula: str) -> str:
    return f'--column {target}="{formula}"'
