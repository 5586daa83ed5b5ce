"""What held-out runs say of a model: additions that predict them worse leave it, and how wide its prediction is.

Nothing is fitted to held-out runs. They can only take away: a name that they contradict is not given.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jaxmodel.case.records import Run
from jaxmodel.diagnosis.advice.remarks import extrapolated
from jaxmodel.diagnosis.comparison import WORSE
from jaxmodel.diagnosis.result import ChannelError
from jaxmodel.diagnosis.rungs import evaluated_rows, rung, with_adjusted_starts
from jaxmodel.diagnosis.search import Found, Search
from jaxmodel.diagnosis.wording import amount
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.candidates import SHIFTED
from jaxmodel.fit.data import collect
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.gauss_newton import linearised
from jaxmodel.fit.likelihood import ChannelWeight, autocorrelation_time
from jaxmodel.fit.space import View

# Chi-square of a change of predictions from which held-out readings show whether it is true: 2 of 100 that are true do
# not lower it.
CHANGED = 16.0


def worse(
    cache: FitCache, before: Mapping[str, ChannelError], after: Mapping[str, ChannelError], beyond: float = 0.0
) -> dict[str, float]:
    """Return the channels of held-out runs that are predicted worse, if no other makes up for it.

    Args:
        cache: of the case.
        before: errors of a model, by channel.
        after: those of another.
        beyond: only errors above so many tolerances count as worse.

    Returns:
        By channel the rise of its RMS error, in tolerances.
    """
    changes = _changes(cache, before, after)
    if not sum(changes.values()) > WORSE:
        return {}
    return {
        name: change
        for name, change in changes.items()
        if change > WORSE and after[name].check > beyond * cache.tolerances[name]
    }


def _changes(
    cache: FitCache, before: Mapping[str, ChannelError], after: Mapping[str, ChannelError]
) -> dict[str, float]:
    """Return by how much the RMS error of each channel of held-out runs is larger after than before, in tolerances."""
    return {
        name: (one.check - before[name].check) / max(cache.tolerances[name], 1e-12)
        for name, one in after.items()
        if np.isfinite(one.check)
    }


def confirmed(search: Search, found: Found, keep: Sequence[str] = (), again: bool = True) -> Found:
    """Return what a search found without the additions that held-out runs contradict.

    Held-out runs are predicted worse with such an addition than without it, and not within the tolerance. Of runs
    within the fitted conditions less is enough: what it changes there must be seen there. An unknown law has no physics
    to speak for it: it leaves if they are not predicted better. What an addition kept out may be needed without it: the
    search begins again, once, and what it finds stays if held-out runs are predicted better with it.

    Args:
        search: that found it.
        found: its result.
        keep: additions that stay.
        again: whether to search for what an addition kept out.
    """
    cache, model, contradicted = search.cache, found.final.added, {}
    if all(run.split != "check" for run in cache.case.runs):
        return found
    while others := [label for label in model if label not in keep]:
        against = _in_vain(search, model, others) or _raising(search, model, others)
        if not against:
            break
        # A shift of one run says nothing of others: it goes before what acts in all.
        label = max(against, key=lambda one: (cache.space.candidates[one].group in SHIFTED, against[one][0]))
        cache.report(f"dropping {label}")
        contradicted[label] = dataclasses.replace(found.tests[label], held_out=against[label][1])
        model = tuple(one for one in model if one != label)
    if not contradicted:
        return found
    search = search.without(contradicted)
    lacking = search.found(model, (*found.path, model), found.refused)
    best = lacking
    if again and any(cache.space.candidates[label].group != "law" for label in contradicted):
        other = confirmed(search, search.run(keep), keep, again=False)
        before, after = (
            rung(cache, "", cache.fit(one.final.added, "all"), compared=True).errors for one in (lacking, other)
        )
        if sum(_changes(cache, before, after).values()) < -WORSE:
            best = other
    return dataclasses.replace(best, refused={**best.refused, **contradicted})


def _raising(search: Search, model: Sequence[str], others: Sequence[str]) -> dict[str, tuple[float, str]]:
    """Return the additions with which held-out runs are predicted worse beyond the tolerance: by how much, in words."""
    cache, against = search.cache, {}
    own = rung(cache, "", cache.fit(model, "all"), compared=True).errors
    beyond = any(one.check > cache.tolerances[name] for name, one in own.items())
    for label in others:
        group = cache.space.candidates[label].group
        is_law = group == "law"
        if not beyond and not is_law:
            continue  # within the tolerance no effect is contradicted
        rest = [one for one in model if one != label]
        lacking = rung(cache, "", cache.fit(rest, "all"), compared=True).errors
        channels = worse(cache, lacking, own, beyond=1.0)
        if channels and not is_law and group not in SHIFTED:
            # Without it a curve may be the same by another name: the activation energy of a resistance. Beside no such
            # curve, too, it must be contradicted. No curve is a shift of one run.
            with_it, without = (rung(cache, "", one, compared=True).errors for one in search.compared(model, label))
            channels = channels if worse(cache, without, with_it, beyond=1.0) else {}
        if channels:
            against[label] = max(channels.values()), _raises(list(channels), lacking, own)
        elif is_law and sum(_changes(cache, lacking, own).values()) > -WORSE:
            against[label] = 0.0, "no check run is predicted better with it"
    return against


def _in_vain(search: Search, model: Sequence[str], others: Sequence[str]) -> dict[str, tuple[float, str]]:
    """Return the additions that change predictions of held-out runs and make none better.

    With chi-square of the held-out readings and K that of the change d of their predictions, an addition that is true
    lowers chi-square by K, within 2 sqrt(K): it is contradicted if it does not, and K exceeds `CHANGED`. Held-out
    readings are weighted by what a model misses of them, if that is more than it misses of the fitted ones: a change
    that is small beside what else is missing there says nothing. Runs outside the conditions that were fitted are left
    out: there whatever else is off speaks louder.
    """
    cache, against = search.cache, {}
    outside = {one.file for one in extrapolated(cache.case)}
    runs = enumerate(cache.case.runs)
    inside = {number: run for number, run in runs if run.split == "check" and run.file not in outside}
    if not inside:
        return {}

    @functools.cache
    def predicted(fit: Fit) -> dict[str, dict[str, np.ndarray]]:
        return cache.space.predicted(fit.spec, with_adjusted_starts(cache, fit).x, list(inside))

    for label in others:
        richer, before = search.compared(model, label)
        gained, change = 0.0, 0.0
        for name, weight in richer.likelihood.channels.items():
            with_it, without = (_misses(cache, inside.values(), predicted(one), name) for one in (richer, before))
            if with_it:
                lowered, moved = _of_chi_square(weight, with_it, without)
                gained, change = gained + lowered, change + moved
        if change > CHANGED and gained < 0.0:
            against[label] = change, "it changes what is predicted of check runs, and predicts none of them better"
    return against


def _misses(
    cache: FitCache, runs: Iterable[Run], predictions: Mapping[str, Mapping[str, np.ndarray]], channel: str
) -> list[np.ndarray]:
    """Return measured minus predicted of a channel in each run that reads it, without the rows that are empty."""
    found = []
    for run in runs:
        if channel in run.measured.outputs:
            rows = evaluated_rows(run, cache.settings)
            missed = run.measured.outputs[channel][rows] - predictions[run.name][channel][rows]
            found.append(missed[np.isfinite(run.measured.outputs[channel][rows])])
    return [one for one in found if one.size]


def _of_chi_square(
    weight: ChannelWeight, with_it: Sequence[np.ndarray], without: Sequence[np.ndarray]
) -> tuple[float, float]:
    """Return by how much an addition lowers chi-square of a channel, and chi-square of the change of its predictions.

    Args:
        weight: of the channel in fitted runs.
        with_it: errors of held-out runs with the addition, by run.
        without: those without it.
    """
    squares = [sum(float(one @ one) for one in errors) for errors in (with_it, without)]
    left = min(squares) / sum(one.size for one in with_it)
    # Errors that last count as few readings: those of fitted runs may be noise where those of held-out runs are not.
    lasting = max(weight.inflation, autocorrelation_time(with_it if squares[0] < squares[1] else without))
    spread = max(weight.sd**2, left) * lasting
    moved = sum(float(np.sum((one - other) ** 2)) for one, other in zip(with_it, without, strict=True))
    return (squares[1] - squares[0]) / spread, moved / spread


def _raises(channels: Sequence[str], before: Mapping[str, ChannelError], after: Mapping[str, ChannelError]) -> str:
    """Say which errors on check runs rise, from what to what."""
    parts = []
    for name in channels:
        (low, high), unit = amount(name, [before[name].check, after[name].check])
        parts.append(f"{name} from {low} to {high} {unit}".rstrip())
    return f"on check runs it raises the error of {' and of '.join(parts)}"


def prediction_sd(
    cache: FitCache, fit: Fit, x: np.ndarray, models: Mapping[tuple[str, ...], float]
) -> dict[str, float]:
    """Return, by channel, the sd of a prediction of the check runs, as RMS over their readings.

    sqrt(J C J' + V), J the derivatives of the predictions by the unknowns, C their covariance, scaled to the sd that
    the runs show, and V the variance between the predictions of the models that the fit runs do not tell apart.

    Args:
        cache: of the case.
        fit: the model.
        x: (unknowns,) its coordinates, starts of check runs adjusted.
        models: by additions, the probabilities of the models that are not told apart; itself among them.
    """
    space, checks = cache.space, [number for number, run in enumerate(cache.case.runs) if run.split == "check"]
    data = collect(space.fitted, cache.noise, space.coarse.channels, checks, cache.settings)
    if not data.count:
        return {}
    view = View(space, data)
    _, jacobian = linearised(view, space.problem(fit.spec), fit.spec, x)
    scale = fit.sd / np.sqrt(np.diag(fit.covariance))
    moved = jacobian * scale
    variance = np.sum((moved @ fit.covariance) * moved, axis=1) + _between(cache, view, models)
    return {
        name: float(np.sqrt(np.mean(np.concatenate([variance[rows] for rows in slices]))))
        for name, slices in data.by_channel.items()
    }


def _between(cache: FitCache, view: View, models: Mapping[tuple[str, ...], float]) -> np.ndarray | float:
    """Return the variance between the predictions of some models, (readings,), each counted by its probability."""
    if len(models) < 2:
        return 0.0
    shares = np.array(list(models.values())) / sum(models.values())
    fits = [cache.fit(one) for one in models]
    predicted = np.stack(
        [view.at(cache.space.problem(one.spec), [one.spec.lane(with_adjusted_starts(cache, one).x)])[0] for one in fits]
    )
    return shares @ (predicted - shares @ predicted) ** 2
