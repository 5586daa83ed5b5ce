"""The search for what a model lacks: enter what explains most, remove what is not needed, name what is stable.

1. Curves of the stated tables are in every model, with amplitudes by evidence: exact tables leave them at nothing.
2. Candidates are ranked by their projected gain over the present model, curves included; the best few are refitted,
   each under weights of its own. The one that gains most log evidence enters, models compared at equal weights.
3. What entered is removed in turn, all else fitted again, and dropped if it is not needed: order does not decide.
4. What is left is exchanged for what could stand in its place, if that has more evidence.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from jaxmodel.diagnosis.comparison import ABOVE_NOISE, Comparison, Test
from jaxmodel.effects.curves import CURVES
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.candidates import SHIFTED
from jaxmodel.fit.estimate import NONE, Fit
from jaxmodel.fit.lanes import at_once
from jaxmodel.fit.likelihood import Likelihood
from jaxmodel.fit.scores import Gain
from jaxmodel.fit.screen import SINGLE

# Every cell has charge transfer and diffusion: they come before what explains less than what is missed most.
KINETICS = ("charge_transfer", "slow_diffusion")
CLOCK = "time_s"
# A candidate is refitted if its expected gain is at least this share of the odds that it must exceed. Assumed.
LIKELY = 0.3
# Q of a model, in odds of a candidate, from which what is left of it tells of the gain. Assumed.
TELLING = 6.0
# Share of a mean square error by which an addition reduces what is missed. Assumed.
REDUCED = 0.1
# A candidate is not refitted where another may enter that leaves less than this share of Q at its first point. Assumed.
FAR_LESS = 0.5
# Log evidence by which data hardly tell two models apart: 20 to 1.
NOT_TOLD = 3.0
# What is fitted in the place of an addition, the best by score. Assumed.
MOST_IN_PLACE = 2
# Correlation of the derivatives of two from which one does the same as the other. Assumed.
SAME = 0.98
# Groups of which one may stand in the place of another.
ALIKE = ("effect", "sensor", "specimen")
# Effects that are tried with another beside them, where none alone has enough evidence. Assumed.
MOST_TOGETHER = 2


@dataclasses.dataclass(frozen=True)
class Found:
    """The result of a search.

    Attributes:
        final: the final model.
        path: additions of all models on the way, those of the base model first.
        tests: of each addition of the final model, by label.
        refused: significant candidates that are not in it, by label.
        rivals: models that the data do not tell from the final one, by what stands in the place of what.
    """

    final: Fit
    path: tuple[tuple[str, ...], ...]
    tests: dict[str, Test]
    refused: dict[str, Test]
    rivals: dict[str, tuple[tuple[str, ...], ...]]


class Search(Comparison):
    """A search over the models of a case.

    Attributes:
        ruled_out: candidates that may not enter.
    """

    def __init__(self, cache: FitCache, ruled_out: Collection[str] = ()) -> None:
        """Search over the models of a cache, without some candidates."""
        super().__init__(cache)
        self.ruled_out = frozenset(ruled_out)

    def without(self, labels: Collection[str]) -> Search:
        """Return the search in which some candidates more may not enter."""
        return Search(self.cache, {*self.ruled_out, *labels})

    def run(
        self, start: Sequence[str] = (), seek: bool = True, each: Callable[[tuple[str, ...]], None] = lambda _: None
    ) -> Found:
        """Search automatically.

        Args:
            start: additions that are in the model from the start, and stay.
            seek: False to test no other candidate.
            each: is called with the additions of every model as it is accepted.
        """
        cache = self.cache
        model = cache.space.key(start)
        path = [(), *([model] if model else [])]
        refused: dict[str, Test] = {}
        if seek:
            has_kinetics, beside, ended = False, False, {model}
            for _ in range(cache.settings.most_rounds):
                if not has_kinetics and cache.is_within_tolerance(cache.fit(model)):
                    model, has_kinetics = self._with_kinetics(model), True
                entered = None
                if not beside:
                    entered, refused = self._entering(model)
                if entered is None or not self._reduces_what_is_missed(model, entered):
                    # What shows only beside curves leaves a model that is far off without them: from there on nothing
                    # is to be learnt without them.
                    shown = self._entering_beside(model)
                    beside, entered = beside or shown is not None, shown or entered
                if entered is None and not has_kinetics:
                    before, has_kinetics = model, True
                    model = self._with_kinetics(before)
                    if model != before:
                        continue
                if entered is not None:
                    cache.report(f"adding {entered}")
                    model = self._needed(cache.space.key((*model, entered)), (*start, entered))
                elif not beside and (together := self._entering_together(model, refused)):
                    model = self._needed(together, start)
                else:
                    # What is not needed in the end may have kept out what is.
                    model = self._needed(model, start)
                    if model in ended or model == path[-1]:
                        break
                    ended.add(model)
                    continue
                if model in path:
                    break
                path.append(model)
                each(model)
            model = self._needed(model, start)
            model = self._exchanged(model, start)
            law = self._law(model)
            if law:
                model = cache.space.key((*model, law))
            if model != path[-1]:
                path.append(model)
                each(model)
        return self.found(model, path, refused)

    def found(self, model: Sequence[str], path: Sequence[tuple[str, ...]], refused: Mapping[str, Test]) -> Found:
        """Return the result of a search that ends at a model, with the tests of its additions."""
        tests = {label: self.final_test(model, label) for label in model}
        refused = {label: one for label, one in refused.items() if one.significant and label not in model}
        return Found(self.cache.fit(model), tuple(path), tests, refused, self._rivals(tuple(model)))

    # What may enter

    def may_enter(self, model: Sequence[str], label: str) -> bool:
        """Return True if a candidate is not ruled out, and all that it acts on is in the model."""
        candidates = self.cache.space.candidates
        return label not in self.ruled_out and all(
            name in model or name not in candidates for name in candidates[label].effect.needs
        )

    def _promising(self, model: Sequence[str], simpler: Sequence[str]) -> list[str]:
        """Return the candidates that are worth a try, the best scores first; `simpler` are always among them."""
        cache, settings = self.cache, self.cache.settings
        group = {label: one.group for label, one in cache.space.candidates.items()}
        of_weights = (cache.scores(model), cache.scores_by_tolerance(model))
        ranked = [[one for one in scores.gains() if self.may_enter(model, one.label)] for scores in of_weights]
        effects: list[Gain] = []
        for one_ranking in ranked:
            effects += [one for one in one_ranking if group[one.label] in ("effect", "sensor")][
                : settings.refitted_effects
            ]
        for of_channel in of_weights[0].gains_by_channel():
            leading = [one for one in of_channel if self.may_enter(model, one.label) and group[one.label] == "effect"]
            effects += [one for one in leading[: settings.leading_effects] if one.log_evidence > 0.0]
        # Of shifts the best of each kind: at a constant current a voltage that reads too low hides a contact.
        runs: list[Gain] = []
        for one_ranking in ranked:
            of_kind: dict[str, Gain] = {}
            for one in one_ranking:
                if group[one.label] == "run":
                    of_kind.setdefault(cache.space.candidates[one.label].effect.label, one)
            runs += list(of_kind.values())[: settings.refitted_runs]
            runs += [one for one in one_ranking if group[one.label] == "specimen"][: settings.refitted_effects]
        # Where a model leaves noise alone, a score is what a refit gains. Where it leaves more, a score only ranks: it
        # is bounded by half the number of independent errors.
        quiet = self.is_noise(cache.fit(model))
        by_label = {one.label: one for ranking in ranked for one in ranking}
        effects = [*(by_label[label] for label in simpler if label in by_label), *effects]
        least = {
            one.label: LIKELY * self.odds_of(cache.space.candidates[one.label]) if quiet else -1.0
            for one in effects + runs
        }
        likely = [one.label for one in (*effects, *runs) if one.log_evidence > least[one.label] or one.label in simpler]
        return list(dict.fromkeys(likely))

    def _simpler(self, model: Sequence[str]) -> list[str]:
        """Return the effects that do the work of all curves with one number, the best first."""
        cache = self.cache
        fit = cache.fit(model)
        of_curves = {
            place
            for label, amplitude in fit.spec.amplitudes.items()
            if amplitude > NONE
            for place in cache.space.layout.of[label]
        }
        columns = {number for number, place in enumerate(fit.spec.free) if place in of_curves}
        if not columns:
            return []
        gains = cache.scores(model).in_place_of(columns, fit)
        alike = [label for label in gains if cache.space.candidates[label].group in ALIKE]
        likely = [label for label in alike if self.may_enter(model, label)]
        likely = [label for label in likely if gains[label] > self.odds_of(cache.space.candidates[label])]
        return sorted(likely, key=lambda label: -gains[label])[: cache.settings.refitted_effects]

    def _with_kinetics(self, model: tuple[str, ...]) -> tuple[str, ...]:
        """Return the model with charge transfer and diffusion if they have evidence.

        Of a model that is far off, what is missed most comes first: kinetics would bend to it.
        """
        cache = self.cache
        for label in KINETICS:
            if cache.case.kind != "cell" or label not in cache.space.candidates or label in model:
                continue
            if not self.may_enter(model, label):
                continue
            cache.report(f"calibrating with {label}")
            test = self.test((*model, label), label)
            if test.significant and test.plausible:
                model = cache.space.key((*model, label))
        return model

    def _entering(self, model: tuple[str, ...]) -> tuple[str | None, dict[str, Test]]:
        """Return the candidate that gains most and may be added, and the tests of those that were refitted.

        They are refitted in the order of what they leave at their first points, under weights that are the same for
        all. The rest is left out once one may be added that leaves far less than they do.
        """
        cache = self.cache
        before, simpler = cache.fit(model), self._simpler(model)
        labels = self._promising(model, simpler)
        cache.report(f"trying {len(labels)} candidates")
        reached = at_once(lambda label: cache.first_point((*model, label), label)[1], labels)
        left = dict(zip(labels, reached, strict=True))
        labels.sort(key=left.__getitem__)
        if self.is_noise(before):
            labels = [one for one in labels if one in simpler or self._may_be_significant(before, one, left[one])]
        found: list[tuple[float, Test]] = []
        for place in range(0, len(labels), 2):
            some = labels[place : place + 2]
            if any(over > 0.0 and test.enters and left[test.label] < FAR_LESS * left[some[0]] for over, test in found):
                break
            cache.report(f"refitting with {', '.join(some)}")
            fits = at_once(lambda label: cache.fit((*model, label)), some)
            for label, richer in zip(some, fits, strict=True):
                test = self._test(richer, before, label)
                found.append((test.gain - test.odds, test))  # of one model: all odds are held against the same data
        found.sort(key=lambda one: -one[0])
        entering = [(over, test) for over, test in found if over > 0.0 and test.enters]
        best = self._of_all_runs(entering)
        return (best.label if best else None), {test.label: test for _, test in found}

    def _of_all_runs(self, entering: Sequence[tuple[float, Test]]) -> Test | None:
        """Return the first of some tests, or what acts in more runs and data hardly tell from it.

        In place of a shift of one run that is a difference of one specimen, and in place of both an effect.
        """
        candidates = self.cache.space.candidates
        for alone in (SHIFTED, ("run",)):
            wider = [(over, test) for over, test in entering if candidates[test.label].group not in alone]
            if wider and wider[0][0] > entering[0][0] - NOT_TOLD:
                return wider[0][1]
        return entering[0][1] if entering else None

    def _may_be_significant(self, before: Fit, label: str, left: float) -> bool:
        """Return True if a candidate that leaves so much of Q at its first point may be significant after a refit.

        Where few readings are independent Q is small whatever is missing, and nothing is told by it.
        """
        odds = self.odds_of(self.cache.space.candidates[label])
        return before.objective < TELLING * odds or before.objective - left > 2.0 * LIKELY * odds

    def _reduces_what_is_missed(self, model: tuple[str, ...], label: str) -> bool:
        """Return True if an addition reduces the error of a channel beyond its tolerance, or there is none."""
        cache = self.cache
        before, after = (cache.fit(one).mean_squares(cache.view) for one in (model, (*model, label)))
        missed = [name for name, square in before.items() if square > cache.tolerances[name] ** 2]
        return not missed or any(after[name] < (1.0 - REDUCED) * before[name] for name in missed)

    def _entering_together(self, model: tuple[str, ...], tests: Mapping[str, Test]) -> tuple[str, ...] | None:
        """Return the model with two more effects that are needed only beside each other; None if there are none.

        While much is missed few errors are independent, and what explains half of them has little evidence: cells of
        some age have lost capacity and conduct worse, and of four motors two may differ. Once both are in, each is
        asked as in any model.

        Args:
            model: whose errors are beyond tolerance, and to which no single effect may be added.
            tests: of those that were tried.
        """
        cache = self.cache
        if cache.is_within_tolerance(cache.fit(model)):
            return None
        likely = [
            test
            for test in tests.values()
            if test.gain > cache.settings.least_odds
            and test.enters
            and cache.space.candidates[test.label].group in ("effect", "specimen")
            and self._reduces_what_is_missed(model, test.label)
        ]
        for first in sorted(likely, key=lambda one: one.odds - one.gain)[:MOST_TOGETHER]:
            together = cache.space.key((*model, first.label))
            second, _ = self._entering(together)
            if second is None:
                continue
            both = cache.space.key((*together, second))
            if self.test(both, first.label).significant:
                cache.report(f"adding {first.label} and {second}")
                return both
        return None

    def _entering_beside(self, model: tuple[str, ...]) -> str | None:
        """Return a candidate that is named beside curves of what no table states, where errors of a model are left.

        What is slow or small shows only when these have taken what they explain: the lag of a thermometer once the
        entropy has bent the temperature. What warms a cell may show only then too.
        """
        cache = self.cache
        if self.is_noise(cache.fit(model)) or (not model and cache.is_within_tolerance(cache.fit(model))):
            return None
        gains = cache.scores_at(cache.fit(model, "beside"), SINGLE).gains_reweighed()
        likely = [label for label, gain in gains.items() if gain > 0.0 and self.may_enter(model, label)]
        # What curves act through shows only with them: where heat is mostly reversible, a cell hardly warms without it.
        opening = [label for label in self._opening() if label not in model and self.may_enter(model, label)]
        likely = likely[: cache.settings.refitted_beside]
        for label in dict.fromkeys((*opening, *self._imitated(model), *likely)):
            cache.report(f"refitting with {label}, beside curves")
            if self._test(*self._beside(model, label), label).named:
                return label
        return None

    def _opening(self) -> list[str]:
        """Return the effects that curves of no table need, as far as a channel that is missed shows them."""
        cache = self.cache
        needed = dict.fromkeys(name for one in CURVES.values() for name in one.needs)
        return [
            name
            for name in needed
            if name in cache.space.candidates
            and (channel := cache.space.candidates[name].effect.shown_by) in cache.view.data.by_channel
            and cache.base.likelihood.channels[channel].sd > ABOVE_NOISE * cache.noise[channel].sd
        ]

    def _imitated(self, model: tuple[str, ...]) -> list[str]:
        """Return the best effects that curves of no table with evidence imitate, by scores without them."""
        cache = self.cache
        curves = [label for label, test in self.curves(cache.fit(model, "beside")).items() if test.significant]
        imitated = {name for label in curves if label in cache.of_no_table for name in CURVES[label].imitates}
        known = [one for one in sorted(imitated) if one in cache.space.candidates and one not in model]
        if not (known := [name for name in known if self.may_enter(model, name)]):
            return []
        gains = cache.scores_at(cache.fit(model, "beside", known), ("effect",)).gains_reweighed()
        return [name for name in gains if name in known and gains[name] > 0.0][: cache.settings.refitted_beside]

    def _needed(self, model: tuple[str, ...], keep: Sequence[str]) -> tuple[str, ...]:
        """Return the model without additions that it does not need, the least needed first."""
        cache = self.cache
        while others := [label for label in model if label not in keep]:
            tests = {label: self.test(model, label) for label in others}
            weak = [label for label, one in tests.items() if not one.significant]
            weak.sort(key=lambda label: tests[label].gain - tests[label].odds)
            needless = next((label for label in weak if not self.final_test(model, label).significant), None)
            if needless is None:
                break
            cache.report(f"dropping {needless}")
            model = tuple(label for label in model if label != needless)
        return model

    def _in_place_of(
        self, model: tuple[str, ...], label: str, groups: Collection[str] = ALIKE
    ) -> tuple[tuple[str, ...], list[str]]:
        """Return a model without an addition, and the best candidates of some groups that could do its work.

        They are the best where it is, and the best without it: an exchange current has no place at which it is nothing.
        """
        cache, fit = self.cache, self.cache.fit(model)
        lacking = tuple(one for one in model if one != label)
        of_label = set(cache.space.layout.of[label])
        gains = cache.scores(model).in_place_of(
            {at for at, place in enumerate(fit.spec.free) if place in of_label}, fit
        )

        def may_replace(one: str) -> bool:
            in_question = cache.space.candidates[one].group in groups and one not in model
            return in_question and self.may_enter(lacking, one)

        alike = sorted(filter(may_replace, gains), key=lambda one: -gains[one])[:MOST_IN_PLACE]
        without = [one.label for one in cache.scores(lacking).gains() if may_replace(one.label)][:1]
        return lacking, list(dict.fromkeys((*without, *alike)))

    def _exchanged(self, model: tuple[str, ...], keep: Sequence[str]) -> tuple[str, ...]:
        """Return the model with an addition exchanged for another where that has more evidence, beside curves too.

        What heats a cell shows little of it before an entropy curve has bent the temperature. What is needed beside
        curves is not exchanged for what is not: nothing would be named.
        """
        cache = self.cache
        for label in [one for one in model if one not in keep]:
            if not self.test(model, label).significant:
                continue  # it is needed beside curves alone, and rivals are not compared there
            lacking, rivals = self._in_place_of(model, label)
            for rival in rivals:
                other = cache.fit((*lacking, rival))
                against, of_label = (self.odds_of(cache.space.candidates[one]) for one in (rival, label))
                odds = against - of_label - cache.settings.least_odds  # one of them is there: the likelier stands
                if not self.better(other, cache.fit(model), odds):
                    continue
                # A curve that is one of the two would stand in for it.
                beside = cache.fit(other.added, "beside", (label,)), cache.fit(model, "beside", (rival,))
                if not self.is_exact(other) and not self.better(*beside, odds):
                    continue
                if not self._test(other, cache.fit(lacking), rival).plausible:
                    continue
                if self.final_test(other.added, rival).significant or not self.final_test(model, label).significant:
                    cache.report(f"replacing {label} by {rival}")
                    model = other.added
                    break
        return model

    def _law(self, model: tuple[str, ...]) -> str | None:
        """Return the unknown law that explains what is left; None if there is none, or nothing material is left."""
        cache = self.cache
        fit = cache.fit(model)
        if not self._much_is_left(fit):
            return None
        gains = [one for one in cache.scores_at(fit, ("law",)).gains() if one.label not in self.ruled_out]
        gains = [one for one in gains if one.log_evidence > self.odds_of(cache.space.candidates[one.label])]
        gains.sort(key=lambda one: cache.space.candidates[one.label].over == CLOCK)
        for gain in gains[: cache.settings.refitted_laws]:
            cache.report(f"refitting the law {gain.label}")
            richer = cache.fit((*model, gain.label))
            test = self._test(richer, fit, gain.label)
            if test.significant and test.material and not test.worse:
                return gain.label
        return None

    def _much_is_left(self, fit: Fit) -> bool:
        """Return True if a channel's error is above its noise by what an unknown law may explain."""
        settings, data = self.cache.settings, self.cache.view.data
        before, after = self.cache.base.mean_squares(self.cache.view), fit.mean_squares(self.cache.view)
        for name, slices in data.by_channel.items():
            noise = float(np.mean(np.concatenate([data.sd[rows] for rows in slices]) ** 2))
            share = (after[name] - noise) / max(before[name] - noise, 1e-300)
            beyond = after[name] > 1.1 * noise
            if beyond and (share > settings.law_share or after[name] < settings.near_noise**2 * noise):
                return True
        return False

    def _rivals(self, model: tuple[str, ...]) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Return, for each addition, the models with something else in its place that the data do not rule out.

        What is wrong with a sensor in all runs may be so in one of them alone.
        """
        cache, found = self.cache, {}
        own = cache.fit(model)
        for label in [one for one in model if cache.space.candidates[one].group in ALIKE]:
            lacking, near = self._in_place_of(model, label)
            if cache.space.candidates[label].is_sensor:
                near += self._in_place_of(model, label, ("run",))[1]
            near = [one for one in near if not self._says_the_same(one, label)]
            others = [cache.fit((*lacking, one)) for one in near]
            same = [cache.in_place(own, label, one) for one in self._same_as(own, label)]
            untold = [one.added for one in others if not self._told(own, one)]
            untold += [one.added for one in same if not self._tells(own, one, _nearer(own, one))]
            found[label] = tuple(dict.fromkeys(untold))
        return found

    def _same_as(self, fit: Fit, label: str) -> list[str]:
        """Return the candidates that do the same as an addition of a model: an offset of the current is like a leak."""
        cache, (place, *_) = self.cache, self.cache.space.layout.of[label]
        alike = cache.scores(fit.added).resembling(fit.spec.free.index(place))
        return [
            one
            for one, correlation in alike.items()
            if correlation > SAME
            and cache.space.candidates[one].group in ALIKE
            and not self._says_the_same(one, label)
            and self.may_enter([other for other in fit.added if other != label], one)
        ][:MOST_IN_PLACE]

    def _says_the_same(self, one: str, other: str) -> bool:
        """Return True for the same difference of either of two specimens: one has more where the other has less."""
        first, second = (self.cache.space.candidates[label] for label in (one, other))
        of_two = len(self.cache.case.specimens) == 2 and bool(first.specimen and second.specimen)
        return of_two and first.effect.label == second.effect.label

    def _told(self, own: Fit, other: Fit) -> bool:
        """Return True if the data tell a model from another, as they are or beside curves of no table."""
        if self._tells(own, other) or self.is_exact(own):
            return self._tells(own, other)
        return self._tells(self.cache.fit(own.added, "beside"), self.cache.fit(other.added, "beside"))

    def _tells(self, own: Fit, other: Fit, weights: Likelihood | None = None) -> bool:
        """Return True if the data tell a model from another under some weights, its own if none are given."""
        weights = weights or own.likelihood
        return self.evidence(own, weights) - self.evidence(other, weights) >= NOT_TOLD


def _nearer(one: Fit, other: Fit) -> Likelihood:
    """Return the weights of the model that leaves less: under those of the other nothing is told."""

    def weight(fit: Fit) -> float:
        return sum(channel.count * np.log(channel.root) for channel in fit.likelihood.channels.values())

    return max((one, other), key=weight).likelihood
