"""A case as a least-squares problem: unknowns in, whitened residuals out, over all its runs at once.

The model holds every candidate effect behind a switch. Lanes of one compiled program differ only in their switches and in which
unknowns are free, so that the base model, every candidate and every pair are fitted by the same program.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from discrepancy.candidates import Candidate, Coordinate, known_coordinate
from discrepancy.noise import NoiseModel
from discrepancy.whitening import chain_starts, chain_weights
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Case
from jaxmodel.errors import FitError
from jaxmodel.model import Model
from jaxmodel.names import with_values
from jaxmodel.parameters import info
from jaxmodel.simulate import Track, run_track, track

# Shapes are rounded up to these, so that cases of like size share a compiled program.
_ROWS, _STEPS = 512, 1024


class Readings(eqx.Module):
    """Every reading of a case in one flat list, with what whitening needs.

    Attributes:
        index: (n,) place in the flattened (runs, rows, channels) predictions.
        value: (n,) what was read.
        sd: (n,) noise of one reading, in its unit.
        previous: (n,) number of the reading before it in its chain.
        weight: (n,) correlation of its noise with that of the reading before.
        fit: (n,) 1 where the run may be used to calibrate, 0 where it may only judge.
    """

    index: Array
    value: Array
    sd: Array
    previous: Array
    weight: Array
    fit: Array

    def whiten(self, errors: Array) -> Array:
        """Return errors (n,) as white noise of unit variance."""
        scaled = errors / self.sd
        return (scaled - self.weight * scaled[self.previous]) / jnp.sqrt(1.0 - self.weight**2)


class Lane(eqx.Module):
    """One member of a batch of fits or derivatives: where all unknowns stand and which effects are on."""

    x: Array
    switches: Array


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where everything stands in the vector of unknowns.

    Attributes:
        coordinates: one for each unknown.
        run: for each unknown the run it belongs to, or -1 for all runs.
        base: numbers of the base model's unknowns, per-run ones included.
        of_candidate: numbers of each candidate's unknowns, by label.
    """

    coordinates: tuple[Coordinate, ...]
    run: tuple[int, ...]
    base: tuple[int, ...]
    of_candidate: dict[str, tuple[int, ...]]

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return len(self.coordinates)


def make_layout(case: Case, candidates: list[Candidate]) -> Layout:
    """Lay out the unknowns: declared parameters, initial states of charge by run, then the candidates' parameters.

    Raises:
        FitError: the case declares no uncertain parameter and no uncertain initial state.
    """
    coordinates, run = [], []
    for name, known in case.parameters.items():
        if known.sd is not None:
            coordinates.append(known_coordinate(name, known.value, known.sd, info(name)))
            run.append(-1)
    for number, entry in enumerate(case.runs):
        own = {**entry.overrides, **({"initial_soc": entry.initial_soc} if case.kind != "motor" else {})}
        for name, known in own.items():
            if known.sd is not None:
                coordinates.append(known_coordinate(name, known.value, known.sd, info(name)))
                run.append(number)
    if not coordinates:
        raise FitError(
            f"{case.path}: nothing to calibrate; give at least one parameter an uncertainty, "
            f"as in capacity_Ah = {{ value = 5.2, sd = 0.15 }}."
        )
    base = tuple(range(len(coordinates)))
    of_candidate = {}
    for candidate in candidates:
        first = len(coordinates)
        coordinates.extend(candidate.coordinates)
        run.extend([-1] * len(candidate.coordinates))
        of_candidate[candidate.label] = tuple(range(first, len(coordinates)))
    return Layout(tuple(coordinates), tuple(run), base, of_candidate)


class Problem(eqx.Module):
    """The compiled heart of a diagnosis: predictions of all runs for any setting of the unknowns and switches."""

    models: Model
    courses: Track
    times: Array
    readings: Readings
    layout: Layout = eqx.field(static=True)
    labels: tuple[str, ...] = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    run_names: tuple[str, ...] = eqx.field(static=True)

    def predict(self, lane: Lane) -> Array:
        """Return the predicted readings, shape (runs, rows, channels), rows past a run's end repeating its last."""
        runs = self.times.shape[0]
        numbers: dict[str, Array] = {}
        for place, coordinate in enumerate(self.layout.coordinates):
            number, run = coordinate.number(lane.x[place]), self.layout.run[place]
            if run < 0:
                numbers[coordinate.name] = jnp.broadcast_to(number, (runs,))
        for place, coordinate in enumerate(self.layout.coordinates):
            run = self.layout.run[place]
            if run >= 0:
                known = numbers.get(coordinate.name, getattr(self.models.parameters, coordinate.name))
                numbers[coordinate.name] = known.at[run].set(coordinate.number(lane.x[place]))
        for place, label in enumerate(self.labels):
            numbers[f"{label}.switch"] = jnp.broadcast_to(lane.switches[place], (runs,))
        models = with_values(self.models, numbers)
        trajectories = jax.vmap(run_track)(models, self.courses, self.times)
        return jnp.stack([trajectories.readings[name] for name in self.channels], axis=-1)

    def residual(self, lane: Lane) -> Array:
        """Return the whitened residuals of all readings, measured less predicted, shape (n,)."""
        return self.readings.whiten(self.readings.value - self.predict(lane).reshape(-1)[self.readings.index])

    def start(self) -> Lane:
        """Return the lane of the base model at its nominal parameters."""
        return Lane(jnp.zeros(self.layout.size), jnp.zeros(len(self.labels)))


