"""The open-circuit voltage seen directly: slow branches, the gap between them, and rests of the same session."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jaxmodel.parameterisation.result import Extraction
from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.segments import rests, slow

SOC = np.linspace(0.0, 1.0, 101)
MIDDLE = (0.3, 0.7)  # where the gap between branches is read
RESTED_S = 600.0


def branches(runs: Sequence[Rows], capacity_Ah: float) -> pd.DataFrame:
    """Return the slow discharges and charges on one scale: run, soc, degC, voltage_V, branch, current_A."""
    found = []
    for rows in runs:
        for span in slow(rows, capacity_Ah):
            at = slice(span.first, span.last + 1)
            soc = rows.run.initial_soc.value - rows.drawn_Ah[at] / capacity_Ah
            branch = "discharge" if rows.current_A[span.first] > 0.0 else "charge"
            columns = {"run": rows.name, "soc": soc, "degC": rows.degC[at], "voltage_V": rows.voltage_V[at]}
            found.append(pd.DataFrame(columns | {"branch": branch, "current_A": rows.current_A[at]}))
    return pd.concat(found, ignore_index=True).dropna() if found else pd.DataFrame()


def rested(runs: Sequence[Rows], capacity_Ah: float) -> pd.DataFrame:
    """Return the last voltage of each long rest: run, time_s, soc, degC, voltage_V, rested_s."""
    found = []
    for rows in runs:
        for span in rests(rows, RESTED_S):
            last = span.last
            while last > span.first and not rows.read[last]:
                last -= 1
            soc = rows.run.initial_soc.value - rows.drawn_Ah[last] / capacity_Ah
            where = {"run": rows.name, "time_s": rows.time_s[last], "soc": soc, "degC": rows.degC[last]}
            still_s = rows.time_s[last] - rows.time_s[span.first]
            found.append(where | {"voltage_V": rows.voltage_V[last], "rested_s": still_s})
    return pd.DataFrame(found)


def hysteresis_gap(found: pd.DataFrame, ohm: float) -> list[Extraction]:
    """Return half of the gap between slow discharge and slow charge less the drop over a resistance, by temperature.

    V_charge - V_discharge = 2 M + 2 i ohm; the mean of both branches is the open-circuit voltage.
    """
    said = []
    if not len(found):
        return said
    for T, group in found.groupby((found["degC"] / 5.0).round() * 5.0):
        by_branch = {name: part.sort_values("soc") for name, part in group.groupby("branch")}
        if set(by_branch) != {"charge", "discharge"}:
            continue
        middle = SOC[(SOC >= MIDDLE[0]) & (SOC <= MIDDLE[1])]
        voltage = {name: np.interp(middle, part["soc"], part["voltage_V"]) for name, part in by_branch.items()}
        gap = voltage["charge"] - voltage["discharge"]
        drop = 2.0 * float(np.median(np.abs(group["current_A"].to_numpy()))) * ohm
        half = 0.5 * (float(np.median(gap)) - drop)
        runs = tuple(dict.fromkeys(group["run"]))
        method = "half of the gap between slow charge and discharge, less the drop over the resistance"
        samples = f"SOC {MIDDLE[0]:g} to {MIDDLE[1]:g}"
        sd = max(0.5 * float(np.std(gap)), 0.25 * drop, 5e-4)
        said.append(Extraction(f"hysteresis at {T:.0f} degC", half, sd, "V", runs, samples, method))
    return said
