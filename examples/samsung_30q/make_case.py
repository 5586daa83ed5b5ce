"""Derive this case from the measured data of cell 1: case.toml and one CSV per discharge.

Usage: python make_case.py SOURCE_FOLDER, the folder with cell1_c10_slow.csv, cell1_cc1C.csv to cell1_cc4C.csv and
cell1_hppc_*_p20degC.csv. The columns and the steps are described in README.md beside this script.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import nnls

HERE = Path(__file__).parent

# Run, every n-th row kept after the first minute, split. The hottest and fastest discharge is the one held out.
DISCHARGES = (("cc1C", 4, "fit"), ("cc2C", 2, "fit"), ("cc3C", 1, "fit"), ("cc4C", 1, "check"))
PULSE_TESTS = ("hppc_0p5C_p20degC", "hppc_1C_p20degC", "hppc_2C_p20degC")

FULL_V = 4.16  # SOC 1 is this voltage at rest: about the fullest state in the data (the pulse tests start there)
RESTING_A = 0.05  # a pulse test is at rest below this current: the sensor reads up to 0.03 A there
PULSE_A = 1.2  # above the 1.0 A that moves a pulse test from one state of charge to the next
OCV_SOC = np.hstack(
    [
        [0, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.275],
        [0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.825, 0.85, 0.875, 0.9, 0.95, 0.975, 0.99, 1],
    ]
)
R_INTS_SOC = np.array([0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.75, 1])
# Rests move by 5 % of charge, so finer points alternate between neighbours. Below 0.2 the voltage of a rest follows the
# steep open-circuit curve rather than a resistance: the tables are held there.
RC_SOC = np.array([0.2, 0.6, 1])
SHORT_TAU_S = (8, 10, 12, 15, 18, 22)
LONG_TAU_S = (150, 200, 250, 300, 400, 500, 600)


def read(folder: Path, name: str) -> pd.DataFrame:
    """Return one file of cell 1 with the charge drawn since its first row, in A h."""
    rows = pd.read_csv(folder / f"cell1_{name}.csv")
    if "discharged_Ah" not in rows:  # the pulse tests bring theirs, integrated before they were thinned
        rows["discharged_Ah"] = (rows.current_A * rows.time_s.diff().fillna(0.0)).cumsum() / 3600.0
    return rows


def weights(soc: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the weights of linear interpolation, held at the ends, shape (soc, points)."""
    return np.column_stack([np.interp(soc, points, unit) for unit in np.eye(len(points))])


def relaxed(time_s: np.ndarray, drive: np.ndarray, tau_s: float) -> np.ndarray:
    """Return the first-order response to a drive of shape (rows, any) that holds over the step ending at its row."""
    kept = np.exp(-np.diff(time_s, prepend=time_s[0]) / tau_s)
    response = np.zeros_like(drive)
    for row in range(1, len(time_s)):
        response[row] = kept[row] * response[row - 1] + (1.0 - kept[row]) * drive[row]
    return response


def full_charge(folder: Path) -> tuple[float, float]:
    """Return the charge of the C/10 run (A h), and that between its first state and SOC 1.

    The slope at the top comes from the first pulse of each pulse test: rest voltage before it less that after it.
    """
    slopes = []
    for name in PULSE_TESTS:
        test = read(folder, name)
        resting = (test.current_A.abs() < RESTING_A).to_numpy()
        pulse = np.flatnonzero(~resting)[0]
        rest = pulse + np.flatnonzero(resting[pulse:])[0]
        end = rest + np.flatnonzero(~resting[rest:])[0] - 1
        slopes.append((test.voltage_V[0] - test.voltage_V[end]) / test.discharged_Ah[end])
    slow = read(folder, "c10_slow")
    return slow.discharged_Ah.iloc[-1], (FULL_V - slow.voltage_V[0]) / float(np.mean(slopes))


