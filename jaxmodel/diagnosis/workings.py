"""Internals of an investigation: the space of models of a case, and all models fitted so far."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jaxmodel.base.errors import FitError
from jaxmodel.base.units import unit_of
from jaxmodel.case.measurements import KINDS
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.evidence.cross_validation import CrossValidation, cross_validate
from jaxmodel.diagnosis.evidence.left_out import Blocks
from jaxmodel.diagnosis.evidence.linear import AMPLITUDES, Gain, Linear
from jaxmodel.diagnosis.evidence.trial import Scale, Settled, Trial
from jaxmodel.diagnosis.fitting.fit import COMPARED, FLAT, SETTLED, Fit, fit
from jaxmodel.diagnosis.fitting.lanes import at_once
from jaxmodel.diagnosis.fitting.layout import BASE
from jaxmodel.diagnosis.fitting.model import Labels, ModelSpace, Setting, View
from jaxmodel.diagnosis.fitting.noise_propagation import propagated_noise
from jaxmodel.diagnosis.fitting.readings import Readings, Weights, collect
from jaxmodel.diagnosis.fitting.starts import best_local_optimum, best_random_start, negligible
from jaxmodel.diagnosis.noise.contract import noise_of_case
from jaxmodel.diagnosis.noise.input_noise import InputNoise
from jaxmodel.diagnosis.noise.instrument import NoiseModel
from jaxmodel.diagnosis.noise.model_error import NONE, ModelError, estimate
from jaxmodel.diagnosis.preparation import prepared
from jaxmodel.diagnosis.preparation.held_inputs import noisy_inputs
from jaxmodel.diagnosis.preparation.signals import robust_sd
from jaxmodel.diagnosis.screening.screen import Screen, screen
from jaxmodel.diagnosis.settings import SETTINGS, Settings

Progress = Callable[[str], None]

# Steps of the base unknowns alone after an effect is added, to find a start for the full fit.
FOLLOWING_STEPS = 4
# Steps of the first fit of the base model, before its model error is known.
FIRST_STEPS = 8
# Steps of a model that is only compared with others.
COMPARING_STEPS = 12
# A refit that reaches less than this share of its expected gain starts again elsewhere.
REACHED = 0.5
# Such a restart begins at most so many sd from the stated values.
_NOT_STRAINED = 2.0
# Readings of a series from which its model error is estimated.
_MOST_OF_A_SERIES = 1500
_MOST_REWEIGHTINGS = 2
# A model error that falls below this share of its previous size is estimated again.
_FALLS = 0.5
_MOST_FALLS = 4


class Workings:
    """One case, its space of models, and all models fitted so far."""

    def __init__(
        self,
        case: Case,
        *,
        without: Sequence[str] = (),
        settings: Settings = SETTINGS,
        progress: Progress | None = None,
    ) -> None:
        """Prepare the readings and lay out all candidates.

        Args:
            case: with at least one fit run.
            without: names of effects that are ruled out.
            settings: the constants.
            progress: called with a description of each step.

        Raises:
            FitError: nothing is uncertain, no run may be used to calibrate, or there are no readings.
            EffectError: a name that is no candidate of this case.
        """
        self.settings, self._progress = settings, progress
        self.case, self.preparation = prepared(case)
        self.noise = noise_of_case(self.case)
        self.space = ModelSpace(self.case, without, settings)
        self.fit_runs = [number for number, run in enumerate(self.case.runs) if run.split == "fit"]
        if not any(name in self.case.runs[number].measured.outputs for name in self.noise for number in self.fit_runs):
            raise FitError(f"{self.case.label}: {_why_no_readings(self.case)}.")
        self._settled: dict[Labels, Settled] = {}
        self._trials: dict[tuple, Trial] = {}
        self._gains: dict[int, tuple[Trial, list[Gain]]] = {}
        self._cross_validations: dict[int, CrossValidation] = {}

    def report(self, what: str) -> None:
        """Report what is being done, if a progress function was given."""
        if self._progress is not None:
            self._progress(what)

    # Noise and model error.

    def _scale(self, noise: Mapping[str, NoiseModel], error: ModelError, inputs: InputNoise | None) -> Scale:
        readings = self._readings(noise, inputs)
        return Scale(noise, View(self.space, readings), Weights(readings, error))

    def _readings(self, noise: Mapping[str, NoiseModel], inputs: InputNoise | None) -> Readings:
        channels, steepness = KINDS[self.case.kind].outputs, self.space.steepness
        return collect(self.space.fitted, noise, channels, self.fit_runs, inputs, self.settings, steepness=steepness)

    @functools.cached_property
    def first_scale(self) -> Scale:
        """Return the scale without model error and without input noise."""
        return self._scale(self.noise, NONE, None)

    @functools.cached_property
    def base(self) -> Settled:
        """Return the calibrated base model under its own weights."""
        self.report("calibrating the base model")
        scale = self.first_scale
        setting = self.space.setting(())
        starts = [np.zeros(self.space.layout.size), best_random_start(scale.view, setting, scale.weights)]
        tried = at_once(lambda start: fit(scale.view, setting, scale.weights, start, steps=FIRST_STEPS), starts)
        found = Trial(setting, {}, min(tried, key=lambda one: one.objective), scale)
        if noisy_inputs(self.case):
            noise, inputs = propagated_noise(self.space.fitted, scale.noise, self.space, setting, found.fitted.x)
            self.noise = noise
            scale = self._scale(noise, NONE, inputs)
            found = self._refitted(found, scale)
        return self._settle(found)

    def settled(self, labels: Sequence[str], start: Trial | None = None) -> Settled:
        """Return a model under its own weights; it does not depend on the order of additions."""
        key = self.space.key(labels)
        if not key:
            return self.base
        if key not in self._settled:
            if start is not None and start.labels == key:
                first = self._refitted(start, self.base.scale)
            else:
                first = self.trial(key, self.base)
            self._settled[key] = self._settle(first)
        return self._settled[key]

    def _settle(self, trial: Trial) -> Settled:
        """Alternate between estimating the model error from the richest model and refitting, until both are stable."""
        screened = None
        for number in range(_MOST_REWEIGHTINGS):
            screened = screen(trial.scale.view, trial.setting, trial.fitted.x, trial.scale.noise)
            scale = self._scale_of_richest(trial, screened)
            if number and scale.error.is_near(trial.scale.error):
                break
            trial = self._refitted(trial, scale)
            if not (number or trial.labels):
                # Without model error the parameters may have moved far, to another minimum: fit from the stated values
                # too.
                again = self._refitted(dataclasses.replace(trial, fitted=self._as_stated(trial)), scale)
                trial = min(trial, again, key=lambda one: one.fitted.objective)
        else:
            screened = screen(trial.scale.view, trial.setting, trial.fitted.x, trial.scale.noise, near=screened)
        # With a model error, whose estimate is rough, further convergence is of no use.
        flat = FLAT if trial.scale.error.sd else SETTLED
        fitted = fit(trial.scale.view, trial.setting, trial.scale.weights, trial.fitted.x, flat=flat)
        return Settled(trial.setting, trial.amplitudes, fitted, trial.scale, screened)

    def _scale_of_richest(self, trial: Trial, screened: Screen) -> Scale:
        """Return the scale estimated from the residual of the richest model that contains a trial.

        Repeated while the model error falls: under a large model error few additions are worthwhile, under a smaller
            one more are.
        """
        least, scale = self.settings.least_odds + np.log(max(1, len(self.space.candidates))), trial.scale
        for _ in range(_MOST_FALLS):
            left = self._linear(dataclasses.replace(trial, scale=scale), screened).richest(least)
            before, scale = scale.error, self._reestimated(scale, left)
            if not any(scale.error.sd.get(series, 0.0) < _FALLS * sd for series, sd in before.sd.items()):
                break
        return scale

    def _linear(self, trial: Trial, screened: Screen) -> Linear:
        pulls = trial.fitted.x[list(trial.setting.free)]
        is_common = np.array([self.space.layout.runs[place] < 0 for place in trial.setting.free])
        return Linear(screened, trial.scale.weights, self.space.candidates, pulls, is_common)

    def linear(self, settled: Settled) -> Linear:
        """Return the expected gains of all candidates over a settled model."""
        return self._linear(settled, settled.screened)

    def linear_at(self, trial: Trial, groups: Sequence[str] = ("effect", "sensor", "curve", "run")) -> Linear:
        """Return the expected gains of candidates of some groups over a model fitted under any scale."""
        screened = screen(trial.scale.view, trial.setting, trial.fitted.x, trial.scale.noise, groups)
        return self._linear(trial, screened)

    def gains_at(self, trial: Trial) -> list[Gain]:
        """Return the expected gains of all candidates over a model; computed once."""
        if id(trial) not in self._gains:
            self._gains[id(trial)] = (trial, self.linear_at(trial).gains())
        return self._gains[id(trial)][1]

    @property
    def pieces(self) -> int:
        """Return the number of time blocks per run for cross-validation.

        Whole runs are not left out: one of few runs is usually another condition, which the others cannot predict.
        """
        settings = self.settings
        return max(settings.left_out_blocks, -(-settings.fewest_blocks // len(self.fit_runs)))

    def cross_validation(self, trial: Trial) -> CrossValidation:
        """Return what a model predicts of each piece of each run when the others are fitted; computed once."""
        if id(trial) not in self._cross_validations:
            self._cross_validations[id(trial)] = cross_validate(trial, self.pieces)
        return self._cross_validations[id(trial)]

    def errors_of(self, trial: Trial) -> np.ndarray:
        """Return measured minus predicted of the fitted readings, in the channels' units."""
        view = trial.scale.view
        return view.readings.value - view.at(self.space.problem(trial.setting), [trial.setting.lane(trial.fitted.x)])[0]

    @staticmethod
    def _as_stated(trial: Trial) -> Fit:
        """Return a fit at the stated values of all parameters."""
        return dataclasses.replace(trial.fitted, x=np.zeros_like(trial.fitted.x))

    def _reestimated(self, scale: Scale, left: np.ndarray) -> Scale:
        """Return the scale with noise and model error estimated from the residual of the richest model."""
        readings = scale.view.readings
        noise = dict(scale.noise)
        for name, model in noise.items():
            fast = _fast_scatter([left[rows] for (channel, _), rows in readings.chains if channel == name])
            doubtful = model.stated is None or model.contradicts
            if doubtful and 0.0 < fast < model.own_sd / self.settings.noise_contradiction:
                floor = max(fast, model.quantum / np.sqrt(12.0))
                source = f"{model.source}; reduced to the scatter of the residual from reading to reading, {floor:.3g}"
                stated = model.stated or 0.0
                agrees = floor < self.settings.noise_contradiction * stated
                if agrees:
                    # A varying input, not the sensor, made the readings scatter.
                    floor = float(np.hypot(stated, model.quantum / np.sqrt(12.0)))
                    source = f"stated ({stated:g})"
                noise[name] = dataclasses.replace(
                    model, sd=floor, rho=0.0, source=source, contradicts=model.contradicts and not agrees
                )
        if any(noise[name] is not model for name, model in scale.noise.items()):
            readings = dataclasses.replace(self._readings(noise, None), shared=scale.view.readings.shared)
            scale = Scale(noise, View(self.space, readings), scale.weights)
        pieces = readings.pieces(_MOST_OF_A_SERIES)
        return scale.with_error(estimate(pieces, readings.differenced(left), self.tolerances, self.settings))

    @functools.cached_property
    def tolerances(self) -> dict[str, float]:
        """Return the tolerance of each channel, stated or assumed, in its unit."""
        stated = self.case.tolerance
        return {name: stated[name].rms if name in stated else self.assumed_tolerance(name) for name in self.noise}

    def assumed_tolerance(self, channel: str) -> float:
        """Return the assumed tolerance of a channel, in its unit."""
        if unit_of(channel) == "degC":
            return self.settings.assumed_temperature_K
        runs = [run.measured.outputs[channel] for run in self.case.runs if channel in run.measured.outputs]
        highest, lowest = np.nanmax([np.nanmax(one) for one in runs]), np.nanmin([np.nanmin(one) for one in runs])
        share = self.settings.assumed_voltage if unit_of(channel) == "V" else self.settings.assumed_share
        return share * float(highest - lowest)

    # Fits.

    def trial(
        self,
        labels: Sequence[str],
        other: Trial,
        gain: Gain | None = None,
        amplitudes: Mapping[str, float] | None = None,
    ) -> Trial:
        """Return a model fitted under the scale of another, starting at its fit.

        Args:
            labels: of the model.
            other: the other model.
            gain: expected gain of the addition, with its start.
            amplitudes: prior sd of curves and laws.
        """
        key = self.space.key(labels)
        scale = other.scale
        own = {label: a for label, a in {**other.amplitudes, **(amplitudes or {})}.items() if label in key}
        if gain is not None and self.space.candidates[gain.label].is_vector:
            own[gain.label] = gain.amplitude
        known = (id(scale.weights), key, tuple(sorted(own.items())))
        if known in self._trials:
            return self._trials[known]
        setting = self.space.setting(key, own)
        begin = {name: x for name, x in other.start(self.space).items() if name == BASE or name in key}
        new = [label for label in key if label not in begin]
        for label in new:
            candidate = self.space.candidates[label]
            if gain is not None and gain.label == label:
                begin[label] = gain.start
            else:
                begin[label] = np.zeros(len(candidate.coordinates)) if candidate.is_vector else self._first_start(label)
        first = self.space.layout.at(begin)
        if gain is not None:
            first[list(other.setting.free)] += gain.base_step
        best = self._calibrated(setting, scale, first, bool(new) and gain is None)
        reference = other.fitted.objective if set(other.labels) <= set(key) else np.inf
        promised = REACHED * gain.chi2 if gain is not None else 0.0
        if best.objective > reference - promised:
            # The first amplitude was wrong, or the base parameters had moved far to compensate: start them again.
            begin[BASE] = np.clip(begin[BASE], -_NOT_STRAINED, _NOT_STRAINED)
            again = self._calibrated(setting, scale, self.space.layout.at(begin), True, best.objective)
            best = min(best, again, key=_objective)
            for label in [one for one in new if self.space.candidates[one].group in ("effect", "sensor")]:
                probes = self.space.candidates[label].probes
                if best.objective > reference - promised:
                    # The start may be invalid, such as a cell that is empty in the model only.
                    middle = begin | {label: np.array(probes[len(probes) // 2], dtype=float)}
                    again = self._calibrated(setting, scale, self.space.layout.at(middle), False, best.objective)
                    best = min(best, again, key=_objective)
        if best.objective > reference and new:
            # An effect can always be small: a fit that is worse than without it has failed.
            faint = {label: negligible(self.space.candidates[label]) for label in new}
            start = self.space.layout.at(begin | faint)
            best = min(best, self._calibrated(setting, scale, start, True), key=_objective)
        for label in key:
            if self.space.candidates[label].reach:
                best = best_local_optimum(scale.view, setting, scale.weights, self.space.candidates[label], best)
        found = Trial(setting, own, best, scale)
        self._trials[known] = found
        return found

    def _first_start(self, label: str) -> np.ndarray:
        """Return the start of an effect according to the scores of the base model."""
        for gain in self.base_gains:
            if gain.label == label:
                return gain.start
        return np.array(self.space.candidates[label].probes[0], dtype=float)

    @functools.cached_property
    def base_gains(self) -> list[Gain]:
        """Return the expected gains of all candidates over the base model."""
        return self.linear(self.base).gains()

    def _calibrated(
        self, setting: Setting, scale: Scale, start: np.ndarray, is_new: bool, rival: float = np.inf
    ) -> Fit:
        """Fit first the base unknowns with the addition held at its start, then all; `rival` as in `fit`."""
        if is_new:
            base = range(self.space.layout.base)
            start = fit(scale.view, setting, scale.weights, start, steps=FOLLOWING_STEPS, free=base).x
        return fit(scale.view, setting, scale.weights, start, rival=rival, flat=COMPARED, steps=COMPARING_STEPS)

    def _refitted(self, trial: Trial, scale: Scale) -> Trial:
        """Return a model refitted under another scale, with the best prior sd of its curves."""
        fitted = fit(scale.view, trial.setting, scale.weights, trial.fitted.x, flat=COMPARED, steps=COMPARING_STEPS)
        found = Trial(trial.setting, trial.amplitudes, fitted, scale)
        return self.at_its_best(found)

    def at_its_best(self, trial: Trial) -> Trial:
        """Return a model with the prior sd of its curves that predicts left-out data best, refitted if that changed."""
        curves = [label for label in trial.labels if self.space.candidates[label].is_vector]
        amplitudes = {label: self._best_amplitude(trial, label) for label in curves}
        if all(amplitudes[label] == trial.amplitudes.get(label, 1.0) for label in curves):
            return trial
        setting = self.space.setting(trial.labels, amplitudes)
        fitted = fit(trial.scale.view, setting, trial.scale.weights, trial.fitted.x, flat=COMPARED)
        return Trial(setting, amplitudes, fitted, trial.scale)

    def _best_amplitude(self, trial: Trial, label: str) -> float:
        """Return the prior sd of a curve with the best log score on left-out data, to first order.

        A wide prior may have the best score although it predicts badly, with a large uncertainty; it is not used if the
        error on left-out data rises above that of the narrowest prior.
        """
        mine = np.isin(list(trial.setting.free), list(self.space.layout.of[label]))
        blocks = Blocks.of(trial.fitted, trial.scale.pieces(self.pieces))
        found = []
        for amplitude in AMPLITUDES:
            scores, missed = blocks.under(np.where(mine, amplitude, trial.fitted.prior_sd)).left()
            found.append((float(np.sum(scores)), amplitude, float(np.sum(missed))))
        most = (1.0 + self.settings.largest_increase) * found[0][2]
        return max((score, amplitude) for score, amplitude, missed in found if missed <= most)[1]


def _objective(fitted: Fit) -> float:
    return fitted.objective


def _fast_scatter(series: Sequence[np.ndarray]) -> float:
    """Return the robust sd of fast scatter, from second differences of the readings."""
    second = [one[:-2] - 2.0 * one[1:-1] + one[2:] for one in series if one.size > 2]
    return robust_sd(np.concatenate([*second, np.zeros(0)])) / np.sqrt(6.0)


def _why_no_readings(case: Case) -> str:
    """Return why there are no readings to calibrate with, and what to do."""
    read = {name for run in case.runs if run.split == "fit" for name in run.measured.outputs}
    if not read:
        return 'no fit run has a reading; set split = "fit" for at least one run with a measured column'
    return (
        f"{' and '.join(sorted(read))} never change in the fit runs and have no stated noise, so they carry no "
        "information; state the noise under [sensors], or measure a quantity that changes"
    )
