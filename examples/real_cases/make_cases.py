"""Make cases from measurements: LFP cells, an NCA cell in the cold, cells that warm, one that ages, two sets of motors.

Usage: python make_cases.py DATA_FOLDER OUT_FOLDER. DATA_FOLDER has a123_26650_plett/, panasonic_18650pf/,
k2_lfp_26650/, lg_mj1_18650/, dmegc_18650_electrothermal/, nasa_18650_ageing/, gearmotor_prony_brake/ and
crazyflie21_brushed/, the files of the sources in README.md beside this script with the columns named there.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import nnls

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "examples" / "presets"))
# The reading of the brake's table is the preset's.
from motors import brake_points  # noqa: E402  # pyright: ignore[reportMissingImports]

SOC = np.round(np.hstack([np.linspace(0, 0.1, 9), np.linspace(0.15, 0.9, 16), np.linspace(0.925, 1, 4)]), 4)
RESTING_A = 0.01
SHORT_TAU_S = (5, 10, 15, 20, 30, 45)
LONG_TAU_S = (100, 200, 300, 500, 800, 1200)
# File, ambient temperature in degC, whether it is fitted or kept as check.
Runs = tuple[tuple[str, int, str], ...]


def toml_table(name: str, key: str, values: np.ndarray, soc: np.ndarray = SOC) -> str:
    """Return the TOML of a curve over SOC."""
    return f"\n[parameters.{name}]\nsoc = {soc.tolist()}\n{key} = {[round(float(v), 5) for v in values]}\n"


def run_entry(name: str, split: str, label: str, more: str = "") -> str:
    """Return the TOML of one run."""
    return f'\n[[runs]]\nfile = "{name}.csv"\nsplit = "{split}"\nlabel = "{label}"\n{more}'


def write_csv(path: Path, columns: dict[str, Any] | pd.DataFrame) -> None:
    """Write one run, rows in order of time, one row for each time."""
    rows = pd.DataFrame(columns).drop_duplicates("time_s").sort_values("time_s")
    rows.to_csv(path, index=False, lineterminator="\n")


def write_warm_run(
    out: Path, name: str, rows: pd.DataFrame, ambient_degC: Any, split: str, label: str, soc_sd: float = 0.01
) -> str:
    """Write a run of a cell whose temperature was read too, from full; return its TOML."""
    columns = {"time_s": rows.time_s, "current_A": rows.current_A, "ambient_degC": ambient_degC}
    readings = {"voltage_V": rows.voltage_V, "cell_temperature_degC": rows.temperature_degC}
    write_csv(out / f"{name}.csv", columns | readings)
    return run_entry(name, split, label, f"initial_soc = {{ value = 1.0, sd = {soc_sd} }}\n")


# A123 26650 LFP


def with_charge(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with the charge taken out until each."""
    steps_Ah = np.diff(rows.time_s) * rows.current_A.to_numpy()[1:] / 3600.0
    return rows.assign(discharged_Ah=np.append(0.0, np.cumsum(steps_Ah)))


def middle_of_branches(folder: Path, capacity_Ah: float) -> np.ndarray:
    """Return the open-circuit voltage at SOC: half way between the C/30 discharge and the C/30 charge at 25 degC."""
    branches = []
    for way, first_soc in (("discharge", 1.0), ("charge", 0.0)):
        rows = pd.read_csv(folder / f"ocv_slow_{way}_p25degC.csv")
        rows = rows[rows.current_A.abs() > RESTING_A]
        soc = first_soc - (rows.discharged_Ah - rows.discharged_Ah.iloc[0]) / capacity_Ah
        rows = rows.assign(soc=soc).sort_values("soc")
        branches.append(np.interp(SOC, rows.soc, rows.voltage_V))
    return np.mean(branches, axis=0)


def relaxed(time_s: np.ndarray, drive: np.ndarray, tau_s: float) -> np.ndarray:
    """Return the first-order response to a drive that holds from each row to the next."""
    response = np.zeros_like(drive)
    for row, kept in enumerate(np.exp(-np.diff(time_s) / tau_s)):
        response[row + 1] = kept * response[row] + (1.0 - kept) * drive[row]
    return response


