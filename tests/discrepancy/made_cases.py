"""Cells measured by the referee: four runs at four temperatures, true parameters off their stated values, effects hidden.

All cases have the same layout, so that they share compiled programs.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.cases import Case, read_case
from tests.independent import Run, make_profile, simulate, write_case

NOISE_V = 0.002
TRUE = {"capacity_Ah": 2.05, "series_resistance_scale": 1.09, "rc_resistance_scale": 0.93, "storage_months": 0}
STATED = {
    "capacity_Ah": (2.0, 0.05),
    "series_resistance_scale": (1.0, 0.1),
    "rc_resistance_scale": (1.0, 0.1),
    "storage_months": 0,
}
# Temperature, pattern of the load, whether it also charges, true state of charge, by how much it is misstated, split.
RUNS = (
    (0.0, "pulse train", True, 0.95, 0.008, "fit"),
    (20.0, "varying load", True, 0.75, -0.012, "fit"),
    (40.0, "load steps", False, 0.80, 0.005, "fit"),
    (10.0, "varying load", False, 0.85, -0.007, "check"),
)
SOC_SD = 0.01


def made_runs(duration_s: float = 1200.0) -> list[Run]:
    """Return what was done to the cell: readings every three seconds, charging and discharging at up to 6 A."""
    runs = []
    for number, (ambient, pattern, reversing, soc, off, split) in enumerate(RUNS):
        profile = make_profile(
            "cell",
            pattern,
            number + 1,
            duration_s=duration_s,
            step_s=3.0,
            ambient_degC=ambient,
            largest_drive=6.0,
            reversing=reversing,
        )
        runs.append(Run(profile, initial_soc=soc, stated_soc=(soc + off, SOC_SD), split=split))
    return runs


def made_cell(folder: Path, effects: Mapping[str, Mapping[str, float | str]], seed: int = 0, **options) -> Case:
    """Write and read a cell with hidden effects; `options` are those of the referee's `write_case`."""
    options = {"sensors": {"voltage_V": NOISE_V}} | options
    write_case(folder, "cell", TRUE, STATED, made_runs(), effects=effects, seed=seed, **options)
    return read_case(folder)


def made_cell_with_unknown_law(folder: Path, ohm_per_soc: float, seed: int = 0) -> Case:
    """Write and read a cell whose resistance grows below half charge, which no effect of the catalogue does.

    It is taken off the voltages that the referee made: in a cell driven by its current nothing feeds back.
    """
    made_cell(folder, {}, seed)
    for number, run in enumerate(made_runs(), start=1):
        soc = simulate("cell", TRUE, run.profile, {}, run.initial_soc)["soc"]
        file = folder / f"run-{number:02d}.csv"
        table = pd.read_csv(file)
        table["voltage_V"] -= table["current_A"] * ohm_per_soc * np.maximum(0.5 - soc, 0.0)
        table.to_csv(file, index=False)
    return read_case(folder)
