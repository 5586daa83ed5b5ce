"""The ladder of models: nominal, calibrated, with a first effect, with a second; each with its numbers and errors."""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted number with its standard deviation (of the fit, priors included) and unit."""

    value: float
    sd: float
    unit: str


@dataclasses.dataclass(frozen=True)
class ChannelError:
    """RMS of measured less predicted of one channel, in its unit, by split; NaN where there is none."""

    fit: float
    check: float


@dataclasses.dataclass(frozen=True)
class Rung:
    """One model of the ladder: nominal, calibrated, with a first effect, with a second.

    Attributes:
        name: how the ladder calls it.
        added: labels of the effects in it.
        estimates: calibrated numbers by name; per-run ones as 'initial_soc[run-01]'.
        at_bound: names of the estimates further than three of their prior's sd from it.
        errors: by channel.
        predictions: by run, then channel, at the rows of the run.
        chi2: of the whitened residuals of the fit runs.
        readings: how many these are.
    """

    name: str
    added: tuple[str, ...]
    estimates: dict[str, Estimate]
    at_bound: tuple[str, ...]
    errors: dict[str, ChannelError]
    predictions: dict[str, dict[str, np.ndarray]]
    chi2: float
    readings: int
