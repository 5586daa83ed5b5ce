"""Units by the names of columns: each name ends with its own."""

from __future__ import annotations

UNITS = {
    "m_s2": "m/s2",
    "rad_s": "rad/s",
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


def ending_of(column: str) -> str:
    """Return the unit at the end of a column's name as the name has it; '' for a pure number."""
    return next((ending for ending in UNITS if column.endswith(f"_{ending}")), "")


def unit_of(column: str) -> str:
    """Return the unit of a column by its name; '' for a pure number."""
    return UNITS.get(ending_of(column), "")
