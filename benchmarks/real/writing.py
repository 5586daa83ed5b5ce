"""Cases as files: the TOML of curves and runs, and the CSV of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

# Points of the curves that are made from data; closer where open-circuit curves bend.
SOC = np.round(np.hstack([np.linspace(0, 0.1, 9), np.linspace(0.15, 0.9, 16), np.linspace(0.925, 1, 4)]), 4)
# File, ambient temperature in degC, whether it is fitted or kept as check.
Runs = tuple[tuple[str, int, str], ...]


def toml_table(name: str, key: str, values: np.ndarray, soc: np.ndarray = SOC) -> str:
    """Return the TOML of a curve over SOC."""
    return f"\n[parameters.{name}]\nsoc = {soc.tolist()}\n{key} = {[round(float(v), 5) for v in values]}\n"


def run_entry(name: str, split: str, label: str, more: str = "") -> str:
    """Return the TOML of one run."""
    return f'\n[[runs]]\nfile = "{name}.csv"\nsplit = "{split}"\nlabel = "{label}"\n{more}'


def initial_soc(value: float, sd: float = 0.01) -> str:
    """Return the TOML of the charge that a run begins with."""
    return f"initial_soc = {{ value = {value}, sd = {sd} }}\n"


def write_csv(path: Path, columns: dict[str, Any] | pd.DataFrame) -> None:
    """Write one run, rows in order of time, one row for each time."""
    rows = pd.DataFrame(columns).drop_duplicates("time_s").sort_values("time_s")
    rows.to_csv(path, index=False, lineterminator="\n")


def write_warm_run(
    out: Path,
    name: str,
    rows: pd.DataFrame,
    ambient_degC: Any,
    split: str,
    label: str,
    soc_sd: float = 0.01,
    soc: float = 1.0,
) -> str:
    """Write a run of a cell whose temperature was read too; return its TOML."""
    columns = {"time_s": rows.time_s, "current_A": rows.current_A, "ambient_degC": ambient_degC}
    readings = {"voltage_V": rows.voltage_V, "cell_temperature_degC": rows.temperature_degC}
    write_csv(out / f"{name}.csv", columns | readings)
    return run_entry(name, split, label, initial_soc(soc, soc_sd))


def write_toml(out: Path, text: str) -> None:
    """Write case.toml."""
    (out / "case.toml").write_text(text, encoding="utf-8", newline="\n")
