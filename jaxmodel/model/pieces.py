"""A run of any length in pieces of equal size: one compiled program for all, and memory for the readings alone.

The state after a piece is that before the next, so that the readings are those of `jaxmodel.model.simulation.simulate`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.model.electrothermal import Model, Readings, initial_state, read, step, valid
from jaxmodel.model.flow import State
from jaxmodel.model.possible import possible
from jaxmodel.model.profile import Profile
from jaxmodel.model.robot import Inputs
from jaxmodel.model.scan import ROUND, states_after
from jaxmodel.model.sensors import Signal, faulty, sensors_of, within_steps
from jaxmodel.model.simulation import Cutoff, Status, below, grid_of

# Steps of a piece, of a run of more rows and of a shorter one: whole rounds, so that only the last has padding.
STEPS, FEW = 512 * ROUND, 64 * ROUND

_faulty = eqx.filter_jit(faulty)


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """The readings of a run over the rows of its profile, on the host.

    Attributes:
        readings: by column name, (rows,); NaN after the end.
        valid: (rows,) False where the equations are outside their valid range.
        status: how the run ended.
        end_row: the row at which the cut-off was reached; else the last.
    """

    readings: dict[str, np.ndarray]
    valid: np.ndarray
    status: Status
    end_row: int


class _Steps(NamedTuple):
    """Steps of a run, (steps,) each: duration in s, row whose inputs hold, and whether the step ends that row."""

    duration_s: np.ndarray
    row: np.ndarray
    ends: np.ndarray


class _Seen(NamedTuple):
    """What a piece shows at its start and after every step, (1 + steps,) each, on the host or the device.

    `starts` has the readings at the start of every step under its own inputs, (steps,), of delayed columns.
    """

    readings: Readings
    starts: Readings
    valid: Array
    finite: Array


def run_in_pieces(
    model: Model, profile: Profile, cutoff: Cutoff | None = None, steps_of: Model | None = None
) -> Course:
    """Run a model over a profile of any length.

    Args:
        model: any kind; its leaves are scalars.
        profile: inputs over time, names as in case files.
        cutoff: where the run ends, if before the end of the profile.
        steps_of: the model that determines the steps; the model itself if None.

    Returns:
        The readings at the rows of the profile, with a status; a failure in the run raises no error.
    """
    rows, row_before = profile.time_s.size, 0
    size = STEPS if rows > STEPS else FEW
    state = _begin(model, jax.device_put({name: values[0] for name, values in profile.inputs.items()}))
    delayed = tuple(dict.fromkeys(effect.column for effect in sensors_of(model) if effect.has_state))
    readings: dict[str, np.ndarray] = {}
    is_valid, is_finite, end, ended = np.ones(rows, dtype=bool), True, rows - 1, False
    is_possible = np.ones(rows, dtype=bool)
    within: list[tuple[_Steps, _Seen]] = []
    for steps, count in _pieces(steps_of or model, profile, size):
        held = np.append(row_before, steps.row)
        inputs = {name: values[held] for name, values in profile.inputs.items()}
        held_inputs, duration_s, number = jax.device_put((inputs, steps.duration_s, np.asarray(count)))
        state, seen = _piece(model, state, held_inputs, duration_s, number, delayed)
        seen = jax.tree.map(np.asarray, seen)
        at = np.flatnonzero(np.append(not row_before, steps.ends))
        for name, values in seen.readings.items():
            readings.setdefault(name, np.full(rows, np.nan))[held[at]] = values[at]
        is_valid[held[at]] = seen.valid[at]
        is_finite &= bool(np.all(seen.finite[at]))
        is_possible[held[at]] = possible({name: values[at] for name, values in seen.readings.items()})
        row_before = int(steps.row[-1])
        if delayed:
            within.append((steps, seen))
        if cutoff is not None:
            is_below = np.asarray(_below(model, jax.device_put(seen.readings), cutoff))[at] & (held[at] > 0)
            if np.any(is_below):
                end, ended = int(held[at[np.argmax(is_below)]]), True
                break
    for name in readings:
        if any(effect.column in ("", name) for effect in sensors_of(model)):
            readings[name] = _read_by_sensors(model, name, readings[name], within)
        readings[name][end + 1 :] = np.nan
    is_valid[end + 1 :] = True
    status = Status.REACHED_CUTOFF if ended else Status.COMPLETE
    status = status if is_possible[: end + 1].all() else Status.IMPOSSIBLE
    status = status if is_finite else Status.NOT_FINITE
    return Course(readings, is_valid, status, end)


def _pieces(model: Model, profile: Profile, size: int) -> Iterator[tuple[_Steps, int]]:
    """Give the steps of a run in pieces of one size, and how many they are without padding."""
    left, jumped_s = _Steps(np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=bool)), None
    for first in range(0, profile.time_s.size - 1, size):
        rows = slice(first, first + size + 1)
        part = Profile(profile.time_s[rows], {name: values[rows] for name, values in profile.inputs.items()})
        grid = grid_of(model, part, jumped_s)
        jumped_s, ends = grid.jumped_s, np.zeros(grid.row.size, dtype=bool)
        ends[grid.last_step] = True
        more = _Steps(grid.duration_s, first + grid.row, ends)
        left = _Steps(*(np.concatenate(columns) for columns in zip(left, more, strict=True)))
        whole = left.row.size // size * size
        for begin in range(0, whole, size):
            yield _Steps(*(column[begin : begin + size] for column in left)), size
        left = _Steps(*(column[whole:] for column in left))
    if count := left.row.size:
        more = (0, size - count)
        yield _Steps(np.pad(left.duration_s, more), np.pad(left.row, more, mode="edge"), np.pad(left.ends, more)), count


@eqx.filter_jit
def _begin(model: Model, inputs: Inputs) -> State:
    return jax.tree.map(lambda x: jnp.asarray(x, dtype=float), initial_state(model, inputs))


@eqx.filter_jit
def _below(model: Model, readings: dict[str, Array], cutoff: Cutoff) -> Array:
    """Return where (rows,) ideal readings (rows,) are below a cut-off."""
    return jax.vmap(lambda of_row: below(model, of_row, cutoff))(readings)


@eqx.filter_jit
def _piece(
    model: Model,
    begin: State,
    inputs: dict[str, Array],
    duration_s: Array,
    count: Array,
    delayed: tuple[str, ...],
) -> tuple[State, _Seen]:
    """Return the state after a piece, and what it shows; later steps than `count` have no effect."""

    def advance_one(state, given):
        return step(model, state, *given)

    later = {name: values[1:] for name, values in inputs.items()}
    after = states_after(advance_one, begin, (later, duration_s), count, one_kernel=True)
    states = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), begin, after)
    readings = jax.vmap(lambda s, u: read(model, s, u))(states, inputs)
    finite = jnp.stack([jnp.isfinite(values) for values in (*states.values(), *readings.values())])
    starts = within_steps(model, states, inputs)[0] if delayed else {}
    seen = _Seen(
        readings,
        {name: values for name, values in starts.items() if "" in delayed or name in delayed},
        jax.vmap(lambda s, u: valid(model, s, u))(states, inputs),
        jnp.all(finite, axis=0),
    )
    return jax.tree.map(lambda x: x[-1], states), seen


def _read_by_sensors(model: Model, name: str, ideal: np.ndarray, within: list[tuple[_Steps, _Seen]]) -> np.ndarray:
    """Return the readings (rows,) of a column by its sensors.

    Args:
        model: with effects on the column.
        name: of the column.
        ideal: (rows,) its true values.
        within: all pieces, if a sensor is late.
    """
    values = jnp.asarray(np.pad(ideal, (0, -ideal.size % FEW), mode="edge"))
    signal = None
    if within and name in within[0][1].starts:
        ends = np.flatnonzero(np.concatenate([steps.ends for steps, _ in within]))
        signal = Signal(
            jnp.asarray(np.concatenate([steps.duration_s for steps, _ in within])),
            jnp.asarray(np.concatenate([seen.starts[name] for _, seen in within])),
            jnp.asarray(np.concatenate([seen.readings[name][1:] for _, seen in within])),
            values,
            jnp.asarray(np.pad(np.append(0, ends + 1), (0, values.size - ends.size - 1), mode="edge")),
        )
    return np.array(_faulty(sensors_of(model), name, values, signal))[: ideal.size]
