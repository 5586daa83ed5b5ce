"""Cells that warm, and one that ages: K2, LG, DMEGC, NASA's, a Nissan Leaf's, and the Samsung of this repository."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.real.base_models import rested, rested_points, two_pair_cell, with_charge
from benchmarks.real.writing import SOC, Runs, toml_table, write_toml, write_warm_run

ROOT = Path(__file__).parents[2]


def samsung_30q(source: Path, out: Path) -> None:
    """Copy the case that this repository holds; `source` is not used."""
    for path in (ROOT / "examples" / "samsung_30q").iterdir():
        if path.suffix in (".csv", ".toml") or path.name == "LICENSE-DATA":
            shutil.copy(path, out / path.name)


# K2 Energy 26650 LFP

K2_RUNS: Runs = (
    ("hppc_p30degC", 30, "fit"),
    ("hppc_p20degC", 20, "fit"),
    ("cc1C_p30degC", 30, "fit"),
    ("cc1C_p20degC", 20, "fit"),
    ("hppc_p50degC", 50, "check"),
    ("cc1C_p50degC", 50, "check"),
)


def k2(source: Path, out: Path) -> None:
    """Write the case of the other LFP cell: pulses and 1C at 20 and 30 degC, those at 50 degC kept as check."""
    folder = source / "k2_lfp_26650"
    known = pd.read_csv(folder / "hppc_p30degC.csv").drop_duplicates("time_s")
    capacity_Ah = float(known.discharged_Ah.max())
    sensors = "voltage_V = 0.001\ncurrent_A = 0.02\ncell_temperature_degC = 0.1\n"
    title = "K2 26650 LFP, pulses and 1C discharges"
    text = two_pair_cell(title, capacity_Ah, 0.1, rested(known, capacity_Ah), known, sensors)
    for name, ambient_degC, split in K2_RUNS:
        rows = pd.read_csv(folder / f"{name}.csv")
        label = f"{ambient_degC} degC, {'pulses' if 'hppc' in name else '1C'}"
        text += write_warm_run(out, name, rows, rows.ambient_temperature_degC, split, label, soc_sd=0.02)
    write_toml(out, text)


# LG INR18650 MJ1

LG_RUNS: Runs = (("p28degC", 28, "fit"), ("p20degC", 20, "fit"), ("p40degC", 40, "check"))


def lg_mj1(source: Path, out: Path) -> None:
    """Write the case of a cell in a chamber that breathes: pulses from full at 20 and 28 degC, at 40 kept as check."""
    folder = source / "lg_mj1_18650"
    known = pd.read_csv(folder / "pulse_10pctSOC_p28degC.csv").drop_duplicates("time_s")
    capacity_Ah = 3.5
    sensors = "voltage_V = 0.001\ncurrent_A = 0.01\ncell_temperature_degC = 0.1\n"
    text = two_pair_cell("LG INR18650 MJ1, pulses", capacity_Ah, 0.1, rested(known, capacity_Ah), known, sensors)
    for name, ambient_degC, split in LG_RUNS:
        rows = pd.read_csv(folder / f"pulse_10pctSOC_{name}.csv")
        label = f"{ambient_degC} degC, pulses"
        text += write_warm_run(out, name, rows, rows.ambient_temperature_degC, split, label)
    write_toml(out, text)


# DMEGC INR18650

DMEGC_RUNS = (
    ("pulse", "0.5C pulses", "fit"),
    ("cc0p5C", "0.5C", "fit"),
    ("cc1C", "1C", "fit"),
    ("cc2C", "2C", "check"),
)


def dmegc(source: Path, out: Path) -> None:
    """Write the case of the cell that warms: constant current and pulses at 25 degC, the highest current kept as check.

    Its thermocouple is good to a degree: the first readings, at rest, are taken for the chamber.
    """
    folder = source / "dmegc_18650_electrothermal"

    def read(name: str) -> pd.DataFrame:
        return with_charge(pd.read_csv(folder / f"cell1_{name}.csv").drop_duplicates("time_s"))

    slow = read("ocv_c20")
    capacity_Ah = float(slow.discharged_Ah.max())
    ocv = np.interp(SOC, 1.0 - slow.discharged_Ah[::-1] / capacity_Ah, slow.voltage_V[::-1])
    sensors = "voltage_V = 0.001\ncurrent_A = 0.001\ncell_temperature_degC = 0.2\n"
    title = "DMEGC INR18650, constant current and pulses"
    text = two_pair_cell(title, capacity_Ah, 0.08, ocv, read("pulse"), sensors)
    for name, label, split in DMEGC_RUNS:
        rows = read(name)
        rested_degC = float(rows.temperature_degC.head(3).mean())
        text += write_warm_run(out, name, rows, rested_degC, split, label)
    write_toml(out, text)


# NASA's 18650 cells, aged

NASA_CELL, NASA_RUNS = "B0006", ((1, "fit"), (22, "fit"), (64, "fit"), (105, "fit"), (147, "check"), (168, "check"))
NASA_TAU_S = (30.0, 300.0)


def nasa(source: Path, out: Path) -> None:
    """Write the case of a cell over its life: discharges at 2 A and 24 degC, the oldest two kept as check.

    Nothing but these discharges and impedances was measured: the open-circuit voltage is that of the first discharge
    less the drop over the resistance that the impedances show at first, half of which is given to two RC pairs.
    """
    folder = source / "nasa_18650_ageing"
    impedance = pd.read_csv(folder / "impedance_by_cycle.csv").query("battery == @NASA_CELL").head(3)
    ohm = float((impedance.Re_ohm + impedance.Rct_ohm).mean())
    discharges = pd.read_csv(folder / f"discharges_{NASA_CELL}.csv")
    new = with_charge(discharges[discharges.cycle == 1])
    capacity_Ah = float(new.discharged_Ah.max())
    loaded = new.current_A.gt(0.5)
    shown = new[new.index <= loaded[loaded].index[-1]]
    rising = (shown.voltage_V + ohm * shown.current_A.where(loaded, 0.0)).to_numpy()[::-1]
    ocv = np.maximum.accumulate(np.interp(SOC, 1.0 - shown.discharged_Ah.to_numpy()[::-1] / capacity_Ah, rising))
    text = f"""title = "NASA 18650 {NASA_CELL}, discharges over its life"
