"""Numbers, ranges and signs in words: 12, 13, 16 mV below the model; SOC 0.3 to 0.4."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxmodel.base.units import ending_of, unit_of
from jaxmodel.diagnosis.residuals.regimes import Bins

_SMALLER = {"V": "mV", "A": "mA", "ohm": "mohm", "N m": "mN m"}
_NAMES = {"soc": "SOC", "V_set": "set voltage"}
_RATIOS = {("V", "A"): "ohm"}
_ZERO = 0.05  # of the largest of some numbers: the sign of smaller ones does not count


def numbers(values: Sequence[float], unit: str) -> tuple[list[str], str]:
    """Return numbers with sensible digits, and their unit: [0.0123, 0.2] V is ['12', '200'] mV."""
    largest = max((abs(v) for v in values), default=0.0)
    scale = 1.0
    if unit in _SMALLER and largest < 0.995:
        scale, unit = 1e3, _SMALLER[unit]
    decimals = int(np.clip(1 - np.floor(np.log10(max(largest * scale, 1e-12))), 0, 4))
    texts = [f"{v * scale:,.{decimals}f}" for v in values]
    return ["0" if float(text.replace(",", "")) == 0.0 else text for text in texts], unit


def with_unit(value: float, unit: str) -> str:
    """Return one number with its unit, as '12 mV'."""
    (text,), unit = numbers([value], unit)
    return f"{text} {unit}".rstrip()


def ratio(unit: str, per: str) -> str:
    """Return the unit of a slope: V per A is ohm."""
    return _RATIOS.get((unit, per)) or (f"{unit}/({per})" if " " in per else f"{unit}/{per}")


def listed(texts: Sequence[str]) -> str:
    """Return 'a, b and c'."""
    return ", ".join(texts) if len(texts) < 2 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def difference(values: Sequence[float], unit: str) -> str:
    """Say how far the measurement is above or below the model, or give differences where the sign changes."""
    largest = max(abs(v) for v in values)
    signs = {np.sign(v) for v in values if abs(v) > _ZERO * largest}
    if len(signs) == 1 and all(np.sign(v) in signs or abs(v) <= _ZERO * largest for v in values):
        texts, unit = numbers([abs(v) for v in values], unit)
        side = "above" if signs == {1.0} else "below"
        return f"the measurement is {', '.join(texts)} {unit} {side} the model".replace("  ", " ")
    texts, unit = numbers(values, unit)
    return f"measurement minus model is {', '.join(texts)} {unit}".rstrip()


def plain_name(name: str) -> str:
    """Return a condition's name without its unit: 'cell_temperature_degC' is 'cell temperature'."""
    if name in _NAMES:
        return _NAMES[name]
    ending = ending_of(name)
    return (name.removesuffix(f"_{ending}") if ending else name).replace("_", " ")


def values_of(values: Sequence[float], name: str, capacity_Ah: float | None = None) -> str:
    """Return values of a condition: '3, 6, 9 A', or '1, 2, 3C' where the cell's capacity is known."""
    unit = unit_of(name)
    if unit == "A" and capacity_Ah:
        rates = [v / capacity_Ah for v in values]
        return f"{', '.join(_short(rates))}C"
    return f"{', '.join(_short(values))} {unit}".rstrip()


def _short(values: Sequence[float]) -> list[str]:
    """Return numbers with as few digits as keep them distinct, at least two."""
    largest = max((abs(v) for v in values), default=0.0)
    texts: list[str] = []
    for digits in range(2, 6):
        decimals = int(np.clip(digits - 1 - np.floor(np.log10(max(largest, 1e-12))), 0, 6))
        texts = [f"{v:,.{decimals}f}" for v in values]
        if len(set(texts)) == len(texts):
            break
    if all("." in text for text in texts):
        while all(text.endswith("0") for text in texts):
            texts = [text[:-1] for text in texts]
        texts = [text.removesuffix(".") for text in texts]
    return ["0" if text.strip("-0.") == "" else text for text in texts]


def within(bins: Bins, first: int, last: int) -> str:
    """Return a range of a condition: 'SOC 0.3 to 0.4', 'cell temperature above 40 degC'; '' for all of it."""
    if first == 0 and last == bins.count - 1:
        return ""
    low, high = float(bins.lower[first]), float(bins.upper[last])
    name, unit = plain_name(bins.name), f" {bins.unit}".rstrip()
    if bins.name == "time_since_load_changed_s":
        if not np.isfinite(low):
            return f"within {high:g} s of a change of load"
        return f"more than {low:g} s after a change of load" + (f", up to {high:g} s" if np.isfinite(high) else "")
    if bins.are_levels:
        ends = _short([low, high]) if first != last else _short([low])
        return f"{name} {' to '.join(ends)}{unit}"
    if not np.isfinite(low):
        return f"{name} below {high:,g}{unit}"
    if not np.isfinite(high):
        return f"{name} above {low:,g}{unit}"
    return f"{name} {low:,g} to {high:,g}{unit}"


def sentence(where: str, what: str) -> str:
    """Return 'SOC 0.3 to 0.4: the measurement is ...', or 'Everywhere: ...' for the whole range."""
    where = where or "everywhere"
    return f"{where[0].upper()}{where[1:]}: {what}"
