"""One program that predicts every run of a case for any setting of unknowns and switches."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.records import Case
from jaxmodel.case.specimens import stated_differences
from jaxmodel.fit.candidates import Candidate
from jaxmodel.fit.layout import Layout
from jaxmodel.fit.shapes import rounded_length, rounded_rows, rounded_steps, shapes_of
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.ports import Effect
from jaxmodel.model.simulation import Needed, Track, read_track, track

_OfRun = TypeVar("_OfRun")


class Lane(NamedTuple):
    """Values of all unknowns, switches of effects, and settings of laws.

    Attributes:
        x: (unknowns,) coordinates.
        switches: (effects with a switch,) 0 to 1.
        laws: (ports, settings) variable and multiplier of each law; see `fit.laws`.
    """

    x: Array | np.ndarray
    switches: Array | np.ndarray
    laws: Array | np.ndarray


class Unknowns(eqx.Module):
    """The unknowns as coordinates; see `Coordinate` for the transform.

    Attributes:
        targets: parameters of the model as (name, indices); several indices are the values of several runs.
        vectors: vectors of the model as (name, first index, one past the last); values are mix @ numbers.
        of_run: (runs, unknowns) True if an unknown applies to the run.
        mixes: of each vector.
    """

    targets: tuple[tuple[str, tuple[int, ...]], ...] = eqx.field(static=True)
    vectors: tuple[tuple[str, int, int], ...] = eqx.field(static=True)
    of_run: Array
    logarithmic: Array
    centre: Array
    spread: Array
    origin: Array
    sign: Array
    ceiling: Array
    bend: Array
    above: Array
    below: Array
    mixes: tuple[Array, ...]

    def numbers(self, x: Array | np.ndarray) -> Any:
        """Return the numbers at the coordinates x, both of shape (..., unknowns); on the host if x is."""
        xp: Any = np if isinstance(x, np.ndarray) else jnp
        fields = ("above", "below", "centre", "spread", "ceiling", "bend", "origin", "sign", "logarithmic")
        above, below, centre, spread, ceiling, bend, origin, sign, logarithmic = (
            xp.asarray(getattr(self, name)) for name in fields
        )
        with np.errstate(all="ignore"):  # of what is not chosen
            half = 0.5 * xp.where(x > 0.0, above, below)
            bends = xp.abs(x) > half
            half = xp.where(bends, half, 1.0)  # no infinity in what is not chosen: its derivative would be no number
            off = xp.where(bends, xp.sign(x) * half * (1.0 + xp.tanh(xp.abs(x) / half - 1.0)), x)
            straight = centre + spread * off
            bent = ceiling - bend * xp.logaddexp(0.0, (ceiling - straight) / bend)
            straight = xp.where(xp.isfinite(ceiling), bent, straight)
            curved = origin + sign * xp.exp(xp.where(logarithmic, straight, 0.0))
            return xp.where(logarithmic, curved, straight)

    def mixed(self, numbers: Any) -> list[Any]:
        """Return the values of each vector from the numbers (..., unknowns); on the host if these are."""
        xp: Any = np if isinstance(numbers, np.ndarray) else jnp
        parts = zip(self.vectors, self.mixes, strict=True)
        return [numbers[..., first:last] @ xp.asarray(mix).T for (_, first, last), mix in parts]


@dataclasses.dataclass(frozen=True, eq=False)
class OneRun:
    """A run of a problem, without padding.

    Attributes:
        number: of the run in the problem.
        sizes: steps and rows.
        shared: its part of the problem; what is the same for all lanes.
    """

    number: int
    sizes: tuple[int, int]
    shared: Any


class Problem(eqx.Module):
    """Predictions of all runs for any setting of the unknowns; a pytree, so that cases of equal shape share programs.

    Attributes:
        models: of each run, with all candidates.
        tracks: steps and inputs of each run.
        times: (runs, rows) times of the readings.
        unknowns: of all candidates and the base model.
        switched: effects with a switch.
        channels: all outputs of the kind, measured or not.
        shapes: number of runs that are simulated together, with rows and steps.
    """

    models: Model
    tracks: Track
    times: Array
    unknowns: Unknowns
    switched: tuple[str, ...] = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    shapes: tuple[tuple[int, int, int], ...] = eqx.field(static=True)

    def model_at(self, model: Model, own: Array, found: Any, mixed: Sequence[Any], switches: Any, laws: Any) -> Model:
        """Return a run's model at numbers and vectors; `own` (unknowns,) is True for unknowns that apply to the run."""
        values: dict[str, Any] = {}
        for name, places in self.unknowns.targets:
            value = _get(model, name)
            for place in places:
                value = jnp.where(own[place], found[place], value)
            values[name] = value
        for (name, *_), vector in zip(self.unknowns.vectors, mixed, strict=True):
            values[name] = vector.reshape(_get(model, name).shape)
            # At its null a curve or law is not computed: with a table for each relation, they are most of a step.
            values[f"{name.rpartition('.')[0]}.switch"] = jnp.any(vector != 0.0).astype(float)
        for place, label in enumerate(self.switched):
            values[f"{label}.switch"] = switches[place]
        if any(effect.label == "law" for effect in model.effects):
            values["law.settings"] = laws
        return _with(model, values)

    def model_of(self, run: int, lane: Lane) -> Model:
        """Return the model of one run at a lane."""
        of_run = jax.tree.map(lambda leaf: np.asarray(leaf)[run], (self.models, self.unknowns.of_run))
        model, own = of_run
        numbers = self.unknowns.numbers(np.asarray(lane.x))
        given = (model, own, numbers, self.unknowns.mixed(numbers), lane.switches, lane.laws)
        return _model_at(self, *jax.device_put(given))

    def predictions(self, lanes: Lane) -> Array:
        """Return the predicted readings of many lanes, shape (lanes, runs, rows, channels).

        Lanes and runs form one axis, the innermost of all arithmetic, to fill the vector registers; a second axis would
        take twice as long to trace and compile.
        """

        def of_one(run: tuple[Model, Array, Track, Array], lane: Lane) -> Array:
            model, own, steps, time_s = run
            numbers = self.unknowns.numbers(lane.x)
            at = self.model_at(model, own, numbers, self.unknowns.mixed(numbers), lane.switches, lane.laws)
            readings = read_track(at, steps, time_s, needed)
            return jnp.stack([readings[name] for name in self.channels], axis=-1)

        runs, count, needed = self.times.shape[0], lanes.x.shape[0], self._needed(lanes)
        of_runs = (self.models, self.unknowns.of_run, self.tracks, self.times)
        of_each_run = jax.tree.map(lambda x: jnp.repeat(x, count, axis=0), of_runs)
        of_each_lane = Lane(
            jnp.tile(lanes.x, (runs, 1)),
            jnp.tile(lanes.switches, (runs, 1)),
            jnp.tile(lanes.laws, (runs, 1, 1)),
        )
        found = jax.vmap(of_one)(of_each_run, of_each_lane)
        return jnp.swapaxes(found.reshape(runs, count, *found.shape[1:]), 0, 1)

    def _needed(self, lanes: Lane) -> Needed:
        on = [
            lanes.switches[:, self.switched.index(effect.label)] if effect.label in self.switched else effect.switch
            for effect in self.models.effects
            if effect.has_state
        ]
        dynamic = [jnp.asarray(True) if one is None else jnp.any(jnp.asarray(one) != 0.0) for one in on]
        return Needed(jnp.max(self.tracks.last_step) + 1, jnp.asarray(dynamic, dtype=bool))

    def without(self, absent: Collection[str]) -> Problem:
        """Return the problem without some effects, all others always on: a program that takes a fraction of the time.

        Unknowns keep their places, and those of absent effects move nothing.

        Args:
            absent: labels of effects.
        """
        present = tuple(
            eqx.tree_at(lambda e: e.switch, effect, None, is_leaf=lambda x: x is None)
            for effect in self.models.effects
            if effect.label not in absent
        )
        unknowns = self.unknowns

        def is_there(name: str) -> bool:
            return name.rpartition(".")[0] not in absent

        vectors = [(one, mix) for one, mix in zip(unknowns.vectors, unknowns.mixes, strict=True) if is_there(one[0])]
        return dataclasses.replace(
            self,
            models=eqx.tree_at(lambda m: m.effects, self.models, present),
            unknowns=dataclasses.replace(
                unknowns,
                targets=tuple(one for one in unknowns.targets if is_there(one[0])),
                vectors=tuple(one for one, _ in vectors),
                mixes=tuple(mix for _, mix in vectors),
            ),
            switched=(),
        )

    def of(self, runs: np.ndarray) -> Problem:
        """Return the problem of some runs; unknowns keep their indices, and those of other runs have no effect."""
        rows, steps = np.max([self._length(runs), *(shape[1:] for shape in self.shapes)], axis=0).tolist()
        return self._of_runs(runs, rows, steps)

    @functools.cached_property
    def blocks(self) -> list[tuple[np.ndarray, Problem]]:
        """Return the problems of blocks of runs, and the indices of these runs.

        Blocks of equal shape share a compiled program.
        """
        if ((*self.times.shape, self.tracks.duration_s.shape[1]),) == self.shapes:
            # A copy, because the cached property would change the identity of the program.
            return [(np.arange(self.times.shape[0]), dataclasses.replace(self))]
        everything = self._length(slice(None))
        shapes = [*self.shapes, (self.shapes[-1][0], *everything)]
        lengths = [self._length(run) for run in range(self.times.shape[0])]
        fits = [next(n for n, (_, *size) in enumerate(shapes) if np.all(np.less_equal(own, size))) for own in lengths]
        blocks = []
        for number, (count, *size) in enumerate(shapes):
            runs = np.flatnonzero(np.equal(fits, number))
            for first in range(0, runs.size, count):
                some = runs[first : first + count]
                blocks.append((some, self._of_runs(np.pad(some, (0, count - some.size), mode="edge"), *size)))
        return blocks

    @functools.cached_property
    def by_run(self) -> list[OneRun]:
        """Return the runs, each with its own length, as arrays on the host."""
        models, tracks = jax.tree.map(np.asarray, (self.models, self.tracks))
        of_run = np.asarray(self.unknowns.of_run)
        found = []
        for number, last_step in enumerate(tracks.last_step):
            rows, steps = int(np.argmax(last_step == last_step[-1])) + 2, int(last_step[-1]) + 1
            inputs = {name: values[number, : steps + 1] for name, values in tracks.inputs.items()}
            parts = (tracks.duration_s[number, :steps], inputs, last_step[: rows - 1])
            track = eqx.tree_at(lambda t: (t.duration_s, t.inputs, t.last_step), tracks, parts)
            model = jax.tree.map(lambda leaf, n=number: leaf[n], models)
            found.append(OneRun(number, (steps, rows), (model, track, of_run[number])))
        return found

    @functools.cached_property
    def unknowns_on_host(self) -> Unknowns:
        """Return its unknowns with arrays on the host."""
        return jax.tree.map(np.asarray, self.unknowns)

    @functools.cached_property
    def ready(self) -> dict[tuple[bool, ...], Any]:
        """What calls of its kernel with and without dynamic sensors need; see `fit.kernels`."""
        return {}

    def _length(self, runs: np.ndarray | slice | int) -> tuple[int, int]:
        """Return the rows and steps of the longest of some runs, rounded up."""
        return rounded_length(np.atleast_2d(np.asarray(self.tracks.last_step)[runs]))

    def _of_runs(self, runs: np.ndarray, rows: int, steps: int) -> Problem:
        """Return the problem of some runs, cut to so many rows and steps."""
        tracks = Track(
            duration_s=_part(self.tracks.duration_s, runs, steps),
            inputs={name: _part(values, runs, steps + 1) for name, values in self.tracks.inputs.items()},
            last_step=_part(self.tracks.last_step, runs, rows - 1),
        )
        return dataclasses.replace(
            self,
            models=jax.tree.map(lambda leaf: _part(leaf, runs), self.models),
            tracks=tracks,
            times=_part(self.times, runs, rows),
            unknowns=dataclasses.replace(self.unknowns, of_run=_part(self.unknowns.of_run, runs)),
        )


