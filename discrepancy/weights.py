"""How readings are weighed where no model comes near the sensors' noise: by what the best model leaves."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from discrepancy.ladder import Rung
from discrepancy.noise import NoiseModel
from discrepancy.whitening import Floats
from jaxmodel.cases import Case

_LAGS = 60  # at which the memory of errors is looked for


def by_errors(noise: Mapping[str, NoiseModel], best: Rung) -> dict[str, NoiseModel]:
    """Weigh each channel by what a model leaves there: by their noise, a very fine sensor would decide everything."""
    return {
        name: dataclasses.replace(model, sd=max(model.sd, best.errors[name].fit), rho=0.0, from_inputs=0.0)
        for name, model in noise.items()
    }


def by_errors_and_time(noise: Mapping[str, NoiseModel], best: Rung, case: Case) -> dict[str, NoiseModel]:
    """Weigh a run by the time that it spans too, not by how often it was read.

    What a wrong model leaves hangs together over minutes: readings within these are one piece of evidence, and a run
    read every second would outweigh one read every minute.
    """

    def remembered(channel: str) -> float:
        read = [run for run in case.runs if run.split == "fit" and channel in run.measured.outputs]
        return memory(
            [(run.measured.time_s, run.measured.outputs[channel] - best.predictions[run.name][channel]) for run in read]
        )

    return {
        name: dataclasses.replace(model, memory_s=remembered(name)) for name, model in by_errors(noise, best).items()
    }


def memory(series: Sequence[tuple[Floats, Floats]]) -> float:
    """Return the time in which the correlation of a model's errors falls to 1/e, in seconds.

    Args:
        series: of each run, (n,) times in seconds, increasing, and (n,) measured less predicted, NaN where missing.

    Returns:
        The time, at most a quarter of the longest run; 0 where there is nothing to go by.
    """
    kept = [(time[np.isfinite(error)], error[np.isfinite(error)]) for time, error in series]
    kept = [(time, error) for time, error in kept if time.size > 1 and np.any(error)]
    if not kept:
        return 0.0
    longest = max(float(np.ptp(time)) for time, _ in kept) / 4.0
    shortest = min(float(np.median(np.diff(time))) for time, _ in kept)
    lags = np.geomspace(shortest, max(longest, shortest), _LAGS)
    correlation = np.array([_correlation(kept, lag) for lag in lags])
    faded = np.flatnonzero(correlation < np.exp(-1.0))
    return float(lags[faded[0]]) if faded.size else longest


def _correlation(series: Sequence[tuple[Floats, Floats]], lag: float) -> float:
    """Return the correlation of errors with those a lag later, all runs together; no mean is taken off them."""
    products, squares = 0.0, 0.0
    for time, error in series:
        now = time <= time[-1] - lag
        later = np.interp(time[now] + lag, time, error)
        products += float(np.sum(error[now] * later))
        squares += float(np.sum(error[now] ** 2 + later**2)) / 2.0
    return products / squares if squares > 0.0 else 0.0
