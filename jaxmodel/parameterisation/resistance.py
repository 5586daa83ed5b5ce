"""The series resistance by the first sample after each step of the current."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jaxmodel.case.plausible.ranges import USUAL_OHM_AH
from jaxmodel.parameterisation.result import Extraction
from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.segments import steps


def step_resistances(runs: Sequence[Rows], capacity_Ah: float, noise_V: float) -> pd.DataFrame:
    """Return a row for each step: run, time_s, step_s, soc, degC, change_A, ohm, sd.

    ohm = -(V_k - V_(k-1)) / (i_k - i_(k-1)): it holds what the pairs have answered within the sample, so that it is an
    upper bound of R_0 which is the closer the faster the log.
    """
    tables = []
    for rows in runs:
        at = steps(rows)
        at = at[np.isfinite(rows.voltage_V[at]) & np.isfinite(rows.voltage_V[at - 1])]
        change = rows.current_A[at] - rows.current_A[at - 1]
        ohm = -(rows.voltage_V[at] - rows.voltage_V[at - 1]) / change
        soc = rows.run.initial_soc.value - rows.drawn_Ah[at] / capacity_Ah
        columns = {"time_s": rows.time_s[at], "step_s": np.diff(rows.time_s)[at - 1], "soc": soc, "degC": rows.degC[at]}
        columns |= {"change_A": change, "ohm": ohm, "sd": np.sqrt(2.0) * noise_V / np.abs(change)}
        tables.append(pd.DataFrame({"run": rows.name, **columns}))
    found = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    return found.query("ohm > 0.0").reset_index(drop=True) if len(found) else found


def typical_ohm(found: pd.DataFrame, capacity_Ah: float) -> float:
    """Return the resistance of a cell half full: the median of its steps there, or that of a cell of its capacity."""
    return median_ohm(_in_the_middle(found) if len(found) else found, capacity_Ah)


def median_ohm(found: pd.DataFrame, capacity_Ah: float) -> float:
    """Return the median resistance of some steps; without any that of a cell of its capacity."""
    return float(np.median(found["ohm"].to_numpy())) if len(found) else USUAL_OHM_AH / capacity_Ah


def _in_the_middle(found: pd.DataFrame) -> pd.DataFrame:
    """Return the steps away from empty and full, where the first sample after a step holds a part of the curve."""
    return found.query("0.3 <= soc <= 0.9")


def first_sample(found: pd.DataFrame) -> list[Extraction]:
    """Return the median resistance by rounded temperature, of the middle of the charge."""
    said = []
    if not len(found):
        return said
    groups = found.assign(T=(found["degC"] / 5.0).round() * 5.0)
    for T, group in groups.groupby("T"):
        middle = _in_the_middle(group)
        middle = middle if len(middle) >= 3 else group
        ohm = middle["ohm"].to_numpy()
        median = float(np.median(ohm))
        spread = float(1.2533 * 1.4826 * np.median(np.abs(ohm - median)) / np.sqrt(ohm.size))
        runs = tuple(dict.fromkeys(middle["run"]))
        samples = f"{len(middle)} steps of the current, {np.median(middle['step_s'].to_numpy()):.2g} s after each"
        name = f"first-sample resistance at {T:.0f} degC"
        said.append(
            Extraction(name, median, max(spread, 0.01 * median), "ohm", runs, samples, "voltage step over current step")
        )
    return said
