"""The table of errors by run and channel, with sensor noise and tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pandas as pd

from discrepancy.residuals.table import ChannelResiduals

COLUMNS = (
    "run",
    "split",
    "channel",
    "unit",
    "readings",
    "rms",
    "mean",
    "max",
    "noise_sd",
    "rms_over_noise",
    "tolerance",
    "within_tolerance",
)


def error_table(
    channels: Sequence[ChannelResiduals], splits: Mapping[str, Literal["fit", "check"]] | None = None
) -> pd.DataFrame:
    """Return one row for each channel in each run.

    Args:
        channels: residuals of the channels, on fit and check runs.
        splits: by run name; "" in the table if not given.

    Returns:
        Columns `COLUMNS`: rms and mean over the readings, max the largest size, all in the channel's unit;
        within_tolerance is None where no tolerance is stated.
    """
    rows = [
        _row(channel, number, (splits or {}).get(channel.run_names[number], ""))
        for channel in channels
        for number in channel.runs
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _row(channel: ChannelResiduals, number: int, split: str) -> dict[str, object]:
    mine = channel.run == number
    error = channel.error[mine]
    rms = float(np.sqrt(np.mean(error**2)))
    tolerance = channel.tolerance
    return {
        "run": channel.run_names[number],
        "split": split,
        "channel": channel.channel,
        "unit": channel.unit,
        "readings": int(mine.sum()),
        "rms": rms,
        "mean": float(np.mean(error)),
        "max": float(np.abs(error).max()),
        "noise_sd": channel.noise_sd,
        "rms_over_noise": rms / channel.noise_sd if channel.noise_sd > 0.0 else float("nan"),
        "tolerance": float("nan") if tolerance is None else tolerance,
        "within_tolerance": None if tolerance is None else rms <= tolerance,
    }
