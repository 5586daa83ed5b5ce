"""Laws in no catalogue: those of a cell act on the voltage, those of a drive distort what truly acts on it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd


def _low_soc_resistance(columns, strength):
    columns["voltage_V"] -= columns["current_A"] * 0.06 * strength * np.maximum(0.5 - columns["soc"], 0.0)


def _quadratic_resistance(columns, strength):
    columns["voltage_V"] -= 1.5e-3 * strength * columns["current_A"] * np.abs(columns["current_A"])


def _contact_that_loosens(columns, strength):
    columns["voltage_V"] -= columns["current_A"] * 0.01 * strength * (columns["time_s"] / 1800.0) ** 2


def _share(values):
    return np.abs(values) / max(1e-9, float(np.abs(values).max()))


# Of a cell nothing feeds back; a drive is given what the bench reports.
OUTSIDE_CELL: dict[str, Callable] = {
    "low_soc_resistance": _low_soc_resistance,
    "quadratic_resistance": _quadratic_resistance,
    "contact_that_loosens": _contact_that_loosens,
}
OUTSIDE_DRIVE: dict[str, Callable] = {
    "amplifier_that_saturates": lambda p, s, drive: p | {drive: p[drive] * (1.0 - 0.05 * s * _share(p[drive]))},
    "brake_that_fades": lambda p, s, drive: (
        p | {"load_torque_Nm": p["load_torque_Nm"] * (1.0 - 0.05 * s * p["time_s"] / 1800.0)}
    ),
    "torque_sensor_that_bends": lambda p, s, drive: (
        p | {"load_torque_Nm": p["load_torque_Nm"] * (1.0 + 0.1 * s * _share(p["load_torque_Nm"]) ** 2)}
    ),
}
# Where these laws act, in the words in which a diagnosis names an equation or a channel.
ACTS_ON = {
    **dict.fromkeys(OUTSIDE_CELL, ("acts on voltage_V",)),
    "amplifier_that_saturates": ("the armature voltage", "the duty"),
    "brake_that_fades": ("the torque balance",),
    "torque_sensor_that_bends": ("the torque balance",),
}


def apply(folder: Path, kind: str, law: str, strength: float, clean: list, reported: list) -> None:
    """Put an unknown law of a cell on its voltages; for a drive put back the inputs that the bench reports."""
    for number, (truth, profile) in enumerate(zip(clean, reported, strict=True), start=1):
        path = folder / f"run-{number:02d}.csv"
        table = pd.read_csv(path)
        if kind == "cell":
            columns = {name: table[name].to_numpy().copy() for name in table} | {"soc": np.asarray(truth["soc"])}
            OUTSIDE_CELL[law](columns, strength)
            table["voltage_V"] = columns["voltage_V"]
        else:
            for name in profile:
                table[name] = profile[name]
        table.to_csv(path, index=False)
