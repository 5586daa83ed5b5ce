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

from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.candidates import Candidate
from jaxmodel.fit.coordinates import REACH_OF_ALL
from jaxmodel.fit.estimate import NONE, Fit, best_amplitudes, rarer
from jaxmodel.fit.lanes import at_once
from jaxmodel.fit.likelihood import Likelihood
from jaxmodel.fit.linearisation import log_evidence, solved
from jaxmodel.fit.scores import Gain
from jaxmodel.fit.settings import SEED

# Every cell has charge transfer and diffusion: they enter before anything else, if they help at all.
KINETICS = ("charge_transfer", "slow_diffusion")
CLOCK = "time_s"
# Bags: how many, and in what share of them a name must be needed.
BAGS, STABLE = 100, 0.9
# A named size is at least so many sd from its null, and so many times its usual range at most.
LEAST_SD, FURTHEST = 2.0, 3.0
# Of a range over decades, whose ends are at one sd, this is within two sd.
FURTHEST_SD = 2.0
# Errors up to so many times the noise, with so many readings for each independent one, are those of a sensor. Assumed.
ABOVE_NOISE, WHITE = 1.15, 1.5
# A shift of one run removes at least this share of the noise, as a root mean square over the run. Assumed.
SEEN = 0.3
# Pooled error of a channel that a name may add: a twentieth is within what weights and noise do. Assumed.
NO_WORSE = 0.05
# Product over channels of the shares of the mean square error that are left, below which one channel pays for another.
# Assumed.
PAID_FOR = 0.5
# A candidate is refitted if its expected gain is at least this share of the odds that it must exceed. Assumed.
LIKELY = 0.3
# Share of a mean square error by which an addition reduces what is missed. Assumed.
REDUCED = 0.1
# Log evidence of all curves together from which tables are not exact: 20 to 1.
INEXACT = 3.0
# A candidate is not refitted where another may enter that leaves less than this share of Q at its first point. Assumed.
FAR_LESS = 0.5


@dataclasses.dataclass(frozen=True)
class Test:
    """One addition to a model, held against the model without it.

    Attributes:
        label: of the addition.
        gain: log evidence that the model loses without it, refitted, at equal weights.
        odds: log odds that the gain must exceed.
        share: of bags in which it gains at all.
        size_sd: its amplitude, in sd from its null.
        plausible: its numbers lie within a few times their usual range, with the right sign.
        material: it reduces the error of a channel by enough.
        worse: channels whose pooled error is larger with it.
        unseen: what it acts through and no channel shows; "" if one does, or tables are exact.
        held_out: what speaks against it on held-out runs; "" if nothing does.
    """

    label: str
    gain: float
    odds: float
    share: float
    size_sd: float
    plausible: bool
    material: bool
    worse: tuple[str, ...]
    unseen: str = ""
    held_out: str = ""

    @property
    def significant(self) -> bool:
        """Return True if its evidence exceeds the odds against so many candidates."""
        return self.gain > self.odds

    @property
    def named(self) -> bool:
        """Return True if it is needed, stable, material, of a possible size, and makes no channel worse."""
        return self.significant and not self.why_not()

    @property
    def enters(self) -> bool:
        """Return True if it may enter a model, apart from its evidence."""
        return self.plausible and self.material and not self.unseen

    def why_not(self) -> str:
        """Return why a significant addition is not named; "" if it is."""
        if self.held_out:
            return self.held_out
        if self.unseen:
            return f"it acts through {self.unseen}, which no channel shows"
        if self.share < STABLE:
            return f"it is needed in only {100.0 * self.share:.0f} % of resampled data"
        if self.size_sd < LEAST_SD:
            return f"its size is {self.size_sd:.1f} sd from nothing"
        if not self.plausible:
            return f"its size is more than {FURTHEST:g} times outside its usual range"
        if self.worse:
            return f"it raises the error of {' and '.join(self.worse)}"
        if not self.material:
            return "it reduces no error by a material amount"
        return ""


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


