"""`compare` and `diagnose`: from a case to its diagnosis."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from scipy.special import softmax

from jaxmodel.base.errors import EffectError
from jaxmodel.base.progress import Stage, stages
from jaxmodel.base.remark import Remark
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.advice import remarks as remarks
from jaxmodel.diagnosis.advice.law_file import law_file
from jaxmodel.diagnosis.advice.next_experiment import best_of_each, propose
from jaxmodel.diagnosis.comparison import Test
from jaxmodel.diagnosis.decision import ChannelEvidence, Evidence, decide
from jaxmodel.diagnosis.findings import (
    all_curves,
    curve_found,
    law_found,
    run_found,
    specimen_found,
    unknown_sentence,
)
from jaxmodel.diagnosis.held_out import confirmed, prediction_sd, worse
from jaxmodel.diagnosis.residuals.statements import Account, account
from jaxmodel.diagnosis.residuals.table import ChannelResiduals
from jaxmodel.diagnosis.result import (
    ChannelError,
    CurveFound,
    Diagnosis,
    Extrapolated,
    Immaterial,
    NamedEffect,
    Remaining,
    Removed,
    Rung,
    ScoreEntry,
    Sensor,
)
from jaxmodel.diagnosis.rungs import AdjustedStarts, errors_by_run, nominal, residuals_of, rung, with_adjusted_starts
from jaxmodel.diagnosis.search import KINETICS, Found, Search
from jaxmodel.diagnosis.tolerances import fit_for_purpose, tolerances
from jaxmodel.diagnosis.wording import effect_name
from jaxmodel.effects.curves import CURVES
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.distinguishable import is_distinguishable
from jaxmodel.fit.estimate import NONE, Fit
from jaxmodel.fit.lanes import one_thread_of_blas
from jaxmodel.fit.space import Labels

SOMETHING_ELSE = "something_else"
# Usual share of the work that is done when each part of a diagnosis starts. Assumed; the number of rounds varies.
DONE_BY = {"calibrating": 0.0, "refitting": 0.35, "adding": 0.5, "comparing models": 0.85}
# Probability of a cause that was not tested, where all errors are noise and where some are left. Assumed.
UNTESTED, UNTESTED_WITH_ERROR_LEFT = 0.01, 0.05
# A model more probable than this is a rival; an experiment is proposed for at most so many.
RIVAL, MOST_RIVALS = 0.05, 3
# An error that exceeds the noise by less than this is noise.
ABOVE_NOISE = 1.1
# Share of its usual size from which the correction of a formula stands for something unknown (design).
USUAL_SHARE = 1.0 / 3.0


@one_thread_of_blas
def compare(case: Case, *, progress: bool | Stage = True) -> Diagnosis:
    """Calibrate a case's model and compare it with the measurements, without testing any candidate.

    Args:
        case: with at least one fit run.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with what is
            done next.

    Raises:
        FitError: nothing is uncertain, or no run may be used to calibrate.
    """
    with stages(progress, case.name) as tell:
        return comparison(FitCache(case, progress=tell))


def comparison(cache: FitCache) -> Diagnosis:
    """Return the calibrated base model of an investigation as a diagnosis that tests no candidate."""
    cache.report("calibrating the base model")
    fit = cache.calibrated
    adjusted = with_adjusted_starts(cache, fit)
    ladder = (nominal(cache), rung(cache, "calibrated", fit, adjusted))
    left = residuals_of(cache, ladder[-1])
    remaining = _remaining(cache, fit, ladder[-1], left)
    return Diagnosis(
        case=cache.case,
        verdict="",
        effects=(),
        candidates=(),
        unexplained=None,
        blind_to=(),
        noise=_sensors(cache),
        ladder=ladder,
        scores=(),
        critical_z=float("nan"),
        remarks=_remarks(cache, fit, adjusted, ladder, ()),
        remaining=remaining,
        extrapolated=remarks.extrapolated(cache.case),
        tolerance=tolerances(cache),
        where_base={name: one.where for name, one in remaining.items()},
        errors=errors_by_run(cache, {"base": ladder[-1]}),
    )


@one_thread_of_blas
def diagnose(
    case: Case,
    *,
    add: Sequence[str] = (),
    with_effects: Sequence[str] = (),
    without: Sequence[str] = (),
    progress: bool | Stage = True,
) -> Diagnosis:
    """Find which physical effect or sensor fault a case's model lacks, which tables are wrong, and what error remains.

    Args:
        case: with at least one fit run.
        add: names of effects that are added whatever the data show; no other candidate is tested.
        with_effects: the same, but other candidates are tested too.
        without: names of effects that are ruled out.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with what is
            done next.

    Raises:
        FitError: nothing is uncertain, or no run may be used to calibrate.
        EffectError: a name that is no candidate of this case, or a sensor's effect without its column.
    """
    ordered = (
        *(f"--add {n}" for n in add),
        *(f"--with {n}" for n in with_effects),
        *(f"--without {n}" for n in without),
    )
    with stages(progress, case.name, DONE_BY) as tell:
        cache = FitCache(case, without=without, progress=tell)
        if add and with_effects:
            raise EffectError("--add tests no other candidate and --with does; give all effects with one of the two.")
        wanted = cache.space.labels_to_add([*add, *with_effects])
        search = Search(cache)
        return conclude(search, search.run(wanted, seek=not add), wanted, ordered)


def conclude(search: Search, found: Found, wanted: Sequence[str] = (), ordered: Sequence[str] = ()) -> Diagnosis:
    """Return the diagnosis of a finished search."""
    cache = search.cache
    cache.report("comparing models")
    found = confirmed(search, found, wanted)
    labels = found.final.added
    last_fit = cache.fit(labels, "all")
    adjusted = with_adjusted_starts(cache, last_fit)
    ladder = [nominal(cache), rung(cache, "calibrated", cache.calibrated)]
    steps = [path for path in found.path if path and path != labels]
    ladder += [rung(cache, f"with {' + '.join(path)}", cache.fit(path), compared=True) for path in steps]
    final = rung(cache, f"with {' + '.join(labels) or 'corrected tables'}", last_fit, adjusted)
    hypotheses = _hypotheses(search, found)
    likely = {model: p for model, p in sorted(hypotheses.items(), key=lambda one: -one[1]) if p > RIVAL}
    stays = not wanted and bool(worse(cache, ladder[0].errors, final.errors))
    if stays:
        final = dataclasses.replace(ladder[0], name="as stated")
    else:
        final = final.with_prediction_sd(prediction_sd(cache, last_fit, adjusted.x, likely))
    curves_differ = any(amplitude > NONE for amplitude in last_fit.spec.amplitudes.values())
    if labels or curves_differ or stays:
        ladder.append(final)
    last = ladder[-1]
    left = {"base": residuals_of(cache, ladder[1]), "final": residuals_of(cache, last)}
    groups = {label: cache.space.candidates[label].group for label in labels}
    removes = _removes(search, labels)
    is_effect = [label for label in labels if groups[label] in ("effect", "sensor")]
    order = sorted(is_effect, key=lambda label: -found.tests[label].gain)
    of_specimens = [label for label in labels if groups[label] == "specimen"]
    differ = [label for label in of_specimens if found.tests[label].named or label in wanted]
    named = [] if stays else [label for label in order if found.tests[label].named or label in wanted]
    laws = [law_found(cache, found.final, label, removes[label]) for label in labels if groups[label] == "law"]
    tests = search.curves(found.final)
    curves = tuple(
        curve_found(cache, found.final, label, {})
        for label, test in tests.items()
        if CURVES[label].tables
        and label not in cache.of_no_table
        and test.significant
        and test.material
        and test.size_sd >= 2.0
    )
    unstated = [*(one for one in curves if not one.stated and _is_usual(one)), *laws]
    extrapolated = remarks.extrapolated(cache.case)
    channels = {name: _channel_evidence(cache, name, ladder[1], last) for name in cache.noise}
    explained = bool(named) and all(_small(one) for one in channels.values())
    decision = decide(
        Evidence(
            named=tuple(named),
            possible=tuple(label for label in order if label not in named),
            sensors=frozenset(label for label in order if groups[label] == "sensor"),
            kinetics=frozenset(order) & frozenset(KINETICS),
            unknown=() if explained else tuple(unknown_sentence(curve) for curve in unstated),
            channels=channels,
            extrapolates=bool(extrapolated),
        ),
        cache.settings,
    )
    most = cache.settings.most_probable
    effects = tuple(
        NamedEffect(
            label=label,
            name=cache.space.candidates[label].effect.name,
            column=cache.space.candidates[label].effect.column,
            probability=_probability(found, label, most, forced=label in wanted),
            parameters={n.removeprefix(f"{label}."): e for n, e in last.estimates.items() if n.startswith(f"{label}.")},
            cannot_tell_apart_from=_not_told_apart(cache, found, label),
            removes=removes[label],
        )
        for label in named
    )
    explained_all = all(one.fit <= ABOVE_NOISE * one.noise for one in channels.values())
    else_p = UNTESTED if explained_all else UNTESTED_WITH_ERROR_LEFT
    if decision.verdict == "unknown_effect":
        else_p = 0.9
    candidates: dict[str, float] = {}
    for model, p in hypotheses.items():
        name = _name(cache, model)
        candidates[name] = candidates.get(name, 0.0) + p * (1.0 - else_p)
    candidates[SOMETHING_ELSE] = else_p
    candidates = dict(sorted(((n, min(p, most)) for n, p in candidates.items()), key=lambda pair: -pair[1]))
    scores = cache.scores(())
    critical = scores.critical_z()
    blind = _blind(cache, found.final)
    rivals = [cache.fit(model) for model in list(likely)[:MOST_RIVALS]] if len(likely) > 1 else []
    proposals = ()
    if rivals:
        cache.report("searching for an experiment that decides")
        proposals = best_of_each(propose(cache, rivals))
    return Diagnosis(
        case=cache.case,
        verdict=decision.verdict,
        effects=effects,
        candidates=tuple((name, p) for name, p in candidates.items() if p >= 5e-4),
        unexplained=decision.unexplained,
        blind_to=tuple(name for name in blind if name not in {effect.name for effect in effects}),
        noise=_sensors(cache),
        ladder=tuple(ladder),
        scores=tuple(
            ScoreEntry(
                gain.label, gain.z, bool(abs(gain.z) > critical), cache.space.candidates[gain.label].name in blind
            )
            for gain in scores.gains()
            if cache.space.candidates[gain.label].group in ("effect", "sensor")
        ),
        critical_z=critical,
        remarks=(
            *_remarks(cache, last_fit, adjusted, ladder, extrapolated),
            *([remarks.stated_model_stays(order)] if stays else []),
        ),
        curves=() if stays else (*curves, *laws),
        runs=tuple(
            run_found(cache, last_fit, last, label, removes[label])
            for label in labels
            if groups[label] == "run" and found.tests[label].named and not stays
        ),
        specimens=tuple(
            specimen_found(cache, last, label, _not_told_apart(cache, found, label), removes[label])
            for label in differ
            if not stays
        ),
        immaterial=tuple(
            _immaterial(cache, one, {})
            for one in (
                *(found.tests[label] for label in (*order, *of_specimens) if label not in (*named, *differ)),
                *found.refused.values(),
            )
            if cache.space.candidates[one.label].group in ("effect", "sensor", "specimen")
        ),
        remaining=_remaining(cache, last_fit, last, left["final"]),
        extrapolated=extrapolated,
        tolerance=tolerances(cache),
        fit_for_purpose=fit_for_purpose(cache, last),
        where_base=_where(cache, left["base"]),
        errors=errors_by_run(cache, {"base": ladder[1], "final": last}),
        rivals=tuple(_name(cache, one.added) for one in rivals),
        proposals=proposals,
        law_source=_law_source(cache, laws),
        corrections=all_curves(cache, last_fit) if last is final and not stays else (),
        ordered=tuple(ordered),
    )


def _hypotheses(search: Search, found: Found) -> dict[Labels, float]:
    """Return the probability of the final model and of its rivals: those lacking something or with another thing.

    What held-out runs contradict is none.
    """
    cache, final = search.cache, found.final
    logs: dict[Labels, float] = {final.added: 0.0}
    for label, test in found.tests.items():
        rest = tuple(one for one in final.added if one != label)
        logs[rest] = max(logs.get(rest, -np.inf), -(test.gain - test.odds + cache.settings.least_odds))
    own = search.evidence(final, final.likelihood)
    for models in found.rivals.values():
        for model in models:
            logs[model] = search.evidence(cache.fit(model), final.likelihood) - own
    if not final.added:
        for label, test in found.refused.items():
            if not test.held_out:
                logs[(label,)] = test.gain - test.odds
    return dict(zip(logs, softmax(np.array(list(logs.values()))).tolist(), strict=True))


def _probability(found: Found, label: str, most: float, *, forced: bool) -> float:
    """Return the probability of a named effect: no more than its margin, its rivals and resampled data allow."""
    test = found.tests[label]
    if forced and not test.named:
        return float(min(most, 1.0 / (1.0 + np.exp(-(test.gain - test.odds)))))
    alone = 1.0 / (1.0 + np.exp(-(test.gain - test.odds + 1.0)))
    return float(min(most, alone, test.share) / (1.0 + 0.5 * len(found.rivals.get(label, ()))))


def _not_told_apart(cache: FitCache, found: Found, label: str) -> tuple[str, ...]:
    """Return the names of effects that explain the readings as well in the place of one; of a shift with its run."""
    rest = set(found.final.added) - {label}
    others = [cache.space.candidates[next(iter(set(model) - rest))] for model in found.rivals.get(label, ())]
    return tuple(dict.fromkeys(one.label if one.group == "run" else one.name for one in others))


def _name(cache: FitCache, labels: Sequence[str]) -> str:
    """Return the name of a model in the answer, without columns."""
    return "+".join(cache.space.candidates[label].name for label in labels) or "base"


def _removes(search: Search, labels: Sequence[str]) -> dict[str, dict[str, Removed]]:
    """Return by how much each channel's error is smaller with each addition than without it, as it was tested."""

    @functools.cache
    def errors(fit: Fit) -> dict[str, ChannelError]:
        return rung(search.cache, "", fit, compared=True).errors

    found = {}
    for label in labels:
        after, lacking = map(errors, search.compared(labels, label))
        found[label] = {
            channel: Removed(lacking[channel].fit - one.fit, lacking[channel].check - one.check)
            for channel, one in after.items()
        }
    return found


