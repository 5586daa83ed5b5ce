"""Conditions of a run that no sensor measures."""

from __future__ import annotations

import numpy as np

from jaxmodel.case.records import Run

# A step of an input by more than this share of its range in the run is a change of load.
_CHANGE = 0.1


def time_since_load_changed(run: Run) -> np.ndarray:
    """Return the time since the load of a run last changed at each row, in s."""
    time_s = run.measured.time_s
    changed = np.zeros(time_s.size, dtype=bool)
    changed[0] = True
    for name, values in run.measured.inputs.items():
        if not name.endswith("degC"):
            changed |= np.abs(np.diff(values, prepend=values[0])) > _CHANGE * max(np.ptp(values), 1e-12)
    last = np.maximum.accumulate(np.where(changed, np.arange(time_s.size), 0))
    return time_s - time_s[last]
