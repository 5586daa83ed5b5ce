"""The Panasonic NCR18650PF: drive cycles and pulses from -20 to 25 degC, with a thermocouple on the case."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.real.base_models import two_pair_cell
from benchmarks.real.writing import SOC, Runs, toml_table, write_toml, write_warm_run

ROOT = Path(__file__).parents[2]
FOLDER = "panasonic_18650pf"
TITLE = "Panasonic NCR18650PF, drive cycles from -20 to 25 degC"
SENSORS = "voltage_V = 0.001\ncurrent_A = 0.005\ncell_temperature_degC = 0.1\n"
CURVES = {"ocv": "voltage_V", "R_ints": "ohm", "R_TS": "ohm", "C_TS": "farad", "R_TL": "ohm", "C_TL": "farad"}
LOADED_A = 0.1

# With the preset's tables at 25 degC.
PRESET_RUNS: dict[str, Runs] = {
    "panasonic_drive": (
        ("us06_p25", 25, "fit"),
        ("us06_p10", 10, "fit"),
        ("us06_p00", 0, "fit"),
        ("us06_n20", -20, "check"),
    ),
    "panasonic_cycle1": (
        ("cycle1_p25", 25, "fit"),
        ("cycle1_p10", 10, "fit"),
        ("cycle1_p00", 0, "fit"),
        ("cycle1_n20", -20, "check"),
        ("nn_p10", 10, "check"),
    ),
    "panasonic_cold": (
        ("nn_p25", 25, "fit"),
        ("nn_n20", -20, "fit"),
        ("us06_p00", 0, "fit"),
        ("us06_n20", -20, "check"),
        ("cycle3_p25", 25, "check"),
    ),
}
# With tables that a user makes from C/20 and pulses at 25 degC: fitted in the whole range, other cycles as check.
UNSEEN: Runs = (
    ("us06_p25", 25, "check"),
    ("us06_p10", 10, "check"),
    ("us06_p00", 0, "check"),
    ("us06_n20", -20, "check"),
    ("cycle3_p25", 25, "check"),
)
FOUR: Runs = (
    ("cycle1_p25", 25, "fit"),
    ("nn_p10", 10, "fit"),
    ("cycle1_p00", 0, "fit"),
    ("nn_n20", -20, "fit"),
)
PULSES: Runs = (
    ("hppc_p25", 25, "fit"),
    ("hppc_p10", 10, "fit"),
    ("hppc_p00", 0, "fit"),
    ("hppc_n20", -20, "fit"),
)
OWN_RUNS: dict[str, Runs] = {
    "panasonic_four": (*FOUR, *UNSEEN),
    "panasonic_pulses": (*FOUR, *PULSES, *UNSEEN),
}


def with_preset(source: Path, out: Path, runs: Runs) -> None:
    """Write a case whose base model has the preset's tables at 25 degC and takes the chamber for the cell."""
    preset = tomllib.loads(_made_preset(source).read_text(encoding="utf-8"))["parameters"]
    text = f"""title = "{TITLE}"
kind = "cell"

[parameters]
capacity_Ah = {{ value = 2.9, sd = 0.1 }}
series_resistance_scale = {{ value = 1.0, sd = 0.15 }}
rc_resistance_scale = {{ value = 1.0, sd = 0.15 }}
rc_capacitance_scale = {{ value = 1.0, sd = 0.2 }}
storage_months = 0
cycles = 0
"""
    for name, key in CURVES.items():
        curve = preset[name]
        values = np.asarray(curve[key])
        warm = values[-1] if values.ndim == 2 else values  # the row of 25 degC
        text += toml_table(name, key, warm, np.asarray(curve["soc"]))
    write_toml(out, text + f"\n[sensors]\n{SENSORS}" + _write_runs(source / FOLDER, out, runs))


def _made_preset(source: Path) -> Path:
    """Return the preset of this cell, made from its data at the first call: no package holds it (docs/presets.md)."""
    made = ROOT / ".real-cases" / "presets"
    file = made / FOLDER / f"{FOLDER}.toml"
    if not file.exists():
        commands = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
        script = ROOT / "examples" / "presets" / "make.sh"
        subprocess.run(["sh", script, source, made, FOLDER], env=os.environ | commands, check=True)
    return file


def with_own_tables(source: Path, out: Path, runs: Runs) -> None:
    """Write a case whose base model is made from the C/20 discharge and the pulses at 25 degC.

    The charge of the same test is not used: it reaches 4.2 V after 2.62 of 3.00 A h, and why is not known.
    """
    folder = source / FOLDER
    slow = pd.read_csv(folder / "c20_ocv_p25degC.csv")
    discharge = slow[slow.current_A > LOADED_A]
    full_Ah = float(discharge.discharged_Ah.iloc[0])
    capacity_Ah = float(discharge.discharged_Ah.iloc[-1]) - full_Ah
    soc = 1.0 - (discharge.discharged_Ah - full_Ah) / capacity_Ah
    ocv = np.interp(SOC, soc[::-1], discharge.voltage_V[::-1])
    pulses = pd.read_csv(folder / "hppc_p25degC.csv").drop_duplicates("time_s")
    text = two_pair_cell(TITLE, capacity_Ah, 0.1, ocv, pulses, SENSORS, held_before=True)
    write_toml(out, text + _write_runs(folder, out, runs))


def _write_runs(folder: Path, out: Path, runs: Runs) -> str:
    """Write the runs of a case, in a chamber at its set point, and return their TOML."""
    text = ""
    for name, ambient_degC, split in runs:
        cycle = name.split("_")[0].upper()
        file = f"{name}degC.csv" if cycle == "HPPC" else f"drive_{name}degC.csv"
        rows = pd.read_csv(folder / file)
        text += write_warm_run(out, name, rows, float(ambient_degC), split, f"{cycle} at {ambient_degC} degC")
    return text
