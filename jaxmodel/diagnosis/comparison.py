"""Two models held against each other: evidence at equal weights, and what makes an addition a name."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np

from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.candidates import Candidate
from jaxmodel.fit.estimate import NONE, Fit, best_amplitudes, evidence
from jaxmodel.fit.likelihood import Likelihood
from jaxmodel.fit.linearisation import log_evidence, solved
from jaxmodel.fit.settings import SEED

# Bags: how many, and in what share of them a name must be needed.
BAGS, STABLE = 100, 0.9
# A named size is at least so many sd from its null, and so many times its usual range at most.
LEAST_SD, FURTHEST = 2.0, 3.0
# Of a range over decades, whose ends are at one sd, this is within two sd.
FURTHEST_SD = 2.0
# Errors up to so many times the noise, with so many readings for each independent one, are those of a sensor. Assumed.
ABOVE_NOISE, WHITE = 1.15, 1.5
# An addition removes this share of the noise at least, as a root mean square; a shift of one run in that run. Assumed.
SEEN = 0.3
# Pooled error of a channel that a name may add: a twentieth is within what weights and noise do. Assumed.
NO_WORSE = 0.05
# Share of a tolerance by which an error on held-out runs may rise (design).
WORSE = 0.1
# Product over channels of the shares of the mean square error that are left, below which one channel pays for another.
# Assumed.
PAID_FOR = 0.5
# Log evidence of all curves together from which tables are not exact: 20 to 1.
INEXACT = 3.0


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


class Comparison:
    """Models of a case held against each other."""

    def __init__(self, cache: FitCache) -> None:
        """Compare the models of a cache."""
        self.cache = cache

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

    def evidence(self, fit: Fit, likelihood: Likelihood, loose: Collection[int] = ()) -> float:
        """Return the log evidence of a model under some weights, the amplitudes of its curves the best under them.

        Args:
            fit: the model.
            likelihood: the weights.
            loose: unknowns whose stated values are not held to.
        """
        return evidence(self.cache.view, fit, likelihood, loose)

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

    def better(self, one: Fit, other: Fit, odds: float = 0.0) -> bool:
        """Return True if a model has more evidence than another under the weights of either, by more than some odds."""
        least = self.cache.settings.least_odds + odds
        return all(
            self.evidence(one, weights) > self.evidence(other, weights) + least
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
        entropy curve and curves of friction and torque too, as far as these are not the addition itself. It is material
        if it reduces the error of the model, whether or not these reach about the same error: which of the two it is,
        the evidence says.
        """
        test = self._test(*self.compared(model, label), label)
        if test.significant and not test.material:
            test = dataclasses.replace(test, material=self.test(model, label).material)
        # What is reported is the size in the final model: beside curves its sd may be smaller.
        own = self._size_sd(self.cache.fit(model), self.cache.space.candidates[label])
        return dataclasses.replace(test, size_sd=min(test.size_sd, own))

    def compared(self, model: Sequence[str], label: str) -> tuple[Fit, Fit]:
        """Return the model with an addition and without it, as `final_test` holds them against each other."""
        cache, rest = self.cache, [one for one in model if one != label]
        if self.is_exact(cache.fit(model)) or cache.space.candidates[label].group == "law":
            return cache.fit(model), cache.fit(rest)
        return self._beside(rest, label)

    def _beside(self, rest: Sequence[str], label: str) -> tuple[Fit, Fit]:
        return self.cache.fit((*rest, label), "beside"), self.cache.fit(rest, "beside", (label,))

    def _test(self, richer: Fit, before: Fit, label: str) -> Test:
        candidate, gained = self.cache.space.candidates[label], self.gain(richer, before)
        # For the first addition the odds are even: with less evidence the data do not decide.
        odds = self.odds_of(candidate) - (0.0 if before.added else self.cache.settings.least_odds)
        exact = self.is_exact(richer)
        if not exact:
            odds += self.cache.settings.odds_beside_model_error
        worse, material = self._errors(richer, before)
        if self.is_noise(richer) and candidate.runs:
            # A shift of one run must be seen in that run: of a model that is not quite the cell, some run is always a
            # little off. The same holds for a specimen.
            material = self._shifts(richer, before, candidate.runs)
        elif exact:
            material = True  # what is significant is all that there was to explain
        elif candidate.is_sensor:
            material = material and self._stands_out(richer, before)
        elif candidate.runs:
            # Tables bend to a contact of one run until hardly more is missed: the evidence says which of the two it is.
            material = material or self._moves(richer, candidate)
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
        shares = np.zeros((BAGS, numbers.size))
        for bag in shares:
            for run in np.unique(numbers):
                mine = np.flatnonzero(numbers == run)
                bag[mine] = random.multinomial(mine.size, np.full(mine.size, 1.0 / mine.size))
        weights, found = richer.likelihood, []
        for one in (richer, before):
            precision = best_amplitudes(self.cache.view, one.spec, one.linear, weights).precision
            found.append([log_evidence(gram, precision) for gram in one.linear.resampled(weights, shares)])
        return float(np.mean(np.greater(*found)))

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

    def _shifts(self, richer: Fit, before: Fit, runs: Collection[int]) -> bool:
        """Return True if the error of a channel in one of some runs falls by enough to be seen beside its noise."""
        data = self.cache.view.data
        for (_, number), rows in data.chains:
            if number in runs:
                removed = np.mean(before.errors[rows] ** 2) - np.mean(richer.errors[rows] ** 2)
                if removed > (SEEN * data.sd[rows][0]) ** 2:
                    return True
        return False

    def _moves(self, fit: Fit, candidate: Candidate) -> bool:
        """Return True if a shift of some runs moves a channel by more than its tolerance there."""
        places = [fit.spec.free.index(place) for place in self.cache.space.layout.of[candidate.label]]
        x, data = fit.free[places], self.cache.view.data
        for name, gram in fit.linear.by_channel.items():
            rows = sum(
                part.stop - part.start for (one, run), part in data.chains if one == name and run in candidate.runs
            )
            if rows and x @ gram.square[np.ix_(places, places)] @ x > rows * self.cache.tolerances[name] ** 2:
                return True
        return False

    def _stands_out(self, richer: Fit, before: Fit) -> bool:
        """Return True if an addition removes more of a channel's error than the model misses of it beside noise.

        A fault of a sensor that is smaller may as well be the model's.
        """
        after, earlier = richer.mean_squares(self.cache.view), before.mean_squares(self.cache.view)
        return any(
            earlier[name] - square > max(square - self.cache.noise[name].sd ** 2, 0.0) for name, square in after.items()
        )

    def _is_material(self, name: str, before: float, after: float) -> bool:
        """Return True if a channel's mean square error falls by enough.

        Enough is a tenth of a stated tolerance, as the root of what is removed, or without one a share of what is above
        the noise, and of the noise itself: an offset of a tenth of it is no fault of a sensor. Where all is explained
        but noise, what is significant is all there was to explain.
        """
        cache, settings = self.cache, self.cache.settings
        removed = max(before - after, 0.0)
        if name in cache.case.tolerance:
            return removed >= (settings.material_share * cache.case.tolerance[name].rms) ** 2
        noise = cache.noise[name].sd ** 2
        return removed >= max(settings.least_share * (before - min(noise, after)), SEEN**2 * noise) > 0.0

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
        """Return True if an addition lies within a few times its usual range: its amplitude, energies and shares."""
        x = fit.x[list(self.cache.space.layout.of[candidate.label])]
        if candidate.is_vector:
            return float(np.sqrt(np.mean(x**2))) <= self.cache.settings.implausible
        first, *others = candidate.coordinates
        if any(not one.logarithmic and abs(at) > FURTHEST for one, at in zip(others, x[1:], strict=True)):
            return False
        if not first.logarithmic:
            return bool(abs(x[0]) <= FURTHEST)
        # A smaller amplitude than usual is small and not wrong.
        stronger = -x[0] if candidate.null_at_infinity else x[0]
        return bool(stronger <= max(1.0 + np.log(FURTHEST) / first.spread, FURTHEST_SD))


def is_rare(candidate: Candidate) -> bool:
    """Return True for an effect that is rare."""
    return candidate.effect.rare
