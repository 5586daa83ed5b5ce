"""Conversion of units as benches write them, by pint; the spellings that pint does not know are data here."""

from __future__ import annotations

import functools
import re
from typing import Any, NamedTuple

# Spellings of cyclers and benches by pint's. A letter that pint takes for another unit (C is coulomb, h is hour, F is
# farad, Nm is nanometre) stands for what a bench means by it.
SPELLINGS = {
    "1": "dimensionless", "-": "dimensionless", "%": "percent", "pct": "percent", "percent": "percent",
    "fraction": "dimensionless", "pu": "dimensionless",
    "s": "second", "sec": "second", "secs": "second", "seconds": "second", "second": "second", "sek": "second", 
    "秒": "second", "分": "minute", "小时": "hour",
    "ms": "millisecond", "msec": "millisecond", "us": "microsecond", "µs": "microsecond", "ns": "nanosecond",
    "min": "minute", "mins": "minute", "minutes": "minute", "minute": "minute",
    "h": "hour", "hr": "hour", "hrs": "hour", "hours": "hour", "hour": "hour", "std": "hour", "d": "day", "days": "day",
    "a": "ampere", "amp": "ampere", "amps": "ampere", "ampere": "ampere", "amperes": "ampere",
    "ma": "milliampere", "ua": "microampere", "µa": "microampere", "ka": "kiloampere", "milliamps": "milliampere",
    "v": "volt", "volt": "volt", "volts": "volt", "mv": "millivolt", "uv": "microvolt", "µv": "microvolt",
    "kv": "kilovolt", "millivolts": "millivolt", "mvolts": "millivolt", "mvolt": "millivolt",
    "mamps": "milliampere", "mamp": "milliampere", "milliampere": "milliampere", "mamp-hr": "milliampere*hour",
    "vdc": "volt", "adc": "ampere",
    "w": "watt", "mw": "milliwatt", "kw": "kilowatt", "watts": "watt",
    "ah": "ampere*hour", "a.h": "ampere*hour", "a*h": "ampere*hour", "a h": "ampere*hour", "amp-hr": "ampere*hour",
    "mah": "milliampere*hour", "ma.h": "milliampere*hour", "ma*h": "milliampere*hour", "ma h": "milliampere*hour",
    "as": "ampere*second", "wh": "watt*hour", "w.h": "watt*hour", "w*h": "watt*hour", "mwh": "milliwatt*hour",
    "c": "degC", "°c": "degC", "degc": "degC", "deg c": "degC", "oc": "degC", "ºc": "degC", "℃": "degC",
    "@c": "degC", "\ufffdc": "degC", "celsius": "degC", "deg_c": "degC", "degrees c": "degC", "˚c": "degC",
    "f": "degF", "°f": "degF", "degf": "degF", "fahrenheit": "degF", "℉": "degF", "k": "kelvin", "kelvin": "kelvin",
    "ohm": "ohm", "ohms": "ohm", "ω": "ohm", "mohm": "milliohm", "mω": "milliohm",
    "rpm": "rpm", "1/min": "rpm", "r/min": "rpm", "min-1": "rpm", "rev/min": "rpm", "u/min": "rpm",
    "rps": "revolution/second", "rev/s": "revolution/second", "rot/s": "revolution/second", "rev": "revolution",
    "krpm": "kilorpm", "tr/min": "rpm", "rad/s": "radian/second", "rad_s": "radian/second", "rads": "radian/second",
    "deg/s": "degree/second", "deg_s": "degree/second", "°/s": "degree/second", "hz": "hertz",
    "nm": "newton*meter", "n m": "newton*meter", "n.m": "newton*meter", "n*m": "newton*meter", "n-m": "newton*meter",
    "n·m": "newton*meter", "mnm": "millinewton*meter", "mn m": "millinewton*meter", "mn.m": "millinewton*meter",
    "ncm": "newton*centimeter", "n cm": "newton*centimeter", "kgcm": "kilogram_force*centimeter",
    "kg cm": "kilogram_force*centimeter", "lbf in": "pound_force*inch", "in-lb": "pound_force*inch",
    "oz-in": "ounce_force*inch", "ozin": "ounce_force*inch",
    "n.mm": "newton*millimeter", "n*mm": "newton*millimeter", "n mm": "newton*millimeter", "nmm": "newton*millimeter",
    "m/s": "meter/second", "m_s": "meter/second", "m/s2": "meter/second**2", "m_s2": "meter/second**2",
    "m/s²": "meter/second**2", "m/s^2": "meter/second**2", "g": "gram", "kg": "kilogram", "n": "newton",
    "m": "meter", "mm": "millimeter", "cm": "centimeter", "deg": "degree", "°": "degree", "rad": "radian",
}  # fmt: skip
# Case tells mega from milli.
_MEGA = {"MA": "megaampere", "MV": "megavolt", "MW": "megawatt", "MOhm": "megaohm"}
# By the model's spelling of a unit.
_TARGETS = {
    "": "dimensionless",
    "s": "second",
    "A": "ampere",
    "V": "volt",
    "W": "watt",
    "A h": "ampere*hour",
    "W h": "watt*hour",
    "degC": "degC",
    "rad/s": "radian/second",
    "rad": "radian",
    "N m": "newton*meter",
    "m/s2": "meter/second**2",
    "deg": "degree",
}


