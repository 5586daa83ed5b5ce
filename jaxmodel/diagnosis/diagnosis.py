"""`compare` and `diagnose`: from a case to its diagnosis."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from jaxmodel.base.errors import EffectError
from jaxmodel.case.records import Case
from jaxmodel.diagnosis import policy
from jaxmodel.diagnosis.advice import remarks as remarks
from jaxmodel.diagnosis.advice.law_file import law_file
from jaxmodel.diagnosis.advice.next_experiment import best_of_each, propose
from jaxmodel.diagnosis.decision import ChannelEvidence, Evidence, decide
from jaxmodel.diagnosis.evidence.trial import Trial
from jaxmodel.diagnosis.findings import curve_found, law_found, run_found, unknown_sentence
from jaxmodel.diagnosis.fitting.candidates import is_distinguishable
from jaxmodel.diagnosis.fitting.lanes import one_thread_of_blas
from jaxmodel.diagnosis.fitting.model import Labels
from jaxmodel.diagnosis.gates import Addition, odds_of
from jaxmodel.diagnosis.residuals.statements import statements
from jaxmodel.diagnosis.residuals.table import ChannelResiduals
from jaxmodel.diagnosis.result import (
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
from jaxmodel.diagnosis.tolerances import fit_for_purpose, tolerances
from jaxmodel.diagnosis.workings import Progress, Workings

SOMETHING_ELSE = "something_else"
# Two models are indistinguishable if their log evidence differs by less than this (20 to 1).
DISTINGUISHABLE = 3.0
# Probability of a cause that was not tested, without and with a remaining model error. Assumed.
UNTESTED, UNTESTED_WITH_MODEL_ERROR = 0.01, 0.05
# A model more probable than this is a rival; an experiment is proposed for at most so many.
RIVAL, MOST_RIVALS = 0.05, 3


@one_thread_of_blas
def compare(case: Case, *, progress: Progress | None = None) -> Diagnosis:
    """Calibrate a case's model and compare it with the measurements, without testing any candidate.

    Args:
        case: with at least one fit run.
        progress: called with a description of each step.

    Raises:
        FitError: nothing is uncertain, or no run may be used to calibrate.
    """
    return comparison(Workings(case, progress=progress))


def comparison(inv: Workings) -> Diagnosis:
    """Return the calibrated base model of an investigation as a diagnosis that tests no candidate."""
    adjusted = with_adjusted_starts(inv, inv.base)
    ladder = (nominal(inv), rung(inv, "calibrated", inv.base, adjusted))
    left = residuals_of(inv, ladder[-1])
    remaining = _remaining(inv, inv.base, ladder[-1], left)
    return Diagnosis(
        case=inv.case,
        verdict="",
        effects=(),
        candidates=(),
        unexplained=None,
        blind_to=(),
        noise=_sensors(inv.base),
        ladder=ladder,
        scores=(),
        critical_z=float("nan"),
        remarks=_remarks(inv, inv.base, adjusted, ladder, ()),
        remaining=remaining,
        extrapolated=remarks.extrapolated(inv.case),
        tolerance=tolerances(inv),
        where_base={name: one.where for name, one in remaining.items()},
        errors=errors_by_run(inv, {"base": ladder[-1]}),
    )


@one_thread_of_blas
def diagnose(
    case: Case,
    *,
    add: Sequence[str] = (),
    with_effects: Sequence[str] = (),
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Find which physical effect or sensor fault a case's model lacks, which tables are wrong, and what error remains.

    Args:
        case: with at least one fit run.
        add: names of effects that are added whatever the data show; no other candidate is tested.
        with_effects: the same, but other candidates are tested too.
        without: names of effects that are ruled out.
        progress: called with a description of each step.

    Raises:
        FitError: nothing is uncertain, or no run may be used to calibrate.
        EffectError: a name that is no candidate of this case, or a sensor's effect without its column.
    """
    inv = Workings(case, without=without, progress=progress)
    if add and with_effects:
        raise EffectError("--add tests no other candidate and --with does; give all effects with one of the two.")
    wanted = inv.space.labels_to_add([*add, *with_effects])
    found = policy.run(inv, wanted, seek=not add)
    return conclude(
        inv,
        found,
        wanted,
        (*(f"--add {n}" for n in add), *(f"--with {n}" for n in with_effects), *(f"--without {n}" for n in without)),
    )


