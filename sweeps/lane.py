"""One lane of a sweep: a run of the model whose metrics are reduced while it advances."""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.model.electrothermal import Model, initial_state, read, step, valid
from jaxmodel.model.flow import State, with_rests
from jaxmodel.model.names import with_values
from jaxmodel.model.possible import possible
from jaxmodel.model.profile import Profile
from jaxmodel.model.robot import Inputs
from jaxmodel.model.simulation import Cutoff, Status, track
from jaxmodel.sweeps.metrics import End, Metric, Moment, Step
from jaxmodel.sweeps.power import powers
from jaxmodel.sweeps.sums import add, nothing


@dataclasses.dataclass(frozen=True)
class Keep:
    """What is kept of each lane: metrics, and the columns that are stored over time."""

    metrics: tuple[Metric, ...]
    columns: tuple[str, ...] = ()


class SteppedProfile(eqx.Module):
    """An input profile cut into integration steps, shared by all lanes; a lane's own values replace its inputs.

    Attributes:
        duration_s: of each step, shape (steps,).
        ends_row: True where a row of the profile ends with the step, shape (steps,).
        first: inputs of the first row that change later.
        later: the same inputs for each step, shape (steps,).
        steady: inputs that never change; as constants they cost nothing per step.
        stored: for each stored row, the step that ends there, counted from 1; 0 is the first row.
    """

    duration_s: Array
    ends_row: Array
    first: Inputs
    later: dict[str, Array]
    steady: Inputs
    stored: Array


class Outcome(eqx.Module):
    """The result of one lane.

    Attributes:
        values: by name of the metric; NaN where the run is not finite.
        columns: by name, at the stored rows.
        status: a `jaxmodel.model.simulation.Status`.
    """

    values: dict[str, Array]
    columns: dict[str, Array]
    status: Array


def lay_out(model: Model, profile: Profile, stored_rows: np.ndarray) -> SteppedProfile:
    """Cut a profile into integration steps for a model, whose leaves may carry lanes, and mark the rows to store."""
    steps = track(model, profile)
    last_step = np.asarray(steps.last_step)
    ends_row = np.zeros(steps.duration_s.shape[0], dtype=bool)
    ends_row[last_step] = True
    steady = {name: values[0] for name, values in steps.inputs.items() if np.ptp(np.asarray(values)) == 0.0}
    changing = {name: values for name, values in steps.inputs.items() if name not in steady}
    return SteppedProfile(
        duration_s=steps.duration_s,
        ends_row=jnp.asarray(ends_row),
        first={name: values[0] for name, values in changing.items()},
        later={name: values[1:] for name, values in changing.items()},
        steady=steady,
        stored=jnp.asarray(np.concatenate([[0], last_step + 1])[stored_rows]),
    )


