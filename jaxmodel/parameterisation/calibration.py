"""The calibration of a first case by the estimator of a diagnosis, its curves brought into its tables."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Sequence

import numpy as np

from jaxmodel.case.known import Known, Table
from jaxmodel.case.records import Case
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import Fit, calibrate, evidence, mean_squares
from jaxmodel.fit.estimates import Estimate, curves_of, estimates_of
from jaxmodel.fit.fitted_case import FittedNumbers, fitted_case
from jaxmodel.fit.gauss_newton import errors_at
from jaxmodel.parameterisation.thermal_start import bounded

# Which tables a scale multiplies.
SCALED = {
    "series_resistance_scale": ("R_ints",),
    "rc_resistance_scale": ("R_TS", "R_TL"),
    "rc_capacitance_scale": ("C_TS", "C_TL"),
}
# Every cell has charge transfer and diffusion beyond two RC pairs; they are stated where the data tell of them.
KINETICS = ("charge_transfer", "slow_diffusion")
# Log evidence from which kinetics are tried, by their score, and from which they are in: 20 to 1.
ODDS = 3.0
MOST_V_PER_K = 5e-4  # of the entropy (design)
NO_WORSE = 1.02  # how far a channel's error may grow over that of the first case, beyond its tolerance (design)
# Root mean square of the pulls of a fit, in sd, from which its numbers are against what is stated. Assumed.
FAR = 1.5
SHARE_SD = 0.3  # of the heat transfer beside a heat capacity that is held. Assumed.


@dataclasses.dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibrated case.

    Attributes:
        case: with all that was fitted in its numbers, effects and tables.
        cache: of its models.
        fit: the model.
        estimates: its numbers by name.
        notes: sentences on what the case holds in another way than the model.
    """

    case: Case
    cache: FitCache
    fit: Fit
    estimates: dict[str, Estimate]
    notes: tuple[str, ...]


def calibrated(first: Case, curves: Sequence[str], tell: Callable[[str], None]) -> Calibrated:
    """Return a case calibrated with its curves, which end in its tables, and with kinetics where the data tell of them.

    Where that leads to a heat capacity that no cell has, it is held at the nearest that cells have, as exact.

    Args:
        first: the case.
        curves: labels of the curves that may correct it.
        tell: called with each stage.
    """
    tell("calibration")
    kinetics = [one for one in KINETICS if one not in first.effects]
    cache = FitCache(first, only=(*curves, *kinetics))
    spec, stated = cache.flexible(cache.space.spec(curves)), np.zeros(cache.space.layout.size)
    fit = calibrate(cache.view, spec, stated, cache.tolerances)
    before = errors_at(cache.view, cache.space.problem(spec), spec, stated[None])[:, 0]
    held: Collection[str] = ()
    # Errors that last leave few independent readings. Where much is missed, their weight may fall from round to round
    # until they count for nothing beside what is stated: errors of a tolerance are the weights.
    worse = _worse(cache, fit, before)
    if of := _beyond(cache, fit):
        other = calibrate(cache.view, spec, stated, cache.tolerances, held=of)
        nearer = _worse(cache, fit, other.errors) and not _worse(cache, other, fit.errors)
        if worse or (nearer and _is_credible(other)):
            fit, held = other, of
    if _worse(cache, fit, before):
        held = list(cache.tolerances)
        fit = calibrate(cache.view, spec, stated, cache.tolerances, held=held)
    for gain in cache.scores_at(fit, ("effect",)).gains() if kinetics else ():
        if gain.log_evidence > ODDS:
            tell(f"calibration with {gain.label}")
            fit = _with_kinetics(cache, fit, gain.label, held)
    found = _baked(cache, fit)
    if "C_th" in first.effect_sd.get("self_heating", {}):
        C_read, hA_read = (float(found.case.effects["self_heating"][name]) for name in ("C_th", "hA"))
        C_th, hA = bounded(C_read, hA_read, found.case.parameters["capacity_Ah"].value)
        if C_th != C_read:
            sd = {"self_heating": {"hA": SHARE_SD * hA}} if "hA" in first.effect_sd["self_heating"] else {}
            rest = {name: of_effect for name, of_effect in first.effect_sd.items() if name != "self_heating"}
            effects = first.effects | {"self_heating": {"C_th": C_th, "hA": hA}}
            return calibrated(dataclasses.replace(first, effects=effects, effect_sd=rest | sd), curves, tell)
    return found