class Search:
    """A search over the models of a case."""

    def __init__(self, cache: FitCache) -> None:
        """Search in the models of a cache."""
        self.cache = cache

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
            has_kinetics = False
            for _ in range(cache.settings.most_rounds):
                if not has_kinetics and cache.is_within_tolerance(cache.fit(model)):
                    model, has_kinetics = self._with_kinetics(model), True
                entered, refused = self._entering(model)
                if entered is None or not self._reduces_what_is_missed(model, entered):
                    entered = self._entering_beside(model) or entered
                if entered is None and has_kinetics:
                    break
                if entered is None:
                    before, has_kinetics = model, True
                    model = self._with_kinetics(before)
                    if model == before:
                        break
                    continue
                cache.report(f"adding {entered}")
                model = cache.space.key((*model, entered))
                model = self._needed(model, (*start, entered))
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
        refused = {label: one for label, one in refused.items() if label not in model}
        return Found(self.cache.fit(model), tuple(path), tests, refused, self._rivals(tuple(model)))

    # What may enter

    def odds_of(self, candidate: Candidate) -> float:
        """Return the log odds that the gain of a candidate must exceed: one, and the log of how many are alike."""
        settings = self.cache.settings
        group = ("effect", "sensor") if candidate.group in ("effect", "sensor") else (candidate.group,)
        similar = sum(
            np.exp(-settings.rare_odds * is_rare(one))
            for one in self.cache.space.candidates.values()
            if one.group in group
        )
        return settings.least_odds + float(np.log(max(1.0, similar))) + settings.rare_odds * is_rare(candidate)

    def may_enter(self, model: Sequence[str], label: str) -> bool:
        """Return True if all that a candidate acts on is in the model."""
        candidates = self.cache.space.candidates
        return all(name in model or name not in candidates for name in candidates[label].effect.needs)

    def promising(self, model: Sequence[str]) -> list[Gain]:
        """Return the candidates that are worth a refit, the best scores first."""
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
        # Where a model leaves noise alone, a score is what a refit gains. Where it leaves more, a score only ranks: it
        # is bounded by half the number of independent errors.
        quiet = self.is_noise(cache.fit(model))
        by_label = {one.label: one for ranking in ranked for one in ranking}
        simpler = self._simpler(model)
        effects = [*(by_label[label] for label in simpler if label in by_label), *effects]
        together: dict[str, Gain] = {}
        for one in (*effects, *runs):
            least = LIKELY * self.odds_of(cache.space.candidates[one.label]) if quiet else -1.0
            if one.log_evidence > least or one.label in simpler:
                together.setdefault(one.label, one)
        return list(together.values())

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
        likely = [label for label in gains if _alike(cache, label) and self.may_enter(model, label)]
        likely = [label for label in likely if gains[label] > self.odds_of(cache.space.candidates[label])]
        return sorted(likely, key=lambda label: -gains[label])[: cache.settings.refitted_effects]

    def _with_kinetics(self, model: tuple[str, ...]) -> tuple[str, ...]:
        """Return the model with charge transfer and diffusion if they have evidence.

        Of a model that is far off, what is missed most comes first: kinetics would bend to it.
        """
        cache = self.cache
        for label in KINETICS:
            if label not in cache.space.candidates or label in model or cache.case.kind != "cell":
                continue
            cache.report(f"calibrating with {label}")
            if self.test((*model, label), label).significant:
                model = cache.space.key((*model, label))
        return model

    def _entering(self, model: tuple[str, ...]) -> tuple[str | None, dict[str, Test]]:
        """Return the candidate that gains most and may be added, and the tests of those that were refitted.

        They are refitted in the order of what they leave at their first points, under weights that are the same for
        all. The rest is left out once one may be added that leaves far less than they do.
        """
        cache = self.cache
        gains, before = self.promising(model), cache.fit(model)
        cache.report(f"trying {len(gains)} candidates")
        labels = [gain.label for gain in gains]
        reached = at_once(lambda label: cache.first_point((*model, label), label)[1], labels)
        left = dict(zip(labels, reached, strict=True))
        labels.sort(key=left.__getitem__)
        labels = self._worth_a_refit(model, labels, left)
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
        best = next((test for over, test in found if over > 0.0 and test.enters), None)
        return (best.label if best else None), {test.label: test for _, test in found if test.significant}

    def _worth_a_refit(self, model: tuple[str, ...], labels: Sequence[str], left: Mapping[str, float]) -> list[str]:
        """Return the candidates that could be significant, by what they leave of Q at their first points.

        Where few readings are independent Q is small whatever is missing, and all are refitted.
        """
        cache, before, simpler = self.cache, self.cache.fit(model), self._simpler(model)
        odds = {label: self.odds_of(cache.space.candidates[label]) for label in labels}
        if not cache.is_within_tolerance(before):
            return list(labels)
        return [
            label
            for label in labels
            if label in simpler
            or before.objective < 6.0 * odds[label]
            or before.objective - left[label] > 2.0 * LIKELY * odds[label]
        ]

    def _reduces_what_is_missed(self, model: tuple[str, ...], label: str) -> bool:
        """Return True if an addition reduces the error of a channel beyond its tolerance, or there is none."""
        cache = self.cache
        before, after = (cache.fit(one).mean_squares(cache.view) for one in (model, (*model, label)))
        missed = [name for name, square in before.items() if square > cache.tolerances[name] ** 2]
        return not missed or any(after[name] < (1.0 - REDUCED) * before[name] for name in missed)

    def _entering_beside(self, model: tuple[str, ...]) -> str | None:
        """Return a candidate that is named beside curves of what no table states, where errors of a model are left.

        What is slow or small shows only when these have taken what they explain: the lag of a thermometer once the
        entropy has bent the temperature. What warms a cell may show only then too.
        """
        cache = self.cache
        if self.is_noise(cache.fit(model)) or (not model and cache.is_within_tolerance(cache.fit(model))):
            return None
        gains = cache.scores_at(cache.fit(model, "beside"), ("effect", "sensor", "run")).gains()
        likely = [
            one.label
            for one in gains
            if one.log_evidence > self.odds_of(cache.space.candidates[one.label]) and self.may_enter(model, one.label)
        ]
        for label in likely[: cache.settings.refitted_beside]:
            cache.report(f"refitting with {label}, beside curves")
            if self._beside(model, label).named:
                return label
        return None

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

    def _exchanged(self, model: tuple[str, ...], keep: Sequence[str]) -> tuple[str, ...]:
        """Return the model with an addition exchanged for another where that has more evidence."""
        cache = self.cache
        for label in [one for one in model if one not in keep]:
            lacking = tuple(one for one in model if one != label)
            gains = [one for one in cache.scores(lacking).gains() if self.may_enter(lacking, one.label)]
            rivals = [one.label for one in gains if one.label not in model and _alike(cache, one.label)][:2]
            for rival in rivals:
                other = cache.fit((*lacking, rival))
                if self.better(other, cache.fit(model)) and self._test(other, cache.fit(lacking), rival).plausible:
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
        gains = cache.scores_at(fit, ("law",)).gains()
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
        """Return, for each addition, the models with something else in its place that the data do not rule out."""
        cache, found = self.cache, {}
        for label in [one for one in model if _alike(cache, one)]:
            lacking = tuple(one for one in model if one != label)
            gains = [one for one in cache.scores(lacking).gains() if self.may_enter(lacking, one.label)]
            near = [one.label for one in gains if one.label not in model and _alike(cache, one.label)][:2]
            own = cache.fit(model)
            unsure = self.gain(own, cache.fit(lacking)) < 50.0
            others = [cache.fit((*lacking, one)) for one in near if unsure]
            found[label] = tuple(
                one.added
                for one in others
                if self.evidence(own, own.likelihood) - self.evidence(one, own.likelihood) < 3.0
            )
        return found

    # Comparisons, at equal weights

    def evidence(self, fit: Fit, likelihood: Likelihood, loose: Collection[int] = ()) -> float:
        """Return the log evidence of a model under some weights, the amplitudes of its curves the best under them.

        Args:
            fit: the model.
            likelihood: the weights.
            loose: unknowns whose stated values are not held to.
        """
        spec = best_amplitudes(self.cache.view, fit.spec, fit.linear, likelihood)
        precision = np.where(np.isin(spec.free, list(loose)), spec.precision / REACH_OF_ALL**2, spec.precision)
        return log_evidence(fit.linear.under(likelihood), precision) - rarer(spec)

    def gain(self, richer: Fit, before: Fit) -> float:
        """Return the log evidence that a richer model gains over another, under the richer one's weights.

        A stated number that the other has to strain may be stated wrong: that alone makes no effect.
        """
        strained = self._strained(before)
        own, other = (self.evidence(one, richer.likelihood, strained) for one in (richer, before))
        return own - other

    def _strained(self, fit: Fit) -> frozenset[int]:
        """Return the unknowns of all runs that a model has to move far from what the case states."""
        layout = self.cache.space.layout
        return frozenset(
            place
            for place, pull in zip(fit.spec.free, fit.pulls, strict=True)
            if place < layout.base and layout.runs[place] < 0 and abs(pull) > self.cache.settings.strained
        )

    def better(self, one: Fit, other: Fit) -> bool:
        """Return True if a model has more evidence than another under the weights of either."""
        return all(
            self.evidence(one, weights) > self.evidence(other, weights) + self.cache.settings.least_odds
            for weights in (one.likelihood, other.likelihood)
        )

    def curves(self, fit: Fit) -> dict[str, Test]:
        """Hold each curve of a model against the model with nothing in its place, to first order."""
        cache, weights, found = self.cache, fit.likelihood, {}
        of_base = [label for label in fit.spec.amplitudes if cache.space.candidates[label].group == "curve"]
        odds = cache.settings.least_odds + float(np.log(max(1, len(of_base))))
        for label in of_base:
            if fit.spec.amplitudes[label] <= NONE:
                continue
            without = cache.space.spec(fit.spec.labels, {**fit.spec.amplitudes, label: NONE})
            gram = fit.linear.under(weights)
            gained = log_evidence(gram, fit.spec.precision) - log_evidence(gram, without.precision)
            x = solved(gram.square, gram.aim, without.precision)
            material = False
            for name, one in fit.linear.by_channel.items():
                material |= self._is_material(name, one.misfit(x) / one.count, one.misfit(fit.free) / one.count)
            candidate = cache.space.candidates[label]
            size = self._size_sd(fit, candidate)
            found[label] = Test(label, gained, odds, 1.0, size, True, material, ())
        return found

    def test(self, model: Sequence[str], label: str) -> Test:
        """Hold one addition of a model against the model without it."""
        cache = self.cache
        richer, before = cache.fit(model), cache.fit([one for one in model if one != label])
        return self._test(richer, before, label)

    def final_test(self, model: Sequence[str], label: str) -> Test:
        """Hold an addition against the model without it, and against what else could stand for it.

        Where errors are left that no sensor makes, it must be needed beside an activation energy of each resistance, an
        entropy curve and curves of friction and torque too, as far as these are not the addition itself.
        """
        cache = self.cache
        if self.is_exact(cache.fit(model)) or cache.space.candidates[label].group == "law":
            return self.test(model, label)
        return self._beside([one for one in model if one != label], label)

    def _beside(self, rest: Sequence[str], label: str) -> Test:
        cache = self.cache
        richer, before = cache.fit((*rest, label), "beside"), cache.fit(rest, "beside", (label,))
        return self._test(richer, before, label)

    def _test(self, richer: Fit, before: Fit, label: str) -> Test:
        candidate, gained = self.cache.space.candidates[label], self.gain(richer, before)
        # For the first addition the odds are even: with less evidence the data do not decide.
        odds = self.odds_of(candidate) - (0.0 if before.added else self.cache.settings.least_odds)
        exact = self.is_exact(richer)
        if not exact:
            odds += self.cache.settings.odds_beside_model_error
        worse, material = self._errors(richer, before)
        if self.is_noise(richer) and candidate.run >= 0:
            # A shift of one run must be seen in that run: of a model that is not quite the cell, some run is always a
            # little off.
            material = self._shifts(richer, before, candidate.run)
        elif exact:
            material = True  # what is significant is all that there was to explain
        share = 1.0 if exact else self._share_of_bags(richer, before) if gained > odds else 0.0
        shown_by = candidate.effect.shown_by
        unseen = "" if exact or not shown_by or shown_by in self.cache.view.data.by_channel else shown_by
        return Test(
            label,
            gained,
            odds,
            share,
            self._size_sd(richer, candidate),
            self._plausible(richer, candidate),
            material,
            worse,
            unseen,
        )

    def is_exact(self, fit: Fit) -> bool:
        """Return True if a model leaves the noise of the sensors and no curve has evidence: evidence needs no check."""
        if not self.is_noise(fit):
            return False
        stiff = self.cache.space.spec(fit.spec.labels, dict.fromkeys(fit.spec.amplitudes, NONE), fit.spec.spreads)
        gram = fit.linear.under(fit.likelihood)
        return log_evidence(gram, fit.spec.precision) - log_evidence(gram, stiff.precision) < INEXACT

    def is_noise(self, fit: Fit) -> bool:
        """Return True if a model leaves the noise of the sensors and nothing else."""
        return all(
            one.sd <= ABOVE_NOISE * self.cache.noise[name].sd and one.inflation <= WHITE
            for name, one in fit.likelihood.channels.items()
        )

    def _share_of_bags(self, richer: Fit, before: Fit) -> float:
        """Return the share of resampled data in which a richer model has more evidence; each run's blocks are drawn."""
        random = np.random.default_rng(SEED)
        numbers = np.array(list(richer.linear.runs.values()))
        weights = richer.likelihood
        specs = [best_amplitudes(self.cache.view, one.spec, one.linear, weights) for one in (richer, before)]
        won = 0
        for _ in range(BAGS):
            shares = np.zeros(numbers.size)
            for run in np.unique(numbers):
                mine = np.flatnonzero(numbers == run)
                shares[mine] = random.multinomial(mine.size, np.full(mine.size, 1.0 / mine.size))
            own, other = (
                log_evidence(one.linear.under(weights, shares), spec.precision)
                for one, spec in zip((richer, before), specs, strict=True)
            )
            won += own > other
        return won / BAGS

    def _errors(self, richer: Fit, before: Fit) -> tuple[tuple[str, ...], bool]:
        """Return the channels that a richer model makes worse, and whether it makes any better by enough."""
        cache, settings = self.cache, self.cache.settings
        after, earlier = richer.mean_squares(cache.view), before.mean_squares(cache.view)
        left_out = [one.linear.left_out(richer.likelihood, one.spec.precision) for one in (richer, before)]
        worse, material = [], False
        for name, slices in cache.view.data.by_channel.items():
            noise = float(np.mean(np.concatenate([cache.view.data.sd[rows] for rows in slices]) ** 2))
            floor = noise + (settings.negligible_share * cache.tolerances[name]) ** 2
            most = (1.0 + NO_WORSE) ** 2
            if after[name] > most * earlier[name] and after[name] > floor:
                worse.append(name)
            if left_out[0][name] > (1.0 + settings.largest_increase) * left_out[1][name] and left_out[0][name] > floor:
                worse.append(name)
            material |= self._is_material(name, earlier[name], after[name])
        # One channel may pay for another: where a cell warms in the model too, its resistances change.
        together = np.prod([max(after[name], 1e-300) / max(earlier[name], 1e-300) for name in after])
        return (tuple(dict.fromkeys(worse)) if together > PAID_FOR else ()), material

    def _shifts(self, richer: Fit, before: Fit, run: int) -> bool:
        """Return True if the error of a channel in one run falls by enough to be seen beside its noise."""
        data = self.cache.view.data
        for (_, number), rows in data.chains:
            if number == run:
                removed = np.mean(before.errors[rows] ** 2) - np.mean(richer.errors[rows] ** 2)
                if removed > (SEEN * data.sd[rows][0]) ** 2:
                    return True
        return False

    def _is_material(self, name: str, before: float, after: float) -> bool:
        """Return True if a channel's mean square error falls by enough.

        Enough is a tenth of a stated tolerance, as the root of what is removed, or without one a share of what is above
        the noise. Where all is explained but noise, what is significant is all there was to explain.
        """
        cache, settings = self.cache, self.cache.settings
        removed = max(before - after, 0.0)
        if name in cache.case.tolerance:
            return removed >= (settings.material_share * cache.case.tolerance[name].rms) ** 2
        noise = cache.noise[name].sd ** 2
        return removed >= settings.least_share * (before - min(noise, after)) > 0.0

    def _size_sd(self, fit: Fit, candidate: Candidate) -> float:
        """Return the size of an addition in its sd."""
        places = [fit.spec.free.index(place) for place in self.cache.space.layout.of[candidate.label]]
        if candidate.is_vector:
            covariance = fit.covariance[np.ix_(places, places)]
            x = fit.free[places]
            return float(np.sqrt(max(x @ np.linalg.solve(covariance, x), 0.0)))
        if not candidate.has_amplitude:
            return np.inf
        coordinate, x, sd = candidate.coordinates[0], fit.free[places[0]], fit.sd[places[0]]
        if coordinate.logarithmic:
            return 1.0 / max(coordinate.spread * sd, 1e-12)
        return abs(coordinate.number(x) - coordinate.number(0.0)) / max(coordinate.slope(x) * sd, 1e-300)

    def _plausible(self, fit: Fit, candidate: Candidate) -> bool:
        """Return True if the amplitude of an addition lies within a few times its usual range."""
        x = fit.x[list(self.cache.space.layout.of[candidate.label])]
        if candidate.is_vector:
            return float(np.sqrt(np.mean(x**2))) <= self.cache.settings.implausible
        first = candidate.coordinates[0]
        if not first.logarithmic:
            return bool(abs(x[0]) <= FURTHEST)
        # A smaller amplitude than usual is small and not wrong.
        stronger = -x[0] if candidate.null_at_infinity else x[0]
        return bool(stronger <= max(1.0 + np.log(FURTHEST) / first.spread, FURTHEST_SD))


def is_rare(candidate: Candidate) -> bool:
    """Return True for an effect that is rare."""
    return candidate.effect.rare


def _alike(cache: FitCache, label: str) -> bool:
    return cache.space.candidates[label].group in ("effect", "sensor")
