"""A simulated cell as the case that a user would bring: noise, the sensor fault, the base's tables, stated numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.physics.base import OCV_SOC, RESISTANCE_SOC
from benchmarks.physics.draw import OIL_S, Recipe
from benchmarks.physics.sets import SETS
from benchmarks.physics.simulate import Simulated, SimulatedRun
from benchmarks.real.least_squares import relaxed
from benchmarks.real.writing import initial_soc, run_entry, write_csv, write_toml

# How well numbers are stated, as in the cases dfn-*; what is stated is drawn with half of it.
SOC_SD, CAPACITY_SD, SCALE_SD, OFFSET_SD_V = 0.005, 0.01, 0.15, 0.002
DRAWN_SHARE = 0.5
# Of the columns' last digit.
DIGITS = {"current_A": 4, "voltage_V": 4, "cell_temperature_degC": 2}
LABELS = {
    "pulses": "pulses of both signs",
    "discharge": "constant current",
    "loop": "out, charge, and back",
    "drive": "drive cycle",
}
COLUMN_OF = {
    "current_offset": "current_A",
    "current_gain": "current_A",
    "voltage_offset": "voltage_V",
    "temperature_lag": "cell_temperature_degC",
    "temperature_offset": "cell_temperature_degC",
}


def write_case(found: Simulated, folder: Path) -> None:
    """Write a case; one cell always gives the same files."""
    recipe, base = found.recipe, found.base
    rng = np.random.default_rng([recipe.seed, recipe.index, recipe.attempt, 1])
    folder.mkdir(parents=True, exist_ok=True)
    capacity = base.capacity_Ah * (1.0 + DRAWN_SHARE * CAPACITY_SD * rng.standard_normal())
    text = f"""title = "{title(recipe, base.capacity_Ah)}"
kind = "cell"
preset = "paper"

[parameters]
capacity_Ah = {{ value = {capacity:.5g}, sd = {CAPACITY_SD * capacity:.3g} }}
series_resistance_scale = {{ value = 1.0, sd = {SCALE_SD} }}
rc_resistance_scale = {{ value = 1.0, sd = {SCALE_SD} }}
rc_capacitance_scale = {{ value = 1.0, sd = {SCALE_SD} }}
ocv_offset_V = {{ value = 0.0, sd = {OFFSET_SD_V} }}
n_series = 1
cycles = 0
storage_months = 0
"""
    text += _table("ocv", "voltage_V", OCV_SOC, base.ocv_V)
    for values, unit in ((base.ohm, "ohm"), (base.farad, "farad")):
        text += "".join(_table(name, unit, RESISTANCE_SOC, value) for name, value in values.items())
    text += "\n[sensors]\n" + "".join(f"{column} = {sd:.4g}\n" for column, sd in recipe.noise.items())
    for number, run in enumerate(found.runs, start=1):
        name, soc = f"run-{number:02d}", run.first_soc + DRAWN_SHARE * SOC_SD * rng.standard_normal()
        label = f"{run.plan.ambient_degC:g} degC, {LABELS[run.plan.kind]}"
        text += run_entry(name, run.plan.split, label, initial_soc(round(float(soc), 4), SOC_SD))
        write_csv(folder / f"{name}.csv", columns(recipe, run, rng))
    write_toml(folder, text)


def columns(recipe: Recipe, run: SimulatedRun, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return what the logger has written of a run."""
    trace = run.trace
    true = {"current_A": trace.current_A, "voltage_V": trace.voltage_V}
    if recipe.thermometer:
        true["cell_temperature_degC"] = trace.temperature_degC
    read = {}
    for name, values in true.items():
        faulty = values
        if COLUMN_OF.get(recipe.fault) == name:
            faulty = misread(recipe.fault, recipe.fault_size, trace.time_s, values)
        noisy = faulty + recipe.noise[name] * rng.standard_normal(values.size)
        read[name] = np.round(noisy, DIGITS[name])
    ambient = np.full(trace.time_s.size, run.plan.ambient_degC)
    first = {"time_s": trace.time_s.round(3), "current_A": read.pop("current_A"), "ambient_degC": ambient}
    return first | read


def misread(fault: str, size: float, time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return what a sensor with a fault of the catalogue reads of true values."""
    if fault.endswith("_offset"):
        return values + size
    if fault.endswith("_gain"):
        return values * (1.0 + size)
    return relaxed(time_s, values, size, first=float(values[0]))


def title(recipe: Recipe, capacity_Ah: float) -> str:
    """Return what a user would call the case; nothing hidden is told."""
    where = "thermostat" if recipe.heat == "isothermal" else "oil bath" if recipe.cooling_s == OIL_S else "chamber"
    also = ", thermometer on the cell" if recipe.thermometer else ""
    return f"{SETS[recipe.parameter_set].chemistry}, {capacity_Ah:.3g} Ah, {where}{also}"


def _table(name: str, key: str, soc: np.ndarray, values: np.ndarray) -> str:
    shown = ", ".join(f"{value:.5g}" if key != "voltage_V" else f"{value:.5f}" for value in values)
    return f"{name} = {{ soc = {soc.tolist()}, {key} = [{shown}] }}\n"