def _worse(cache: FitCache, fit: Fit, before: np.ndarray) -> list[str]:
    """Return the channels that pay for another: their error is larger than before, and beyond its tolerance.

    Args:
        cache: of the case.
        fit: the model.
        before: (readings,) errors of the first case.
    """
    then, now = mean_squares(cache.view, before), fit.mean_squares(cache.view)
    return [
        name
        for name, tolerance in cache.tolerances.items()
        if name in now and math.sqrt(now[name]) > max(NO_WORSE * math.sqrt(then[name]), tolerance)
    ]


def _is_credible(fit: Fit) -> bool:
    """Return whether a fit's numbers are on the whole within a few sd of what is stated of them."""
    return float(np.sqrt(np.mean(fit.pulls**2))) < FAR


def _beyond(cache: FitCache, fit: Fit) -> list[str]:
    """Return the channels whose error is beyond its tolerance."""
    squares = fit.mean_squares(cache.view)
    return [name for name, size in cache.tolerances.items() if math.sqrt(squares.get(name, 0.0)) > size]


def _with_kinetics(cache: FitCache, before: Fit, label: str, held: Collection[str]) -> Fit:
    """Return a model with charge transfer or diffusion too, if it has more evidence under the weights of either.

    Args:
        cache: of the case.
        before: the model without it.
        label: of the effect.
        held: channels whose weights stay.
    """
    space = cache.space
    spec = space.spec((*before.spec.labels, label), before.spec.amplitudes, before.spec.spreads)
    start = cache.with_probe(spec, before.likelihood, before.x, label)
    richer = calibrate(cache.view, spec, start, cache.tolerances, before.likelihood, held=held)
    weights = (before.likelihood, richer.likelihood)
    gains = [evidence(cache.view, richer, one) - evidence(cache.view, before, one) for one in weights]
    return richer if min(gains) > ODDS else before


def _baked(cache: FitCache, fit: Fit) -> Calibrated:
    """Return the case with the fitted numbers, its curves and scales in the tables; what is stated as exact stays."""
    estimates, _ = estimates_of(cache, fit)
    fitted = FittedNumbers(estimates)
    case, notes = fitted_case(cache.case, fitted, fit.added, curves_of(cache, fit), between=False)
    tables, parameters = dict(case.tables), dict(case.parameters)
    for name, scaled in SCALED.items():
        if name in estimates and all(tables[one].sd is not None for one in scaled if one in tables):
            known = parameters[name]
            for table in (one for one in scaled if one in tables):
                tables[table] = dataclasses.replace(tables[table], values=known.value * tables[table].values)
            parameters[name] = Known(1.0, None if known.sd is None else known.sd / known.value)
    # The knots of a curve are those of its table but for how charge is counted.
    tables = {name: _at_knots(table, cache.case.tables[name].soc) for name, table in tables.items()}
    if "dU_dT" in tables and tables["dU_dT"].sd is not None:
        values = np.clip(tables["dU_dT"].values, -MOST_V_PER_K, MOST_V_PER_K)
        tables["dU_dT"] = dataclasses.replace(tables["dU_dT"], values=values)
    case = dataclasses.replace(case, tables=tables, parameters=parameters)
    return Calibrated(_as_full_as_stated(case, cache.case), cache, fit, estimates, (*fitted.notes, *notes))


def _as_full_as_stated(case: Case, first: Case) -> Case:
    """Return the case with all starts and tables moved along the charge together, to where starts are as stated.

    That moves no prediction. A start approaches full without reaching it, so that all that are full would lie below it,
    and a run that was not fitted, which starts full, not.
    """
    stated = {run.name: run.initial_soc.value for run in first.runs if run.split == "fit" and run.initial_soc.sd}
    starts = {run.name: run.initial_soc.value for run in case.runs if run.name in stated}
    if not starts or any(table.sd is None for table in case.tables.values()):
        return case
    off = float(np.mean([stated[name] - now for name, now in starts.items()]))
    move = float(np.clip(off, -min(starts.values()), 1.0 - max(starts.values())))
    runs = [
        dataclasses.replace(run, initial_soc=dataclasses.replace(run.initial_soc, value=starts[run.name] + move))
        if run.name in starts
        else run
        for run in case.runs
    ]
    tables = {}
    for name, table in case.tables.items():
        soc = table.soc + move
        tables[name] = _at_knots(dataclasses.replace(table, soc=soc), np.unique(np.clip(soc, 0.0, 1.0)))
    return dataclasses.replace(case, runs=tuple(runs), tables=tables)


def _at_knots(table: Table, soc: np.ndarray) -> Table:
    """Return a table at other knots."""
    rows = [np.interp(soc, table.soc, row) for row in np.atleast_2d(table.values)]
    return dataclasses.replace(table, soc=soc, values=np.array(rows) if table.values.ndim > 1 else rows[0])