def rc_pairs(folder: Path, capacity_Ah: float) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return R_TS and R_TL (ohm) at RC_SOC, and the two time constants (s), from every rest of the pulse tests.

    In a rest V = constant - V_TS - V_TL. Both are linear in the resistances once the time constants are chosen, so
    the resistances are non-negative least squares, and the time constants those of a grid that leave least.
    """

    def misfit(taus: tuple[float, float]) -> tuple[float, np.ndarray]:
        columns, voltages = [], []
        for test, current, rests in tests:
            drive = weights(1.0 - test.discharged_Ah.to_numpy() / capacity_Ah, RC_SOC) * current[:, None]
            response = np.hstack([relaxed(test.time_s.to_numpy(), drive, tau) for tau in taus])
            for rest in rests:
                voltage = test.voltage_V.to_numpy()[rest]
                columns.append(response[rest].mean(axis=0) - response[rest])
                voltages.append(voltage - voltage.mean())
        resistances, norm = nnls(np.vstack(columns), np.hstack(voltages))
        return norm, resistances

    tests = []
    for name in PULSE_TESTS:
        test = read(folder, name)
        current = test.current_A.where(test.current_A.abs() >= RESTING_A, 0.0).to_numpy()
        stretches = np.split(np.arange(len(test)), np.flatnonzero(np.diff(current == 0.0)) + 1)
        above_held = capacity_Ah * (1.0 - RC_SOC[0])
        tests.append((test, current, [s for s in stretches if tells_of_pairs(test, current, s, above_held)]))
    taus = min(itertools.product(SHORT_TAU_S, LONG_TAU_S), key=lambda taus: misfit(taus)[0])
    short, long = np.split(misfit(taus)[1], 2)
    return short, long, *taus


def tells_of_pairs(test: pd.DataFrame, current: np.ndarray, stretch: np.ndarray, most_Ah: float) -> bool:
    """Return whether a stretch of rows is a rest with something to see, at a charge where it says something."""
    moves = np.ptp(test.voltage_V.to_numpy()[stretch]) > 0.004
    return current[stretch[0]] == 0.0 and len(stretch) >= 5 and moves and test.discharged_Ah[stretch[0]] < most_Ah


def series_resistance(folder: Path, capacity_Ah: float, response_of_1s_ohm: float) -> np.ndarray:
    """Return R_ints (ohm) at R_INTS_SOC: the step at both edges of each pulse, less what the pairs do in 1 s."""
    soc, resistance = [], []
    for name in PULSE_TESTS:
        step = read(folder, name).assign(dV=lambda d: d.voltage_V.diff(), dI=lambda d: d.current_A.diff())
        step = step[(step.dI.abs() > PULSE_A) & (step.time_s.diff() < 1.5)]
        soc.append(1.0 - step.discharged_Ah / capacity_Ah)
        resistance.append(-step.dV / step.dI - response_of_1s_ohm)
    return np.linalg.lstsq(weights(np.hstack(soc), R_INTS_SOC), np.hstack(resistance), rcond=None)[0]


def open_circuit_voltage(folder: Path, capacity_Ah: float, first_soc: float, tables: dict) -> np.ndarray:
    """Return V_oc at OCV_SOC: the C/10 run with its own polarisation put back, and FULL_V at SOC 1."""
    slow = read(folder, "c10_slow")
    time_s, current = slow.time_s.to_numpy(), slow.current_A.to_numpy()
    soc = first_soc - slow.discharged_Ah.to_numpy() / capacity_Ah
    voltage = slow.voltage_V.to_numpy() + current * np.interp(soc, R_INTS_SOC, tables["R_ints"])
    for resistances, tau_s in ((tables["R_TS"], tables["tau_S"]), (tables["R_TL"], tables["tau_L"])):
        voltage += relaxed(time_s, current * np.interp(soc, RC_SOC, resistances), tau_s)
    below_full = np.linalg.lstsq(
        weights(soc, OCV_SOC)[:, :-1], voltage - FULL_V * weights(soc, OCV_SOC)[:, -1], rcond=None
    )
    return np.append(below_full[0], FULL_V)


def noise(folder: Path) -> dict[str, float]:
    """Return the sd of each sensor's white noise, over the discharges, from second differences.

    The voltage answers part of the current's scatter, so that part is real: the rest is the current sensor's noise,
    and what the current does not explain is the voltage sensor's. Rounding (0.01 K) is taken off the temperature's.
    """
    variance = {"voltage_V": [], "current_A": [], "cell_temperature_degC": []}
    for name, _, _ in DISCHARGES:
        run = read(folder, name)
        first = run.iloc[1] - run.iloc[0]
        dV, dI, dT = (np.diff(run[c], 2)[5:-20] for c in ("voltage_V", "current_A", "temperature_degC"))
        slope = (dV @ dI) / (dI @ dI)
        real = slope / (first.voltage_V / first.current_A)
        variance["voltage_V"].append(np.var(dV - slope * dI) / 6.0)
        variance["current_A"].append(np.var(dI) / 6.0 * max(0.0, 1.0 - real))
        variance["cell_temperature_degC"].append(np.var(dT) / 6.0 - 0.01**2 / 12.0)
    return {column: float(np.sqrt(np.mean(values))) for column, values in variance.items()}


def write_run(folder: Path, name: str, every: int) -> pd.DataFrame:
    """Write the CSV of one discharge and return its rows."""
    run = read(folder, name)
    kept = (run.time_s <= 60.0) | (np.arange(len(run)) % every == 0) | (run.index == run.index[-1])
    air = run.ambient_temperature_degC.rolling(61, center=True, min_periods=1).mean()  # an input: noise is not wanted
    columns = {
        "time_s": run.time_s.map("{:.1f}".format),
        "current_A": run.current_A.map("{:.4f}".format),
        "ambient_degC": air.map("{:.2f}".format),
        "voltage_V": run.voltage_V.map("{:.4f}".format),
        "cell_temperature_degC": run.temperature_degC.map("{:.2f}".format),
    }
    pd.DataFrame(columns)[kept].to_csv(HERE / f"{name}.csv", index=False, lineterminator="\n")
    return run


def table(name: str, soc: np.ndarray, key: str, values: np.ndarray, digits: int) -> str:
    """Return the TOML of a curve over SOC, held from its lowest point down to SOC 0."""
    if soc[0] > 0.0:
        soc, values = np.insert(soc, 0, 0.0), np.insert(values, 0, values[0])
    rounded = [round(float(value), digits) for value in values]
    return f"\n[parameters.{name}]\nsoc = {soc.tolist()}\n{key} = {rounded}\n"


def main(folder: Path) -> None:
    """Write case.toml and the runs beside this script."""
    slow_Ah, above_Ah = full_charge(folder)
    capacity_Ah = slow_Ah + above_Ah
    R_TS, R_TL, tau_S, tau_L = rc_pairs(folder, capacity_Ah)
    C_TS, C_TL = tau_S / R_TS, tau_L / R_TL
    R_ints = series_resistance(folder, capacity_Ah, float(np.mean(1.0 / C_TS + 1.0 / C_TL)))
    tables = {"R_ints": R_ints, "R_TS": R_TS, "R_TL": R_TL, "tau_S": tau_S, "tau_L": tau_L}
    ocv = open_circuit_voltage(folder, capacity_Ah, 1.0 - above_Ah / capacity_Ah, tables)
    sensors = noise(folder)
    curves = table("ocv", OCV_SOC, "voltage_V", ocv, 4) + table("R_ints", R_INTS_SOC, "ohm", R_ints, 5)
    curves += table("R_TS", RC_SOC, "ohm", R_TS, 5) + table("C_TS", RC_SOC, "farad", C_TS, 0)
    curves += table("R_TL", RC_SOC, "ohm", R_TL, 5) + table("C_TL", RC_SOC, "farad", C_TL, 0)
    text = f"""# Written by make_case.py from the data named in README.md; CC BY-SA 4.0, see LICENSE-DATA.