def run_lane(
    keep: Keep, model: Model, stepped: SteppedProfile, cutoff: Cutoff | None, own: dict[str, Array]
) -> Outcome:
    """Run one lane: the model over the stepped profile, with the lane's own values.

    Of `own`, an input's name replaces it, `scale.INPUT` multiplies it, `initial.STATE` sets a state at the start, and
    any other name is a parameter.

    Pure; the physics and the meaning of the cut-off are those of `jaxmodel.model.simulation.run_track`.
    """
    held = {name: value for name, value in own.items() if name in stepped.steady or name in stepped.later}
    scales, initial = _after("scale.", own), _after("initial.", own)
    named = {name: value for name, value in own.items() if not name.startswith(("scale.", "initial."))}
    model = with_values(model, {name: value for name, value in named.items() if name not in held})
    held = stepped.steady | held

    def inputs_of(changing: Inputs) -> Inputs:
        inputs = changing | held
        return inputs | {name: inputs[name] * factor for name, factor in scales.items()}

    first_inputs = inputs_of(stepped.first)
    if "soc" in initial:  # effects that hold a charge of their own begin with it too
        model = with_values(model, {"initial_soc": initial["soc"]})
    start = initial_state(model, first_inputs) | initial
    asks_powers = any(metric.asks_powers for metric in keep.metrics)

    def moment(state: State, inputs: Inputs) -> Moment:
        spent = powers(model, state, inputs) if asks_powers else {}
        return Moment(inputs | read(model, state, inputs), valid(model, state, inputs), spent)

    first = moment(start, first_inputs)

    def arrived(carry: Any, held_over: Inputs, before: Moment, taken: Array, ends_row: Array) -> tuple[Any, Moment]:
        """Count the step that led to a state; return whether the run goes on from there, and its moment."""
        state, running, can_be, elapsed, carried = carry
        after = moment(state, held_over)
        report = Step(before, after, taken, ends_row)
        updated = tuple(metric.update(c, report) for metric, c in zip(keep.metrics, carried, strict=True))
        if cutoff is not None:
            updated = jax.tree.map(lambda new, old: jnp.where(running, new, old), updated, carried)
            running &= ~(ends_row & _below(model, after, cutoff))
        can_be &= possible(after.columns)
        return (state, running, can_be, add(elapsed, taken), updated), after

    # A step is counted at the start of the next one: what both evaluate at that state, under inputs that are the same,
    # is then evaluated once. The first round has no step to count.
    def advance_one(carry: Any, given: tuple[Any, Any, Array]) -> tuple[Any, dict[str, Array]]:
        (held_over, ends_row), (changing, duration), begun = given
        *now, before, taken = carry
        counted, after = arrived(tuple(now), inputs_of(held_over), before, taken, ends_row)
        state, running, can_be, elapsed, carried = jax.tree.map(
            lambda new, old: jnp.where(begun, new, old), counted, tuple(now)
        )
        inputs = inputs_of(changing)
        taken = duration if cutoff is None else jnp.where(running, duration, 0.0)
        before, state = moment(state, inputs), step(model, state, inputs, taken)
        return (state, running, can_be, elapsed, carried, before, taken), {
            name: after.columns[name] for name in keep.columns
        }

    carried = tuple(metric.init(first) for metric in keep.metrics)
    if jnp.zeros(()).dtype == jnp.float32:
        start = with_rests(start)
    can_be = jnp.asarray(possible(first.columns))
    begin = (start, jnp.asarray(True), can_be, nothing(), carried, first, jnp.zeros(()))
    over, last_over = _one_later(stepped.first, stepped.later), {n: values[-1] for n, values in stepped.later.items()}
    ends_row, last_ends = _one_later(jnp.asarray(False), stepped.ends_row), stepped.ends_row[-1]
    begun = jnp.arange(stepped.duration_s.shape[0]) > 0
    (*now, before, taken), kept = jax.lax.scan(
        advance_one, begin, ((over, ends_row), (stepped.later, stepped.duration_s), begun)
    )
    counted, last = arrived(tuple(now), inputs_of(last_over), before, taken, last_ends)
    state, running, can_be, (elapsed, *_), carried = counted
    # A number that is not finite stays so: the last state and its readings show whether any was.
    finite = jnp.all(jnp.stack([jnp.isfinite(value) for value in (*state.values(), *last.columns.values())]))
    # All lanes may share `elapsed`. Made a lane's own, a division by it is one: by a shared number it may also be
    # compiled as a product with the reciprocal, which one device and two do not agree on in the last bit.
    end = End(jnp.where(finite, elapsed, jnp.nan), ~running)
    values = {m.name: m.finish(c, end) for m, c in zip(keep.metrics, carried, strict=True)}
    # A sum of numbers that are finite may overflow; a number that is not there (no cut-off was reached) is no overflow.
    for value in values.values():
        finite &= ~jnp.any(jnp.isinf(value))
    values = {name: jnp.where(finite, value, jnp.nan) for name, value in values.items()}
    ended = jnp.where(running, Status.COMPLETE, Status.REACHED_CUTOFF)
    ended = jnp.where(can_be, ended, Status.IMPOSSIBLE)
    return Outcome(
        values=values,
        columns={n: jnp.append(values, last.columns[n])[stepped.stored] for n, values in kept.items()},
        status=jnp.where(finite, ended, Status.NOT_FINITE),
    )


def _one_later(first: Any, values: Any) -> Any:
    """Return what holds before each step, and not over it."""
    return jax.tree.map(lambda one, some: jnp.concatenate([one[None], some[:-1]]), first, values)


def _after(prefix: str, own: dict[str, Array]) -> dict[str, Array]:
    return {name.removeprefix(prefix): value for name, value in own.items() if name.startswith(prefix)}


def _below(model: Model, moment: Moment, cutoff: Cutoff) -> Array:
    """Return True below the cut-off; a motor has none."""
    columns = moment.columns
    if "soc" not in columns:
        return jnp.asarray(False)
    voltage = columns["voltage_V"] if model.kind == "cell" else columns["pack_voltage_V"] / model.parameters.n_series
    return (columns["soc"] < cutoff.soc) | (voltage < cutoff.voltage_V)
