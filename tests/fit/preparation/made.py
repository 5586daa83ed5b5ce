"""A made run for the tests of preparation."""

import numpy as np

from jaxmodel.case.measurements import Measured


def drive(rows: int) -> Measured:
    """Return a drive cycle of a cell at 1 s: current that changes every second, with pauses."""
    rng = np.random.default_rng(1)
    time = np.arange(float(rows))
    current = 2.0 + 3.0 * rng.standard_normal(rows) * (np.sin(time / 97.0) > -0.3)
    voltage = 3.7 - 0.02 * current + 1e-3 * rng.standard_normal(rows)
    inputs = {"current_A": current, "ambient_degC": np.full(rows, 20.0)}
    return Measured(time, inputs, {"voltage_V": voltage})
