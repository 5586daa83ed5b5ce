"""Residuals of one channel with the conditions of each reading, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]
Integers = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class ChannelResiduals:
    """Measured minus modelled readings of one channel, run after run, each in order of time.

    Attributes:
        channel: name of the column, as `voltage_V`.
        unit: unit of the errors.
        noise_sd: sd of the sensor noise in one reading; NaN if unknown.
        tolerance: acceptable RMS error; None if not stated.
        run: (n,) number of each reading's run, an index into `run_names`.
        run_names: names of the runs.
        time_s: (n,) times since the start of the run.
        weight_s: (n,) seconds that each reading represents, positive.
        error: (n,) measured minus modelled.
        conditions: by name, (n,) values at each reading.
    """

    channel: str
    unit: str
    noise_sd: float
    tolerance: float | None
    run: Integers
    run_names: tuple[str, ...]
    time_s: Floats
    weight_s: Floats
    error: Floats
    conditions: Mapping[str, Floats]

    def __post_init__(self) -> None:
        """Refuse columns of unequal length and missing readings: these are left out, not NaN."""
        columns = {"run": self.run, "time_s": self.time_s, "weight_s": self.weight_s, "error": self.error}
        for name, values in {**columns, **self.conditions}.items():
            if values.shape != self.error.shape:
                raise ValueError(f"{self.channel}: {name} has shape {values.shape}, the errors have {self.error.shape}")
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{self.channel}: {name} has missing values; leave those rows out")

    @property
    def runs(self) -> list[int]:
        """Return the numbers of the runs in which this channel was read."""
        return np.unique(self.run).tolist()

    @property
    def mean_square(self) -> float:
        """Return the mean square of the errors, weighted by time; 0 without readings."""
        return float(np.average(self.error**2, weights=self.weight_s)) if self.error.size else 0.0

    def rows(self, chosen: Bools) -> ChannelResiduals:
        """Return some of the readings."""
        return replace(
            self,
            run=self.run[chosen],
            time_s=self.time_s[chosen],
            weight_s=self.weight_s[chosen],
            error=self.error[chosen],
            conditions={name: values[chosen] for name, values in self.conditions.items()},
        )

    def less(self, explained: Floats) -> ChannelResiduals:
        """Return the residuals minus an explained part, (n,) in their unit."""
        return replace(self, error=self.error - explained)

    def time_blocks(self, per_run: int) -> Integers:
        """Cut every run into so many stretches of equal time; (n,) labels that increase from run to run."""
        labels = np.zeros(self.error.size, dtype=int)
        for place, number in enumerate(self.runs):
            mine = self.run == number
            since = self.time_s[mine] - self.time_s[mine].min()
            length = max(float(since.max()), 1e-12)
            labels[mine] = place * per_run + np.minimum((per_run * since / length).astype(int), per_run - 1)
        return labels
