"""A made robot of known truth: random duty and load, as its own log would hold it."""

from __future__ import annotations

import numpy as np
import pandas as pd

from jaxmodel import Case, simulate_case

TRUE = {
    "capacity_Ah": 5.0,
    "R_0": 0.11,
    "k_tau": 0.037,
    "tau_0": 0.012,
    "R_wc": 1.3,
    "R_ca": 3.5,
    "onboard_current_A": 0.4,
}
EXACT = {"cycles": 100, "storage_months": 18, "storage_temperature_degC": 20, "tau_wc": 71.7, "tau_ca": 1370.0}
NOISE = {
    "pack_voltage_V": 0.012,
    "pack_current_A": 0.02,
    "motor_current_A": 0.02,
    "speed_rad_s": 0.5,
    "winding_temperature_degC": 0.15,
    "case_temperature_degC": 0.15,
}


def drive(seed: int, rows: int = 900, incline: bool = False) -> pd.DataFrame:
    """Random duty and load for 15 to 45 s each, with pauses; 1 s rows, 20 degC."""
    rng = np.random.default_rng(seed)
    blocks = [(60, 0.0, 0.0)]
    while sum(seconds for seconds, _, _ in blocks) < rows:
        moving = rng.random() < 0.8
        blocks.append((int(rng.integers(15, 45)), moving * rng.uniform(0.2, 0.9), moving * rng.uniform(0.05, 0.4)))
    seconds = [block[0] for block in blocks]
    duty, load = (np.repeat([block[place] for block in blocks], seconds)[:rows] for place in (1, 2))
    frame = pd.DataFrame({"time_s": np.arange(rows, dtype=float), "duty": duty, "load_torque_Nm": load})
    frame["ambient_degC"] = 20.0
    if incline:  # the same robot by its operator's signal and by the slope
        frame = frame.drop(columns=["duty", "load_torque_Nm"]).assign(V_set=2.5 + 2.5 * duty, incline_deg=60.0 * load)
    return frame


def robot(frames: dict[str, pd.DataFrame], readings=tuple(NOISE), check=(), effects: dict | None = None) -> Case:
    """Return a case with the noisy readings of the true robot, and rough parameters."""
    runs = {name: {"initial_soc": 1.0} for name in frames}
    truth = Case.from_dataframes(frames, kind="robot", parameters=TRUE | EXACT, runs=runs, effects=effects or {})
    rng, measured = np.random.default_rng(3), {}
    for one in simulate_case(truth):
        noisy = {name: one.table[name] + NOISE[name] * rng.standard_normal(len(one.table)) for name in readings}
        measured[one.run.name] = frames[one.run.name].assign(**noisy)
    rough = {name: (1.1 * value, 0.2 * value) for name, value in TRUE.items()}
    return Case.from_dataframes(
        measured,
        kind="robot",
        name="made",
        check=check,
        parameters=rough | {"capacity_Ah": TRUE["capacity_Ah"]} | EXACT,
        runs={name: {"initial_soc": (1.0, 0.005)} for name in frames},
    )
