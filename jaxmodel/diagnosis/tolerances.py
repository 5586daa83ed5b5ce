"""Tolerances on check runs, stated by the case or assumed, and whether the final model is within them."""

from __future__ import annotations

from jaxmodel.diagnosis.result import Rung, ToleranceUsed
from jaxmodel.fit.cache import FitCache


def tolerances(cache: FitCache) -> dict[str, ToleranceUsed]:
    """Return the tolerance of every channel."""
    stated = cache.case.tolerance
    return {
        name: ToleranceUsed(stated[name].rms, stated[name].max, False)
        if name in stated
        else ToleranceUsed(cache.assumed_tolerance(name), None, True)
        for name in cache.noise
    }


def fit_for_purpose(cache: FitCache, last: Rung) -> dict[str, dict[str, bool]]:
    """Return, by channel and check run, whether a model's error is within the tolerance, stated or assumed."""
    found: dict[str, dict[str, bool]] = {}
    for name, tolerance in tolerances(cache).items():
        for run in cache.case.runs:
            error = last.by_run[name].get(run.name)
            if run.split != "check" or error is None:
                continue
            own = run.tolerance.get(name)
            limit = own.max if own is not None else tolerance.largest
            within = error.rms <= (own.rms if own is not None else tolerance.rms)
            found.setdefault(name, {})[run.name] = within and (limit is None or error.worst <= limit)
    return found