title = "Samsung INR18650-30Q, one cell, 1C to 4C at room temperature"
kind = "cell"
preset = "paper"

[parameters]
capacity_Ah = {{ value = {capacity_Ah:.3f}, sd = 0.03 }}
series_resistance_scale = {{ value = 1.0, sd = 0.1 }}
rc_resistance_scale = {{ value = 1.0, sd = 0.3 }}
rc_capacitance_scale = {{ value = 1.0, sd = 0.3 }}
storage_months = 0
cycles = 0
{curves}
[sensors]
voltage_V = {sensors["voltage_V"]:.2g}
cell_temperature_degC = {sensors["cell_temperature_degC"]:.2g}
current_A = {sensors["current_A"]:.2g}
"""
    for name, every, split in DISCHARGES:
        run = write_run(folder, name, every)
        soc = np.interp(run.voltage_V[0], ocv, OCV_SOC)  # row 0 is still at rest
        text += f"""
[[runs]]
file = "{name}.csv"
split = "{split}"
label = "{run.current_A[1:].mean():.0f} A ({name.removeprefix("cc")}) to 2.5 V"
initial_soc = {{ value = {soc:.4f}, sd = 0.001 }}
"""
    (HERE / "case.toml").write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Derive case.toml and its runs from the measured data of cell 1.")
    parser.add_argument("source", type=Path, help="folder of the source data")
    main(parser.parse_args().source)
