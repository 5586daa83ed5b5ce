"""The diagnosis of a case: calibrate, score every effect, refit the likely ones, add what is needed, say what is left.

Steps 1, 2, 4, 6, 7 and 8 of the method. An effect is named when its score is beyond the critical value for all effects
together and the refitted model's evidence (Laplace, with the stated priors) says so; a second one likewise. What
neither explains is found by the deficiency map and called unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from discrepancy.best_model import BestModel, find_best_model
from discrepancy.explained import explained, explains_all_but_little, without_small_additions
from discrepancy.failure import failure, scatter_beyond_noise
from discrepancy.glitches import without_glitches
from discrepancy.hypothesis import Hypothesis, Labels
from discrepancy.lanes import one_thread_of_blas
from discrepancy.law_file import law_file
from discrepancy.leftover import leftover_laws
from discrepancy.misfit import Block
from discrepancy.next_experiment import best_of_each, propose
from discrepancy.posterior import MOST, PRIOR, SOMETHING_ELSE, bayes_factors, hypothesis_name, probabilities
from discrepancy.remarks import far_on_check_runs, remarks, what_is_explained, worse_held_out
from discrepancy.result import Diagnosis, NamedEffect, ScoreEntry
from discrepancy.score import sight
from discrepancy.screen import Screen
from discrepancy.search import Progress, by_strength, tell
from discrepancy.session import Session
from jaxmodel.cases import Case
from jaxmodel.errors import EffectError
from jaxmodel.ports import Effect

# Odds below which two hypotheses are told apart by nothing (3 to 1 on the log scale is 20 to 1).
TOLD_APART = 3.0
# Below this probability the best hypothesis is not named.
NAMED = 0.5
# What is partly explained is named all the same where this share of the excess error goes with it. In the development
# case with a law outside the catalogue that was looked at, the best effects of the catalogue remove 0.3.
PARTIAL_SHARE = 0.6
# Where no model and no law comes near the noise, what explains most is asked for; less than this explains little.
LITTLE_SHARE = 0.2
# Belief in something else where the best model leaves far more than stated noise, in no form. Assumed.
NOT_TO_THE_NOISE = 0.9
# Belief in effects that explain all but little of the excess error in every channel, though a law is left beside them.
# Of the cases opened for development four of four were then effects hidden; effects beside which a law of no catalogue
# stood left an eighth or more in their worst channel.
OF_ANOTHER_FORM = 0.9
# A hypothesis more probable than this is not ruled out; of so many an experiment is asked to decide between all.
RIVAL, MOST_RIVALS = 0.05, 3
# A law that explains this share of what the best does may stand in its file, where no port can carry the best; of those
# that explain this share so many are told.
NEARLY_THE_LAW, MUCH_OF_THE_LAW, MOST_LAWS = 0.9, 0.5, 6


@one_thread_of_blas
def compare(
    case: Case, *, extra_effects: Mapping[str, type[Effect]] | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Calibrate a case's model and hold it against the measurements, without asking what is missing.

    Args:
        case: with at least one fit run.
        extra_effects: the user's own, by name.
        progress: told what is being done.
    """
    case, glitches = without_glitches(case)
    session = Session(case, extra_effects)
    tell(progress, "calibrating")
    base = session.hypothesis()
    ladder = (session.rung("nominal", None), session.rung("calibrated", base))
    return Diagnosis(
        case=case,
        verdict="",
        effects=(),
        candidates=(),
        unexplained=None,
        blind_to=(),
        noise=session.noise,
        ladder=ladder,
        scores=(),
        critical_z=float("nan"),
        failure=failure(session, base),
        remarks=(*glitches, *remarks(session, base)),
    )


