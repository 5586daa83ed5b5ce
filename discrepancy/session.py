"""One case under many hypotheses: programs are made once for each set of effects, fits and screens are kept."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
from collections.abc import Mapping, Sequence
from threading import Thread
from typing import Any

import equinox as eqx
import numpy as np

from discrepancy.calibrate import IDLE_GAIN, Fit, fit, look
from discrepancy.candidates import Candidate, candidates
from discrepancy.contract import noise_left_by, noise_of_case, noise_passed_on, without_input_noise
from discrepancy.held_inputs import noisy_inputs, with_held_inputs
from discrepancy.hypothesis import Hypothesis, Labels
from discrepancy.input_noise import InputNoise
from discrepancy.inputs import check_sign_of_current, with_like_inputs
from discrepancy.ladder import ChannelError, Estimate, Rung
from discrepancy.lanes import at_once, predict
from discrepancy.masking import masking_pairs
from discrepancy.noise import NoiseModel
from discrepancy.problem import BASE, Layout, Problem, Start, make_problem
from discrepancy.readings import flatten
from discrepancy.screen import Screen, Switchboard, screen
from discrepancy.starts import faintest, likeliest_of_some, over_the_ridges, pair_start, scored_starts
from discrepancy.weights import by_errors, by_errors_and_time
from jaxmodel.cases import Case, Run
from jaxmodel.declaration import describe
from jaxmodel.effects import CATALOGUE
from jaxmodel.errors import EffectError, UserError, nearest
from jaxmodel.names import parameter_table
from jaxmodel.ports import Effect, touches
from jaxmodel.profile import Track

FAR_FROM_PRIOR = 3.0
# How far off, and for what share of the readings, the assumed noise must be to be worth refitting.
NOISE_CHANGED = 0.05
NOISE_CHANGED_SHARE = 0.02
# Steps in which the base model follows an effect put into it: a start needs no more.
FOLLOWING_STEPS = 4


class Session:
    """Fits and screens of one case, made when first asked for."""

    def __init__(
        self, case: Case, extra_effects: Mapping[str, type[Effect]] | None = None, without: Sequence[str] = ()
    ) -> None:
        """Read the case's noise and list what could be missing, without the effects that the user rules out."""
        self.catalogue = CATALOGUE | dict(extra_effects or {})
        self.case = with_held_inputs(with_like_inputs(case))
        check_sign_of_current(self.case, self.catalogue)
        self.noise: dict[str, NoiseModel] = noise_of_case(self.case, self.catalogue)
        self.candidates: dict[str, Candidate] = {c.label: c for c in candidates(self.case, self.catalogue)}
        ruled_out = self.labels_of(without)
        self.candidates = {label: c for label, c in self.candidates.items() if label not in ruled_out}
        self.weights = self.noise
        self._input_noise: InputNoise | None = None
        self._hypotheses: dict[Labels, Hypothesis] = {}
        self._screens: dict[Labels, Screen] = {}
        self._rungs: dict[Labels | None, Rung] = {}
        self._families: list[Labels] = [()]

    def _slowed_by(self, label: str) -> str:
        """Return what in a candidate makes every run of a program that holds it take two or three times as long.

        One that bends the armature's equations asks for more steps, each longer to solve; a fault of all sensors with a
        memory, as of their clock, reads all outputs at every step, not at the rows alone.
        """
        effect = self.candidates[label].effect
        if any(touches((effect,), port) for port in ("armature_voltage_drop", "motor_torque")):
            return "bends"
        return "remembers" if effect.is_sensor and effect.has_memory and not effect.column else ""

    @functools.cached_property
    def _board(self) -> Switchboard:
        """Every candidate behind a switch, with inputs free of noise; its steps are those of the base model."""
        everything = tuple(self.candidates.values())
        board = Switchboard(*self._problem((), everything), everything)
        return board if self._quiet is None else board.over(self._courses_of(self._quiet, ()))

    @functools.cached_property
    def _quiet(self) -> Case | None:
        """The case with the noise taken out of its inputs; None where they have none that is known."""
        return without_input_noise(self.case, self.noise) if noisy_inputs(self.case) else None

    def _courses_of(self, case: Case, present: Sequence[Candidate]) -> Track:
        return make_problem(case, self.weights, present, (), self.catalogue)[0].courses

    def _problem(
        self, present: Sequence[Candidate], switched: Sequence[Candidate] = (), family: Sequence[Candidate] = ()
    ) -> tuple[Problem, Layout]:
        return make_problem(self.case, self.weights, present, switched, self.catalogue, self._input_noise, family)

    def bring_together(self, labels: Sequence[str], others: Sequence[str]) -> None:
        """Have the models of some effects and each of the others share a program: it takes less to compile than many.

        What is slow stays with its like: it would make all as slow.
        """
        for slowed_by in dict.fromkeys(["", *map(self._slowed_by, others)]):
            family = {*labels, *(one for one in others if self._slowed_by(one) == slowed_by)}
            if not any(family <= set(known) for known in self._families):
                self._families.append(self.key(tuple(family)))

    def problem_of(self, key: Labels) -> tuple[Problem, Layout]:
        """Return a model in the smallest family of which it is one."""
        self.bring_together(key, ())
        family = min((one for one in self._families if set(key) <= set(one)), key=len)
        return self._problem([self.candidates[label] for label in key], (), [self.candidates[one] for one in family])

    def problem_on(self, hypothesis: Hypothesis, runs: Sequence[Run]) -> Problem:
        """Return a model on other runs of the hardware, each in the place of one of the case."""
        case = dataclasses.replace(self.case, runs=tuple(runs))
        present = [self.candidates[label] for label in hypothesis.labels]
        family = [self.candidates[label] for label in hypothesis.layout.of_effect]
        return make_problem(case, self.weights, present, (), self.catalogue, family=family)[0]

    def in_the_program_of(self, other: Hypothesis, hypothesis: Hypothesis) -> tuple[Problem, np.ndarray]:
        """Return a model's problem as one of another's program, where that is not slow, and where the model stands."""
        shared = not any(self._slowed_by(label) for label in other.layout.of_effect if label not in hypothesis.labels)
        family = [self.candidates[label] for label in (other if shared else hypothesis).layout.of_effect]
        problem, layout = self._problem([self.candidates[label] for label in hypothesis.labels], (), family)
        return problem, layout.at(hypothesis.start)

    def labels_to_add(self, names: Sequence[str]) -> Labels:
        """Return the candidates that a user wants in the model; EffectError as `labels_of`, or for want of a column."""
        labels: dict[str, None] = {}
        for name in names:
            meant = self.labels_of([name])
            if len(meant) > 1:
                raise EffectError(f"--add {name}: say of which column, as in --add {meant[0]}.")
            labels |= dict.fromkeys(meant)
        return self.key(tuple(labels))

    def warm_up(self) -> None:
        """Begin to compile the screening program, which takes as long as the first fits, beside them."""

        def compile_board() -> None:
            with contextlib.suppress(UserError):  # the calibration will meet the same mistake, and tell it
                self._board.warm_up()

        Thread(target=compile_board, daemon=True).start()

    def labels_of(self, names: Sequence[str]) -> Labels:
        """Return the candidates that a user's names mean: an effect, or a sensor's effect on one column as 'a:b'.

        Raises:
            EffectError: no candidate of this case is called so.
        """
        found: list[str] = []
        for name in names:
            meant = [label for label, c in self.candidates.items() if name in (label, c.effect.name)]
            if not meant:
                raise EffectError(
                    f"{self.case.name}: no effect that could be added to this case is called '{name}'."
                    f"{nearest(name, self.candidates)}"
                )
            found.extend(meant)
        return tuple(dict.fromkeys(found))

    def key(self, labels: Sequence[str]) -> Labels:
        """Return effects in the order in which they act on a port they share, that of the catalogue."""
        return tuple(label for label in self.candidates if label in labels)

    def reweighted(self, best: Hypothesis, by_time: bool = False) -> Session:
        """Return a session of the same case that weighs readings by what a model leaves; see `weights`.

        The noise itself, and with it the verdict, stays what the sensors say.
        """
        left = self.rung("", best)
        weights = by_errors_and_time(self.noise, left, self.case) if by_time else by_errors(self.noise, left)
        return self._again(weights=weights, _input_noise=None)

    def with_noise_left_by(self, model: Hypothesis) -> Session | None:
        """Return a session with the noise of sensors as what a calibrated model leaves of the readings tells it.

        None where that is what is assumed already, within some percent.
        """
        noise = noise_left_by(self.case, self.noise, self.rung("", model).predictions)
        changed = any(_other_noise(noise[name], before) for name, before in self.noise.items())
        return self._again(noise=noise, weights=noise, _input_noise=None) if changed else None

    def with_noise_of_inputs(self, best: Hypothesis) -> Session | None:
        """Return a session with each reading's noise as the best model passes it on from noisy inputs.

        None where that is what is assumed already, within some percent.
        """
        if not noisy_inputs(self.case):
            return None
        problem = best.problem
        noise, passed_on = noise_passed_on(self.case, self.noise, problem, best.fitted.x)
        counted = flatten(self.case, noise, problem.channels, problem.times.shape[1], passed_on)
        old, new = np.asarray(problem.readings.sd), np.asarray(counted.sd)
        changed = np.abs(new / old - 1.0)[np.asarray(counted.fit) > 0.0] > NOISE_CHANGED
        if not counted.slow.size and np.mean(changed) <= NOISE_CHANGED_SHARE:
            return None
        return self._again(_input_noise=passed_on, noise=noise, weights=noise)

    def _again(self, **changes: Any) -> Session:
        """Return a session of the same case with other weights, nothing fitted yet."""
        other = copy.copy(self)
        for kept in ("_board", "_quiet"):
            other.__dict__.pop(kept, None)
        other.__dict__.update(changes, _hypotheses={}, _screens={}, _rungs={})
        return other

    def hypothesis(
        self, labels: Sequence[str] = (), starts: Sequence[Start] = (), rival: float | None = None
    ) -> Hypothesis:
        """Return the calibrated model with effects added.

        `starts` are tried in turn until one converges to something better than the base model; what they leave open
        begins where the base model ended. The base model itself is also started from the likeliest of some random
        places within its priors, and the better of the two kept. Fits that never come near a `rival`'s objective, else
        that of the best so far, are given up early.
        """
        key = self.key(labels)
        if key in self._hypotheses:
            return self._hypotheses[key]
        problem, layout = self.problem_of(key)
        own = layout.own(key)
        # Where the base model has been calibrated already, it is the place to begin.
        known = self._hypotheses[()].fitted.x if () in self._hypotheses else np.zeros(layout.base)

        tries = [layout.at({BASE: known, **start}) for start in starts or [{}]]
        if not key:
            tries.append(likeliest_of_some(problem, layout.base))
        rival = self._best_so_far(key) if rival is None else rival

        def calibrated(begin: np.ndarray) -> Fit:
            """Let the base model follow the effects at their first amplitude, then free all."""
            if not key:
                return fit(problem, begin)
            followed = fit(problem, begin, range(layout.base), steps=FOLLOWING_STEPS).x
            return fit(problem, followed, own, rival=rival)

        # Another start is worth its time for the base model, and where the first one made nothing better.
        tried = at_once(calibrated, tries[:1] if key else tries)
        best = min(tried, key=lambda one: one.objective)
        for begin in tries[len(tried) :]:
            ended = best.converged or (len(key) > 1 and best.idle)
            if ended and best.objective < self.hypothesis().fitted.objective:
                break
            best = min(best, calibrated(begin), key=lambda one: one.objective)
        if key and best.objective > self.hypothesis().fitted.objective:
            # An effect can always be faint: a fit worse than without it failed, and is no evidence against the effect.
            faint = layout.at({BASE: known, **{label: faintest(self.candidates[label]) for label in key}})
            best = min(best, calibrated(faint), key=lambda one: one.objective)
        for label in key:
            if self.candidates[label].reach:
                best = over_the_ridges(problem, self.candidates[label], layout.of_effect[label], own, best, rival)
        self._hypotheses[key] = Hypothesis(key, problem, layout, best)
        return self._hypotheses[key]

    def again(self, sets: Sequence[Labels], rival: Hypothesis) -> list[Hypothesis]:
        """Return calibrated models with effects added, begun from where a rival ended too: the better of both.

        They end where they never will come near the rival.
        """
        keys = [self.key(labels) for labels in sets]
        best = {key: self._best_so_far(key) for key in keys}
        return at_once(lambda key: self._from_rival(key, best[key], rival), keys)

    def _from_rival(self, key: Labels, best: float, rival: Hypothesis) -> Hypothesis:
        start = {name: x for name, x in rival.start.items() if name in (BASE, *key)}
        known = self.hypothesis(key, [start], best)
        other = fit(known.problem, known.layout.at(start), known.own, rival=rival.fitted.objective)
        if other.objective < known.fitted.objective - IDLE_GAIN:
            self._hypotheses[key] = dataclasses.replace(known, fitted=other)
            self._screens.pop(key, None)
            self._rungs.pop(key, None)
        return self._hypotheses[key]

    def hypotheses(self, sets: Sequence[tuple[Labels, Sequence[Start]]]) -> list[Hypothesis]:
        """Return several hypotheses; two are compiled and fitted at a time.

        What two must come near is the best before both: no answer depends on which of them is done first.
        """
        found: list[Hypothesis] = []
        for first in range(0, len(sets), 2):
            two = [(*one, self._best_so_far(one[0])) for one in sets[first : first + 2]]
            found += at_once(lambda one: self.hypothesis(*one), two)
        return found

    def _best_so_far(self, key: Labels) -> float:
        return min((one.fitted.objective for one in self.known() if 0 < len(one.labels) <= len(key)), default=np.inf)

    def known(self) -> list[Hypothesis]:
        """Return every hypothesis fitted so far."""
        return list(self._hypotheses.values())

    def screen(self, hypothesis: Hypothesis) -> Screen:
        """Return the scores of all other candidates at a calibrated hypothesis."""
        if hypothesis.labels not in self._screens:
            self._screens[hypothesis.labels] = self._screened(hypothesis)
        return self._screens[hypothesis.labels]

    def _screened(self, hypothesis: Hypothesis) -> Screen:
        problem, own, x = hypothesis.problem, hypothesis.own, hypothesis.fitted.x
        part = problem.only("fit")
        rows, slopes = look(part, x)
        if self._quiet is not None:
            # A sensitivity to resistance made with the noise of a row's own current is correlated with its residual.
            courses = self._courses_of(self._quiet, [self.candidates[label] for label in hypothesis.labels])
            slopes = look(eqx.tree_at(lambda p: p.courses, problem, courses).only("fit"), x)[1]
        counted = np.asarray(part.readings.fit) > 0.0
        base = np.concatenate([-slopes[counted][:, own], np.eye(len(own))])
        residual = np.concatenate([rows[counted], -x[own]])
        names = [hypothesis.layout.names[number] for number in own]
        return screen(self._board, hypothesis.start, base, residual, names)

    def starts(self, screened: Screen, label: str) -> list[Start]:
        """Return where to begin fitting a candidate: at its best-scoring shape and the amplitude it suggests."""
        return scored_starts(self.candidates[label], screened)

    def masking(self, screened: Screen) -> list[tuple[Labels, list[Start]]]:
        """Return pairs of effects that a screen shows together and not alone, the best first, with their starts."""
        pairs = masking_pairs(screened.table)
        return [(self.key(pair.labels), [pair_start(pair, screened, self.candidates)]) for pair in pairs]

    def rung(self, name: str, hypothesis: Hypothesis | None) -> Rung:
        """Return one rung of the ladder; None is the base model at its nominal parameters, uncalibrated.

        Check runs judge with everything fixed that the fit runs determined; only what is their own (an initial state of
        charge known to +- sd) is adjusted on them, within its prior.
        """
        known = hypothesis.labels if hypothesis is not None else None
        if known not in self._rungs:
            self._rungs[known] = self._rung(hypothesis)
        return dataclasses.replace(self._rungs[known], name=name)

    def _rung(self, hypothesis: Hypothesis | None) -> Rung:
        nominal = hypothesis is None
        hypothesis = hypothesis or self.hypothesis()
        problem, layout, fitted = hypothesis.problem, hypothesis.layout, hypothesis.fitted
        x = np.zeros_like(fitted.x) if nominal else fitted.x.copy()
        checks = {number for number, run in enumerate(self.case.runs) if run.split == "check"}
        own = [i for i, run in enumerate(layout.runs) if run in checks]
        if own and not nominal and problem.runs_read("check").size:
            x = fit(problem, x, own, "check").x
        predicted = predict(problem, x)
        predictions = {
            run.name: {
                channel: predicted[number, : run.measured.time_s.size, place]
                for place, channel in enumerate(problem.channels)
            }
            for number, run in enumerate(self.case.runs)
        }
        estimates, far = ({}, ()) if nominal else self._estimates(hypothesis, x)
        return Rung(
            name="",
            added=hypothesis.labels,
            estimates=estimates,
            at_bound=far,
            errors={channel: self._error(channel, predictions) for channel in self.noise},
            predictions=predictions,
            chi2=float("nan") if nominal else fitted.chi2,
            readings=int(np.sum(np.asarray(problem.readings.fit))),
        )

    def _error(self, channel: str, predictions: dict[str, dict[str, np.ndarray]]) -> ChannelError:
        def rms(split: str) -> float:
            errors = [
                run.measured.outputs[channel] - predictions[run.name][channel]
                for run in self.case.runs
                if run.split == split and channel in run.measured.outputs
            ]
            present = np.concatenate([*errors, np.zeros(0)])
            present = present[np.isfinite(present)]
            return float(np.sqrt(np.mean(present**2))) if present.size else float("nan")

        return ChannelError(fit=rms("fit"), check=rms("check"))

    def _estimates(self, hypothesis: Hypothesis, x: np.ndarray) -> tuple[dict[str, Estimate], Labels]:
        units = {name: info.unit for name, info in parameter_table(self.hypothesis().problem.models).items()}
        for label, candidate in self.candidates.items():
            units |= {f"{label}.{name}": info.unit for name, info in describe(candidate.effect).items()}
        estimates, far = {}, []
        layout, sd = hypothesis.layout, hypothesis.fitted.sd
        for number in hypothesis.own:
            coordinate = layout.coordinates[number]
            run = layout.runs[number]
            name = coordinate.name + (f"[{self.case.runs[run].name}]" if run >= 0 else "")
            estimates[name] = Estimate(
                coordinate.number(x[number]), coordinate.slope(x[number]) * sd[number], units.get(coordinate.name, "")
            )
            if abs(x[number]) > FAR_FROM_PRIOR:
                far.append(name)
        return estimates, tuple(far)


def _other_noise(one: NoiseModel, other: NoiseModel) -> bool:
    return abs(one.sd / other.sd - 1.0) > NOISE_CHANGED or abs(one.rho - other.rho) > NOISE_CHANGED
