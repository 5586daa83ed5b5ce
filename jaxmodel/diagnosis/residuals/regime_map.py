"""The residuals of one channel as means over ranges of two conditions, with the cell of each reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from jaxmodel.diagnosis.residuals.regimes import Bins, cut, regimes
from jaxmodel.diagnosis.residuals.table import ChannelResiduals, Floats, Integers

# Stretches of equal time per run where no condition varies materially.
_STRETCHES = 10
RUN, TIME = "run", "time_s"


@dataclass(frozen=True, eq=False)
class RegimeMap:
    """The residuals of one channel over ranges of two conditions.

    Attributes:
        channel: name of the column.
        unit: of the residuals.
        across: the ranges of the first condition, or of the time where no condition varies materially.
        along: the ranges of the second condition, or the runs where there is no second.
        mean: (along, across) time-weighted mean of measured minus modelled; NaN where nothing was read.
        rms: (along, across) time-weighted root mean square.
        seconds: (along, across) the time spent there.
        run: (n,) number of each reading's run, an index into `run_names`.
        run_names: names of the runs.
        time_s: (n,) times since the start of the run.
    """

    channel: str
    unit: str
    across: Bins
    along: Bins
    mean: Floats
    rms: Floats
    seconds: Floats
    run: Integers
    run_names: tuple[str, ...]
    time_s: Floats

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each cell with readings: the middle of both ranges, mean, rms and seconds."""
        along, across = np.nonzero(self.seconds > 0.0)
        return pd.DataFrame(
            {
                self.along.name: self.along.middle[along],
                self.across.name: self.across.middle[across],
                "mean": self.mean[along, across],
                "rms": self.rms[along, across],
                "seconds": self.seconds[along, across],
            }
        )

    def readings_of(self, along: int, across: int) -> Integers:
        """Return the places of the readings in one cell."""
        return np.flatnonzero((self.along.code == along) & (self.across.code == across))


def regime_map(residuals: ChannelResiduals) -> RegimeMap:
    """Return the map of a channel's residuals over the two conditions preferred in `regimes`."""
    cuts = [cut(residuals, name) for name in regimes(residuals).names[:2]]
    across = cuts[0] if cuts else _of_time(residuals)
    along = cuts[1] if len(cuts) > 1 else _of_runs(residuals)
    cell = along.code * across.count + across.code
    shape, count = (along.count, across.count), along.count * across.count

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(cell, residuals.weight_s * values, minlength=count), dtype=float).reshape(shape)

    seconds = total(np.ones(cell.size))
    with np.errstate(invalid="ignore"):
        mean, square = total(residuals.error) / seconds, total(residuals.error**2) / seconds
    return RegimeMap(
        residuals.channel,
        residuals.unit,
        across,
        along,
        mean,
        np.sqrt(square),
        seconds,
        residuals.run,
        residuals.run_names,
        residuals.time_s,
    )


def _of_runs(residuals: ChannelResiduals) -> Bins:
    """Return the runs as ranges."""
    numbers = np.array(residuals.runs, dtype=float)
    return Bins(RUN, "", numbers, numbers, numbers, np.searchsorted(numbers, residuals.run), True)


def _of_time(residuals: ChannelResiduals) -> Bins:
    """Return stretches of equal time, from the first to the last of any run."""
    edges = np.linspace(0.0, float(residuals.time_s.max()), _STRETCHES + 1)
    used, code = np.unique(np.searchsorted(edges[1:-1], residuals.time_s, side="right"), return_inverse=True)
    lower, upper = edges[used], edges[used + 1]
    return Bins(TIME, "s", lower, upper, 0.5 * (lower + upper), code, False)
