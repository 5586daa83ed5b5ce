"""The search for the best model of one or two effects: shortlists by score, refits, pairs, and swaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from discrepancy.hypothesis import Hypothesis
from discrepancy.posterior import hypothesis_name
from discrepancy.screen import Screen
from discrepancy.session import Session

Progress = Callable[[str], None]

# How many effects are refitted at each stage, strongest scores first. A score is local: a large effect nearby may
# outscore the true one, seldom four of them.
SHORTLIST = 5
# Of these so many are refitted before it is asked whether one of them leaves nothing; then only those are refitted yet
# that look the same or promise nearly as much.
FIRST_REFITTED = 2
NEARLY_AS_GOOD = 0.8
# Where no single effect of a shortlist leaves nothing, so do those that promise this share of the first's z: the score
# of a fault too large for slopes to tell (a motor that turns in the model and stands still) comes behind four others.
PROMISES_ENOUGH = 0.33
# How many models of each size, found with coarse weights, are refitted with those of the sensors; none that leaves so
# many times as much as the best.
SEEDS = 3
LEAVES_TOO_MUCH = 2.0
# A second effect must raise the log evidence by this much (odds of 150 to 1) over the best single one.
SECOND_EFFECT_GAIN = 5.0
# Scores beside an effect that by itself leaves so many times what the best one leaves are those of a model far off.
HOPELESS_ALONE = 10.0
# A third effect is sought only where no two come near the noise, and must take this share of what the base model leaves
# (assumed): many small additions are a patchwork. So must a second one beside a law that is in no catalogue.
THIRD_SHARE = 0.05


def search(
    session: Session, progress: Progress | None, effects: int = 2, seeds: Sequence[Hypothesis] = ()
) -> Hypothesis:
    """Return the best model of at most one or two effects.

    `seeds` are models fitted under other weights, to be refitted from where they stand in place of a shortlist.
    """
    base = session.hypothesis()
    if seeds:
        tell(progress, f"refitting {', '.join(hypothesis_name(seed.labels) for seed in seeds)}")
        session.hypotheses([(seed.labels, [seed.start]) for seed in seeds])
    if not _best(session, (0, 1, 2)).labels:
        tell(progress, f"scoring {len(session.candidates)} candidate effects")
        if not session.screen(base).table.significant:
            return _unmasked(session, progress, base)
        _refit_likely(session, progress, base)
    if any(len(seed.labels) == 2 for seed in seeds) and _takes_both(session, _best(session, (2,))):
        return _best(session, (2,))
    best = _best(session, (0, 1))
    if not best.labels or effects == 1 or not session.screen(best).table.significant:
        return best
    couple = _refit_likely(session, progress, best)
    if not _takes_both(session, couple):
        return _best(session, (0, 1))
    swapped = _swap(session, progress, best, couple)
    return swapped if swapped is couple or _takes_both(session, swapped) else _best(session, (1,))


def _unmasked(session: Session, progress: Progress | None, base: Hypothesis) -> Hypothesis:
    """Return a pair of effects that hide each other, where both are worth it, else the base model."""
    pairs = session.masking(session.screen(base))[:FIRST_REFITTED]
    if pairs:
        tell(progress, f"refitting {', '.join(hypothesis_name(labels) for labels, _ in pairs)}")
        couple = max(session.hypotheses(pairs), key=lambda one: one.log_evidence)
        if _takes_both(session, couple):
            return couple
    return base


def _swap(session: Session, progress: Progress | None, best: Hypothesis, couple: Hypothesis) -> Hypothesis:
    """Return the better of a pair and of those of its second effect with another than its first.

    The first may have been a stand-in for two others. The second goes beside what scores best with it, or, where it
    explains next to nothing by itself, beside the other effects that explain nearly as much as the first.
    """
    second = next(label for label in couple.labels if label not in best.labels)
    alone = session.hypothesis((second,))
    if alone.fitted.chi2 < HOPELESS_ALONE * best.fitted.chi2:
        if not session.screen(alone).table.significant:
            return couple
        others = [_refit_likely(session, progress, alone)]
    else:
        enough = LEAVES_TOO_MUCH * best.fitted.objective
        singles = [one for one in session.known() if len(one.labels) == 1 and one.labels[0] not in couple.labels]
        rivals = [one for one in singles if one.fitted.objective < enough]
        sets = [(session.key((*one.labels, second)), [{**one.start, second: couple.start[second]}]) for one in rivals]
        others = session.hypotheses(sets)
    return max([couple, *others], key=lambda one: one.log_evidence)


def _takes_both(session: Session, couple: Hypothesis) -> bool:
    """Return True where two effects are worth it, each by itself refitted from where both end too.

    A single effect that settled in a poor place would make any second one look needed.
    """
    if len(couple.labels) < 2 or couple.log_evidence < _best(session, (0, 1)).log_evidence + SECOND_EFFECT_GAIN:
        return False
    singles = session.again([(label,) for label in couple.labels], couple)
    return couple.log_evidence > max(one.log_evidence for one in singles) + SECOND_EFFECT_GAIN


def another(session: Session, progress: Progress | None, best: Hypothesis) -> Hypothesis:
    """Return a model with one effect more, where that explains enough of what the base model leaves to be worth it."""
    if len(best.labels) < 2 or not session.screen(best).table.significant:
        return best
    more = _refit_likely(session, progress, best)
    worth = best.fitted.chi2 - more.fitted.chi2 > THIRD_SHARE * session.hypothesis().fitted.chi2
    return more if worth and more.log_evidence > best.log_evidence + SECOND_EFFECT_GAIN else best


def _refit_likely(session: Session, progress: Progress | None, model: Hypothesis) -> Hypothesis:
    """Refit a model with each of the effects that score best beside it; return the best.

    All of a shortlist, unless one of the first leaves nothing to be explained.
    """
    screened = session.screen(model)
    likely = _shortlist(screened)
    promised = {effect.name: effect.z_equivalent for effect in screened.table.effects}
    session.bring_together(model.labels, likely)
    own = {label: model.start[label] for label in model.labels}

    def refit(labels: Sequence[str]) -> Hypothesis:
        tell(progress, f"refitting {' '.join((*model.labels, 'with'))} {', '.join(labels)}")
        sets = []
        for label in labels:
            starts = [{**own, **start} for start in session.starts(screened, label)]
            sets.append((session.key((*model.labels, label)), starts))
        return max(session.hypotheses(sets), key=lambda one: one.log_evidence)

    best = refit(likely[:FIRST_REFITTED])
    rest = likely[FIRST_REFITTED:]
    if rest and best.log_evidence > model.log_evidence and not session.screen(best).table.significant:
        added = next(label for label in best.labels if label not in model.labels)
        alike = next((names for names in screened.table.classes if added in names), ())
        near = NEARLY_AS_GOOD * promised[added]
        rest = [label for label in rest if label in alike or promised[label] > near]
    if rest:
        best = max(best, refit(rest), key=lambda one: one.log_evidence)
    if model.labels or not session.screen(best).table.significant:
        return best
    enough = PROMISES_ENOUGH * promised[likely[0]]
    more = [label for label in screened.table.significant if label not in likely and promised[label] > enough]
    return max(best, refit(more), key=lambda one: one.log_evidence) if more else best


def _best(session: Session, sizes: Sequence[int]) -> Hypothesis:
    """Return the model of the most evidence among those fitted with so many effects."""
    return max((one for one in session.known() if len(one.labels) in sizes), key=lambda one: one.log_evidence)


def _shortlist(screened: Screen) -> list[str]:
    """Return the significant effects with the strongest scores, and what cannot be told apart from the first."""
    significant = [effect.name for effect in screened.table.effects if effect.name in screened.table.significant]
    chosen = significant[:SHORTLIST]
    for alike in screened.table.classes:
        if chosen[0] in alike:
            chosen += [name for name in alike if name not in chosen][:3]
    return chosen


def strongest(session: Session) -> list[Hypothesis]:
    """Return the hypotheses with effects that explain the readings best, a few of each size."""
    ranked = sorted(session.known(), key=lambda one: one.log_evidence, reverse=True)
    ranked = [one for one in ranked if one.fitted.objective < LEAVES_TOO_MUCH * ranked[0].fitted.objective]
    return [one for size in (1, 2) for one in [each for each in ranked if len(each.labels) == size][:SEEDS]]


def by_strength(session: Session, best: Hypothesis) -> list[str]:
    """Return a model's effects, the one that explains more by itself first."""
    if len(best.labels) < 2:
        return list(best.labels)
    alone = session.hypotheses([((label,), [{label: best.start[label]}]) for label in best.labels])
    return [one.labels[0] for one in sorted(alone, key=lambda one: -one.log_evidence)]


def tell(progress: Progress | None, what: str) -> None:
    """Tell what is being done, if anybody listens."""
    if progress is not None:
        progress(what)
