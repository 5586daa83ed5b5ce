"""Tables over the state of charge: what they truly are, and what a user states who measured them a little wrong."""

from __future__ import annotations

from typing import Any

import numpy as np

SOC = np.round(np.linspace(0.0, 1.0, 21), 2)
# Where a cell is really driven; below, what is stated is off by what it is off here.
DRIVEN_FROM = 0.2
# The largest error of a stated table: V of the open-circuit voltage, a share of the series resistance.
OFF = {"ocv": (0.008, 0.025), "R_ints": (0.15, 0.4)}
VALUES = {"ocv": "voltage_V", "R_ints": "ohm"}


def true_tables(rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Draw the tables of a cell: the paper's formulas, somewhat bent."""
    voltage = -1.031 * np.exp(-35.0 * SOC) + 3.685 + 0.2156 * SOC - 0.1178 * SOC**2 + 0.3201 * SOC**3
    voltage += rng.uniform(-0.04, 0.04) * (SOC - 0.5) + rng.uniform(-0.02, 0.02) * np.sin(2.0 * np.pi * SOC)
    ohm = (0.0633 + 0.1562 * np.exp(-24.37 * np.maximum(SOC, 0.012))) * rng.uniform(0.6, 1.2)
    ohm *= 1.0 + rng.uniform(-0.1, 0.1) * np.cos(np.pi * SOC)
    return {"ocv": _table("ocv", np.round(voltage, 4)), "R_ints": _table("R_ints", np.round(ohm, 5))}


def stated_table(rng: np.random.Generator, name: str, table: dict[str, Any]) -> dict[str, Any]:
    """Return a table that is off by a smooth bump, of which no calibrated number makes anything.

    Of an open-circuit voltage the bump has neither level nor slope where the cell is driven: starts and capacity would
    take those. A share of the series resistance has no level there: its scale would.
    """
    centre, width = rng.uniform(0.35, 0.85), rng.uniform(0.1, 0.22)
    shape = np.exp(-0.5 * ((SOC - centre) / width) ** 2)
    if rng.uniform() < 0.5:
        shape = shape - rng.uniform(0.5, 1.0) * np.exp(-0.5 * ((SOC - centre + 0.35) / width) ** 2)
    degree = 1 if name == "ocv" else 0
    driven = SOC >= DRIVEN_FROM
    bump = shape - np.polyval(np.polyfit(SOC[driven], shape[driven], degree), SOC)
    bump *= float(rng.choice([-1.0, 1.0])) * rng.uniform(*OFF[name]) / np.abs(bump[driven]).max()
    values = np.array(table[VALUES[name]])
    if name == "ocv":
        held = np.where(driven, bump, bump[driven][0])
        return _table(name, np.round(values + held, 4))
    return _table(name, np.round(values * np.exp(np.where(driven, bump, bump[driven][0])), 5))


def _table(name: str, values: np.ndarray) -> dict[str, Any]:
    return {"soc": SOC.tolist(), VALUES[name]: values.tolist()}