_model_at = eqx.filter_jit(Problem.model_at)


def _part(values: Array, runs: np.ndarray, size: int | None = None) -> Array:
    """Return some runs and the first columns; on the host, where a new shape compiles no program."""
    kept = np.asarray(values)[runs]
    return jax.device_put(kept if size is None else kept[:, :size])


def _owner(model: Model, name: str) -> tuple[int | None, str]:
    label, _, field = name.rpartition(".")
    return ([effect.label for effect in model.effects].index(label) if label else None), field


def _get(model: Model, name: str) -> Any:
    place, field = _owner(model, name)
    return getattr(model.parameters if place is None else model.effects[place], field)


def _with(model: Model, values: Mapping[str, Any]) -> Model:
    """Return the model with parameters and vectors replaced by name."""
    owners = [(*_owner(model, name), value) for name, value in values.items()]

    def leaves(m: Model) -> list[Any]:
        return [getattr(m.parameters if place is None else m.effects[place], field) for place, field, _ in owners]

    return eqx.tree_at(leaves, model, [value for _, _, value in owners], is_leaf=lambda x: x is None)


def make_problem(
    case: Case,
    layout: Layout,
    candidates: Sequence[Candidate],
    fine_for: Sequence[Effect] = (),
) -> Problem:
    """Prepare a case for fitting with every candidate, at its null or behind a switch.

    Args:
        case: with its runs.
        layout: of the unknowns.
        candidates: of the case.
        fine_for: effects that determine the step size too.
    """
    bare = [case_model(case, run) for run in case.runs]
    tracks, times = _tracks([with_effects(model, fine_for) for model in bare], case)
    effects, switched, stated = [], [], stated_differences(case)
    for candidate in candidates:
        if candidate.effect.label in [*stated, *(effect.label for effect in effects)]:
            continue
        effect = candidate.effect
        if candidate.is_switched:
            effect = eqx.tree_at(lambda e: e.switch, effect, jnp.zeros(()), is_leaf=lambda x: x is None)
            switched.append(effect.label)
        effects.append(effect)
    labels = {effect.label for effect in effects}
    vectors = [one for one in layout.vectors if one[0].rpartition(".")[0] in labels]
    fit_runs = np.flatnonzero([run.split == "fit" for run in case.runs])
    parts = {
        field: jax.device_put(np.array([getattr(coordinate, field) for coordinate in layout.coordinates]))
        for field in ("logarithmic", "centre", "spread", "origin", "sign", "ceiling", "bend", "above", "below")
    }
    return Problem(
        models=_stacked([with_effects(model, effects) for model in bare]),
        tracks=tracks,
        times=times,
        unknowns=Unknowns(
            layout.targets,
            tuple((name, first, last) for name, first, last, _ in vectors),
            of_run=layout.of_runs(len(case.runs)),
            mixes=tuple(jax.device_put(mix) for *_, mix in vectors),
            **parts,
        ),
        switched=tuple(switched),
        channels=case.vocabulary.outputs,
        shapes=shapes_of([rounded_length(last_step[None]) for last_step in np.asarray(tracks.last_step)], fit_runs),
    )


