"""The space of models of a case, and the programs that predict their readings."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import equinox as eqx
import numpy as np

from jaxmodel.base.errors import EffectError, nearest
from jaxmodel.case.build import case_model, own_effect_hint, run_profile
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.fitting.candidates import Candidate, candidates, laws
from jaxmodel.diagnosis.fitting.lanes import at_places, predictions
from jaxmodel.diagnosis.fitting.laws import PORTS, no_laws
from jaxmodel.diagnosis.fitting.layout import Layout, make_layout
from jaxmodel.diagnosis.fitting.problem import Lane, Problem, make_problem, tracks_of, with_effects
from jaxmodel.diagnosis.fitting.readings import Readings
from jaxmodel.diagnosis.noise.contract import without_input_noise
from jaxmodel.diagnosis.noise.instrument import NoiseModel
from jaxmodel.diagnosis.noise.model_error import Series
from jaxmodel.diagnosis.noise.steepness import steepness
from jaxmodel.diagnosis.preparation.held_inputs import noisy_inputs
from jaxmodel.diagnosis.preparation.thinning import thinned
from jaxmodel.diagnosis.settings import SETTINGS, Settings
from jaxmodel.model.pieces import run_in_pieces
from jaxmodel.model.ports import Effect

Labels = tuple[str, ...]
# Steps of all fit runs above which a model has a program of its own.
_WORTH_A_PROGRAM = 30_000
# Typical size of a law at a port, as a share of the usual value there.
_SHARE = {"overpotential": 0.003, "counted_current": 0.02, "cell_heat": 0.1, "bridge_voltage": 0.03}
_SHARE |= {"load_torque": 0.05, "torque_constant": 0.03, "motor_loss": 0.1, "onboard_current": 0.3}


@dataclasses.dataclass(frozen=True)
class Setting:
    """One model of a case: its free unknowns, their priors, and the effects that are switched on.

    Attributes:
        labels: of its additions.
        free: places of the free unknowns.
        prior_sd: (unknowns,) prior sd of each coordinate; 1 except for curves and laws.
        switches: of the effects with a switch.
        laws: settings of the laws.
        is_fine: it needs the finer steps of effects that make the armature equations nonlinear.
    """

    labels: Labels
    free: tuple[int, ...]
    prior_sd: np.ndarray
    switches: np.ndarray
    laws: np.ndarray
    is_fine: bool

    def lane(self, x: np.ndarray) -> Lane:
        """Return the lane of the model at coordinates x."""
        return Lane(x, self.switches, self.laws)


class ModelSpace:
    """All models of a case in one compiled program; a second one has finer steps, for nonlinear armature equations.

    Attributes:
        case: with all readings.
        fitted: the same case, thinned if it is long: what fits simulate.
        candidates: by label.
        layout: of the unknowns.
    """

    def __init__(
        self,
        case: Case,
        without: Sequence[str] = (),
        settings: Settings = SETTINGS,
    ) -> None:
        """Lay out the unknowns, without the candidates that are ruled out."""
        self.case, self.settings = case, settings
        self.fitted = thinned(case, settings)
        self._own: dict[tuple[int, tuple[str, ...]], Problem] = {}
        self._quieted: dict[int, tuple[Problem, Problem]] = {}
        ranges, sizes = _ranges(case), _sizes(case)
        everything = [*candidates(case), *laws(case, ranges, sizes, settings)]
        self.candidates: dict[str, Candidate] = {one.label: one for one in everything}
        ruled_out = self.labels_of(without)
        self.candidates = {label: one for label, one in self.candidates.items() if label not in ruled_out}
        self.layout: Layout = make_layout(case, list(self.candidates.values()))

    @functools.cached_property
    def coarse(self) -> Problem:
        """Return the problem at the steps of the base model."""
        return make_problem(self.fitted, self.layout, list(self.candidates.values()), ())

    @functools.cached_property
    def fine(self) -> Problem:
        """Return the problem at the finer steps for nonlinear armature equations."""
        return make_problem(self.fitted, self.layout, list(self.candidates.values()), self._bending)

    @property
    def _bending(self) -> list[Effect]:
        return [one.effect for one in self.candidates.values() if one.bends and one.group == "effect"]

    def problem(self, setting: Setting) -> Problem:
        """Return the problem of a model.

        In a large case it is one with the model's own effects alone: to compile it takes a second, and each of many
        evaluations takes a third of the time that one with all candidates takes, although these are switched off.
        """
        whole = self.problem_of_all(setting)
        if not self.is_large:
            return whole
        return self._of_effects(whole, setting)

    def _of_effects(self, whole: Problem, setting: Setting) -> Problem:
        """Return the part of a problem that has the effects of a model alone."""
        effects = tuple(sorted({self.candidates[label].effect.label for label in setting.labels}))
        if (id(whole), effects) not in self._own:
            candidates = {one.effect.label for one in self.candidates.values()}
            self._own[id(whole), effects] = whole.without(candidates - set(effects))
        return self._own[id(whole), effects]

    @functools.cached_property
    def is_large(self) -> bool:
        """Return whether a model is worth a program of its own."""
        return sum(count * steps for count, _, steps in self.coarse.shapes) > _WORTH_A_PROGRAM

    def problem_of_all(self, setting: Setting) -> Problem:
        """Return the problem in which every candidate can be switched on beside a model."""
        return self.fine if setting.is_fine else self.coarse

    def quiet(self, problem: Problem, setting: Setting, noise: Mapping[str, NoiseModel]) -> Problem:
        """Return a problem with the noise removed from its inputs, if it is stated."""
        if not noisy_inputs(self.case):
            return problem
        if id(problem) not in self._quieted:
            quiet = eqx.tree_at(lambda p: p.tracks, problem, self._quiet_tracks(setting.is_fine, noise))
            self._quieted[id(problem)] = (problem, quiet)
        return self._quieted[id(problem)][1]

    def _quiet_tracks(self, is_fine: bool, noise: Mapping[str, NoiseModel]):
        key = f"_quiet_{is_fine}"
        if key not in self.__dict__:
            quiet = without_input_noise(self.fitted, noise)
            self.__dict__[key] = tracks_of(quiet, self._bending if is_fine else ())
        return self.__dict__[key]

    def setting(self, labels: Sequence[str], amplitudes: Mapping[str, float] | None = None) -> Setting:
        """Return the model with some additions to the base model.

        Args:
            labels: of candidates.
            amplitudes: prior sd of curves and laws, in units of their usual size; 1 if not given.
        """
        key = self.key(labels)
        prior_sd = np.ones(self.layout.size)
        switches, settings = np.zeros(len(self.coarse.switched)), no_laws(self.case.kind)
        for label in key:
            candidate = self.candidates[label]
            prior_sd[list(self.layout.of[label])] = (amplitudes or {}).get(label, 1.0)
            if candidate.is_switched:
                switches[self.coarse.switched.index(candidate.effect.label)] = 1.0
            if candidate.law is not None:
                settings[candidate.law[0]] = candidate.law[1]
        fine = any(self.candidates[label].bends for label in key if self.candidates[label].is_switched)
        return Setting(key, tuple(self.layout.places_of(key)), prior_sd, switches, settings, fine)

    def key(self, labels: Sequence[str]) -> Labels:
        """Return candidates in the order in which they act on a shared port."""
        return tuple(label for label in self.candidates if label in labels)

    def labels_of(self, names: Sequence[str]) -> Labels:
        """Return the candidates with given names: an effect, or a sensor fault of one column as 'a:b'.

        Raises:
            EffectError: there is no such candidate.
        """
        found: list[str] = []
        for name in names:
            meant = [label for label, one in self.candidates.items() if name in (label, one.name) and one.run < 0]
            meant = meant or [label for label in self.candidates if name == label]
            if not meant:
                raise EffectError(
                    f"{self.case.name}: '{name}' is not a candidate of this case.{nearest(name, self.candidates)} "
                    f"{own_effect_hint(name)}"
                )
            found.extend(meant)
        return tuple(dict.fromkeys(found))

    def labels_to_add(self, names: Sequence[str]) -> Labels:
        """Return the candidates that a user adds; EffectError as `labels_of`, or if the column is missing."""
        labels: dict[str, None] = {}
        for name in names:
            meant = self.labels_of([name])
            if len(meant) > 1:
                raise EffectError(f"--add {name}: give its column too, as in --add {meant[0]}.")
            labels |= dict.fromkeys(meant)
        return self.key(tuple(labels))

    @functools.cached_property
    def steepness(self) -> dict[Series, np.ndarray]:
        """Return the steepness of the voltages that follow the charge, at the rows that a fit simulates."""
        if self.case.kind == "motor":
            return {}
        setting = self.setting(())
        place = self.coarse.channels.index("soc")
        soc = predictions(self.coarse, [setting.lane(np.zeros(self.layout.size))])[0, :, :, place]
        rows = [run.measured.time_s.size for run in self.fitted.runs]
        of_runs = [of_run[:count] for of_run, count in zip(soc, rows, strict=True)]
        return steepness(self.fitted, of_runs, self.settings.soc_uncertainty)

    @functools.cached_property
    def steepness_of_all(self) -> dict[Series, np.ndarray]:
        """Return the same at all rows."""
        if self.fitted is self.case or self.case.kind == "motor":
            return self.steepness
        predicted = self.predicted(self.setting(()), np.zeros(self.layout.size))
        soc = [predicted[run.name]["soc"] for run in self.case.runs]
        return steepness(self.case, soc, self.settings.soc_uncertainty)

    def predicted(
        self, setting: Setting, x: np.ndarray, runs: Sequence[int] | None = None
    ) -> dict[str, dict[str, np.ndarray]]:
        """Return what a model predicts for all readings, by run and channel, each over the rows of the run.

        Args:
            setting: the model.
            x: (unknowns,) coordinates.
            runs: numbers of the runs; all if None.
        """
        lane, channels = setting.lane(x), self.coarse.channels
        numbers = range(len(self.case.runs)) if runs is None else runs
        found: dict[str, dict[str, np.ndarray]] = {}
        if self.fitted is self.case:
            together = predictions(self.problem(setting), [lane])[0]
            for number in numbers:
                run, rows = self.case.runs[number], slice(self.case.runs[number].measured.time_s.size)
                found[run.name] = {name: together[number, rows, place] for place, name in enumerate(channels)}
            return found
        problem = self._of_effects(self.problem_of_all(setting), setting)
        for number in numbers:
            run = self.case.runs[number]
            bare = with_effects(case_model(self.case, run), self._bending if setting.is_fine else ())
            course = run_in_pieces(problem.model_of(number, lane), run_profile(run), steps_of=bare)
            found[run.name] = {name: course.readings[name] for name in channels}
        return found


class View:
    """The fitted readings of a case, and their prediction by any model."""

    def __init__(self, space: ModelSpace, readings: Readings) -> None:
        """Choose the readings; only their runs are simulated."""
        self.space, self.readings = space, readings
        self.runs = np.unique(readings.run)
        number = np.full(len(space.case.runs), -1)
        number[self.runs] = np.arange(self.runs.size)
        self.places = (number[readings.run], readings.row, readings.channel)
        self._parts: dict[int, tuple[Problem, Problem]] = {}

    def at(self, problem: Problem, lanes: Sequence[Lane]) -> np.ndarray:
        """Return the predictions of the readings by lanes of a problem, shape (lanes, readings)."""
        whole, part = self._parts.get(id(problem), (None, None))
        if whole is not problem:
            part = problem.of(self.runs)
            self._parts[id(problem)] = (problem, part)
        assert part is not None
        return at_places(part, self.places, lanes)


def _ranges(case: Case) -> dict[str, tuple[float, float]]:
    """Return lowest and highest value of every measured or derived quantity in the fit runs."""
    found: dict[str, list[float]] = {}

    def see(name: str, values: np.ndarray) -> None:
        read = values[np.isfinite(values)]
        found.setdefault(name, []).extend([float(read.min()), float(read.max())] if read.size else [])

    for run in case.runs:
        if run.split != "fit":
            continue
        for name, values in (run.measured.outputs | run.measured.inputs).items():
            see(name, values)
        see("time_s", run.measured.time_s - run.measured.time_s[0])
        cycles = run.overrides.get("cycles", case.parameters.get("cycles"))
        if cycles is not None:
            see("cycles", np.array([cycles.value]))
        if "current_A" in run.measured.inputs and "capacity_Ah" in case.parameters:
            time_s, current = run.measured.time_s, run.measured.inputs["current_A"]
            taken = np.cumsum(current * np.diff(time_s, prepend=time_s[0])) / 3600.0
            see("soc", run.initial_soc.value - taken / case.parameters["capacity_Ah"].value)
    if "cell_temperature_degC" not in found and "ambient_degC" in found:
        found["cell_temperature_degC"] = found["ambient_degC"]
    return {name: (min(ends), max(ends)) for name, ends in found.items() if ends}


def _sizes(case: Case) -> dict[str, float]:
    """Return the typical size of a law at every port, in its unit, and the largest value of every multiplier."""

    def largest(*names: str) -> float:
        sizes = [
            float(np.nanmax(np.abs(values)))
            for run in case.runs
            for name, values in (run.measured.inputs | run.measured.outputs).items()
            if name in names and np.isfinite(values).any()
        ]
        return max(sizes, default=0.0)

    def stated(name: str, default: float) -> float:
        return case.parameters[name].value if name in case.parameters else default

    current = largest("current_A", "motor_current_A", "pack_current_A") or 1.0
    torque = largest("load_torque_Nm") or stated("k_tau", 0.0385) * current
    usual = {
        "overpotential": 3.7,
        "counted_current": current,
        "cell_heat": 0.1 * 3.7 * current,
        "load_torque": torque,
        "torque_constant": stated("k_tau", 0.0385),
        "motor_loss": current**2 * stated("R_0", 0.103),
        "bridge_voltage": largest("voltage_V", "pack_voltage_V") or 20.0,
        "onboard_current": stated("onboard_current_A", 0.3),
    }
    sizes = {port: max(_SHARE[port] * usual[port], 1e-12) for port in PORTS[case.kind]}
    return sizes | {"current_A": current, "load_torque_Nm": torque}
