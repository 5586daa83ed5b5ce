"""All calibrated models of one case: each is fitted once, and its numbers do not depend on what was fitted before."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np

from jaxmodel.base.errors import FitError
from jaxmodel.base.memory import give_back
from jaxmodel.base.units import unit_of
from jaxmodel.case.records import Case
from jaxmodel.effects.curves import CURVES
from jaxmodel.fit.data import collect
from jaxmodel.fit.estimate import AMPLITUDES, NONE, SPREADS, STEPS, Fit, calibrate, rarer
from jaxmodel.fit.gauss_newton import descend, errors_at
from jaxmodel.fit.lanes import at_once
from jaxmodel.fit.likelihood import Likelihood, from_tolerances
from jaxmodel.fit.linearisation import solved
from jaxmodel.fit.noise.contract import noise_of_case
from jaxmodel.fit.noise.of_speed import with_noise_of_speed
from jaxmodel.fit.preparation import prepared
from jaxmodel.fit.scores import Scores
from jaxmodel.fit.screen import Screen, screen
from jaxmodel.fit.settings import SEED, SETTINGS, Settings
from jaxmodel.fit.space import Labels, ModelSpace, ModelSpec, View
from jaxmodel.fit.starts import best_along

Progress = Callable[[str], None]
# Which curves a model has: none, corrections of tables, those of relations without a table too, or of these only those
# that imitate none of its additions.
Curves = Literal["none", "base", "all", "beside"]
_Key = tuple[Labels, bool, Labels]  # of a model: its additions, whether it has curves of no table, all its curves
# Log evidence by which a fit from another start must be better. Assumed.
LEAST_BETTER = 0.5
# Mean square error of a channel, over that of a simpler model, from which a start has given it up. Assumed.
GIVEN_UP = 1.1
# A channel with at least so many readings for each independent one, and errors of so many sd of its noise, may be
# calibrated from the weights of noise, where those would leave at most this share of the mean square above it. Assumed.
SLOW, QUIET, LEFT = 10.0, 1.15, 0.5
# Models whose scores are kept: they hold the derivatives of all readings by all candidates.
SCORED = 4
# Random points from which the first fit may start, where the stated model stands still. Assumed.
_RANDOM_STARTS = 15


class FitCache:
    """One case, its fitted readings, and every model of it that was calibrated.

    Attributes:
        case: as it is fitted: bad readings left out, inputs alike in all runs.
        preparation: remarks on what is doubtful or was excluded.
        noise: of every output.
        space: of all models.
        view: the fitted readings.
        fit_runs: numbers of the fitted runs.
        settings: the constants.
    """

    def __init__(
        self,
        case: Case,
        *,
        without: Sequence[str] = (),
        only: Sequence[str] | None = None,
        settings: Settings = SETTINGS,
        progress: Progress | None = None,
    ) -> None:
        """Prepare the readings and lay out all candidates.

        Args:
            case: with at least one fit run.
            without: names of effects that are ruled out.
            only: names of the curves and effects that are laid out; None: all candidates.
            settings: the constants.
            progress: called with a description of each step.

        Raises:
            FitError: nothing is uncertain, no run may be used to calibrate, or there are no readings.
            EffectError: a name that is no candidate of this case.
        """
        self.settings, self._progress = settings, progress
        self.case, self.preparation = prepared(case)
        self.noise = with_noise_of_speed(self.case, noise_of_case(self.case))
        self.space = ModelSpace(self.case, without, settings, only)
        self.fit_runs = [number for number, run in enumerate(self.case.runs) if run.split == "fit"]
        if not any(name in self.case.runs[number].measured.outputs for name in self.noise for number in self.fit_runs):
            raise FitError(f"{self.case.label}: {_why_no_readings(self.case)}.")
        outputs = self.case.vocabulary.outputs
        self.view = View(self.space, collect(self.space.fitted, self.noise, outputs, self.fit_runs, settings))
        self._fits: dict[_Key, Fit] = {}
        self._stay: dict[_Key, dict[str, float]] = {}
        self._points: dict[tuple[Labels, str, Curves], tuple[np.ndarray, float]] = {}
        self._scores: dict[Labels, tuple[Scores, Scores]] = {}

    def report(self, what: str) -> None:
        """Report what is being done, if a progress function was given; what was done frees its memory."""
        give_back()
        if self._progress is not None:
            self._progress(what)

    @functools.cached_property
    def tolerances(self) -> dict[str, float]:
        """Return the tolerance of each channel, stated or assumed, in its unit."""
        stated = self.case.tolerance
        return {name: stated[name].rms if name in stated else self.assumed_tolerance(name) for name in self.noise}

    @functools.cached_property
    def weights_of_tolerances(self) -> Likelihood:
        """Return the weights with which a fit begins whose errors are not known: those of errors of a tolerance."""
        return from_tolerances(self.view.data, self.tolerances)

    def assumed_tolerance(self, channel: str) -> float:
        """Return the assumed tolerance of a channel, in its unit."""
        if unit_of(channel) == "degC":
            return self.settings.assumed_temperature_K
        runs = [run.measured.outputs[channel] for run in self.case.runs if channel in run.measured.outputs]
        highest, lowest = np.nanmax([np.nanmax(one) for one in runs]), np.nanmin([np.nanmin(one) for one in runs])
        share = self.settings.assumed_voltage if unit_of(channel) == "V" else self.settings.assumed_share
        return share * float(highest - lowest)

    # Models

    def spec(self, labels: Sequence[str], curves: Curves = "base") -> ModelSpec:
        """Return the model with some additions, and the curves that belong to it."""
        return self.space.spec((*self.curves_of(labels, curves), *labels))

    @functools.cached_property
    def of_no_table(self) -> frozenset[str]:
        """Return the curves of relations of which the case states no table that may be wrong."""
        tables = self.case.tables | self.case.motor_tables
        stated = {name for name, table in tables.items() if table.sd is not None}
        return frozenset(name for name, one in CURVES.items() if one.is_rare and not stated & set(one.tables))

    def curves_of(self, labels: Sequence[str], curves: Curves = "base", beside: Sequence[str] = ()) -> Labels:
        """Return the curves of a model with some additions; `beside` are more effects that no curve may imitate."""
        if curves == "none":
            return ()
        present, named = {*labels, *self.case.effects}, {*labels, *beside}
        return tuple(
            name
            for name, one in CURVES.items()
            if name in self.space.candidates
            and set(one.needs) <= present
            and (
                name not in self.of_no_table
                or curves == "all"
                or (curves == "beside" and not named & set(one.imitates))
            )
        )

    def fit(self, labels: Sequence[str], curves: Curves = "base", beside: Sequence[str] = ()) -> Fit:
        """Return a model calibrated under its own weights; computed once.

        It starts where the model without its last addition is, in the order of their scores over the base model, so
        that it does not depend on the order in which a person or a search added them.
        """
        labels, own = self.space.key(labels), self.curves_of(labels, curves, beside)
        more = curves in ("all", "beside")
        key = (labels, more, own)  # the same curves may be asked for by several names
        if key not in self._fits:
            fit = self._with_more_curves(labels, own) if more else self._calibrated(labels, curves)
            self._fits[key], self._stay[key] = self._quieter(fit, self._stay.get(self._before(key), {}))
        return self._fits[key]

    def _before(self, key: _Key) -> _Key:
        """Return the key of the model from which one is calibrated."""
        labels, more, _ = key
        if not more and labels:
            labels, _ = self._last(labels)
        return labels, False, self.curves_of(labels)

    def _last(self, labels: Labels) -> tuple[Labels, str]:
        """Return the additions of a model without the last one, and that: it begins where they end."""
        last = max(labels, key=self._rank)
        return self.space.key([label for label in labels if label != last]), last

    @property
    def base(self) -> Fit:
        """Return the base model: the calibrated model of the case with the curves of its tables."""
        return self.fit(())

    @property
    def calibrated(self) -> Fit:
        """Return the model of the case with its stated numbers calibrated, and nothing else."""
        return self.fit((), "none")

    def _calibrated(self, labels: Labels, curves: Curves) -> Fit:
        spec = self.flexible(self.spec(labels, curves), 1.0)
        if labels:
            rest, last = self._last(labels)
            return self._from(self.fit(rest, curves), labels, curves, last)
        if curves == "none":
            return calibrate(self.view, spec, self._first_start(spec), self.tolerances)
        exact = self.space.spec(spec.labels, dict.fromkeys(spec.amplitudes, NONE))
        held = self.flexible(spec, SPREADS[0])
        return self._best_of(
            [
                (exact, self.calibrated.x, self.calibrated.likelihood),
                (spec, self.calibrated.x, None),
                (held, self._first_start(held), None),
            ],
            self.calibrated,
        )

    def is_within_tolerance(self, fit: Fit) -> bool:
        """Return True if a model is within tolerance on every channel."""
        return all(square <= self.tolerances[name] ** 2 for name, square in fit.mean_squares(self.view).items())

    def _from(self, before: Fit, labels: Labels, curves: Curves, label: str) -> Fit:
        """Return a model with one more addition, from its first point.

        A model that is within tolerance goes on under its weights and with its amplitudes. From one that is not, curves
        begin as free as they may be.
        """
        x, _ = self.first_point(labels, label, curves)
        spec, weights = self._beginning(before, labels, curves)
        return calibrate(self.view, spec, x, self.tolerances, weights)

    def _beginning(self, before: Fit, labels: Labels, curves: Curves) -> tuple[ModelSpec, Likelihood | None]:
        """Return a model with one more addition before it is calibrated, and its weights; None for the tolerances."""
        spec = self.spec(labels, curves)
        if not self.is_within_tolerance(before):
            return self.flexible(spec, 1.0), None
        return self.space.spec(spec.labels, before.spec.amplitudes, before.spec.spreads), before.likelihood

    def first_point(self, labels: Sequence[str], last: str, curves: Curves = "base") -> tuple[np.ndarray, float]:
        """Return where a model with one more addition begins, and Q there: the best of a few starts, after some steps.

        The weights are those of the model without the addition if that is within tolerance, else those of the
        tolerances: a channel with a large error would count for nothing, and the addition that explains it would stay
        unused. Q of models that differ in the addition can be compared.

        Args:
            labels: the additions of the model.
            last: the one that the model before lacks.
            curves: of both.

        Returns:
            Coordinates (unknowns,), and Q.
        """
        key = self.space.key(labels)
        if (key, last, curves) not in self._points:
            self._points[key, last, curves] = self._best_start(key, last, curves)
        return self._points[key, last, curves]

    def in_place(self, fit: Fit, label: str, other: str) -> Fit:
        """Return a model with one of its additions exchanged for another, from where the model is.

        Where two do the same, both must be held against each other at the same optimum of the rest.
        """
        labels = [one for one in fit.spec.labels if one != label]
        spec = self.space.spec((*labels, other), fit.spec.amplitudes, fit.spec.spreads)
        without = fit.x.copy()
        without[list(self.space.layout.of[label])] = 0.0
        start = self.with_probe(spec, fit.likelihood, without, other)
        return calibrate(self.view, spec, start, self.tolerances, fit.likelihood)

    def with_probe(self, spec: ModelSpec, weights: Likelihood, x: np.ndarray, label: str) -> np.ndarray:
        """Return where the calibration of a model with one more addition may begin, (unknowns,).

        Args:
            spec: the model.
            weights: of its errors.
            x: (unknowns,) coordinates without the addition.
            label: of the addition, whose probe is the one that leaves least after some steps.
        """
        places, points = list(self.space.layout.of[label]), []
        for probe in self.space.candidates[label].probes:
            at = x.copy()
            at[places] = probe
            points.append(descend(self.view, spec, weights, at, steps=STEPS, flat=0.5))
        return min(points, key=lambda one: one.objective).x

    def _with_more_curves(self, labels: Labels, curves: Labels) -> Fit:
        """Return a model with curves of no table too, from where it is without them and from the stated numbers."""
        before = self.fit(labels)
        amplitudes = {**before.spec.amplitudes, **dict.fromkeys(self.of_no_table, 1.0)}
        spec = self.space.spec((*curves, *labels), amplitudes, before.spec.spreads)
        stated = np.zeros_like(before.x)
        effects = [place for label in labels for place in self.space.layout.of[label]]
        stated[effects] = before.x[effects]
        starts = [(spec, before.x, before.likelihood), (self.flexible(spec, 1.0), stated, None)]
        return self._best_of(starts, before)

    def _best_of(self, starts: Sequence[tuple[ModelSpec, np.ndarray, Likelihood | None]], simpler: Fit) -> Fit:
        """Return the model with the most evidence of those calibrated from some starts, under the weights of any two.

        A knee of the open-circuit voltage has several places where it fits, and curves take up what a charge is off.
        A channel that is given up counts for little in the evidence: a start that misses one by more than a simpler
        model does, and by what is material beside its noise, has not found the place. If all do, another channel that
        comes near its noise outweighs it: then the weights of the simpler model stay, from the first start.
        """
        earlier, noise = simpler.mean_squares(self.view), self.view.data.noise
        least = {
            name: noise[name] ** 2 + (self.settings.material_share * self.tolerances[name]) ** 2 for name in earlier
        }

        def gives_up(fit: Fit) -> bool:
            return any(
                square > max(GIVEN_UP * earlier[name], least[name])
                for name, square in fit.mean_squares(self.view).items()
            )

        fits = at_once(lambda one: calibrate(self.view, one[0], one[1], self.tolerances, one[2]), starts)
        kept = [one for one in fits if not gives_up(one)]
        if not kept:
            (spec, x, _), weights = starts[0], simpler.likelihood
            held = calibrate(self.view, spec, x, self.tolerances, weights, held=weights.channels)
            kept = [*fits, held] if gives_up(held) else [held]
        return functools.reduce(_better, kept)

    def _quieter(self, fit: Fit, stay: Mapping[str, float]) -> tuple[Fit, dict[str, float]]:
        """Return a model calibrated from the weights of its sensors' noise, where that has more evidence.

        Errors that last minutes count as few readings, and so they stay: weights and errors ask for each other. How
        much of them the weights of noise would leave is algebra, and few models need the second calibration: not those
        of which that much was left in vain before the last addition, which changes little of it.

        Args:
            fit: the model.
            stay: of the model before, as returned.

        Returns:
            The model, and by channel the mean square above noise that those weights would have left in vain.
        """
        if not fit.spec.amplitudes or not self.is_within_tolerance(fit):
            return fit, dict(stay)
        noise, before = self.view.data.noise, fit.mean_squares(self.view)
        weights = from_tolerances(self.view.data, noise, inflation=1.0)
        gram = fit.linear.under(weights)
        x = solved(gram.square, gram.aim, fit.spec.precision)
        less = {}
        for name, one in fit.linear.by_channel.items():
            missed, left = (max(one - noise[name] ** 2, 0.0) for one in (before[name], one.misfit(x) / one.count))
            is_slow = fit.likelihood.channels[name].inflation > SLOW and before[name] > (QUIET * noise[name]) ** 2
            if is_slow and left < LEFT * min(missed, stay.get(name, np.inf)):
                less[name] = left
        if not less:
            return fit, dict(stay)
        best = _better(fit, calibrate(self.view, fit.spec, fit.x, self.tolerances, weights))
        return best, {**stay, **(less if best is fit else {})}

    def flexible(self, spec: ModelSpec, spread: float = 1.0) -> ModelSpec:
        """Return a model with its curves as free as they may be, where its calibration begins.

        `spread` is that of its charges. The evidence then takes what is not needed. From stiff curves it may
        not find the way: the error that they leave keeps the weight of a reading small, and so the evidence for
        freer ones.
        """
        largest = {label: self.space.candidates[label].largest for label in spec.amplitudes}
        return self.space.spec(
            spec.labels,
            {label: max(a for a in AMPLITUDES if a <= most) for label, most in largest.items()},
            dict.fromkeys(spec.spreads, spread),
        )

    def _rank(self, label: str) -> tuple[int, int]:
        """Return the place of a candidate: effects, faults, differences and shifts, each by scores over the base.

        What is tried on top of a model mostly comes after what is in it, so that few other models need be fitted.
        """
        order = ("effect", "sensor", "specimen", "run", "law").index(self.space.candidates[label].group)
        return order, self._ranks.get(label, len(self._ranks))

    @functools.cached_property
    def _ranks(self) -> dict[str, int]:
        return {gain.label: number for number, gain in enumerate(self.scores_by_tolerance(()).gains())}

    def _first_start(self, spec: ModelSpec) -> np.ndarray:
        """Return the stated values, or the best of a few random ones: a motor that stalls gives no direction."""
        stated = np.zeros((1 + _RANDOM_STARTS, self.space.layout.size))
        free = list(spec.free)
        stated[1:, free] = np.random.default_rng(SEED).normal(size=(_RANDOM_STARTS, len(free)))
        root = self.weights_of_tolerances.roots(self.view.data)
        errors = errors_at(self.view, self.space.problem(spec), spec, stated)
        objective = np.sum((root[:, None] * errors) ** 2, axis=0) + np.sum(stated**2, axis=1)
        best = int(np.argmin(objective))
        return stated[best if objective[best] < 0.5 * objective[0] else 0]

    def _best_start(self, labels: Labels, last: str, curves: Curves) -> tuple[np.ndarray, float]:
        before = self.fit([label for label in labels if label != last], curves)
        candidate, of_weights = self.space.candidates[last], [self.scores(before.added)]
        spec, own = self._beginning(before, labels, curves)
        if own is None:
            of_weights.append(self.scores_by_tolerance(before.added))
        weights = own or self.weights_of_tolerances
        starts = self._starts(before, last, of_weights)
        points = at_once(lambda x: descend(self.view, spec, weights, x, steps=STEPS, flat=0.5), starts)
        best = min(points, key=lambda one: one.objective)
        if candidate.reach:
            best = best_along(self.view, spec, weights, candidate, best)
        return best.x, best.objective

    def _starts(self, before: Fit, label: str, of_weights: Sequence[Scores]) -> list[np.ndarray]:
        """Return where a model with one more addition may begin: where scores expect it, and in its usual range."""
        candidate, place = self.space.candidates[label], list(self.space.layout.of[label])
        free, scored, starts = list(before.spec.free), self.fit(before.added).spec.free, []
        for scores in of_weights:
            gain = next((one for one in scores.gains() if one.label == label), None)
            if gain is not None:
                starts.append(before.x.copy())
                # Scores are of the model with its curves: of their steps, a model without curves takes its own.
                step = dict(zip(scored, gain.base_step, strict=False))
                starts[-1][free] += [step.get(number, 0.0) for number in free]
                starts[-1][place] = gain.start
        if not candidate.is_vector:
            starts.append(before.x.copy())
            starts[-1][place] = candidate.probes[len(candidate.probes) // 2] if candidate.probes else 0.0
        if not starts:
            starts.append(before.x.copy())
        return starts

    # Scores

    def scores(self, labels: Sequence[str]) -> Scores:
        """Return the expected gains of all candidates over a model, under its own weights; computed once."""
        return self._scores_of(self.space.key(labels))[0]

    def scores_by_tolerance(self, labels: Sequence[str]) -> Scores:
        """Return the same with errors of a tolerance as weights.

        Under its own weights a model counts a channel that it misses for nothing, and what would explain it too.
        """
        return self._scores_of(self.space.key(labels))[1]

    def _scores_of(self, key: Labels) -> tuple[Scores, Scores]:
        found = self._scores.get(key)
        if found is None:
            fit = self.fit(key)
            screened = screen(self.view, fit.spec, fit.x)
            found = self._scored(fit, screened), self._scored(fit, screened, self.weights_of_tolerances)
            while len(self._scores) >= SCORED:
                self._scores.pop(next(iter(self._scores)), None)
            self._scores[key] = found
        return found

    def scores_at(self, fit: Fit, groups: Sequence[str]) -> Scores:
        """Return the expected gains of the candidates of some groups over a model.

        Its own weights hold if it is within tolerance, else those of the tolerances.
        """
        weights = None if self.is_within_tolerance(fit) else self.weights_of_tolerances
        return self._scored(fit, screen(self.view, fit.spec, fit.x, groups), weights)

    def _scored(self, fit: Fit, screened: Screen, likelihood: Likelihood | None = None) -> Scores:
        is_common = np.array([self.space.layout.runs[place] < 0 for place in fit.spec.free])
        return Scores(screened, self.view.data, fit, self.space.candidates, is_common, likelihood)


def _better(one: Fit, other: Fit) -> Fit:
    """Return the second of two fits of a model if it has more evidence, under the weights of both; else the first."""

    def evidence(fit: Fit, weights: Likelihood) -> float:
        return fit.log_evidence(weights) - rarer(fit.spec)

    more = sum(evidence(other, weights) - evidence(one, weights) for weights in (one.likelihood, other.likelihood))
    return other if more > 2.0 * LEAST_BETTER else one


def _why_no_readings(case: Case) -> str:
    """Return why there are no readings to calibrate with, and what to do."""
    read = {name for run in case.runs if run.split == "fit" for name in run.measured.outputs}
    if not read:
        return 'no fit run has a reading; set split = "fit" for at least one run with a measured column'
    return (
        f"{' and '.join(sorted(read))} never change in the fit runs and have no stated noise, so they carry no "
        "information; state the noise under [sensors], or measure a quantity that changes"
    )