def conclude(inv: Workings, found: policy.Found, wanted: Sequence[str] = (), ordered: Sequence[str] = ()) -> Diagnosis:
    """Return the diagnosis of a finished investigation."""
    inv.report("comparing models")
    final = found.final
    adjusted = with_adjusted_starts(inv, final)
    ladder = [nominal(inv), rung(inv, "calibrated", inv.base)]
    ladder += [rung(inv, "with " + " + ".join(m.labels), m, compared=True) for m in found.path[1:] if m is not final]
    if final.labels:
        ladder.append(rung(inv, "with " + " + ".join(final.labels), final, adjusted))
    last = ladder[-1]
    left = {"base": residuals_of(inv, ladder[1])}
    left["final"] = residuals_of(inv, last) if final.labels else left["base"]
    groups = {label: inv.space.candidates[label].group for label in final.labels}
    lacking = {label: _lacking(inv, found.compared, final, label) for label in final.labels}
    removes = {label: _removes(rung(inv, "", trial, compared=True), last) for label, trial in lacking.items()}
    probabilities, indistinguishable = _probabilities(inv, found)
    holding = {
        label: sum(p for labels, p in probabilities.items() if label in labels)
        for label in final.labels
        if groups[label] in ("effect", "sensor")
    }
    order = sorted(holding, key=lambda one: lacking[one].log_evidence)
    laws = [law_found(inv, final, label, removes[label]) for label in final.labels if groups[label] == "law"]
    curves = tuple(curve_found(inv, final, label, removes[label]) for label in final.labels if groups[label] == "curve")
    unstated = [curve for curve in (*curves, *laws) if not curve.stated]
    extrapolated = remarks.extrapolated(inv.case)
    channels = {name: _channel_evidence(inv, found, name, ladder[1], last) for name in inv.noise}
    explained = bool(holding) and all(_small(one) for one in channels.values())
    evidence = Evidence(
        effects={label: (1.0 if label in wanted else holding[label]) for label in order},
        sensors=frozenset(label for label in order if groups[label] == "sensor"),
        unknown=() if explained else tuple(unknown_sentence(curve) for curve in unstated),
        channels=channels,
        extrapolates=bool(extrapolated),
    )
    decision = decide(evidence, inv.settings)
    most = inv.settings.most_probable
    named = tuple(
        NamedEffect(
            label=label,
            name=inv.space.candidates[label].effect.name,
            column=inv.space.candidates[label].effect.column,
            probability=float(min(most, holding[label])),
            parameters={n.removeprefix(f"{label}."): e for n, e in last.estimates.items() if n.startswith(f"{label}.")},
            cannot_tell_apart_from=indistinguishable.get(label, ()),
            removes=removes[label],
        )
        for label in order
        if holding[label] >= inv.settings.named or label in wanted
    )
    else_p = UNTESTED_WITH_MODEL_ERROR if final.scale.error.sd else UNTESTED
    if decision.verdict == "unknown_effect":
        else_p = 0.9
    candidates: dict[str, float] = {}
    for labels, p in probabilities.items():
        candidates[_name(inv, labels)] = candidates.get(_name(inv, labels), 0.0) + p * (1.0 - else_p)
    candidates[SOMETHING_ELSE] = else_p
    candidates = dict(sorted(((n, min(p, most)) for n, p in candidates.items()), key=lambda pair: -pair[1]))
    gains = inv.base_gains
    critical = inv.linear(inv.base).critical_z()
    blind = _blind(inv)
    rivals = _rivals(found.compared, probabilities)
    proposals = ()
    if rivals:
        inv.report("searching for an experiment that decides")
        proposals = best_of_each(propose(inv, rivals))
    return Diagnosis(
        case=inv.case,
        verdict=decision.verdict,
        effects=named,
        candidates=tuple((name, p) for name, p in candidates.items() if p >= 5e-4),
        unexplained=decision.unexplained,
        blind_to=tuple(name for name in blind if name not in {effect.name for effect in named}),
        noise=_sensors(final),
        ladder=tuple(ladder),
        scores=tuple(
            ScoreEntry(gain.label, gain.z, bool(abs(gain.z) > critical), inv.space.candidates[gain.label].name in blind)
            for gain in gains
            if inv.space.candidates[gain.label].group in ("effect", "sensor")
        ),
        critical_z=critical,
        remarks=_remarks(inv, final, adjusted, ladder, extrapolated),
        curves=(*curves, *laws),
        runs=tuple(
            run_found(inv, final, last, label, removes[label]) for label in final.labels if groups[label] == "run"
        ),
        immaterial=tuple(_immaterial(inv, one, last) for one in found.refused.values()),
        remaining=_remaining(inv, final, last, left["final"]),
        extrapolated=extrapolated,
        tolerance=tolerances(inv),
        fit_for_purpose=fit_for_purpose(inv, last),
        where_base=_where(inv, left["base"]),
        errors=errors_by_run(inv, {"base": ladder[1], "final": last}),
        rivals=tuple(_name(inv, one.labels) for one in rivals),
        proposals=proposals,
        law_source=_law_source(inv, laws),
        ordered=tuple(ordered),
    )


