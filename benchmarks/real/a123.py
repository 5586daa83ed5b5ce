"""The A123 26650 LFP cell: dynamic profiles and slow branches from -25 to 45 degC, without a thermometer."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pandas as pd

from benchmarks.real.base_models import middle_of_branches, two_pair_cell
from benchmarks.real.writing import Runs, initial_soc, run_entry, write_csv, write_toml

FOLDER = "a123_26650_plett"


@dataclasses.dataclass(frozen=True)
class Plan:
    """What a case of this cell is made of.

    Attributes:
        runs: name, ambient temperature, split.
        known: the temperature, as files name it, at which the user made the base model's tables.
    """

    runs: Runs
    known: str = "p25"


PLANS = {
    "a123_lfp": Plan(
        (
            ("dyn_p25degC", 25, "fit"),
            ("ocv_slow_discharge_p25degC", 25, "fit"),
            ("ocv_slow_charge_p25degC", 25, "fit"),
            ("dyn_p45degC", 45, "fit"),
            ("dyn_p05degC", 5, "fit"),
            ("dyn_n05degC", -5, "check"),
        )
    ),
    "a123_cold": Plan(
        (
            ("dyn_p05degC", 5, "fit"),
            ("dyn_n25degC", -25, "fit"),
            ("ocv_slow_discharge_p05degC", 5, "fit"),
            ("ocv_slow_charge_p05degC", 5, "fit"),
            ("dyn_n05degC", -5, "check"),
        )
    ),
    # Between 5 and 45 degC the data have 25 degC alone: it is kept whole, and the tables are those of 45 degC.
    "a123_warm": Plan(
        (
            ("dyn_p45degC", 45, "fit"),
            ("ocv_slow_discharge_p45degC", 45, "fit"),
            ("ocv_slow_charge_p45degC", 45, "fit"),
            ("dyn_p05degC", 5, "fit"),
            ("ocv_slow_discharge_p05degC", 5, "fit"),
            ("ocv_slow_charge_p05degC", 5, "fit"),
            ("dyn_p25degC", 25, "check"),
            ("ocv_slow_discharge_p25degC", 25, "check"),
            ("ocv_slow_charge_p25degC", 25, "check"),
        ),
        known="p45",
    ),
}


def a123(source: Path, out: Path, plan: Plan) -> None:
    """Write a case: tables of one temperature, runs of several."""
    folder = source / FOLDER
    slow = pd.read_csv(folder / f"ocv_slow_discharge_{plan.known}degC.csv")
    capacity_Ah = float(slow.discharged_Ah.max())
    ocv = middle_of_branches(slow, pd.read_csv(folder / f"ocv_slow_charge_{plan.known}degC.csv"), capacity_Ah)
    dynamic = pd.read_csv(folder / f"dyn_{plan.known}degC.csv").drop_duplicates("time_s")
    title = "A123 26650 LFP, dynamic profile and slow charge and discharge"
    text = two_pair_cell(title, capacity_Ah, 0.02, ocv, dynamic, "voltage_V = 0.001\ncurrent_A = 0.005\n")
    for name, ambient_degC, split in plan.runs:
        profile = "dynamic" if "dyn" in name else "C/30 charge" if "slow_charge" in name else "C/30 discharge"
        rows = pd.read_csv(folder / f"{name}.csv")
        columns = {"time_s": rows.time_s, "current_A": rows.current_A, "ambient_degC": float(ambient_degC)}
        write_csv(out / f"{name}.csv", columns | {"voltage_V": rows.voltage_V})
        soc = initial_soc(0.0 if "slow_charge" in name else 1.0)
        text += run_entry(name, split, f"{ambient_degC} degC, {profile}", soc)
    write_toml(out, text)