kind = "cell"

[parameters]
capacity_Ah = {{ value = {capacity_Ah:.3f}, sd = 0.05 }}
series_resistance_scale = {{ value = 1.0, sd = 0.2 }}
storage_months = 0

[sensors]
voltage_V = 0.002
current_A = 0.005
cell_temperature_degC = 0.1
"""
    level = np.ones(SOC.size)
    text += toml_table("ocv", "voltage_V", ocv) + toml_table("R_ints", "ohm", 0.5 * ohm * level)
    for pair, tau_s in zip(("TS", "TL"), NASA_TAU_S, strict=True):
        text += toml_table(f"R_{pair}", "ohm", 0.25 * ohm * level)
        text += toml_table(f"C_{pair}", "farad", tau_s / (0.25 * ohm) * level)
    for cycle, split in NASA_RUNS:
        rows = discharges[discharges.cycle == cycle]
        text += write_warm_run(out, f"cycle_{cycle}", rows, 24.0, split, f"discharge {cycle}") + f"cycles = {cycle}\n"
    write_toml(out, text)


# Nissan Leaf, one cell of 33 A h

# Parts of the file of 1C cycles by time: from the end of the rest that its log begins with, and from empty to empty.
LEAF_CYCLES = {"cc1C_first": (1700.0, 15400.0), "cc1C_second": (15400.0, np.inf)}
LEAF_RUNS = {
    "leaf": (("cc1C_first", "fit"), ("cc3C", "fit"), ("cc1C_second", "check")),
    "leaf_3c": (("cc1C_first", "fit"), ("cc1C_second", "fit"), ("cc3C", "check")),
}
LEAF_REST_S = 1800.0
THERMOCOUPLES = ["temperature_tab_degC", "temperature_middle_degC", "temperature_bottom_degC"]


def leaf(source: Path, out: Path, runs: tuple[tuple[str, str], ...]) -> None:
    """Write a case of the large flat cell: charges at C/2 and discharges at 1C, and one at 3C.

    Its user has a test of pulses at 25 degC: voltages after an hour's rest, and what they say of resistances. SOC 0 is
    where that test ended, at 3 V; the open-circuit voltage there is what the cell of the cycles rests at when empty.
    The temperature is the mean of three thermocouples on the surface.
    """
    folder = source / "nissan_leaf_2013_cell"
    pulses = pd.read_csv(folder / "cell_hppc_p25degC.csv").drop_duplicates("time_s")
    capacity_Ah = float(pulses.discharged_Ah.max())
    cycles = pd.read_csv(folder / "cell_cc1C_cycles_p25degC.csv")
    parts = {name: cycles[cycles.time_s.between(*span)] for name, span in LEAF_CYCLES.items()}
    parts["cc3C"] = pd.read_csv(folder / "cell_cc3C_cycles_p25degC.csv")
    points = rested_points(pulses, capacity_Ah, least_s=LEAF_REST_S)
    empty_V = float(parts["cc1C_first"].voltage_V.iloc[0])
    ocv = np.interp(SOC, np.append(0.0, points.soc), np.append(empty_V, points.voltage_V))
    sensors = "voltage_V = 0.002\ncurrent_A = 0.05\ncell_temperature_degC = 0.1\n"
    title = "Nissan Leaf 2013, one cell, 1C and 3C in free convection"
    text = two_pair_cell(title, capacity_Ah, 0.5, ocv, pulses, sensors)
    for name, split in runs:
        part = parts[name]
        rows = part.assign(
            time_s=(part.time_s - part.time_s.iloc[0]).round(3),
            temperature_degC=part[THERMOCOUPLES].mean(axis=1).round(3),
        )
        full = name == "cc3C"
        label = "3C discharge and rest" if full else f"C/2 charge, 1C discharge, {name.split('_')[1]} cycle"
        text += write_warm_run(
            out, name, rows, rows.ambient_temperature_degC, split, label, soc_sd=0.01, soc=1.0 if full else 0.0
        )
    write_toml(out, text)
