"""What the readings of a made case show of its truth, by a least-squares fit of its own.

For the notes in `answer.toml` and for the tests of made data; the diagnosis does not come here. The engine's simulator
predicts, SciPy fits: the numbers that the case states with an sd, each run's start, and the parameters of any effects.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case, Run
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Track
from jaxmodel.model.simulation import run_track, track

# Of a number's sd, or of a tenth of an effect's parameter: the step of the differences that stand for derivatives.
STEP = 1e-3
MOST_STEPS = 25
# So many sd a stated number may move to stand in for what is missing.
FARTHEST_SD = 6.0
NOT_FITTED = ("resampled",)


@dataclasses.dataclass(frozen=True)
class Unknown:
    """A number that is fitted.

    Attributes:
        name: of a parameter, or `initial_soc`, or of an effect's parameter.
        effect: the place of the effect in the case, None of the model's own numbers.
        run: the one run that has this number, None of all.
        start: where the fit begins, and what is stated of a number with an sd.
        unit: in which it moves: its sd, or a tenth of an effect's parameter.
        stated: whether the case states it, so that its distance counts.
    """

    name: str
    effect: int | None
    run: str | None
    start: float
    unit: float
    stated: bool

    @property
    def label(self) -> tuple[str, str | None]:
        """What tells it from the others, whatever the order of effects."""
        return self.name, self.run


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A model at its best.

    Attributes:
        chi2: of the fit readings and of what is stated, in units of the noise.
        rms: of what is left, by channel and split.
        values: of the unknowns; those of one run are named `run-01.initial_soc`.
    """

    chi2: float
    rms: dict[str, dict[str, float]]
    values: dict[str, float]


def unknowns(case: Case, effects_too: bool = True) -> list[Unknown]:
    """Return what of a case is fitted: uncertain numbers, starts, and the numbers of its effects."""
    found = [
        Unknown(name, None, None, known.value, known.sd, True)
        for name, known in case.parameters.items()
        if known.sd is not None
    ]
    for run in case.runs:
        if case.kind != "motor" and run.initial_soc.sd is not None:
            found.append(Unknown("initial_soc", None, run.name, run.initial_soc.value, run.initial_soc.sd, True))
    for place, (label, numbers) in enumerate(case.effects.items() if effects_too else ()):
        for name, value in numbers.items():
            if isinstance(value, float | int) and value != 0.0 and name not in NOT_FITTED:
                found.append(Unknown(f"{label}.{name}", place, None, float(value), 0.1 * float(value), False))
    return found


Place = tuple[int | None, str]


def _leaf(model: Model, place: Place) -> Any:
    owner = model.parameters if place[0] is None else model.effects[place[0]]
    return getattr(owner, place[1])


@functools.partial(jax.jit, static_argnames=("places", "channels"))
def _readings_of(
    model: Model, course: Track, times: jax.Array, sets: jax.Array, places: tuple[Place, ...], channels: tuple[str, ...]
) -> jax.Array:
    """Return readings, (sets, channels, rows), with the numbers at some places of a model set to each of (sets, p)."""

    def of_one(numbers: jax.Array) -> jax.Array:
        changed = model
        for number, place in zip(numbers, places, strict=True):
            changed = eqx.tree_at(functools.partial(_leaf, place=place), changed, number)
        found = run_track(changed, course, times).readings
        return jnp.stack([found[name] for name in channels])

    return jax.vmap(of_one)(sets)


