"""Write a case of real drive cycles for `jaxmodel estimate`: a Panasonic NCR18650PF cell from 25 to -20 degC.

The data are not part of this repository (licence not verified): P. Kollmeyer, Panasonic 18650PF Li-ion Battery Data,
Mendeley Data v1, DOI 10.17632/wykht8y7tg.1, as 1 s means. `examples/presets/make.sh` makes the preset. Call:

    python examples/state_of_charge/make_case.py FOLDER_OF_THE_DATA FOLDER_OF_THE_CASE PRESET.toml [--nominal]

PRESET.toml is where `make.sh` leaves it: the effects that its numbers are for are those of the `case.toml` beside it.

Runs NN (on which, with the pulse tests, the preset was fitted) are "fit": the filter is tuned on them. All others are
"check". The reference charge is that of the present cell: 1 - drawn/Q(day), drawn by the tester's count from the full
charge before the run, Q(day) the charge between full and empty at C/20 and 25 degC on the day of the run. Q was
measured once, on 8 May (the preset's capacity). Of before, nothing shows another: rests of the pulse test in March end
below the C/20 curve, not above it. After it, the cell lost in proportion to the days what a line through the tests that
end warm says: what each drew, and what the C/20 curve says was left at its voltage 5 minutes after. `capacity.csv` has
Q by run. An older cell relaxes more slowly, which counts as loss: the capacity has an sd of 2 % (assumed), and so the
charge drawn by it. `--nominal` counts by the preset's capacity on all days.
"""

from __future__ import annotations

import os
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel import preset_model

TUNED = ("drive_nn_p25degC", "drive_nn_p10degC", "drive_nn_p00degC", "drive_nn_n20degC")
JUDGED = (
    "drive_us06_p25degC", "drive_cycle1_p25degC", "drive_cycle3_p25degC", "drive_us06_p10degC", "drive_cycle1_p10degC",
    "drive_us06_p00degC", "drive_cycle1_p00degC", "drive_us06_n20degC", "drive_cycle1_n20degC",
    "trise_cycle1_from_p10degC", "trise_cycle1_from_n20degC",
)  # fmt: skip
FULL_ON_THE_LOOP = -1.0  # the branch of a charge, on which the loop of hysteresis begins
WARM = (
    "cc1C_p25degC_start1", "drive_cycle1_p25degC", "drive_cycle3_p25degC", "drive_us06_p25degC", "drive_nn_p25degC",
    "trise_cycle1_from_p10degC", "cc1C_p25degC_end1",
)  # fmt: skip
SLOW = "c20_ocv_p25degC"  # the test that measured the capacity
RESTED_S = 300.0  # after the load; how long all tests log
CAPACITY_SD = 0.02  # as a share; assumed
HEAD = """# Made by make_case.py; do not edit.
title = "Panasonic NCR18650PF, drive cycles from 25 to -20 degC"
kind = "cell"
"""


def main(source: Path, target: Path, preset: Path, *, nominal: bool) -> None:
    """Write `case.toml` and the runs."""
    target.mkdir(parents=True, exist_ok=True)
    capacity_Ah = float(preset_model(str(preset), "cell").parameters.capacity_Ah)
    capacities_Ah = _capacities_Ah(source, capacity_Ah)
    if nominal:
        capacities_Ah = dict.fromkeys(capacities_Ah, capacity_Ah)
    text = f'{HEAD}preset = "{Path(os.path.relpath(preset, target)).as_posix()}"\n\n[effects]\n'
    for name, numbers in tomllib.loads((preset.parent / "case.toml").read_text(encoding="utf-8"))["effects"].items():
        values = ", ".join(f"{key} = {_value(number)}" for key, number in numbers.items())
        text += f"{name} = {{ {values} }}\n"
    text += f"\n[parameters]\ncapacity_Ah = {{ value = {capacity_Ah}, sd = {CAPACITY_SD * capacity_Ah:.4f} }}\n"
    for name in (*TUNED, *JUDGED):
        rows = pd.read_csv(source / f"{name}.csv")
        drawn_Ah = rows.discharged_Ah - rows.discharged_Ah.iloc[0]
        chamber = rows.ambient_temperature_degC if "ambient_temperature_degC" in rows else rows.temperature_degC.iloc[0]
        columns = {
            "time_s": rows.time_s,
            "current_A": rows.current_A,
            "ambient_degC": chamber,
            "voltage_V": rows.voltage_V,
            "cell_temperature_degC": rows.temperature_degC,
            "soc": 1.0 - drawn_Ah / capacities_Ah[name],
        }
        pd.DataFrame(columns).to_csv(target / f"{name}.csv", index=False, float_format="%.6g")
        split = "fit" if name in TUNED else "check"
        text += f'\n[[runs]]\nfile = "{name}.csv"\nsplit = "{split}"\nlabel = "{name}"\n'
        text += f"initial_soc = 1.0\ninitial_hysteresis = {FULL_ON_THE_LOOP}\n"
    rows = [(name, f"{capacities_Ah[name]:.4f}") for name in (*TUNED, *JUDGED)]
    pd.DataFrame(rows, columns=["run", "capacity_Ah"]).to_csv(target / "capacity.csv", index=False)
    (target / "case.toml").write_text(text, encoding="utf-8")


def _value(number: object) -> object:
    """Return the value of a parameter that may have an sd beside it."""
    return number["value"] if isinstance(number, dict) else number


def _capacities_Ah(source: Path, on_the_day_of_slow_Ah: float) -> dict[str, float]:
    """Return the capacity on the day of each run."""
    days, slow = _days(source), pd.read_csv(source / f"{SLOW}.csv")
    slow = slow.iloc[: int(slow.discharged_Ah.argmax()) + 1].query("current_A > 0.05")
    left_Ah = slow.discharged_Ah.iloc[-1] - slow.discharged_Ah
    given = []
    for name in WARM:
        rows = pd.read_csv(source / f"{name}.csv")
        end_s = rows.time_s[rows.current_A.abs() > 0.05].iloc[-1] + RESTED_S
        rested_V = np.interp(end_s, rows.time_s, rows.voltage_V)
        drawn_Ah = rows.discharged_Ah.iloc[-1] - rows.discharged_Ah.iloc[0]
        given.append(drawn_Ah + np.interp(rested_V, slow.voltage_V[::-1], left_Ah[::-1]))
    age = {name: max((day - days[SLOW]).days, 0) for name, day in days.items()}
    slope, at_slow = np.polyfit([age[name] for name in WARM], given, 1)
    return {name: on_the_day_of_slow_Ah * (1.0 + slope / at_slow * of) for name, of in age.items()}


def _days(source: Path) -> dict[str, pd.Timestamp]:
    """Return the day of each run, with which the name of its source file begins (month-day-year)."""
    listed = pd.read_csv(source / "runs.csv")
    return {
        Path(file).stem: pd.to_datetime(of[:8], format="%m-%d-%y")
        for file, of in zip(listed.file, listed.source_file, strict=True)
    }


if __name__ == "__main__":
    source_, target_, preset_ = map(Path, sys.argv[1:4])
    main(source_, target_, preset_, nominal="--nominal" in sys.argv)
