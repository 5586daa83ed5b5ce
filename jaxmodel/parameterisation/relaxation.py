"""RC pairs from single rests, by variable projection: V = V_end - a_1 exp(-t / tau_1) - a_2 exp(-t / tau_2)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.optimize import nnls

from jaxmodel.parameterisation.result import Extraction
from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.segments import rests

LEAST_S, LEAST_ROWS, LEAST_V = 120.0, 8, 0.003
GRID_S = np.geomspace(1.0, 3000.0, 33)
MOST_RESTS = 60


def relaxations(runs: Sequence[Rows], capacity_Ah: float) -> pd.DataFrame:
    """Return a row for each rest after a discharge: run, time_s, soc, degC, V_end, tau_1, tau_2, a_1, a_2, rms.

    The linear part (V_end and amplitudes, not negative) is solved for each pair of time constants of a grid.
    """
    found = []
    for rows in runs:
        spans = [span for span in rests(rows, LEAST_S) if rows.current_A[span.first] > rows.resting_A]
        for span in spans[:: max(1, len(spans) * len(runs) // MOST_RESTS)]:
            at = np.arange(span.first + 1, span.last + 1)
            at = at[rows.read[at]]
            if at.size < LEAST_ROWS or np.ptp(rows.voltage_V[at]) < LEAST_V:
                continue
            time = rows.time_s[at] - rows.time_s[span.first]
            fit = _two_exponentials(time, rows.voltage_V[at])
            soc = rows.run.initial_soc.value - rows.drawn_Ah[span.first] / capacity_Ah
            where = {"run": rows.name, "time_s": rows.time_s[span.first], "end_s": rows.time_s[span.last], "soc": soc}
            found.append(where | {"degC": rows.degC[span.first], **fit})
    return pd.DataFrame(found)


def _two_exponentials(time: np.ndarray, voltage: np.ndarray) -> dict[str, float]:
    weight = np.sqrt(np.gradient(np.log(np.maximum(time, 0.1)))) if time.size > 2 else np.ones(time.size)
    inside = GRID_S[(GRID_S > 0.5 * time[0]) & (GRID_S < time[-1])]
    best = (math.inf, 1.0, 1.0, np.zeros(3))
    top = float(np.max(voltage)) + 0.5
    for number, short in enumerate(inside):
        for long in inside[number + 3 :]:
            matrix = np.column_stack([np.ones(time.size), np.exp(-time / short), np.exp(-time / long)])
            values, left = nnls(matrix * weight[:, None], (top - voltage) * weight)
            if left < best[0]:
                best = (left, short, long, values)
    left, short, long, values = best
    rms = float(left / np.sqrt(np.sum(weight**2)))
    return {"V_end": top - values[0], "tau_1": short, "tau_2": long, "a_1": values[1], "a_2": values[2], "rms": rms}


def time_constants(found: pd.DataFrame) -> list[Extraction]:
    """Return the median time constants of the rests, with the spread of single rests as sd of the mean."""
    said = []
    for name in ("tau_1", "tau_2"):
        if not len(found):
            break
        logs = np.log(found[name].to_numpy(dtype=float))
        value = float(np.exp(np.median(logs)))
        sd = value * float(np.std(logs)) / math.sqrt(len(logs)) if len(logs) > 1 else math.nan
        runs = tuple(dict.fromkeys(found["run"]))
        which = "short" if name == "tau_1" else "long"
        said.append(
            Extraction(
                f"time constant of rests, {which}",
                value,
                sd,
                "s",
                runs,
                f"{len(found)} rests",
                "two exponentials by variable projection",
            )
        )
    return said