def _is_usual(curve: CurveFound) -> bool:
    """Return True if a correction is of a usual size: less is within what a formula and a fit do."""
    return float(np.max(np.abs(curve.value))) >= USUAL_SHARE * CURVES[curve.label].typical


def _channel_evidence(cache: FitCache, name: str, base: Rung, last: Rung) -> ChannelEvidence:
    return ChannelEvidence(
        noise=cache.noise[name].sd,
        before=base.errors[name].fit,
        fit=last.errors[name].fit,
        check=last.errors[name].check,
        tolerance=cache.tolerances[name],
        check_before=base.errors[name].check,
        stated_tolerance=name in cache.case.tolerance,
    )


def _small(one: ChannelEvidence) -> bool:
    """Return True if the base model's error is hardly above the noise."""
    return bool(one.before**2 - one.noise**2 < 0.1 * one.noise**2)


def _immaterial(cache: FitCache, test: Test, removes: dict[str, Removed]) -> Immaterial:
    name = cache.space.candidates[test.label].name
    words = effect_name(name)
    if not test.significant:
        sentence = (
            f"{words}: it may be there, and curves of what no table states, such as an activation energy of each "
            f"resistance, explain the fit runs nearly as well (log evidence {test.gain:+.1f} of {test.odds:.1f} needed)"
        )
        return Immaterial(name, removes, sentence)
    against = test.why_not() or "beside the rest of the model it is not needed"
    sentence = f"{words}: it is significant on the fit runs (log evidence {test.gain:+.1f}), but {against}"
    return Immaterial(name, removes, sentence)


