"""Raw cases of cells: runs, kind and a nominal capacity, no tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel import Case, Table

START = (1.0, 0.01)
LOADED_A = 0.05


def frame(path: Path, ambient_degC: float | None) -> pd.DataFrame:
    """Return a log in the columns of a case; the chamber's own reading where no set point is given."""
    rows = pd.read_csv(path).drop_duplicates("time_s")
    found = pd.DataFrame({"time_s": rows.time_s - rows.time_s.iloc[0], "current_A": rows.current_A})
    found["voltage_V"] = rows.voltage_V
    if "temperature_degC" in rows:
        found["cell_temperature_degC"] = rows.temperature_degC
    return found.assign(ambient_degC=rows.ambient_temperature_degC if ambient_degC is None else float(ambient_degC))


def _cell(name: str, frames: dict[str, pd.DataFrame], check: list[str], nominal_Ah: float, empty: tuple = ()) -> Case:
    starts = {run: {"initial_soc": (0.0, 0.01) if run in empty else START} for run in frames}
    parameters = {"capacity_Ah": (nominal_Ah, 0.05 * nominal_Ah), "cycles": 0, "storage_months": 0}
    return Case.from_dataframes(frames, kind="cell", name=name, check=check, parameters=parameters, runs=starts)


def panasonic(source: Path) -> Case:
    """Fit: C/20 discharge and HPPC at four temperatures. Check: every drive cycle."""
    folder, degC = source / "panasonic_18650pf", {"p25": 25, "p10": 10, "p00": 0, "n20": -20}
    frames = {f"hppc_{key}": frame(folder / f"hppc_{key}degC.csv", T) for key, T in degC.items()}
    slow = frame(folder / "c20_ocv_p25degC.csv", 25)
    loaded = np.flatnonzero(slow.current_A > LOADED_A)
    end = int(loaded[0] + np.argmax(slow.current_A.to_numpy()[loaded[0] :] < LOADED_A))
    part = slow.iloc[loaded[0] - 2 : end + 20]
    frames["c20"] = part.assign(time_s=part.time_s - part.time_s.iloc[0])
    check = []
    for cycle in ("us06", "cycle1", "nn", "cycle3"):
        for key, T in degC.items():
            path = folder / f"drive_{cycle}_{key}degC.csv"
            if path.exists():
                frames[f"{cycle}_{key}"] = frame(path, T)
                check.append(f"{cycle}_{key}")
    return _cell("panasonic", frames, check, 2.9)


def samsung_pulses(source: Path) -> Case:
    """Fit: C/10 discharge, HPPC at 20 and 40 degC, 1C discharge. Check: 2C, 3C, 4C."""
    folder = source / "samsung_30q_18650"
    frames = {"c10": frame(folder / "cell1_c10_slow.csv", None)}
    for T in (20, 40):
        frames |= {f"hppc_{r}_p{T}": frame(folder / f"cell1_hppc_{r}_p{T}degC.csv", T) for r in ("0p5C", "1C", "2C")}
    frames |= {f"cc{rate}C": frame(folder / f"cell1_cc{rate}C.csv", None) for rate in (1, 2, 3, 4)}
    return _cell("samsung_30q, pulses", frames, ["cc2C", "cc3C", "cc4C"], 3.0)


def samsung_discharges(source: Path) -> Case:
    """Fit: C/10, 1C, 2C and 3C discharges. Check: 4C."""
    folder = source / "samsung_30q_18650"
    frames = {"c10": frame(folder / "cell1_c10_slow.csv", None)}
    frames |= {f"cc{rate}C": frame(folder / f"cell1_cc{rate}C.csv", None) for rate in (1, 2, 3, 4)}
    return _cell("samsung_30q, discharges", frames, ["cc4C"], 3.0)


def a123(source: Path) -> Case:
    """Fit: slow branches and dynamic profiles at 45 and 5 degC. Check: the dynamic profile at 25 degC."""
    folder, key = source / "a123_26650_plett", {45: "p45", 25: "p25", 5: "p05"}
    frames = {}
    for T in (45, 5):
        for way in ("discharge", "charge"):
            frames[f"slow_{way}_{key[T]}"] = frame(folder / f"ocv_slow_{way}_{key[T]}degC.csv", T)
    frames |= {f"dyn_{key[T]}": frame(folder / f"dyn_{key[T]}degC.csv", T) for T in (45, 5, 25)}
    return _cell("a123", frames, ["dyn_p25"], 2.05, tuple(name for name in frames if "_charge_" in name))


def lg_mj1(source: Path) -> Case:
    """Fit: pulses at 20 and 40 degC. Check: at 28 degC."""
    folder = source / "lg_mj1_18650"
    frames = {f"p{T}": frame(folder / f"pulse_10pctSOC_p{T}degC.csv", None) for T in (20, 28, 40)}
    return _cell("lg_mj1", frames, ["p28"], 3.5)


CELLS = {
    "panasonic": panasonic,
    "samsung_pulses": samsung_pulses,
    "samsung_discharges": samsung_discharges,
    "a123": a123,
    "lg_mj1": lg_mj1,
}
# The most that is asked of the error on check runs, in V, by the beginning or end of a run's name.
ASKED: Mapping[str, Mapping[str, float]] = {
    "panasonic": {"p25": 0.015, "p10": 0.015, "p00": 0.020, "n20": 0.035},
    "samsung_pulses": {"C": 0.015},
    "samsung_discharges": {"C": 0.015},
    "a123": {"p25": 0.010},
    "lg_mj1": {"p28": 0.010},
}


def with_simple_tables(case: Case, capacity_Ah: float) -> Case:
    """Return the case with what the reference needs besides: an open-circuit curve, by the slow discharge or rests."""
    fit = {run.name: run.to_dataframe() for run in case.runs if run.split == "fit"}
    slow = [name for name in fit if name.startswith(("c20", "c10", "slow"))]
    branches = []
    grid = np.linspace(0.0, 1.0, 101)
    for name in slow or list(fit)[:1]:
        rows, start = fit[name], 0.0 if "_charge_" in name else 1.0
        drawn = np.append(0.0, np.cumsum(np.diff(rows.time_s) * rows.current_A.to_numpy()[1:])) / 3600.0
        kept = (rows.current_A.abs() > LOADED_A).to_numpy() if slow else _rested(rows)
        order = np.argsort(start - drawn[kept])
        soc = (start - drawn[kept] / capacity_Ah)[order]
        branches.append(np.interp(grid, soc, rows.voltage_V.to_numpy()[kept][order]))
    known = dataclasses.replace(case.parameters["capacity_Ah"], value=capacity_Ah)
    tables = {"ocv": Table(grid, np.mean(branches, axis=0))}
    return dataclasses.replace(case, tables=tables, parameters=case.parameters | {"capacity_Ah": known})


def _rested(rows: pd.DataFrame) -> np.ndarray:
    """Return the mask of the last row of each rest."""
    still = (rows.current_A.abs() < LOADED_A).to_numpy()
    return still & ~np.append(still[1:], False)