def resistances(rows: pd.DataFrame, ocv: np.ndarray, capacity_Ah: float) -> tuple[np.ndarray, tuple[float, float]]:
    """Return R_ints, R_TS, R_TL (ohm) and the two time constants (s) that fit one run best by least squares.

    V_oc - V = R_ints i + R_TS i_TS + R_TL i_TL, with i_TS and i_TL the current through a first-order lag.
    """
    time_s, current = rows.time_s.to_numpy(), rows.current_A.to_numpy()
    soc = 1.0 - (rows.discharged_Ah - rows.discharged_Ah.iloc[0]) / capacity_Ah
    drop = np.interp(soc, SOC, ocv) - rows.voltage_V.to_numpy()
    middle = ((soc > 0.15) & (soc < 0.9)).to_numpy()  # where the open-circuit voltage is nearly flat

    def misfit(taus: tuple[float, float]) -> tuple[float, np.ndarray]:
        columns = np.column_stack([current, *(relaxed(time_s, current, tau) for tau in taus)])
        found, norm = nnls(columns[middle], drop[middle])
        return norm, found

    taus = min(itertools.product(SHORT_TAU_S, LONG_TAU_S), key=lambda taus: misfit(taus)[0])
    return misfit(taus)[1], taus


def two_pair_cell(
    title: str, capacity_Ah: float, capacity_sd: float, ocv: np.ndarray, known: pd.DataFrame, sensors: str
) -> str:
    """Return the TOML of a cell of one resistance and two RC pairs, these fitted to one run that its user knows."""
    (R_ints, R_TS, R_TL), (tau_S, tau_L) = resistances(known, ocv, capacity_Ah)
    ends, ones = np.array([0.0, 1.0]), np.ones(2)
    text = f"""title = "{title}"
kind = "cell"

[parameters]
capacity_Ah = {{ value = {capacity_Ah:.3f}, sd = {capacity_sd} }}
series_resistance_scale = {{ value = 1.0, sd = 0.1 }}
rc_resistance_scale = {{ value = 1.0, sd = 0.2 }}
rc_capacitance_scale = {{ value = 1.0, sd = 0.2 }}
storage_months = 0
cycles = 0
"""
    text += toml_table("ocv", "voltage_V", ocv) + toml_table("R_ints", "ohm", R_ints * ones, ends)
    text += toml_table("R_TS", "ohm", R_TS * ones, ends) + toml_table("C_TS", "farad", tau_S / R_TS * ones, ends)
    text += toml_table("R_TL", "ohm", R_TL * ones, ends) + toml_table("C_TL", "farad", tau_L / R_TL * ones, ends)
    return text + f"\n[sensors]\n{sensors}"


A123_RUNS: dict[str, Runs] = {
    "a123_lfp": (
        ("dyn_p25degC", 25, "fit"),
        ("ocv_slow_discharge_p25degC", 25, "fit"),
        ("ocv_slow_charge_p25degC", 25, "fit"),
        ("dyn_p45degC", 45, "fit"),
        ("dyn_p05degC", 5, "fit"),
        ("dyn_n05degC", -5, "check"),
    ),
    "a123_cold": (
        ("dyn_p05degC", 5, "fit"),
        ("dyn_n25degC", -25, "fit"),
        ("ocv_slow_discharge_p05degC", 5, "fit"),
        ("ocv_slow_charge_p05degC", 5, "fit"),
        ("dyn_n05degC", -5, "check"),
    ),
}


def a123(source: Path, out: Path, runs: Runs) -> None:
    """Write a case of the LFP cell: the slow branches and the dynamic profile, one temperature kept as check."""
    folder = source / "a123_26650_plett"
    slow = pd.read_csv(folder / "ocv_slow_discharge_p25degC.csv")
    capacity_Ah = float(slow.discharged_Ah.max())
    ocv = middle_of_branches(folder, capacity_Ah)
    warm = pd.read_csv(folder / "dyn_p25degC.csv").drop_duplicates("time_s")
    title = "A123 26650 LFP, dynamic profile and slow charge and discharge"
    text = two_pair_cell(title, capacity_Ah, 0.02, ocv, warm, "voltage_V = 0.001\ncurrent_A = 0.005\n")
    full, empty = "initial_soc = { value = 1.0, sd = 0.01 }\n", "initial_soc = { value = 0.0, sd = 0.01 }\n"
    for name, ambient_degC, split in runs:
        profile = "dynamic" if "dyn" in name else "C/30 charge" if "slow_charge" in name else "C/30 discharge"
        soc = empty if "slow_charge" in name else full
        rows = pd.read_csv(folder / f"{name}.csv")
        columns = {"time_s": rows.time_s, "current_A": rows.current_A, "ambient_degC": float(ambient_degC)}
        write_csv(out / f"{name}.csv", columns | {"voltage_V": rows.voltage_V})
        text += run_entry(name, split, f"{ambient_degC} degC, {profile}", soc)
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


