"""Write a case of real drive cycles for `jaxmodel estimate`: a Panasonic NCR18650PF cell from 25 to -20 degC.

The data are not part of this repository (licence not verified): P. Kollmeyer, Panasonic 18650PF Li-ion Battery Data,
Mendeley Data v1, DOI 10.17632/wykht8y7tg.1, as 1 s means. `examples/presets/make.sh` makes the preset. Call:

    python examples/state_of_charge/make_case.py FOLDER_OF_THE_DATA FOLDER_OF_THE_CASE PRESET.toml

Runs NN (on which, with the pulse tests, the preset was fitted) are "fit": the filter is tuned on them. All others are
"check". The reference charge is the tester's own count from the rest before the run, by the preset's capacity.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd

from jaxmodel import preset_model

TUNED = ("drive_nn_p25degC", "drive_nn_p10degC", "drive_nn_p00degC", "drive_nn_n20degC")
JUDGED = (
    "drive_us06_p25degC", "drive_cycle1_p25degC", "drive_cycle3_p25degC", "drive_us06_p10degC", "drive_cycle1_p10degC",
    "drive_us06_p00degC", "drive_cycle1_p00degC", "drive_us06_n20degC", "drive_cycle1_n20degC",
    "trise_cycle1_from_p10degC", "trise_cycle1_from_n20degC",
)  # fmt: skip
STANDING_A = 0.1  # below it the first row is at rest and gives the charge; else the cell is full, as for the preset
HEAD = """# Made by make_case.py; do not edit.
title = "Panasonic NCR18650PF, drive cycles from 25 to -20 degC"
kind = "cell"
"""


def main(source: Path, target: Path, preset: Path) -> None:
    """Write `case.toml` and the runs."""
    target.mkdir(parents=True, exist_ok=True)
    model = preset_model(str(preset), "cell")
    soc = np.linspace(0.0, 1.0, 101)
    ocv = np.array([float(model.curves.ocv(jnp.asarray(x), jnp.asarray(25.0))) for x in soc])
    text = f'{HEAD}preset = "{Path(os.path.relpath(preset, target)).as_posix()}"\n'
    for name in (*TUNED, *JUDGED):
        rows = pd.read_csv(source / f"{name}.csv")
        at_rest = abs(rows.current_A.iloc[0]) < STANDING_A
        first = float(np.interp(rows.voltage_V.iloc[0], ocv, soc)) if at_rest else 1.0
        drawn = rows.discharged_Ah - rows.discharged_Ah.iloc[0]
        chamber = rows.ambient_temperature_degC if "ambient_temperature_degC" in rows else rows.temperature_degC.iloc[0]
        columns = {
            "time_s": rows.time_s,
            "current_A": rows.current_A,
            "ambient_degC": chamber,
            "voltage_V": rows.voltage_V,
            "cell_temperature_degC": rows.temperature_degC,
            "soc": first - drawn / float(model.parameters.capacity_Ah),
        }
        pd.DataFrame(columns).to_csv(target / f"{name}.csv", index=False, float_format="%.6g")
        split = "fit" if name in TUNED else "check"
        text += f'\n[[runs]]\nfile = "{name}.csv"\nsplit = "{split}"\nlabel = "{name}"\ninitial_soc = {first:.4f}\n'
    (target / "case.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
