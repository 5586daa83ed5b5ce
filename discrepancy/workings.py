"""What an investigation works with: the case's one program, and every model of it that was fitted."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from discrepancy.evidence.cross_validation import CrossValidation, cross_validate
from discrepancy.evidence.left_out import Blocks
from discrepancy.evidence.linear import AMPLITUDES, Gain, Linear
from discrepancy.evidence.trial import Scale, Settled, Trial
from discrepancy.fitting.fit import COMPARED, FLAT, SETTLED, Fit, fit
from discrepancy.fitting.lanes import at_once
from discrepancy.fitting.layout import BASE
from discrepancy.fitting.model import Labels, ModelSpace, Setting, View
from discrepancy.fitting.noise_propagation import propagated_noise
from discrepancy.fitting.readings import Weights, collect
from discrepancy.fitting.starts import faintest, likeliest_of_some, over_the_ridges
from discrepancy.noise.contract import noise_of_case
from discrepancy.noise.input_noise import InputNoise
from discrepancy.noise.instrument import NoiseModel
from discrepancy.noise.model_error import NONE, ModelError, estimate
from discrepancy.preparation import prepared
from discrepancy.preparation.held_inputs import noisy_inputs
from discrepancy.preparation.signals import robust_sd
from discrepancy.screening.screen import Screen, screen
from discrepancy.settings import SETTINGS, Settings
from jaxmodel.case import Case
from jaxmodel.errors import FitError
from jaxmodel.measurements import KINDS
from jaxmodel.units import unit_of

Progress = Callable[[str], None]

# Steps in which the base model follows an effect put into it: a start needs no more.
FOLLOWING_STEPS = 4
# Steps of the base model before anything is known of its error: it only has to come near.
FIRST_STEPS = 8
# Steps of a model that is only compared with others.
COMPARING_STEPS = 12
# A refit that reaches less than this share of what was promised to first order begins anew elsewhere.
REACHED = 0.5
# So many sd from what is stated, at most, fits begin anew.
_NOT_STRAINED = 2.0
# Readings of a series from which its model error is estimated.
_MOST_OF_A_SERIES = 1500
_MOST_REWEIGHTINGS = 2
# One that falls below this share of what it was is estimated again beside the model that is then the richest.
_FALLS = 0.5
_MOST_FALLS = 4


class Workings:
    """One case, its programs, and every model of it that was fitted."""

    def __init__(
        self,
        case: Case,
        *,
        without: Sequence[str] = (),
        settings: Settings = SETTINGS,
        progress: Progress | None = None,
    ) -> None:
        """Prepare the readings and lay out all that could be missing.

        Args:
            case: with at least one fit run.
            without: names of effects that the user rules out.
            settings: the constants.
            progress: told what is being done.

        Raises:
            FitError: nothing is uncertain, no run may be used to calibrate, or no reading is there.
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
        """Tell what is being done, if anybody listens."""
        if self._progress is not None:
            self._progress(what)

    # The scale of errors.

    def _scale(self, noise: Mapping[str, NoiseModel], error: ModelError, inputs: InputNoise | None) -> Scale:
        channels = KINDS[self.case.kind].outputs
        readings = collect(self.case, noise, channels, self.fit_runs, inputs, self.settings)
        return Scale(noise, View(self.space, readings), Weights(readings, error))

    @functools.cached_property
    def first_scale(self) -> Scale:
        """Return the scale without any model error and without the noise of inputs."""
        return self._scale(self.noise, NONE, None)

    @functools.cached_property
    def base(self) -> Settled:
        """Return the calibrated base model under its own weights."""
        self.report("calibrating the base model")
        scale = self.first_scale
        setting = self.space.setting(())
        starts = [np.zeros(self.space.layout.size), likeliest_of_some(scale.view, setting, scale.weights)]
        tried = at_once(lambda start: fit(scale.view, setting, scale.weights, start, steps=FIRST_STEPS), starts)
        found = Trial(setting, {}, min(tried, key=lambda one: one.objective), scale)
        if noisy_inputs(self.case):
            noise, inputs = propagated_noise(self.case, scale.noise, self.space, setting, found.fitted.x)
            self.noise = noise
            scale = self._scale(noise, NONE, inputs)
            found = self._refitted(found, scale)
        return self._settle(found)

    def settled(self, labels: Sequence[str], start: Trial | None = None) -> Settled:
        """Return a model under its own weights; the same whichever way one came to it."""
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
        """Estimate the model error beside the richest model about this one, and fit anew, until both stay."""
        for number in range(_MOST_REWEIGHTINGS):
            screened = screen(trial.scale.view, trial.setting, trial.fitted.x, trial.scale.noise)
            scale = self._scale_beside(trial, screened)
            if number and scale.error.is_near(trial.scale.error):
                break
            trial = self._refitted(trial, scale)
            if not (number or trial.labels):
                # Without a model error the numbers may have run away to where another minimum is near.
                again = self._refitted(dataclasses.replace(trial, fitted=self._as_stated(trial)), scale)
                trial = min(trial, again, key=lambda one: one.fitted.objective)
        else:
            screened = screen(trial.scale.view, trial.setting, trial.fitted.x, trial.scale.noise)
        # Beside a model error numbers are no surer than that error's estimate: to settle them further tells nothing.
        flat = FLAT if trial.scale.error.sd else SETTLED
        fitted = fit(trial.scale.view, trial.setting, trial.scale.weights, trial.fitted.x, flat=flat)
        return Settled(trial.setting, trial.amplitudes, fitted, trial.scale, screened)

    def _scale_beside(self, trial: Trial, screened: Screen) -> Scale:
        """Return the scale that the richest model about a trial, and the trial itself, leave.

        Under the large model error of a model far off nothing is worth adding: as it falls more is.
        """
        least, scale = self.settings.least_odds + np.log(max(1, len(self.space.candidates))), trial.scale
        for _ in range(_MOST_FALLS):
            left = self._linear(dataclasses.replace(trial, scale=scale), screened).richest(least)
            before, scale = scale.error, self._beside(scale, left)
            if not any(scale.error.sd.get(series, 0.0) < _FALLS * sd for series, sd in before.sd.items()):
                break
        return scale

    def _linear(self, trial: Trial, screened: Screen) -> Linear:
        pulls = trial.fitted.x[list(trial.setting.free)]
        is_common = np.array([self.space.layout.runs[place] < 0 for place in trial.setting.free])
        return Linear(screened, trial.scale.weights, self.space.candidates, pulls, is_common)

    def linear(self, settled: Settled) -> Linear:
        """Return what every candidate promises beside a settled model."""
        return self._linear(settled, settled.screened)

    def linear_at(self, trial: Trial, groups: Sequence[str] = ("effect", "sensor", "curve", "run")) -> Linear:
        """Return what candidates of some groups promise beside a model fitted under any scale."""
        screened = screen(trial.scale.view, trial.setting, trial.fitted.x, trial.scale.noise, groups)
        return self._linear(trial, screened)

    def gains_at(self, trial: Trial) -> list[Gain]:
        """Return what every candidate promises beside a model, kept once it was asked."""
        if id(trial) not in self._gains:
            self._gains[id(trial)] = (trial, self.linear_at(trial).gains())
        return self._gains[id(trial)][1]

    @property
    def pieces(self) -> int:
        """Return into how many pieces of time each run is cut, of which each is left out once.

        One of a few runs that is left out whole is mostly another condition, of which the others say nothing.
        """
        settings = self.settings
        return max(settings.left_out_blocks, -(-settings.fewest_blocks // len(self.fit_runs)))

    def cross_validation(self, trial: Trial) -> CrossValidation:
        """Return what a model predicts of each piece of each run when the others are fitted; computed once."""
        if id(trial) not in self._cross_validations:
            self._cross_validations[id(trial)] = cross_validate(trial, self.pieces)
        return self._cross_validations[id(trial)]

    def errors_of(self, trial: Trial) -> np.ndarray:
        """Return measured less predicted of the fitted readings, in the channels' units."""
        view = trial.scale.view
        return view.readings.value - view.at(self.space.problem(trial.setting), [trial.setting.lane(trial.fitted.x)])[0]

    @staticmethod
    def _as_stated(trial: Trial) -> Fit:
        """Return a fit that stands where all numbers are as stated."""
        return dataclasses.replace(trial.fitted, x=np.zeros_like(trial.fitted.x))

    def _beside(self, scale: Scale, left: np.ndarray) -> Scale:
        """Return the scale with the noise and the model error that the richest model leaves."""
        readings = scale.view.readings
        noise = dict(scale.noise)
        for name, model in noise.items():
            fast = _fast_scatter([left[rows] for (channel, _), rows in readings.chains if channel == name])
            doubtful = model.stated is None or model.contradicts
            if doubtful and 0.0 < fast < model.own_sd / self.settings.noise_contradiction:
                floor = max(fast, model.quantum / np.sqrt(12.0))
                source = f"{model.source}; reduced to the scatter of the residual from reading to reading, {floor:.3g}"
                if model.stated is not None and floor < self.settings.noise_contradiction * model.stated:
                    # It was a lively input, and not the sensor, that made the readings scatter.
                    floor = float(np.hypot(model.stated, model.quantum / np.sqrt(12.0)))
                    source = f"stated ({model.stated:g})"
                noise[name] = dataclasses.replace(model, sd=floor, rho=0.0, source=source)
        if any(noise[name] is not model for name, model in scale.noise.items()):
            shared = scale.view.readings.shared
            channels = KINDS[self.case.kind].outputs
            fresh = collect(self.case, noise, channels, self.fit_runs, None, self.settings)
            readings = dataclasses.replace(fresh, shared=shared)
            scale = Scale(noise, View(self.space, readings), scale.weights)
        pieces = readings.pieces(_MOST_OF_A_SERIES)
        return scale.with_error(estimate(pieces, readings.differenced(left), self.tolerances, self.settings))

    @functools.cached_property
    def tolerances(self) -> dict[str, float]:
        """Return, by channel, the RMS that it may have, stated or assumed, in its unit."""
        stated = self.case.tolerance
        return {name: stated[name].rms if name in stated else self.assumed_tolerance(name) for name in self.noise}

    def assumed_tolerance(self, channel: str) -> float:
        """Return the RMS that a channel may have where nobody states a tolerance, in its unit."""
        if unit_of(channel) == "degC":
            return self.settings.assumed_temperature_K
        runs = [run.measured.outputs[channel] for run in self.case.runs if channel in run.measured.outputs]
        values = np.concatenate(runs)
        share = self.settings.assumed_voltage if unit_of(channel) == "V" else self.settings.assumed_share
        return share * float(np.nanmax(values) - np.nanmin(values))

    # Fits.

    def trial(
        self,
        labels: Sequence[str],
        beside: Trial,
        gain: Gain | None = None,
        amplitudes: Mapping[str, float] | None = None,
    ) -> Trial:
        """Return a model fitted under the scale of another, from where that ended.

        Args:
            labels: of the model.
            beside: the other.
            gain: what the addition promises, for where to begin.
            amplitudes: of curves and laws.
        """
        key = self.space.key(labels)
        scale = beside.scale
        own = {label: a for label, a in {**beside.amplitudes, **(amplitudes or {})}.items() if label in key}
        if gain is not None and self.space.candidates[gain.label].is_vector:
            own[gain.label] = gain.amplitude
        known = (id(scale.weights), key, tuple(sorted(own.items())))
        if known in self._trials:
            return self._trials[known]
        setting = self.space.setting(key, own)
        begin = {name: x for name, x in beside.start(self.space).items() if name == BASE or name in key}
        new = [label for label in key if label not in begin]
        for label in new:
            candidate = self.space.candidates[label]
            if gain is not None and gain.label == label:
                begin[label] = gain.start
            else:
                begin[label] = np.zeros(len(candidate.coordinates)) if candidate.is_vector else self._first_start(label)
        first = self.space.layout.at(begin)
        if gain is not None:
            first[list(beside.setting.free)] += gain.base_step
        best = self._calibrated(setting, scale, first, bool(new) and gain is None)
        reference = beside.fitted.objective if set(beside.labels) <= set(key) else np.inf
        promised = REACHED * gain.chi2 if gain is not None else 0.0
        if best.objective > reference - promised:
            # The first amplitude was too far from the right one, or the numbers had gone too far to hide what lacked:
            # let what was there follow.
            begin[BASE] = np.clip(begin[BASE], -_NOT_STRAINED, _NOT_STRAINED)
            best = min(best, self._calibrated(setting, scale, self.space.layout.at(begin), True), key=_objective)
            for label in [one for one in new if self.space.candidates[one].group in ("effect", "sensor")]:
                probes = self.space.candidates[label].probes
                if best.objective > reference - promised:
                    # Too far may be over a cliff, as where a cell is emptied in the model and not on the bench.
                    middle = begin | {label: np.array(probes[len(probes) // 2], dtype=float)}
                    again = self._calibrated(setting, scale, self.space.layout.at(middle), False)
                    best = min(best, again, key=_objective)
        if best.objective > reference and new:
            # An effect can always be faint: a fit worse than without it failed, and is no evidence against it.
            faint = {label: faintest(self.space.candidates[label]) for label in new}
            start = self.space.layout.at(begin | faint)
            best = min(best, self._calibrated(setting, scale, start, True), key=_objective)
        for label in key:
            if self.space.candidates[label].reach:
                best = over_the_ridges(scale.view, setting, scale.weights, self.space.candidates[label], best)
        found = Trial(setting, own, best, scale)
        self._trials[known] = found
        return found

    def _first_start(self, label: str) -> np.ndarray:
        """Return where an effect begins of which nothing is known: as the base model's screen has it."""
        for gain in self.base_gains:
            if gain.label == label:
                return gain.start
        return np.array(self.space.candidates[label].probes[0], dtype=float)

    @functools.cached_property
    def base_gains(self) -> list[Gain]:
        """Return what every candidate promises beside the base model."""
        return self.linear(self.base).gains()

    def _calibrated(self, setting: Setting, scale: Scale, start: np.ndarray, is_new: bool) -> Fit:
        """Let the base model follow what is new at its first amplitude, then free all."""
        if is_new:
            base = range(self.space.layout.base)
            start = fit(scale.view, setting, scale.weights, start, steps=FOLLOWING_STEPS, free=base).x
        return fit(scale.view, setting, scale.weights, start, flat=COMPARED, steps=COMPARING_STEPS)

    def _refitted(self, trial: Trial, scale: Scale) -> Trial:
        """Return a model fitted under another scale from where it stands, its curves' priors as wide as is best."""
        fitted = fit(scale.view, trial.setting, scale.weights, trial.fitted.x, flat=COMPARED, steps=COMPARING_STEPS)
        found = Trial(trial.setting, trial.amplitudes, fitted, scale)
        return self.at_its_best(found)

    def at_its_best(self, trial: Trial) -> Trial:
        """Return a model with its curves' priors as wide as foretells runs left out best, fitted anew if need be."""
        curves = [label for label in trial.labels if self.space.candidates[label].is_vector]
        amplitudes = {label: self._best_amplitude(trial, label) for label in curves}
        if all(amplitudes[label] == trial.amplitudes.get(label, 1.0) for label in curves):
            return trial
        setting = self.space.setting(trial.labels, amplitudes)
        fitted = fit(trial.scale.view, setting, trial.scale.weights, trial.fitted.x, flat=COMPARED)
        return Trial(setting, amplitudes, fitted, trial.scale)

    def _best_amplitude(self, trial: Trial, label: str) -> float:
        """Return the sd of a curve's prior with which runs left out are foretold best, to first order about the fit.

        A wide prior that foretells badly and knows it may have the best score; it is not taken where the error on runs
        left out rises above that of the narrowest one.
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
    """Return the robust sd of what changes from one reading to the next, a straight line through three taken off."""
    second = [one[:-2] - 2.0 * one[1:-1] + one[2:] for one in series if one.size > 2]
    return robust_sd(np.concatenate([*second, np.zeros(0)])) / np.sqrt(6.0)


def _why_no_readings(case: Case) -> str:
    """Return why there is nothing to calibrate to, and what to do."""
    read = {name for run in case.runs if run.split == "fit" for name in run.measured.outputs}
    if not read:
        return 'no fit run has a reading; set split = "fit" for at least one run with a measured column'
    return (
        f"{' and '.join(sorted(read))} never change in the fit runs and have no stated noise, so they carry no "
        "information; state the noise under [sensors], or measure a quantity that changes"
    )