def with_effects(model: Model, added: Sequence[Effect]) -> Model:
    """Return a model with more effects."""
    return eqx.tree_at(lambda m: m.effects, model, (*model.effects, *added))


def _tracks(models: list[Model], case: Case) -> tuple[Track, Array]:
    """Return the steps of all runs, padded to equal number with steps of zero length."""
    profiles = [run_profile(run) for run in case.runs]
    unpadded = [track(model, profile) for model, profile in zip(models, profiles, strict=True)]
    steps = rounded_steps(max(one.duration_s.shape[0] for one in unpadded))
    rows = rounded_rows(max(profile.time_s.size for profile in profiles))
    tracks, times = [], []
    for model, profile in zip(models, profiles, strict=True):
        padded = track(model, profile, steps)
        last = np.asarray(padded.last_step)
        tracks.append(
            dataclasses.replace(padded, last_step=jax.device_put(np.pad(last, (0, rows - 1 - last.size), mode="edge")))
        )
        times.append(np.pad(profile.time_s, (0, rows - profile.time_s.size), mode="edge"))
    return _stacked(tracks), jax.device_put(np.stack(times))


def _stacked(of_runs: Sequence[_OfRun]) -> _OfRun:
    """Stack the arrays of all runs; on the host, where a new shape compiles no program."""
    return jax.device_put(jax.tree.map(lambda *leaves: np.stack(leaves), *of_runs))
