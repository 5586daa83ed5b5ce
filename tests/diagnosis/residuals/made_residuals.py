"""Residuals in closed form: runs at constant currents, or pulses at several temperatures, with a known error."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.signal import lfilter

from jaxmodel.diagnosis.residuals.table import ChannelResiduals

STEP_S = 2.0
CAPACITY_AH = 3.0
Error = Callable[[Mapping[str, np.ndarray], int], np.ndarray | float]


def noise(rng: np.random.Generator, rows: int, rho: float = 0.0) -> np.ndarray:
    """AR(1) noise of unit variance, stationary from its first value."""
    new = np.sqrt(1.0 - rho**2) * rng.standard_normal(rows)
    new[0] = rng.standard_normal()
    return lfilter([1.0], [1.0, -rho], new)


def constant_currents(
    error: Error,
    *,
    sd: float = 1e-3,
    rho: float = 0.9,
    seed: int = 0,
    rates: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0),
    **more,
) -> ChannelResiduals:
    """One full discharge at each rate, at a constant ambient temperature."""
    rng = np.random.default_rng(seed)
    runs = []
    for rate in rates:
        rows = int(3400.0 / rate / STEP_S)
        current = np.full(rows, rate * CAPACITY_AH)
        warm = lfilter([STEP_S / 900.0], [1.0, STEP_S / 900.0 - 1.0], 0.3 * current**2)
        runs.append(
            {
                "soc": 1.0 - np.cumsum(current) * STEP_S / 3600.0 / CAPACITY_AH,
                "current_A": current + 0.004 * rng.standard_normal(rows),
                "ambient_degC": 22.5 + 0.3 * rng.random() + 0.05 * rng.standard_normal(rows),
                "cell_temperature_degC": 22.5 + warm,
                "time_since_load_changed_s": STEP_S * np.arange(rows),
                "cycles": np.zeros(rows),
            }
        )
    return stacked(runs, error, sd, rho, rng, **more)


def pulses(
    error: Error,
    *,
    ambients: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0, 40.0),
    sd: float = 1e-3,
    rho: float = 0.9,
    seed: int = 0,
    charges: bool = False,
    rows: int = 1500,
    **more,
) -> ChannelResiduals:
    """One run of pulses at each ambient temperature."""
    rng = np.random.default_rng(seed)
    runs = []
    for ambient in ambients:
        current, since = np.zeros(rows), np.zeros(rows)
        row = 0
        while row < rows:
            length = int(rng.uniform(20.0, 150.0) / STEP_S)
            current[row : row + length] = rng.choice([0.0, 2.0, 4.0, 6.0, *([-3.0] if charges else [])])
            since[row : row + length] = (STEP_S * np.arange(length))[: rows - row]
            row += length
        warm = lfilter([STEP_S / 600.0], [1.0, STEP_S / 600.0 - 1.0], 0.25 * current**2)
        runs.append(
            {
                "soc": rng.uniform(0.85, 1.0) - np.cumsum(current) * STEP_S / 3600.0 / 3.5,
                "current_A": current + 0.004 * rng.standard_normal(rows),
                "ambient_degC": np.full(rows, ambient),
                "cell_temperature_degC": ambient + warm,
                "time_since_load_changed_s": since,
            }
        )
    return stacked(runs, error, sd, rho, rng, **more)


def stacked(
    runs: list[dict[str, np.ndarray]],
    error: Error,
    sd: float,
    rho: float,
    rng: np.random.Generator,
    *,
    channel: str = "voltage_V",
    unit: str = "V",
    noise_sd: float | None = None,
    tolerance: float | None = None,
) -> ChannelResiduals:
    """The runs one after another, their error with noise beside it."""
    sizes = [len(run["soc"] if "soc" in run else next(iter(run.values()))) for run in runs]
    errors = [error(run, k) + sd * noise(rng, size, rho) for k, (run, size) in enumerate(zip(runs, sizes, strict=True))]
    return ChannelResiduals(
        channel=channel,
        unit=unit,
        noise_sd=sd if noise_sd is None else noise_sd,
        tolerance=tolerance,
        run=np.repeat(np.arange(len(runs)), sizes),
        run_names=tuple(f"run-{k:02d}" for k in range(1, len(runs) + 1)),
        time_s=np.concatenate([STEP_S * np.arange(size) for size in sizes]),
        weight_s=np.full(sum(sizes), STEP_S),
        error=np.concatenate(errors),
        conditions={name: np.concatenate([run[name] for run in runs]) for name in runs[0]},
    )


def between(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """One where values lie in a range, zero elsewhere."""
    return ((values >= low) & (values < high)).astype(float)
