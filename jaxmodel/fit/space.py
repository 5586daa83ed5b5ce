"""The space of models of a case, and the programs that predict their readings."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from jaxmodel.base.errors import EffectError, nearest
from jaxmodel.case.build import case_model, own_effect_hint, run_profile
from jaxmodel.case.records import Case
from jaxmodel.case.specimens import stated_differences
from jaxmodel.fit.candidates import Candidate, candidates, laws
from jaxmodel.fit.data import FitData
from jaxmodel.fit.lanes import at_places, predictions
from jaxmodel.fit.laws import PORTS, no_laws
from jaxmodel.fit.layout import Layout, make_layout
from jaxmodel.fit.preparation.thinning import thinned
from jaxmodel.fit.problem import Lane, Problem, make_problem, with_effects
from jaxmodel.fit.settings import SETTINGS, Settings
from jaxmodel.model.pieces import run_in_pieces
from jaxmodel.model.ports import Effect

Labels = tuple[str, ...]
# Stated numbers of which the evidence is to say how far they are from what is stated.
# Free, they take up what a resistance misses at another current; held, they spoil a cell whose stated capacity is not
# that of the day.
CHARGES = ("capacity_Ah", "initial_soc")
# Steps of all fit runs above which a model has a program of its own.
_WORTH_A_PROGRAM = 30_000
# Typical size of a law at a port, as a share of the usual value there.
_SHARE = {"overpotential": 0.003, "counted_current": 0.02, "cell_heat": 0.1, "bridge_voltage": 0.03}
_SHARE |= {"load_torque": 0.05, "torque_constant": 0.03, "motor_loss": 0.1, "onboard_current": 0.3}


@dataclasses.dataclass(frozen=True)
class ModelSpec:
    """One model of a case: its free unknowns, their priors, and the effects that are switched on.

    Attributes:
        labels: of its additions.
        amplitudes: prior sd of its curves and laws, in units of their usual size.
        spreads: prior sd of the charges of `CHARGES`, in units of the stated sd.
        free: places of the free unknowns.
        precision: (k,) 1 / sd^2 of the priors of the free unknowns' coordinates; 1 except for charges, curves and laws.
        switches: of the effects with a switch.
        laws: settings of the laws.
        is_fine: it needs the finer steps of effects that make the armature equations nonlinear.
        charges: places of the unknowns of `CHARGES`.
    """

    labels: Labels
    amplitudes: dict[str, float]
    spreads: dict[str, float]
    free: tuple[int, ...]
    precision: np.ndarray
    switches: np.ndarray
    laws: np.ndarray
    is_fine: bool
    charges: tuple[int, ...] = ()

    def lane(self, x: np.ndarray) -> Lane:
        """Return the lane of the model at coordinates x."""
        return Lane(x, self.switches, self.laws)

    def with_free(self, places: Collection[int]) -> ModelSpec:
        """Return the model with only some of its free unknowns free; the others stay where a fit starts.

        Args:
            places: of the unknowns that stay free.
        """
        kept = [number for number, place in enumerate(self.free) if place in places]
        return dataclasses.replace(
            self, free=tuple(self.free[number] for number in kept), precision=self.precision[kept]
        )


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
        only: Collection[str] | None = None,
    ) -> None:
        """Lay out the unknowns, without the candidates that are ruled out, or of those with some names alone."""
        self.case, self.settings = case, settings
        self.fitted = thinned(case, settings)
        self._own: dict[tuple[int, tuple[str, ...]], Problem] = {}
        ranges, sizes = _ranges(case), _sizes(case)
        everything = [*candidates(case, ranges), *laws(case, ranges, sizes, settings)]
        self.candidates: dict[str, Candidate] = {
            one.label: one for one in everything if only is None or (one.name in only and one.run < 0)
        }
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

    def problem(self, spec: ModelSpec) -> Problem:
        """Return the problem of a model.

        In a large case it is one with the model's own effects alone: to compile it takes a second, and each of many
        evaluations takes a third of the time that one with all candidates takes, although these are switched off.
        """
        whole = self.problem_of_all(spec)
        if not self.is_large:
            return whole
        return self._of_effects(whole, spec)

    def _of_effects(self, whole: Problem, spec: ModelSpec) -> Problem:
        """Return the part of a problem that has the effects of a model alone."""
        effects = tuple(sorted({self.candidates[label].effect.label for label in spec.labels}))
        if (id(whole), effects) not in self._own:
            # What one specimen states is in the models of all, and a candidate of another.
            candidates = {one.effect.label for one in self.candidates.values()} - stated_differences(self.case)
            self._own[id(whole), effects] = whole.without(candidates - set(effects))
        return self._own[id(whole), effects]

    @functools.cached_property
    def charges(self) -> dict[str, list[int]]:
        """Return the places of the unknowns of `CHARGES`, of those that are uncertain."""
        named = [(one.name, place) for place, one in enumerate(self.layout.coordinates[: self.layout.base])]
        found = {name: [place for own, place in named if own == name] for name in CHARGES}
        return {name: places for name, places in found.items() if places}

    @functools.cached_property
    def is_large(self) -> bool:
        """Return whether a model is worth a program of its own."""
        return sum(count * steps for count, _, steps in self.coarse.shapes) > _WORTH_A_PROGRAM

    def problem_of_all(self, spec: ModelSpec) -> Problem:
        """Return the problem in which every candidate can be switched on beside a model."""
        return self.fine if spec.is_fine else self.coarse

    def spec(
        self,
        labels: Sequence[str],
        amplitudes: Mapping[str, float] | None = None,
        spreads: Mapping[str, float] | None = None,
    ) -> ModelSpec:
        """Return the model with some additions to the base model.

        Args:
            labels: of candidates.
            amplitudes: prior sd of curves and laws, in units of their usual size; 1 if not given.
            spreads: prior sd of the charges of `CHARGES`, in units of the stated sd; 1 if not given.
        """
        spread = {name: (spreads or {}).get(name, 1.0) for name in self.charges}
        key = self.key(labels)
        given = {label: (amplitudes or {}).get(label, 1.0) for label in key if self.candidates[label].is_vector}
        switches, settings = np.zeros(len(self.coarse.switched)), no_laws(self.case.kind)
        for label in key:
            candidate = self.candidates[label]
            if candidate.is_switched:
                switches[self.coarse.switched.index(candidate.effect.label)] = 1.0
            if candidate.law is not None:
                settings[candidate.law[0]] = candidate.law[1]
        fine = any(self.candidates[label].bends for label in key if self.candidates[label].is_switched)
        free, precision = self._free(key), np.ones(self.layout.size)
        for label, amplitude in given.items():
            precision[list(self.layout.of[label])] = amplitude**-2.0
        for name, places in self.charges.items():
            precision[places] = spread[name] ** -2.0
        charges = tuple(place for places in self.charges.values() for place in places)
        return ModelSpec(key, given, spread, free, precision[list(free)], switches, settings, fine, charges)

    def _free(self, key: Labels) -> tuple[int, ...]:
        """Return the unknowns of a model that fitted readings depend on: not those of check runs."""
        checks = {number for number, run in enumerate(self.case.runs) if run.split == "check"}
        return tuple(place for place in self.layout.places_of(key) if self.layout.runs[place] not in checks)

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
        """Return the candidates that a user adds; EffectError as `labels_of`, of a curve, or without its column."""
        labels: dict[str, None] = {}
        for name in names:
            meant = self.labels_of([name])
            if self.candidates[meant[0]].group == "curve":
                raise EffectError(f"'{name}' is a curve, and a diagnosis fits all curves by itself: leave it out.")
            if len(meant) > 1:
                raise EffectError(f"--add {name}: give its column too, as in --add {meant[0]}.")
            labels |= dict.fromkeys(meant)
        return self.key(tuple(labels))

    def predicted(
        self, spec: ModelSpec, x: np.ndarray, runs: Sequence[int] | None = None
    ) -> dict[str, dict[str, np.ndarray]]:
        """Return what a model predicts for all readings, by run and channel, each over the rows of the run.

        Args:
            spec: the model.
            x: (unknowns,) coordinates.
            runs: numbers of the runs; all if None.
        """
        lane, channels = spec.lane(x), self.coarse.channels
        numbers = range(len(self.case.runs)) if runs is None else runs
        found: dict[str, dict[str, np.ndarray]] = {}
        if self.fitted is self.case:
            together = predictions(self.problem(spec), [lane])[0]
            for number in numbers:
                run, rows = self.case.runs[number], slice(self.case.runs[number].measured.time_s.size)
                found[run.name] = {name: together[number, rows, place] for place, name in enumerate(channels)}
            return found
        problem = self._of_effects(self.problem_of_all(spec), spec)
        for number in numbers:
            run = self.case.runs[number]
            bare = with_effects(case_model(self.case, run), self._bending if spec.is_fine else ())
            course = run_in_pieces(problem.model_of(number, lane), run_profile(run), steps_of=bare)
            found[run.name] = {name: course.readings[name] for name in channels}
        return found


class View:
    """The fitted readings of a case, and their prediction by any model."""

    def __init__(self, space: ModelSpace, data: FitData) -> None:
        """Choose the readings; only their runs are simulated."""
        self.space, self.data = space, data
        self.runs = np.unique(data.run)
        number = np.full(len(space.case.runs), -1)
        number[self.runs] = np.arange(self.runs.size)
        self.places = (number[data.run], data.row, data.channel)
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
