"""Units from the names of columns, which end with their unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

UNITS = {
    "m_s2": "m/s2",
    "rad_s": "rad/s",
    "rad": "rad",
    "per_s": "1/s",
    "degC": "degC",
    "deg": "deg",
    "Nm": "N m",
    "Ah": "A h",
    "Wh": "W h",
    "V": "V",
    "A": "A",
    "K": "K",
    "s": "s",
    "set": "V",
}

# No number of this project is larger in these units; squares and cubes of numbers up to it are finite.
LARGEST = 1e12

# As people write them.
_TYPESET = {"m/s2": "m/s²", "degC": "°C", "deg": "°"}
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"))


def ending_of(column: str) -> str:
    """Return the unit at the end of a column's name as the name has it; '' for a pure number."""
    return next((ending for ending in UNITS if column.endswith(f"_{ending}")), "")


def unit_of(column: str) -> str:
    """Return the unit of a column by its name; '' for a pure number."""
    return UNITS.get(ending_of(column), "")


def split_unit(column: str) -> tuple[str, str]:
    """Return a column's quantity in words and its unit: 'pack_voltage_V' is ('pack voltage', 'V')."""
    ending, unit = ending_of(column), unit_of(column)
    if ending and column != "V_set":
        return column.removesuffix(f"_{ending}").replace("_", " "), _TYPESET.get(unit, unit)
    known = {"soc": ("state of charge", ""), "duty": ("duty", ""), "V_set": ("set voltage", "V")}
    return known.get(column, (column.replace("_", " "), ""))


def difference_unit(unit: str) -> str:
    """Return the unit of a difference: of two temperatures in degC, kelvin."""
    return "K" if unit in ("°C", "degC") else unit


def readable(values: Sequence[float] | np.ndarray, unit: str) -> tuple[float, str]:
    """Return the factor and unit (V, mV, µV) that are most readable for the largest of some values."""
    if unit not in ("V", "A", "s", "ohm", "K"):
        return 1.0, unit
    sizes = np.abs(np.asarray(values, dtype=float))
    largest = float(np.max(sizes, initial=0.0, where=np.isfinite(sizes))) or 1.0
    if unit == "K" and largest > 0.02:
        return 1.0, unit
    size, prefix = next(((size, prefix) for size, prefix in _PREFIXES if largest >= size), _PREFIXES[-1])
    return 1.0 / size, prefix + unit
