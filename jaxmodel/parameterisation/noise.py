"""Noise and rounding of the sensors, from the readings alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxmodel.case.records import Run
from jaxmodel.parameterisation.result import Extraction

MOST = 200_000
LEAST_ROWS = 20
LEAST_LEVELS = 10  # assumed


def rounding(values: np.ndarray) -> float:
    """Return the step to which readings are rounded, of which most changes are multiples; 0 if there is none.

    A few levels are rounded only if one follows the next: else they are what a programme of currents asks for.
    """
    there = values[np.isfinite(values)][:MOST]
    change = np.abs(np.diff(there))
    change = change[change > 1e-9]
    if change.size < LEAST_ROWS:
        return 0.0
    step = float(np.min(change))
    multiples = change / step
    if np.unique(there).size < LEAST_LEVELS and np.quantile(multiples, 0.9) > 1.5:
        return 0.0
    regular = np.mean(np.abs(multiples - np.round(multiples)) < 0.05)
    return step if regular > 0.9 and np.median(multiples) < 1e4 else 0.0


def white_noise(time_s: np.ndarray, values: np.ndarray, still: np.ndarray | None = None) -> float:
    """Return the sd of white noise: of second differences over sqrt(6), robust; NaN where there are too few rows.

    Args:
        time_s: of the readings.
        values: the readings.
        still: mask of rows at which the quantity itself hardly moves.
    """
    there = np.isfinite(values)
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    steps = np.diff(time_s)
    even = np.abs(steps[1:] - steps[:-1]) < 0.5 * np.minimum(steps[1:], steps[:-1]) + 1e-9
    good = there[2:] & there[1:-1] & there[:-2] & even
    if still is not None:
        good &= still[2:] & still[1:-1] & still[:-2]
    chosen = second[good][:MOST]
    if chosen.size < LEAST_ROWS:
        return float("nan")
    robust = 1.4826 * float(np.median(np.abs(chosen)))
    # Most second differences of a rounded, quiet reading are zero: then the median says nothing.
    return (robust if robust > 0.0 else float(np.sqrt(np.mean(np.clip(chosen, -1e3, 1e3) ** 2)))) / np.sqrt(6.0)


def sensor_noise(
    runs: Sequence[Run], column: str, unit: str, still: Sequence[np.ndarray] | None = None
) -> Extraction | None:
    """Return the noise sd of a column over some runs, at least that of its rounding; None where nothing tells."""
    found, names, steps = [], [], []
    for number, run in enumerate(runs):
        values = run.measured.outputs.get(column, run.measured.inputs.get(column))
        if values is None:
            continue
        mask = None if still is None else still[number]
        sd = white_noise(run.measured.time_s, values, mask)
        if np.isfinite(sd):
            found.append(sd)
            names.append(run.name)
        steps.append(rounding(values))
    step = float(np.median(steps)) if steps else 0.0
    sd = max(float(np.median(found)), step / np.sqrt(12.0)) if found else 0.0
    if not sd:
        return None  # readings that are all equal tell of no noise
    spread = max(float(np.std(found)), 0.2 * sd) if len(found) > 1 else 0.3 * sd
    said = "second differences where the reading is quiet" + (
        f"; readings are rounded to {step:.3g} {unit}" if step else ""
    )
    return Extraction(f"noise of {column}", sd, spread, unit, tuple(names), "evenly spaced readings", said)