def _lacking(inv: Workings, compared: Sequence[Trial], final: Trial, label: str) -> Trial:
    rest = tuple(one for one in final.labels if one != label)
    return next((one for one in compared if one.labels == rest), None) or inv.trial(rest, final)


def _probabilities(inv: Workings, found: policy.Found) -> tuple[dict[Labels, float], dict[str, Labels]]:
    """Return the probability of every model compared, and what is indistinguishable from each effect."""
    final = found.final
    logs: dict[tuple[str, ...], float] = {}
    for trial in found.compared:
        prior = -sum(odds_of(inv, inv.space.candidates[one], trial) - inv.settings.least_odds for one in trial.labels)
        logs[trial.labels] = max(logs.get(trial.labels, -np.inf), trial.log_evidence + prior)
    values = np.array(list(logs.values()))
    shares = dict(zip(logs, np.exp(values - logsumexp(values)).tolist(), strict=True))
    indistinguishable: dict[str, tuple[str, ...]] = {}
    for label in final.labels:
        rest = set(final.labels) - {label}
        others = [
            next(iter(set(trial.labels) - rest))
            for trial in found.compared
            if rest < set(trial.labels)
            and label not in trial.labels
            and len(trial.labels) == len(final.labels)
            and trial.log_evidence > final.log_evidence - DISTINGUISHABLE
        ]
        indistinguishable[label] = tuple(dict.fromkeys(inv.space.candidates[one].name for one in others))
    return shares, indistinguishable


def _name(inv: Workings, labels: Sequence[str]) -> str:
    """Return the name of a model in the answer, without columns."""
    return "+".join(inv.space.candidates[label].name for label in labels) or "base"


def _rivals(trials: Sequence[Trial], probabilities: Mapping[tuple[str, ...], float]) -> list[Trial]:
    """Return the models between which the data do not decide, the most probable first; none if they do."""
    likely = sorted(
        (labels for labels, p in probabilities.items() if p > RIVAL), key=lambda labels: -probabilities[labels]
    )
    found = [next(one for one in trials if one.labels == labels) for labels in likely][:MOST_RIVALS]
    return found if len(found) > 1 else []


def _removes(lacking: Rung, final: Rung) -> dict[str, Removed]:
    """Return by how much the final model reduces each channel's error relative to one that lacks something."""

    def removed(before: float, after: float) -> float:
        squared = before**2 - after**2
        return float(np.copysign(np.sqrt(abs(squared)), squared))

    return {
        channel: Removed(
            removed(lacking.errors[channel].fit, after.fit), removed(lacking.errors[channel].check, after.check)
        )
        for channel, after in final.errors.items()
    }


def _channel_evidence(inv: Workings, found: policy.Found, name: str, base: Rung, last: Rung) -> ChannelEvidence:
    tolerance = inv.case.tolerance.get(name)
    return ChannelEvidence(
        noise=found.final.scale.noise[name].sd,
        before=base.errors[name].level_fit,
        fit=last.errors[name].level_fit,
        check=last.errors[name].level_check,
        tolerance=None if tolerance is None else tolerance.rms,
        model_error=found.final.scale.error.of_channel(name),
        check_before=base.errors[name].level_check,
        steep=last.errors[name].level_fit < inv.settings.level_share * last.errors[name].fit,
    )


def _small(one: ChannelEvidence) -> bool:
    """Return True if the base model's error is hardly above the noise."""
    return bool(one.before**2 - one.noise**2 < 0.1 * one.noise**2)