class _Predictor:
    """A case's runs, all laid out in as many steps, so that one program serves them; it takes the unknowns."""

    def __init__(self, case: Case, free: Sequence[Unknown]):
        self.free = free
        self.places = tuple(dict.fromkeys((one.effect, one.name.rpartition(".")[2]) for one in free))
        self.models = {run.name: case_model(case, run) for run in case.runs}
        profiles = {run.name: run_profile(run) for run in case.runs}
        courses = {name: track(self.models[name], profile) for name, profile in profiles.items()}
        most = max(course.duration_s.size for course in courses.values())
        self.courses = {name: track(self.models[name], profile, most) for name, profile in profiles.items()}
        self.times = {name: jnp.asarray(profile.time_s) for name, profile in profiles.items()}

    def __call__(self, run: Run, sets: np.ndarray) -> np.ndarray:
        """Return a run's readings, (sets, channels, rows), for many sets of the unknowns, (sets, p)."""
        model = self.models[run.name]
        columns = []
        for place in self.places:
            mine = [
                column
                for column, one in enumerate(self.free)
                if (one.effect, one.name.rpartition(".")[2]) == place
                and one.run in (None, run.name)
                and one.name not in run.overrides
            ]
            columns.append(sets[:, mine[0]] if mine else np.full(len(sets), float(_leaf(model, place))))
        given = jnp.asarray(np.stack(columns, axis=1) if columns else np.zeros((len(sets), 0)))
        where = self.courses[run.name], self.times[run.name]
        return np.asarray(_readings_of(model, *where, given, self.places, tuple(channels_of(run))))


class _Readings:
    """A case, its model and its readings: what is left of them, and how that changes with the unknowns."""

    def __init__(self, case: Case, sd: Mapping[str, float], effects_too: bool = True):
        self.case, self.sd, self.free = case, sd, unknowns(case, effects_too)
        self.start = np.array([one.start for one in self.free])
        self.unit = np.array([one.unit for one in self.free])
        self.stated = np.array([one.stated for one in self.free], dtype=bool)
        self.fitted = [run for run in case.runs if run.split == "fit"]
        self.predict = _Predictor(case, self.free)

    def left(self, moves: np.ndarray, runs: Sequence[Run]) -> list[np.ndarray]:
        """Return what is left of some runs, (sets, channels, rows) each, NaN where nothing was read."""
        sets = self.start + self.unit * np.atleast_2d(moves)
        return [_measured(run) - self.predict(run, sets) for run in runs]

    def whitened(self, moves: np.ndarray) -> np.ndarray:
        """Return (sets, readings and priors) in units of their sd."""
        rows = []
        for run, each in zip(self.fitted, self.left(moves, self.fitted), strict=True):
            scale = np.array([1.0 / self.sd[name] if name in self.sd else 0.0 for name in channels_of(run)])
            rows.append(np.nan_to_num(each * scale[:, None]).reshape(len(each), -1))
        return np.concatenate([*rows, np.atleast_2d(moves)[:, self.stated]], axis=1)

    def slopes(self, moves: np.ndarray) -> np.ndarray:
        """Return d whitened / d moves, (readings and priors, p)."""
        count, step = len(moves), STEP * np.eye(len(moves))
        found = self.whitened(np.concatenate([moves + step, moves - step]))
        return (found[:count] - found[count:]).T / (2.0 * STEP)


def fit(case: Case, sd: Mapping[str, float], effects_too: bool = True) -> Fitted:
    """Fit the model of a case, with the effects and tables it has, to its fit runs.

    Args:
        case: as it is to be modelled; an effect under `[effects]` starts at the numbers given.
        sd: of what the model leaves in each channel if it is right; others do not count.
        effects_too: whether the numbers of effects are fitted.
    """
    readings = _Readings(case, sd, effects_too)
    best = least_squares(
        lambda moves: readings.whitened(moves)[0],
        np.zeros(len(readings.free)),
        jac=readings.slopes,  # type: ignore[arg-type]
        bounds=(
            np.where(readings.stated, -FARTHEST_SD, -9.0),  # an effect's parameter may fall to a tenth
            np.where(readings.stated, FARTHEST_SD, 1e3),
        ),
        x_scale="jac",
        max_nfev=MOST_STEPS,
    )
    names = [one.name if one.run is None else f"{one.run}.{one.name}" for one in readings.free]
    left = [each[0] for each in readings.left(best.x, case.runs)]
    return Fitted(
        chi2=2.0 * float(best.cost),
        rms=rms_of(case, left),
        values=dict(zip(names, (readings.start + readings.unit * best.x).tolist(), strict=True)),
    )