# What a potential is measured against: 'V vs. Li/Li+'.
_AGAINST = re.compile(r"\s+vs\b.*$", re.IGNORECASE)
# Between the units of a compound one, and powers of them.
_BETWEEN = re.compile(r"[\s./*·⋅^-]+|[\d²³]+")

_SI = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd"}
_SI |= {"radian": "rad"}


class Conversion(NamedTuple):
    """A change of unit: value times factor, plus offset."""

    factor: float
    offset: float = 0.0


def spelled(unit: str) -> str | None:
    """Return pint's spelling of a unit of this list, None if it is not in it."""
    text = " ".join(unit.replace("μ", "µ").replace("Ω", "ω").split()).strip("[](){}")
    text = _AGAINST.sub("", text)
    return _MEGA.get(text) or SPELLINGS.get(text.lower()) or SPELLINGS.get(text.lower().removesuffix("."))


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of this list, or is composed of such ('rad.s', 'N m/A')."""
    parts = [part for part in _BETWEEN.split(text.strip("[](){}<> ")) if part]
    return spelled(text) is not None or (len(parts) > 1 and all(spelled(part) for part in parts))


@functools.cache
def conversion(unit: str, target: str) -> Conversion | None:
    """Return the conversion of one unit into another.

    Args:
        unit: as a file writes it.
        target: as `jaxmodel.base.units` writes it; '' for a pure number.

    Returns:
        None if there is no such unit, or it measures another quantity.
    """
    source, wanted = spelled(unit) or unit, _TARGETS[target]
    if source == wanted:
        return Conversion(1.0)
    registry, pint = _registry()
    try:
        zero, one = (registry.Quantity(value, source).to(wanted).magnitude for value in (0.0, 1.0))
    except (pint.PintError, AttributeError, ValueError, TypeError, AssertionError, SyntaxError, ZeroDivisionError):
        return None  # any text may stand in brackets after a name
    except Exception as error:  # the tokenizer's own error has no base class of pint
        if type(error).__module__.split(".")[0] in ("tokenize", "pint", "flexparser"):
            return None
        raise
    return Conversion(float(one - zero), float(zero))


def in_si(unit: str) -> tuple[dict[str, int], Conversion] | None:
    """Return the SI base units of a unit of this project, by their exponents, and the conversion into them.

    Radians count as a base unit, as they do in names of units. It is None if an exponent is not whole, or if there is
    no such unit.
    """
    registry, pint = _registry()
    try:
        found = registry.Unit(re.sub(r"(?<=[A-Za-z])(?=\d)", "**", unit))
        zero, one = (registry.Quantity(value, found).to_base_units() for value in (0.0, 1.0))
    except (pint.PintError, AttributeError, ValueError):
        return None
    exponents = {name: float(power) for name, power in one.unit_items()}
    if not all(power.is_integer() and name in _SI for name, power in exponents.items()):
        return None
    whole = {_SI[name]: int(power) for name, power in exponents.items()}
    return whole, Conversion(float((one - zero).magnitude), float(zero.magnitude))


@functools.cache
def _registry() -> tuple[Any, Any]:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True), pint
