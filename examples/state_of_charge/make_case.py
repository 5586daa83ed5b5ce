"""Write a case of real drive cycles for `jaxmodel estimate`: a Panasonic NCR18650PF cell from 25 to -20 degC.

The data are not part of this repository (licence not verified): P. Kollmeyer, Panasonic 18650PF Li-ion Battery Data,
Mendeley Data v1, DOI 10.17632/wykht8y7tg.1, as 1 s means. `examples/presets/make.sh` makes the preset. Call:

    python examples/state_of_charge/make_case.py FOLDER_OF_THE_DATA FOLDER_OF_THE_CASE PRESET.toml

PRESET.toml is where `make.sh` leaves it: the effects that its numbers are for are those of the `case.toml` beside it.

Runs NN (on which, with the pulse tests, the preset was fitted) are "fit": the filter is tuned on them. All others are
"check". The reference charge is the tester's own count from the full charge before the run, by the preset's capacity.
The cell lost capacity while it was tested: `capacity.csv` has the share that was left on the day of each run by the two
1C tests, in proportion to the days between them. The truth is between it and 1: the loss at 1C is in part one of
resistance.
"""

from __future__ import annotations

import os
import sys
import tomllib
from pathlib import Path

import pandas as pd

from jaxmodel import preset_model

TUNED = ("drive_nn_p25degC", "drive_nn_p10degC", "drive_nn_p00degC", "drive_nn_n20degC")
JUDGED = (
    "drive_us06_p25degC", "drive_cycle1_p25degC", "drive_cycle3_p25degC", "drive_us06_p10degC", "drive_cycle1_p10degC",
    "drive_us06_p00degC", "drive_cycle1_p00degC", "drive_us06_n20degC", "drive_cycle1_n20degC",
    "trise_cycle1_from_p10degC", "trise_cycle1_from_n20degC",
)  # fmt: skip
FULL_ON_THE_LOOP = -1.0  # the branch of a charge, on which the loop of hysteresis begins
FIRST_AH, LAST_AH = 2.798, 2.434  # what the 1C tests gave on the first day and on the last
HEAD = """# Made by make_case.py; do not edit.
title = "Panasonic NCR18650PF, drive cycles from 25 to -20 degC"
kind = "cell"
"""


def main(source: Path, target: Path, preset: Path) -> None:
    """Write `case.toml` and the runs."""
    target.mkdir(parents=True, exist_ok=True)
    capacity_Ah = float(preset_model(str(preset), "cell").parameters.capacity_Ah)
    days = _days(source)
    text = f'{HEAD}preset = "{Path(os.path.relpath(preset, target)).as_posix()}"\n\n[effects]\n'
    for name, numbers in tomllib.loads((preset.parent / "case.toml").read_text(encoding="utf-8"))["effects"].items():
        values = ", ".join(f"{key} = {_value(number)}" for key, number in numbers.items())
        text += f"{name} = {{ {values} }}\n"
    of_the_day = []
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
            "soc": 1.0 - drawn_Ah / capacity_Ah,
        }
        pd.DataFrame(columns).to_csv(target / f"{name}.csv", index=False, float_format="%.6g")
        age = (days[name] - days["cc1C_p25degC_start1"]) / (days["cc1C_p25degC_end1"] - days["cc1C_p25degC_start1"])
        of_the_day.append((name, 1.0 - age * (1.0 - LAST_AH / FIRST_AH)))
        split = "fit" if name in TUNED else "check"
        text += f'\n[[runs]]\nfile = "{name}.csv"\nsplit = "{split}"\nlabel = "{name}"\n'
        text += f"initial_soc = 1.0\ninitial_hysteresis = {FULL_ON_THE_LOOP}\n"
    pd.DataFrame(of_the_day, columns=["run", "capacity_of_the_day"]).to_csv(target / "capacity.csv", index=False)
    (target / "case.toml").write_text(text, encoding="utf-8")


def _value(number: object) -> object:
    """Return the value of a parameter that may have an sd beside it."""
    return number["value"] if isinstance(number, dict) else number


def _days(source: Path) -> dict[str, pd.Timestamp]:
    """Return the day of each run, with which the name of its source file begins (month-day-year)."""
    listed = pd.read_csv(source / "runs.csv")
    return {
        Path(file).stem: pd.to_datetime(of[:8], format="%m-%d-%y")
        for file, of in zip(listed.file, listed.source_file, strict=True)
    }


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