def stands_out(true: Case, sd: Mapping[str, float], lacking: Mapping[str, Case]) -> dict[str, float]:
    """Return by how many sigma each hidden thing stands out of what all else, refitted, makes of the readings.

    In the linear model about the truth: what is faint is told exactly, what is strong roughly.

    Args:
        true: the case with all that is hidden in its model, each number at its truth.
        sd: of what this model leaves in each channel.
        lacking: by name, the case with one hidden thing left out of its model.
    """
    whole = _Readings(true, sd)
    origin = np.zeros(len(whole.free))
    slopes, here = whole.slopes(origin), whole.whitened(origin)[0]
    found = {}
    for name, case in lacking.items():
        labels = {one.label for one in unknowns(case)}
        rest = slopes[:, [one.label in labels for one in whole.free]]
        other = _Readings(case, sd, effects_too=False)
        # Priors apart: those of the two models are in another order.
        moved = other.whitened(np.zeros(len(other.free)))[0][: -int(other.stated.sum()) or None]
        change = np.append(moved - here[: moved.size], np.zeros(here.size - moved.size))
        coefficients = np.linalg.lstsq(rest, change, rcond=None)[0]
        found[name] = float(np.linalg.norm(change - rest @ coefficients))
    return found


def channels_of(run: Run) -> list[str]:
    """Return what was measured of a run, in the order of all arrays here."""
    return sorted(run.measured.outputs)


def _measured(run: Run) -> np.ndarray:
    return np.stack([run.measured.outputs[name] for name in channels_of(run)])


def rms_of(case: Case, left: Sequence[np.ndarray]) -> dict[str, dict[str, float]]:
    """Return the root of the mean square by channel and split, of (channels, rows) for each run."""
    found: dict[str, dict[str, list[np.ndarray]]] = {}
    for run, each in zip(case.runs, left, strict=True):
        for name, values in zip(channels_of(run), each, strict=True):
            found.setdefault(name, {}).setdefault(run.split, []).append(values[np.isfinite(values)])
    return {
        name: {split: float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for split, parts in splits.items()}
        for name, splits in found.items()
    }


def residuals(case: Case) -> list[np.ndarray]:
    """Return readings less the model, (channels, rows) of each run, with every number as the case has it."""
    predict = _Predictor(case, [])
    return [_measured(run) - predict(run, np.zeros((1, 0)))[0] for run in case.runs]


def with_truth(
    case: Case,
    parameters: Mapping[str, float],
    initial_soc: list[float] | None,
    effects: Mapping[str, Mapping[str, Any]],
    tables: Mapping[str, Any] | None = None,
    overrides: Mapping[str, Mapping[str, float]] | None = None,
) -> Case:
    """Return a case as it truly is, what was uncertain still uncertain about the truth.

    Args:
        case: as it is stated.
        parameters: what its numbers are.
        initial_soc: of each run.
        effects: all that are hidden.
        tables: in place of those stated, by name.
        overrides: by run, numbers of its own.
    """
    known = {
        name: Known(float(parameters.get(name, stated.value)), stated.sd) for name, stated in case.parameters.items()
    }
    runs = []
    for place, run in enumerate(case.runs):
        start = run.initial_soc if initial_soc is None else Known(float(initial_soc[place]), run.initial_soc.sd)
        own = {name: Known(float(value)) for name, value in (overrides or {}).get(run.name, {}).items()}
        runs.append(dataclasses.replace(run, initial_soc=start, overrides={**run.overrides, **own}))
    return dataclasses.replace(
        case,
        parameters=known,
        tables={**case.tables, **(tables or {})},
        effects={name: dict(numbers) for name, numbers in effects.items()},
        runs=tuple(runs),
    )


def without(case: Case, *names: str) -> Case:
    """Return a case with some of its effects left out."""
    return dataclasses.replace(case, effects={n: numbers for n, numbers in case.effects.items() if n not in names})