def _sensors(cache: FitCache) -> dict[str, Sensor]:
    return {name: Sensor(one.sd, one.rho, one.source, one.quantum) for name, one in cache.noise.items()}


def _accounts(cache: FitCache, left: Sequence[ChannelResiduals]) -> dict[str, Account]:
    """Return, by channel, the account of where a model with these residuals fails."""
    capacity = cache.case.parameters.get("capacity_Ah")
    rated = None if capacity is None else capacity.value
    return {residuals.channel: account(residuals, capacity_Ah=rated) for residuals in left}


def _where(cache: FitCache, left: Sequence[ChannelResiduals]) -> dict[str, tuple[str, ...]]:
    """Return, by channel, sentences on where a model with these residuals fails."""
    return {name: tuple(s.text for s in one.statements) for name, one in _accounts(cache, left).items()}


def _remaining(cache: FitCache, fit: Fit, last: Rung, left: Sequence[ChannelResiduals]) -> dict[str, Remaining]:
    accounts = _accounts(cache, left)
    interval = {name: _interval_s(cache, name) for name in cache.noise}
    return {
        name: Remaining(
            last.errors[name].fit,
            interval[name] * (fit.likelihood.channels[name].inflation - 1.0) / 2.0
            if name in fit.likelihood.channels
            else 0.0,
            tuple(s.text for s in accounts[name].statements) if name in accounts else (),
            accounts[name].mostly if name in accounts else "",
        )
        for name in cache.noise
    }


