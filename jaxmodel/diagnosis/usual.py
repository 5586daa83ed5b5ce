"""Whether a number of an effect is of a usual size."""

from __future__ import annotations

# An effect's number is unusual this share of its usual range beyond an end: the ends are nothing sharp.
OUT_OF_RANGE = 0.25


def in_usual_range(value: float, low: float, high: float) -> bool:
    """Return True within a usual range and a little beyond: of its ratio where it has one sign, else of its length."""
    if low > 0.0:
        room = (high / low) ** OUT_OF_RANGE
        return bool(low / room <= value <= high * room)
    room = OUT_OF_RANGE * (high - low)
    return bool(low - room <= value <= high + room)