@one_thread_of_blas
def diagnose(
    case: Case,
    *,
    extra_effects: Mapping[str, type[Effect]] | None = None,
    add: Sequence[str] = (),
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Find which physical effect or sensor fault a case's model is missing.

    Args:
        case: with at least one fit run.
        extra_effects: the user's own, by name; they take part like those of the catalogue.
        add: names of effects that the user wants in the model, whatever the data say; nothing else is then sought.
        without: names of effects that the user rules out.
        progress: told what is being done.

    Raises:
        FitError: nothing is uncertain, or no run may be used to calibrate.
        EffectError: a name that is no candidate of this case, or a sensor's effect without its column.
    """
    case, glitches = without_glitches(case)
    session = Session(case, extra_effects, without)
    wanted = session.labels_to_add(add)
    if len(wanted) > max(PRIOR):
        raise EffectError(
            f"--add names {len(wanted)} effects, and no more than {max(PRIOR)} are weighed together; put those that "
            "you are sure of under [effects] of the case."
        )
    session.warm_up()
    found = find_best_model(session, progress, wanted)
    session, best, judge = found.session, found.best, found.judge
    base = session.hypothesis()
    first = judge.screen(judge.hypothesis())
    tell(progress, "weighing")
    # A law in no catalogue may stand beside the best effects, or in place of effects that only come near it.
    left = {best.labels: found.laws}
    if not found.far and any(block.significant for block in found.laws):
        left[base.labels] = leftover_laws(session, base, first, best)
    # Far from the noise there is something else whatever its law: effects compete among themselves.
    weighed, beside = probabilities(
        judge.known(),
        judge.hypothesis(best.labels),
        {best.labels: ()} if found.far else left,
        session.candidates,
        _never_fitted(judge, first, judge.hypothesis(best.labels)),
    )
    unexplained = next((block for block in left[beside] if block.significant), None)
    scatter = ""
    verdict = "unknown_effect" if found.far else _verdict(session, best, weighed, unexplained)
    if verdict != "unknown_effect":
        unexplained = None
        scatter = scatter_beyond_noise(session, best)
    if scatter or found.far:
        verdict, weighed = "unknown_effect", _believed(weighed, SOMETHING_ELSE, NOT_TO_THE_NOISE)

    if unexplained is not None and len(beside) > 1 and not found.far and not wanted:
        found = without_small_additions(found)
        best, beside = found.best, found.best.labels
        left[beside] = found.laws
        unexplained = next((block for block in left[beside] if block.significant), unexplained)
    of_another_form = (
        unexplained is not None
        and beside == best.labels
        and not (found.far or wanted)
        and explains_all_but_little(session, best)
    )
    if of_another_form:
        verdict = _verdict_on(session, best)
        weighed = _believed(weighed, hypothesis_name(best.labels), OF_ANOTHER_FORM)
    named = () if verdict == "unknown_effect" and not beside and not wanted else _named(found, weighed, verdict, wanted)
    ladder = [session.rung("nominal", None), session.rung("calibrated", base)]
    for count in range(1, len(named) + 1):
        added = [effect.label for effect in named[:count]]
        ladder.append(session.rung("with " + " + ".join(added), session.hypothesis(added)))
    told = unexplained.sentence(left[beside]) if unexplained is not None else scatter or _no_form(found)
    held_out = far_on_check_runs(ladder[-1], session.noise)
    if verdict == "adequate" and held_out:
        verdict, told = "undecided", held_out[0]
    blind = _blind(session, first)
    rivals = _undecided_between(judge, weighed)
    if rivals:
        tell(progress, "looking for the experiment that would decide")
    return Diagnosis(
        case=case,
        verdict=verdict,
        effects=named,
        candidates=tuple((name, p) for name, p in weighed.items() if p >= 5e-4),
        unexplained=told,
        blind_to=_blind_names(session, blind, [effect.name for effect in named]),
        noise=session.noise,
        ladder=tuple(ladder),
        scores=_scores(first, blind),
        critical_z=first.table.critical_z,
        failure=failure(session, base),
        remarks=(
            *glitches,
            *what_is_explained(found),
            *remarks(session, best),
            *held_out,
            *worse_held_out(ladder[1:], session.noise),
        ),
        rivals=tuple(hypothesis_name(one.labels) for one in rivals),
        proposals=best_of_each(propose(judge, rivals)),
        laws=_worth_telling(unexplained, left[beside]),
        law_source=_law_source(case, unexplained, left[beside]),
        far=tuple(found.far),
        ordered=(*(f"--add {name}" for name in add), *(f"--without {name}" for name in without)),
    )


def _never_fitted(session: Session, first: Screen, best: Hypothesis) -> dict[Labels, float]:
    """Return the log evidence, in the linear approximation, of effects alone and beside the best single one.

    What the data cannot show may be there all the same: it keeps the share that it had before.
    """
    fitted = {one.labels for one in session.known()}
    base = session.hypothesis().log_evidence
    alone = {(label,): base + log for label, log in bayes_factors(first, session.candidates).items()}
    if len(best.labels) == 1:
        beside = bayes_factors(session.screen(best), session.candidates)
        alone |= {session.key((*best.labels, label)): best.log_evidence + log for label, log in beside.items()}
    return {labels: log for labels, log in alone.items() if labels not in fitted}


def _undecided_between(session: Session, weighed: Mapping[str, float]) -> list[Hypothesis]:
    """Return the models between which the data has not decided, the most probable first; none where it has."""
    fitted = {hypothesis_name(one.labels): one for one in sorted(session.known(), key=lambda one: one.log_evidence)}
    rivals = [fitted[name] for name, p in weighed.items() if name in fitted and p > RIVAL]
    return rivals[:MOST_RIVALS] if len(rivals) > 1 else []


def _worth_telling(law: Block | None, tried: Sequence[Block]) -> tuple[Block, ...]:
    """Return a law found, and others that explain much of what it does: physics may be in one of them instead."""
    if law is None:
        return ()
    return tuple(block for block in tried if block.drop > MUCH_OF_THE_LAW * law.drop)[:MOST_LAWS]


def _law_source(case: Case, law: Block | None, tried: Sequence[Block]) -> str | None:
    """Return the file of a law found, or of the next as good that a port can carry."""
    if law is None:
        return None
    nearly = [block for block in tried if block.drop > NEARLY_THE_LAW * law.drop]
    return next(filter(None, (law_file(block, case.kind, case.name) for block in nearly)), None)


def _verdict(session: Session, best: Hypothesis, weighed: dict[str, float], unexplained: Block | None) -> str:
    if unexplained is not None and weighed[SOMETHING_ELSE] > NAMED:
        return "unknown_effect"
    if not best.labels:
        return "adequate"
    # Whether something more is missing beside what is named is another question.
    if _holding(weighed, {session.candidates[label].effect.name for label in best.labels}) < NAMED:
        return "adequate" if weighed["base"] > NAMED else "undecided"
    return _verdict_on(session, best)


def _verdict_on(session: Session, best: Hypothesis) -> str:
    """Return the verdict where a model's effects are what was missing."""
    sensors = all(session.candidates[label].is_sensor for label in best.labels)
    return "sensor_fault" if sensors else "missing_effect"


def _holding(weighed: Mapping[str, float], names: set[str]) -> float:
    """Return the probability of all hypotheses together that have some effects."""
    return sum(p for name, p in weighed.items() if names <= set(name.split("+")))


def _believed(weighed: Mapping[str, float], name: str, belief: float) -> dict[str, float]:
    """Return the probabilities where one hypothesis is given so much, and the others share the rest as they did."""
    rest = sum(p for other, p in weighed.items() if other != name)
    others = {other: p * (1.0 - belief) / rest for other, p in weighed.items() if other != name}
    return {name: belief, **others}


def _named(
    found: BestModel, weighed: Mapping[str, float], verdict: str, wanted: Sequence[str]
) -> tuple[NamedEffect, ...]:
    """Return the effects to be named: those asked for; beside an unknown one only those that explain most."""
    session, best = found.session, found.best
    share = explained(session, best) if verdict == "unknown_effect" else 1.0
    enough = LITTLE_SHARE if found.far else PARTIAL_SHARE
    nothing = verdict not in ("missing_effect", "sensor_fault", "unknown_effect") or share < enough
    if nothing and not wanted:
        return ()
    estimates = session.rung("", best).estimates
    named = []
    for label in by_strength(found.judge, found.judge.hypothesis(best.labels)):
        effect = session.candidates[label].effect
        holding = min(MOST, _holding(weighed, {effect.name}))
        if found.far:
            holding = min(MOST, holding / (1.0 - NOT_TO_THE_NOISE))  # beside whatever else there is
        elif verdict == "unknown_effect":
            holding = min(0.99, share)
        prefix = f"{label}."
        named.append(
            NamedEffect(
                label=label,
                name=effect.name,
                column=getattr(effect, "column", ""),
                probability=holding,
                parameters={n.removeprefix(prefix): e for n, e in estimates.items() if n.startswith(prefix)},
                cannot_tell_apart_from=_rivals(found.judge, found.judge.hypothesis(best.labels), label),
            )
        )
    return tuple(named)


def _rivals(session: Session, best: Hypothesis, label: str) -> tuple[str, ...]:
    """Return the effects that, put in an effect's place and refitted, explain the readings as well.

    The same fault on another column is told by its column.
    """
    rest = set(best.labels) - {label}
    others = [
        next(iter(set(one.labels) - rest))
        for one in session.known()
        if len(one.labels) == len(best.labels)
        and rest < set(one.labels)
        and one.labels != best.labels
        and one.log_evidence > best.log_evidence - TOLD_APART
    ]
    name = session.candidates[label].effect.name
    names = {other: session.candidates[other].effect.name for other in others}
    return tuple(dict.fromkeys(other if known == name else known for other, known in names.items()))


def _blind(session: Session, screened: Screen) -> tuple[str, ...]:
    """Return labels of what this data could not have shown: below four sigma at the low end of its usual range."""
    smallest = {}
    for name in screened.probes:
        coordinate = session.candidates[name].coordinates[0]
        smallest[name] = float(np.exp(-coordinate.spread)) if coordinate.logarithmic else 0.2
    unseen = [entry.name for entry in sight(screened.table, smallest) if entry.cell == "blind"]
    unscored = [label for label in session.candidates if label not in screened.probes]
    return (*unseen, *unscored)


def _no_form(found: BestModel) -> str | None:
    """Say that what every model leaves far above the noise follows none of the laws tried; None where none does."""
    if not found.far:
        return None
    return f"every model leaves far more than noise in {' and '.join(found.far)}, in the form of no law that was tried"


def _blind_names(session: Session, blind: Sequence[str], named: Sequence[str]) -> tuple[str, ...]:
    """Return the effects not named that this data is blind to, those of a sensor on every column they could have."""
    labels: dict[str, list[str]] = {}
    for label, candidate in session.candidates.items():
        labels.setdefault(candidate.effect.name, []).append(label)
    found = dict.fromkeys(session.candidates[label].effect.name for label in blind)
    return tuple(name for name in found if name not in named and set(labels[name]) <= set(blind))


def _scores(screened: Screen, blind: tuple[str, ...]) -> tuple[ScoreEntry, ...]:
    return tuple(
        ScoreEntry(
            label=effect.name,
            z=float(np.copysign(effect.z_equivalent, effect.z)),
            significant=effect.name in screened.table.significant,
            blind=effect.name in blind,
            hidden_by=effect.hidden_by,
        )
        for effect in screened.table.effects
    )
