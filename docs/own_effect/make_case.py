"""Make a case whose truth holds the effect of examples/my_effects.py: `python docs/own_effect/make_case.py FOLDER`."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel import load_effect_class, read_case, simulate_case

EFFECT = Path(__file__).parents[2] / "examples" / "my_effects.py"
TRUTH = {"R_c": 0.015, "R_th": 40.0, "tau_c": 60.0}
NOISE_V = 0.001
CASE = f"""title = "Made: a hot contact"
kind = "cell"

[parameters]
capacity_Ah = {{ value = 5.2, sd = 0.05 }}
series_resistance_scale = {{ value = 1.0, sd = 0.1 }}
rc_resistance_scale = {{ value = 1.0, sd = 0.1 }}
storage_months = 0

[sensors]
voltage_V = {NOISE_V}
"""
RUN = '\n[[runs]]\nfile = "run-{0}.csv"\nsplit = "{1}"\ninitial_soc = {{ value = 0.95, sd = 0.01 }}\n'

folder = Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(3)
time = 2.0 * np.arange(401)
text = CASE
for number, split in enumerate(("fit", "fit", "check"), start=1):
    text += RUN.format(number, split)
    pulses = np.repeat(rng.choice([0.0, 1.0, 3.0, 6.0], 20), 21)[: time.size]
    columns = {"time_s": time, "current_A": pulses, "ambient_degC": 15.0 + 5.0 * number, "voltage_V": np.nan}
    pd.DataFrame(columns).to_csv(folder / f"run-{number}.csv", index=False)
(folder / "case.toml").write_text(text, encoding="utf-8")

own = load_effect_class(f"{EFFECT}:HotContact")
truth = dataclasses.replace(read_case(folder, own_effects=[own]), effects={own.name: TRUTH})
for outcome in simulate_case(truth):
    file = folder / outcome.run.file
    table = pd.read_csv(file)
    table["voltage_V"] = (outcome.table["voltage_V"] + NOISE_V * rng.standard_normal(time.size)).round(4)
    table.to_csv(file, index=False)