def _interval_s(cache: FitCache, name: str) -> float:
    """Return the median time between fitted readings of a channel, in s."""
    data = cache.view.data
    steps = [np.diff(data.time_s[rows]) for rows in data.by_channel.get(name, [])]
    return float(np.median(np.concatenate(steps))) if steps and sum(one.size for one in steps) else 0.0


def _blind(cache: FitCache, final: Fit) -> tuple[str, ...]:
    """Return the names of effects that the data could not show at their usual size, on any of their columns.

    They are asked beside the final model: what a base model that is far off leaves hides all that is small.
    """
    seen = cache.scores(final.added).visible()
    labels: dict[str, list[str]] = {}
    for label, candidate in cache.space.candidates.items():
        if candidate.group in ("effect", "sensor"):
            labels.setdefault(candidate.name, []).append(label)
    unseen = [name for name, own in labels.items() if not any(label in seen for label in own)]
    unseparated = [
        name
        for name, cls in cache.case.catalogue.items()
        if cache.case.kind in cls.kinds and name not in cache.case.effects and not is_distinguishable(cache.case, cls)
    ]
    return (*unseen, *unseparated)


def _remarks(
    cache: FitCache, fit: Fit, adjusted: AdjustedStarts, ladder: Sequence[Rung], extrapolated: Sequence[Extrapolated]
) -> tuple[Remark, ...]:
    layout = cache.space.layout
    common, of_runs = [], []
    for place, pull in zip(fit.spec.free, fit.pulls, strict=True):
        if place >= layout.base or abs(pull) <= cache.settings.strained:
            continue
        coordinate, run = layout.coordinates[place], layout.runs[place]
        number, stated = coordinate.number(fit.x[place]), coordinate.number(0.0)
        known = remarks.Strained(
            coordinate.name, number, coordinate.off(float(pull)), stated, abs(coordinate.slope(0.0))
        )
        if run < 0:
            common.append(known)
        else:
            of_runs.append(dataclasses.replace(known, run=cache.case.runs[run].name))
    return (
        *cache.preparation,
        *remarks.nothing_held_out(cache.case),
        *remarks.formulas_of_the_paper(cache.case),
        *remarks.noise_remarks(cache.noise),
        *remarks.starts_moving(cache.case, cache.noise, ladder[1].predictions),
        *remarks.better_as_stated(ladder[0], ladder[-1]),
        *remarks.nothing_moves(fit),
        *remarks.strained([*common, *of_runs]),
        *remarks.out_of_range(cache.space, fit),
        *remarks.not_converged(fit),
        *remarks.badly_started(adjusted.pulls, cache.settings.start_reach),
        *map(remarks.outside_fitted, extrapolated),
    )


def _law_source(cache: FitCache, laws: Sequence[CurveFound]) -> str | None:
    if not laws:
        return None
    return law_file(cache.space.candidates[laws[0].label], laws[0].value, laws[0].at, cache.case.kind, cache.case.name)
