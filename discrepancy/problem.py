"""A case as a least-squares problem: unknowns in, whitened residuals out, over all its runs at once."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from discrepancy.candidates import Candidate, Coordinate, known_coordinate
from discrepancy.held_inputs import noisy_inputs
from discrepancy.input_noise import InputNoise
from discrepancy.noise import NoiseModel
from discrepancy.readings import Readings, flatten, part_of
from discrepancy.readings import none as no_readings
from discrepancy.shapes import rounded_length, rounded_rows, rounded_steps, shapes_of
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Case
from jaxmodel.effects import CATALOGUE
from jaxmodel.errors import FitError
from jaxmodel.measurements import KINDS, file_label
from jaxmodel.model import Model
from jaxmodel.names import with_values
from jaxmodel.parameters import info
from jaxmodel.ports import Effect
from jaxmodel.simulate import Needed, Track, run_track, track

# Where a model stands: coordinates of effects by label, and of the base model.
Start = Mapping[str, np.ndarray]
BASE = ""

_OfRun = TypeVar("_OfRun")


class Lane(eqx.Module):
    """Where all unknowns stand, how far the switched effects are on, and what is added to inputs (runs, 1 + steps)."""

    x: Array | np.ndarray
    switches: Array | np.ndarray
    added: dict[str, Array | np.ndarray] = eqx.field(default_factory=dict)


class Unknowns(eqx.Module):
    """The unknown numbers as standard normal coordinates; see `Coordinate` for the transform.

    Attributes:
        names: of the numbers.
        of_run: (runs, unknowns) True where a number is one of that run.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    of_run: Array
    logarithmic: Array
    centre: Array
    spread: Array
    origin: Array
    sign: Array

    def numbers(self, x: Array | np.ndarray) -> Array:
        """Return the numbers at the coordinates x, both of shape (unknowns,)."""
        straight = self.centre + self.spread * x
        curved = self.origin + self.sign * jnp.exp(jnp.where(self.logarithmic, straight, 0.0))
        return jnp.where(self.logarithmic, curved, straight)


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where everything stands in the vector of unknowns.

    Attributes:
        coordinates: one for each unknown.
        runs: for each unknown the run it belongs to, or -1 for all runs.
        fixed_in: for each unknown the runs that state a value of their own.
        base: how many unknowns the base model has; those of effects follow.
        of_effect: numbers of each effect's unknowns, by label.
    """

    coordinates: tuple[Coordinate, ...]
    runs: tuple[int, ...]
    fixed_in: tuple[tuple[int, ...], ...]
    base: int
    of_effect: dict[str, tuple[int, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the unknowns."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    def own(self, labels: Sequence[str]) -> list[int]:
        """Return the numbers of the base model's unknowns, then of some effects'."""
        return [*range(self.base), *(number for label in labels for number in self.of_effect[label])]

    def of_runs(self, count: int) -> Array:
        """Return which unknowns are of which of so many runs, shape (runs, unknowns)."""
        places = list(zip(self.runs, self.fixed_in, strict=True))
        return jax.device_put(
            np.array([[(own < 0 and i not in fixed) or own == i for own, fixed in places] for i in range(count)])
        )

    def at(self, start: Start) -> np.ndarray:
        """Return the vector of unknowns at a start, zero where it says nothing."""
        x = np.zeros(len(self.coordinates))
        x[: self.base] = start.get(BASE, 0.0)
        for label, places in self.of_effect.items():
            x[list(places)] = start.get(label, 0.0)
        return x


def make_layout(case: Case, effects: Sequence[Candidate]) -> Layout:
    """Lay out the unknowns: declared parameters, what runs declare of their own, then the effects' parameters.

    Raises:
        FitError: the case declares nothing uncertain.
    """
    coordinates, runs, fixed_in = [], [], []
    for name, known in case.parameters.items():
        if known.sd is not None:
            coordinates.append(known_coordinate(name, known.value, known.sd, info(name)))
            runs.append(-1)
            fixed_in.append(
                tuple(i for i, run in enumerate(case.runs) if name in run.overrides and run.overrides[name].sd is None)
            )
    for number, run in enumerate(case.runs):
        own = dict(run.overrides) | ({"initial_soc": run.initial_soc} if case.kind != "motor" else {})
        for name, known in own.items():
            if known.sd is not None:
                coordinates.append(known_coordinate(name, known.value, known.sd, info(name)))
                runs.append(number)
                fixed_in.append(())
    if not coordinates:
        raise FitError(
            f"{file_label(case.path)}: nothing to calibrate; give at least one parameter an uncertainty, "
            f"as in capacity_Ah = {{ value = 5.2, sd = 0.15 }}."
        )
    base = len(coordinates)
    of_effect = {}
    for effect in effects:
        first = len(coordinates)
        coordinates.extend(effect.coordinates)
        runs.extend([-1] * len(effect.coordinates))
        fixed_in.extend([()] * len(effect.coordinates))
        of_effect[effect.label] = tuple(range(first, len(coordinates)))
    return Layout(tuple(coordinates), tuple(runs), tuple(fixed_in), base, of_effect)


class Problem(eqx.Module):
    """Predictions of all runs for any setting of the unknowns; a pytree, so that cases of one shape share programs.

    Attributes:
        models: of each run.
        courses: the steps of each run.
        times: (runs, rows) times of the readings.
        readings: what was read.
        unknowns: the numbers that are free.
        switched: effects behind a switch.
        channels: all outputs of the kind, measured or not.
        noisy: inputs whose noise is known, to which every lane may add something.
        shapes: how many runs are simulated at a time, and their rows and steps: those of the runs that may calibrate,
            the short ones by themselves where that saves much, and of the others where they are little longer.
    """

    models: Model
    courses: Track
    times: Array
    readings: Readings
    unknowns: Unknowns
    switched: tuple[str, ...] = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    noisy: tuple[str, ...] = eqx.field(static=True)
    shapes: tuple[tuple[int, int, int], ...] = eqx.field(static=True)

    def _model_at(self, model: Model, own: Array, lane: Lane) -> Model:
        """Return a run's model; `own` (unknowns,) is True where an unknown is one of that run."""
        found = self.unknowns.numbers(lane.x)
        numbers: dict[str, Array] = {}
        for place, name in enumerate(self.unknowns.names):
            before = numbers.get(name, _stated(model, name))
            numbers[name] = jnp.where(own[place], found[place], before)
        for place, label in enumerate(self.switched):
            numbers[f"{label}.switch"] = lane.switches[place]
        return with_values(model, numbers)

    @property
    def moving(self) -> np.ndarray:
        """Return which unknowns enter any of the runs."""
        return np.any(np.asarray(self.unknowns.of_run), axis=0)

    def predictions(self, lanes: Lane) -> Array:
        """Return the predicted readings of many lanes, shape (lanes, runs, rows, channels).

        Every lane of every run is one of the innermost axis of all arithmetic, which fills a processor's vectors: runs
        by themselves are few, and an axis more takes twice as long to trace and to compile.
        """

        def of_one(run: tuple[Model, Array, Track, Array], lane: Lane) -> Array:
            model, own, course, time_s = run
            inputs = course.inputs | {name: course.inputs.get(name, 0.0) + more for name, more in lane.added.items()}
            course = dataclasses.replace(course, inputs=inputs)
            readings = run_track(self._model_at(model, own, lane), course, time_s, needed=needed).readings
            return jnp.stack([readings[name] for name in self.channels], axis=-1)

        runs, count, needed = self.times.shape[0], lanes.x.shape[0], self._needed(lanes)
        of_runs = (self.models, self.unknowns.of_run, self.courses, self.times)
        of_each_run = jax.tree.map(lambda x: jnp.repeat(x, count, axis=0), of_runs)
        of_each_lane = Lane(
            jnp.tile(lanes.x, (runs, 1)),
            jnp.tile(lanes.switches, (runs, 1)),
            {name: jnp.concatenate(jnp.swapaxes(more, 0, 1)) for name, more in lanes.added.items()},
        )
        found = jax.vmap(of_one)(of_each_run, of_each_lane)
        return jnp.swapaxes(found.reshape(runs, count, *found.shape[1:]), 0, 1)

    def _needed(self, lanes: Lane) -> Needed:
        on = [
            lanes.switches[:, self.switched.index(effect.label)] if effect.label in self.switched else effect.switch
            for effect in self.models.effects
            if effect.has_memory
        ]
        memory = [jnp.asarray(True) if one is None else jnp.any(jnp.asarray(one) != 0.0) for one in on]
        return Needed(jnp.max(self.courses.last_step) + 1, jnp.any(jnp.asarray(memory, dtype=bool)))

    def runs_read(self, split: str) -> np.ndarray:
        """Return the numbers of the runs with readings that fit, or check."""
        counted = np.asarray(getattr(self.readings, split)) > 0.0
        return np.unique(np.asarray(self.readings.index)[counted] // (self.times.shape[1] * len(self.channels)))

    def only(self, split: str) -> Problem:
        """Return the problem of the fit runs, or of the check runs, alone, its readings in the same order.

        Unknowns keep their places; those of the runs left out move nothing.
        """
        kept = self.runs_read(split)
        rows, steps = np.max([self._length(kept), *(shape[1:] for shape in self.shapes)], axis=0).tolist()
        number = np.full(self.times.shape[0], kept.size)
        number[kept] = np.arange(kept.size)
        readings = part_of(self.readings, self.times.shape, len(self.channels), number, rows, split)
        return dataclasses.replace(self._of_runs(kept, rows, steps), readings=readings)

    @functools.cached_property
    def blocks(self) -> list[tuple[np.ndarray, Problem]]:
        """Return the problems of a few runs at a time, as many as may calibrate, and the numbers of these runs.

        They are of one shape, and share a compiled program, where `shapes` has one and no run is longer. Readings have
        no part in predictions, and are left out.
        """
        unread = dataclasses.replace(self, readings=no_readings())
        if ((*self.times.shape, self.courses.duration_s.shape[1]),) == self.shapes:
            return [(np.arange(self.times.shape[0]), unread)]
        everything = self._length(slice(None))
        shapes = [*self.shapes, (self.shapes[-1][0], *everything)]
        lengths = [self._length(run) for run in range(self.times.shape[0])]
        fits = [next(n for n, (_, *size) in enumerate(shapes) if np.all(np.less_equal(own, size))) for own in lengths]
        blocks = []
        for number, (count, *size) in enumerate(shapes):
            runs = np.flatnonzero(np.equal(fits, number))
            for first in range(0, runs.size, count):
                some = runs[first : first + count]
                blocks.append((some, unread._of_runs(np.pad(some, (0, count - some.size), mode="edge"), *size)))
        return blocks

    def _length(self, runs: np.ndarray | slice | int) -> tuple[int, int]:
        """Return the rows and steps of the longest of some runs, rounded up."""
        return rounded_length(np.atleast_2d(np.asarray(self.courses.last_step)[runs]))

    def _of_runs(self, runs: np.ndarray, rows: int, steps: int) -> Problem:
        """Return the problem of some runs, cut to so many rows and steps; its readings are those of all."""
        courses = Track(
            duration_s=_part(self.courses.duration_s, runs, steps),
            inputs={name: _part(values, runs, steps + 1) for name, values in self.courses.inputs.items()},
            last_step=_part(self.courses.last_step, runs, rows - 1),
        )
        return dataclasses.replace(
            self,
            models=jax.tree.map(lambda leaf: _part(leaf, runs), self.models),
            courses=courses,
            times=_part(self.times, runs, rows),
            unknowns=dataclasses.replace(self.unknowns, of_run=_part(self.unknowns.of_run, runs)),
        )


def _part(values: Array, runs: np.ndarray, size: int | None = None) -> Array:
    """Return some runs, and the first so many columns; on the host, where each shape does not compile a program."""
    kept = np.asarray(values)[runs]
    return jax.device_put(kept if size is None else kept[:, :size])


def _stated(models: Model, name: str) -> Array:
    label, _, field = name.rpartition(".")
    owner = models.parameters if not label else next(e for e in models.effects if e.label == label)
    return getattr(owner, field)


def make_problem(
    case: Case,
    noise: Mapping[str, NoiseModel],
    present: Sequence[Candidate] = (),
    switched: Sequence[Candidate] = (),
    catalogue: Mapping[str, type[Effect]] = CATALOGUE,
    input_noise: InputNoise | None = None,
    family: Sequence[Candidate] = (),
) -> tuple[Problem, Layout]:
    """Lay a case out for fitting.

    Args:
        case: with at least one run marked `fit`.
        noise: of each output column to be used.
        present: effects added to the case's model, their parameters unknown.
        switched: effects added behind a switch, their parameters unknown.
        catalogue: the known effects, for those that the case itself names.
        input_noise: of each reading, in place of its average over a channel.
        family: effects among which are those present, for models that shall share one compiled program: the others are
            in it too, switched off, and their parameters among the unknowns, where nothing depends on them.

    Raises:
        FitError: no run may be used to calibrate, no reading is there, or nothing is uncertain.
    """
    layout = make_layout(case, [*(family or present), *switched])
    on = {effect.label for effect in present}
    behind_switches = tuple(_switched(effect.effect, float(effect.label in on)) for effect in (*family, *switched))
    bare = [case_model(case, run, catalogue=catalogue) for run in case.runs]
    own = tuple(effect.effect for effect in present)
    # Steps are as fine as what is in the model needs; what is only tried by a switch is not worth finer ones.
    courses, times = _courses([_with_effects(model, own) for model in bare], case)
    added = behind_switches if family else (*own, *behind_switches)
    models = [_with_effects(model, added) for model in bare]
    readings = flatten(case, noise, KINDS[case.kind].outputs, times.shape[1], input_noise)
    if not np.any(np.asarray(readings.fit)):
        raise FitError(f"{file_label(case.path)}: {_why_no_readings(case)}.")
    fit_runs = np.flatnonzero([run.split == "fit" for run in case.runs])
    parts = {
        field: jax.device_put(np.array([getattr(coordinate, field) for coordinate in layout.coordinates]))
        for field in ("logarithmic", "centre", "spread", "origin", "sign")
    }
    problem = Problem(
        models=_side_by_side(models),
        courses=courses,
        times=times,
        readings=readings,
        unknowns=Unknowns(layout.names, layout.of_runs(len(case.runs)), **parts),
        switched=tuple(effect.label for effect in switched),
        channels=KINDS[case.kind].outputs,
        noisy=tuple(noisy_inputs(case)),
        shapes=shapes_of([rounded_length(last_step[None]) for last_step in np.asarray(courses.last_step)], fit_runs),
    )
    return problem, layout


def _why_no_readings(case: Case) -> str:
    """Return why there is nothing to calibrate to, and what to do."""
    read = {name for run in case.runs if run.split == "fit" for name in run.measured.outputs}
    if not read:
        return 'no reading of a run with split = "fit"; mark at least one such run, with a column that is measured'
    return (
        f"{' and '.join(sorted(read))} never change in the fit runs and their noise is not stated, so that nothing is "
        "learnt from them; state it under [sensors], or measure something that moves"
    )


def _switched(effect: Effect, on: float) -> Effect:
    return eqx.tree_at(lambda e: e.switch, effect, jnp.asarray(on), is_leaf=lambda x: x is None)


def _with_effects(model: Model, added: tuple[Effect, ...]) -> Model:
    return eqx.tree_at(lambda m: m.effects, model, (*model.effects, *added))


def _courses(models: list[Model], case: Case) -> tuple[Track, Array]:
    """Lay the runs out in steps of equal number, ends padded with steps of zero length."""
    profiles = [run_profile(run) for run in case.runs]
    pairs = list(zip(models, profiles, strict=True))
    steps = rounded_steps(max(track(model, profile).duration_s.shape[0] for model, profile in pairs))
    rows = rounded_rows(max(profile.time_s.size for profile in profiles))
    courses, times = [], []
    for model, profile in pairs:
        course = track(model, profile, steps)
        last = np.asarray(course.last_step)
        courses.append(
            dataclasses.replace(course, last_step=jax.device_put(np.pad(last, (0, rows - 1 - last.size), mode="edge")))
        )
        times.append(np.pad(profile.time_s, (0, rows - profile.time_s.size), mode="edge"))
    return _side_by_side(courses), jax.device_put(np.stack(times))


def _side_by_side(of_runs: Sequence[_OfRun]) -> _OfRun:
    """Return what is of each run in arrays of all; stacked on the host, where no shape compiles a program."""
    return jax.device_put(jax.tree.map(lambda *leaves: np.stack(leaves), *of_runs))