# K2 Energy 26650 LFP

K2_RUNS: Runs = (
    ("hppc_p30degC", 30, "fit"),
    ("hppc_p20degC", 20, "fit"),
    ("cc1C_p30degC", 30, "fit"),
    ("cc1C_p20degC", 20, "fit"),
    ("hppc_p50degC", 50, "check"),
    ("cc1C_p50degC", 50, "check"),
)


def rested(rows: pd.DataFrame, capacity_Ah: float) -> np.ndarray:
    """Return the open-circuit voltage at SOC: where a run of pulses has rested longest, just before each load."""
    still = rows.current_A.abs() < 0.03
    last = rows[still & ~still.shift(-1, fill_value=False)]
    points = last.assign(soc=1.0 - last.discharged_Ah / capacity_Ah).sort_values("soc")
    return np.maximum.accumulate(np.interp(SOC, points.soc, points.voltage_V))


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
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


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
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


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
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


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
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


# Panasonic NCR18650PF


PANASONIC_RUNS: dict[str, Runs] = {
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


def panasonic(source: Path, out: Path, runs: Runs) -> None:
    """Write a case of the NCA cell: its base model knows 25 degC and takes the chamber for the cell."""
    folder = source / "panasonic_18650pf"
    preset = tomllib.loads((ROOT / "jaxmodel" / "presets" / "panasonic_18650pf.toml").read_text())["parameters"]
    text = """title = "Panasonic NCR18650PF, drive cycles from -20 to 25 degC"
kind = "cell"

[parameters]
capacity_Ah = { value = 2.9, sd = 0.1 }
series_resistance_scale = { value = 1.0, sd = 0.15 }
rc_resistance_scale = { value = 1.0, sd = 0.15 }
rc_capacitance_scale = { value = 1.0, sd = 0.2 }
storage_months = 0
cycles = 0
"""
    for name, key in (
        ("ocv", "voltage_V"),
        ("R_ints", "ohm"),
        ("R_TS", "ohm"),
        ("C_TS", "farad"),
        ("R_TL", "ohm"),
        ("C_TL", "farad"),
    ):
        curve = preset[name]
        values = np.asarray(curve[key])
        warm = values[-1] if values.ndim == 2 else values  # the row of 25 degC
        text += toml_table(name, key, warm, np.asarray(curve["soc"]))
    text += "\n[sensors]\nvoltage_V = 0.001\ncurrent_A = 0.005\ncell_temperature_degC = 0.1\n"
    for name, ambient_degC, split in runs:
        rows = pd.read_csv(folder / f"drive_{name}degC.csv")
        cycle = name.split("_")[0].upper()
        text += write_warm_run(out, name, rows, float(ambient_degC), split, f"{cycle} at {ambient_degC} degC")
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


# Gear motor on a brake

MOTOR_COLUMNS = ("time_s", "voltage_V", "load_torque_Nm", "ambient_degC", "current_A", "speed_rad_s")
HELD_S = 10.0  # how long each steady point is held: many time constants of the motor


def write_held_points(path: Path, points: pd.DataFrame) -> None:
    """Write steady points as a run: each held from its first row on, and read in its last."""
    start_s = HELD_S * np.arange(len(points))
    inputs = points[["voltage_V", "load_torque_Nm"]].assign(ambient_degC=20.0)
    read = inputs.assign(time_s=start_s + HELD_S - 1.0, current_A=points.current_A, speed_rad_s=points.speed_rad_s)
    rows = pd.concat([inputs.assign(time_s=start_s), read])
    write_csv(path, {column: rows[column] for column in MOTOR_COLUMNS})


def gear_motor(source: Path, out: Path) -> None:
    """Write the case of the gear motor: loads from the scale, two voltages kept as check."""
    points = brake_points(source / "gearmotor_prony_brake")
    text = """title = "A 12 V gear motor on a hand-loaded brake"
kind = "motor"

[parameters]
R_0 = { value = 10.9, sd = 0.6 }
k_tau = { value = 0.675, sd = 0.012 }
tau_0 = { value = 0.046, sd = 0.006 }

[sensors]
current_A = 0.01
speed_rad_s = 0.3
"""
    for voltage_V, group in points.groupby("group"):
        name = f"{voltage_V:g}V".replace(".", "p")
        write_held_points(out / f"{name}.csv", group.assign(voltage_V=voltage_V))
        text += run_entry(name, "check" if voltage_V > 10 else "fit", f"{voltage_V:g} V")
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


# Motors that turn propellers

# What the flight electronics draw, and rows in which the motors still follow a new level of the duty.
ELECTRONICS_A, FOLLOWING, FEWEST = 0.19, 4, 5
SLOW, FAST = 0.5, 0.8  # duties between which the sweep is parted


def propellers(source: Path, out: Path) -> None:
    """Write the case of a drone's motors, whose propellers nobody modelled: the fastest, and the way down, are check.

    Four motors share a current; each is given a quarter of it, the mean speed, and the duty's share of the voltage.
    """
    rows = pd.read_csv(source / "crazyflie21_brushed" / "thrust_stand_cf21_stock_prop.csv")
    level = (rows.pwm != rows.pwm.shift()).cumsum()
    speeds = rows[[f"motor{number}_speed_rpm" for number in range(1, 5)]]
    rows = rows.assign(
        voltage_V=rows.pwm * rows.deck_voltage_V,
        current_A=(rows.current_A - ELECTRONICS_A) / 4.0,
        speed_rad_s=speeds.mean(axis=1) * np.pi / 30.0,
    )[rows.groupby(level).cumcount() >= FOLLOWING]
    groups = rows.groupby(level)
    points = groups[["pwm", "voltage_V", "current_A", "speed_rad_s"]].mean()[groups.size() >= FEWEST]
    points = points[points.pwm > 0.15].assign(load_torque_Nm=0.0)
    fastest = points.pwm.idxmax()
    up, down = points.loc[:fastest], points.loc[fastest:]
    text = """title = "Crazyflie 2.1, four motors with propellers on a thrust stand"
kind = "motor"

[parameters]
R_0 = { value = 0.8, sd = 0.3 }
k_tau = { value = 0.001, sd = 0.0002 }
tau_0 = { value = 1e-4, sd = 5e-5 }
J = 2e-7

[sensors]
current_A = 0.02
speed_rad_s = 5.0
"""
    for name, split, some in (
        ("up_slow", "fit", up[up.pwm < SLOW]),
        ("up_middle", "fit", up[up.pwm.between(SLOW, FAST)]),
        ("up_fast", "check", up[up.pwm > FAST]),
        ("down", "check", down[down.pwm < FAST]),
    ):
        write_held_points(out / f"{name}.csv", some)
        text += run_entry(name, split, f"duty {some.pwm.min():.2f} to {some.pwm.max():.2f}, {name.split('_')[0]}")
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")


def main(source: Path, out: Path) -> None:
    """Write all cases."""
    makers = {name: partial(a123, runs=runs) for name, runs in A123_RUNS.items()}
    makers |= {name: partial(panasonic, runs=runs) for name, runs in PANASONIC_RUNS.items()}
    for name, make in (
        makers
        | {"k2_lfp": k2, "lg_mj1": lg_mj1, "dmegc_18650": dmegc, "nasa_ageing": nasa}
        | {"gear_motor": gear_motor, "propellers": propellers}
    ).items():
        (out / name).mkdir(parents=True, exist_ok=True)
        make(source, out / name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="folder of the measurements")
    parser.add_argument("out", type=Path, help="folder for the cases")
    arguments = parser.parse_args()
    try:
        main(arguments.source, arguments.out)
    except FileNotFoundError as error:
        parser.error(f"{error.filename} is not there; README.md beside this script says what DATA_FOLDER must hold.")