def make_problem(
    case: Case,
    candidates: list[Candidate],
    noise: dict[str, NoiseModel],
    layout: Layout | None = None,
    catalogue=None,
) -> Problem:
    """Lay a case out for fitting.

    Args:
        case: with at least one run marked `fit`.
        candidates: the effects to hold behind switches.
        noise: of each output column; columns without one are left out.
        layout: of the unknowns, if made already.
        catalogue: the known effects, where the case's own may come from elsewhere.

    Raises:
        FitError: no run may be used to calibrate, or no reading is there.
    """
    layout = layout or make_layout(case, candidates)
    switched = tuple(
        eqx.tree_at(lambda e: e.switch, candidate.effect, jnp.zeros(()), is_leaf=lambda x: x is None)
        for candidate in candidates
    )
    extra = {} if catalogue is None else {"catalogue": catalogue}
    models = []
    for run in case.runs:
        model = case_model(case, run, **extra)
        models.append(eqx.tree_at(lambda m: m.effects, model, (*model.effects, *switched)))
    courses, times = _courses(models, case)
    channels = tuple(noise)
    readings = _readings(case, channels, noise, times.shape[1])
    if not np.any(readings.fit):
        raise FitError(f"{case.path}: no reading of a run with split = \"fit\"; mark at least one such run.")
    return Problem(
        models=jax.tree.map(lambda *leaves: jnp.stack(leaves), *models),
        courses=courses,
        times=times,
        readings=readings,
        layout=layout,
        labels=tuple(candidate.label for candidate in candidates),
        channels=channels,
        run_names=tuple(run.name for run in case.runs),
    )


def _courses(models: list[Model], case: Case) -> tuple[Track, Array]:
    """Lay the runs out in steps of equal number, ends padded with steps of zero length."""
    profiles = [run_profile(run) for run in case.runs]
    steps = [track(model, profile).duration_s.shape[0] for model, profile in zip(models, profiles, strict=True)]
    steps_padded = _round_up(max(steps), _STEPS)
    rows_padded = _round_up(max(profile.time_s.size for profile in profiles), _ROWS)
    courses, times = [], []
    for model, profile in zip(models, profiles, strict=True):
        course = track(model, profile, steps_padded)
        last = course.last_step
        filled = jnp.concatenate([last, jnp.full(rows_padded - 1 - last.shape[0], last[-1])])
        courses.append(eqx.tree_at(lambda c: c.last_step, course, filled))
        times.append(np.pad(profile.time_s, (0, rows_padded - profile.time_s.size), mode="edge"))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *courses), jnp.asarray(np.stack(times))


def _round_up(count: int, multiple: int) -> int:
    return -(-count // multiple) * multiple


def _readings(case: Case, channels: tuple[str, ...], noise: dict[str, NoiseModel], rows: int) -> Readings:
    """Flatten the readings channel by channel, so that the reading before one in its chain is the one before it here."""
    parts = []
    first = 0
    for channel, name in enumerate(channels):
        for number, run in enumerate(case.runs):
            values = run.measured.outputs.get(name)
            if values is None:
                continue
            clock = _elapsed(run.measured.time_s) if noise[name].rho > 0.0 else None
            present, weight = chain_weights(
                chain_starts([values.size]), noise[name].rho, np.isfinite(values), clock
            )
            count = present.size
            place = (number * rows + present) * len(channels) + channel
            previous = np.maximum(np.arange(count) - 1, 0) + first
            fit = np.full(count, float(run.split == "fit"))
            parts.append((place, values[present], np.full(count, noise[name].sd), previous, weight, fit))
            first += count
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)] if parts else [np.zeros(0)] * 6
    return Readings(*(jnp.asarray(column) for column in columns))


def _elapsed(time_s: np.ndarray) -> np.ndarray:
    """Return time in units of the usual step, the clock of coloured noise."""
    return (time_s - time_s[0]) / np.median(np.diff(time_s))
