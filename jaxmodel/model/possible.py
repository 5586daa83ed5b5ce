"""What no cell and no motor can be in: a run that goes there has finite numbers and is still no result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# No temperature is lower [degC].
ABSOLUTE_ZERO_DEGC = -273.15
# Fixed points of the scale ITS-90 [degC]: copper of a winding melts, and aluminium of a cell's electrode.
COPPER_MELTS_DEGC, ALUMINIUM_MELTS_DEGC = 1084.62, 660.32
# A cell that has given twice what it holds, or has taken in as much again (assumed): what is less far beyond full or
# empty is told by `valid`.
LEAST_SOC, MOST_SOC = -1.0, 2.0
LIMITS = {
    "cell_temperature_degC": (ABSOLUTE_ZERO_DEGC, ALUMINIUM_MELTS_DEGC),
    "winding_temperature_degC": (ABSOLUTE_ZERO_DEGC, COPPER_MELTS_DEGC),
    "case_temperature_degC": (ABSOLUTE_ZERO_DEGC, COPPER_MELTS_DEGC),
    "soc": (LEAST_SOC, MOST_SOC),
}


def possible(readings: Mapping[str, Any]) -> Any:
    """Return whether ideal readings are within `LIMITS`, of any shape; False where one is not a number."""
    within: Any = True
    for name, (low, high) in LIMITS.items():
        if name in readings:  # one comparison: a sweep makes it at every step
            within = within & (abs(readings[name] - 0.5 * (low + high)) <= 0.5 * (high - low))
    return within