def _immaterial(inv: Workings, refused: Addition, last: Rung) -> Immaterial:
    name = inv.space.candidates[refused.label].name
    if not refused.plausible:
        reason = f"its size would be more than {inv.settings.implausible:g} sd from the usual one"
    elif not refused.predicts_better(inv.settings.least_expected_score):
        score = f"log score {refused.score_gain:+.1f}, expected {refused.expected_score_gain:+.1f}"
        reason = f"it does not improve the prediction of left-out data ({score})"
    elif refused.harmful:
        reason = "it increases the error on left-out data"
    elif not refused.material:
        reason = "it reduces no error by a material amount"
    else:
        reason = (
            "with the model error estimated again, its size is implausible or it increases the error on left-out data"
        )
    removes = _removes(last, rung(inv, "", refused.trial, compared=True))
    return Immaterial(
        name, removes, f"{name}: it is significant on the fit runs (log evidence {refused.gain:+.1f}), but {reason}"
    )


def _sensors(trial: Trial) -> dict[str, Sensor]:
    return {name: Sensor(one.sd, one.rho, one.source, one.quantum) for name, one in trial.scale.noise.items()}


def _where(inv: Workings, left: Sequence[ChannelResiduals]) -> dict[str, tuple[str, ...]]:
    """Return, by channel, sentences on where a model with these residuals fails."""
    capacity = inv.case.parameters.get("capacity_Ah")
    return {
        residuals.channel: tuple(
            s.text for s in statements(residuals, capacity_Ah=None if capacity is None else capacity.value)
        )
        for residuals in left
    }


def _remaining(inv: Workings, trial: Trial, last: Rung, left: Sequence[ChannelResiduals]) -> dict[str, Remaining]:
    where = _where(inv, left)
    tau = trial.scale.error.tau_s
    return {name: Remaining(last.errors[name].fit, tau.get(name, 0.0), where.get(name, ())) for name in inv.noise}


def _blind(inv: Workings) -> tuple[str, ...]:
    """Return the names of effects that the data could not show at their usual size, on any of their columns."""
    seen = inv.linear(inv.base).visible()
    labels: dict[str, list[str]] = {}
    for label, candidate in inv.space.candidates.items():
        if candidate.group in ("effect", "sensor"):
            labels.setdefault(candidate.name, []).append(label)
    unseen = [name for name, own in labels.items() if not any(label in seen for label in own)]
    unseparated = [
        name
        for name, cls in inv.case.catalogue.items()
        if inv.case.kind in cls.kinds and name not in inv.case.effects and not is_distinguishable(inv.case, cls)
    ]
    return (*unseen, *unseparated)


def _remarks(
    inv: Workings, trial: Trial, adjusted: AdjustedStarts, ladder: Sequence[Rung], extrapolated: Sequence[Extrapolated]
) -> tuple[str, ...]:
    layout, fitted = inv.space.layout, trial.fitted
    common, of_runs = [], []
    for place, pull in zip(trial.setting.free, fitted.pulls, strict=True):
        if place >= layout.base or abs(pull) <= inv.settings.strained:
            continue
        coordinate, run = layout.coordinates[place], layout.runs[place]
        number, stated = coordinate.number(fitted.x[place]), coordinate.number(0.0)
        known = remarks.Strained(
            coordinate.name, number, coordinate.off(float(pull)), stated, abs(coordinate.slope(0.0))
        )
        if run < 0:
            common.append(known)
        else:
            of_runs.append(dataclasses.replace(known, run=inv.case.runs[run].name))
    return (
        *inv.preparation,
        *remarks.nothing_held_out(inv.case),
        *remarks.formulas_of_the_paper(inv.case),
        *remarks.noise_remarks(trial.scale.noise),
        *remarks.starts_moving(inv.case, trial.scale.noise, ladder[1].predictions),
        *remarks.better_as_stated(ladder[0], ladder[-1]),
        *remarks.nothing_moves(fitted),
        *remarks.strained([*common, *of_runs]),
        *remarks.out_of_range(inv.space, trial),
        *remarks.not_converged(fitted),
        *remarks.badly_started(adjusted.pulls, inv.settings.start_reach),
        *(remarks.extrapolated_sentence(one) for one in extrapolated),
    )


def _law_source(inv: Workings, laws: Sequence[CurveFound]) -> str | None:
    if not laws:
        return None
    return law_file(inv.space.candidates[laws[0].label], laws[0].value, laws[0].at, inv.case.kind, inv.case.name)
