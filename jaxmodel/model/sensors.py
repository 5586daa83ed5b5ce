"""From ideal readings to those of real sensors: offset, gain, lag and clock."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmodel.model.electrothermal import Model, read
from jaxmodel.model.flow import State
from jaxmodel.model.ports import Effect, fold
from jaxmodel.model.profile import Track


class Signal(eqx.Module):
    """The true trajectory of one reading over the steps of a run, for sensors with lag or delay.

    `rows` are its values at the rows of the profile. Within step j it goes from `start[j]` to `end[j]`; it jumps
    between steps where an input jumps.
    """

    duration_s: Array
    start: Array
    end: Array
    rows: Array
    at_rows: Array


def distort(
    model: Model, readings: dict[str, Array], states: State, track: Track, dynamic: Array | None = None
) -> dict[str, Array]:
    """Pass each reading, over its rows, through the sensor effects of its column; `states` are after every step.

    Each effect with state or delay is skipped if no lane has it: it takes as long as the run. `dynamic` says of each of
    them, in order, whether one has.
    """
    sensors = sensors_of(model)
    if not sensors:
        return readings
    if dynamic is None or not any(effect.has_state for effect in sensors):
        return _distort(sensors, None, model, readings, states, track)
    return _distort_if_needed(dynamic, model, readings, states, track)


def has_dynamic_sensors(model: Model) -> bool:
    """Return True if a sensor effect has state or delay, which needs the states of the whole run."""
    return any(effect.has_state for effect in sensors_of(model))


def sensors_of(model: Model) -> tuple[Effect, ...]:
    """Return the sensor effects of a model, in order."""
    return tuple(effect for effect in model.effects if hasattr(effect, "reading"))


@eqx.filter_custom_jvp
def _distort_if_needed(dynamic: Array, model: Model, *given) -> dict[str, Array]:
    sensors = sensors_of(model)
    static = tuple(effect for effect in sensors if not effect.has_state)
    return jax.lax.cond(
        jnp.any(dynamic),
        lambda: _distort(sensors, dynamic, model, *given),
        lambda: _distort(static, None, model, *given),
    )


@_distort_if_needed.def_jvp
def _distort_if_needed_jvp(primals, tangents):
    """Include all sensor effects: an effect that is off may have a derivative."""
    (_, model, *given), (_, *along) = primals, tangents
    return eqx.filter_jvp(
        lambda model, *given: _distort(sensors_of(model), None, model, *given), (model, *given), tuple(along)
    )


@eqx.filter_jit
def _distort(
    sensors: tuple[Effect, ...],
    dynamic: Array | None,
    model: Model,
    readings: dict[str, Array],
    states: State,
    track: Track,
) -> dict[str, Array]:
    signals = {}
    if any(effect.has_state for effect in sensors):
        starts, ends = within_steps(model, states, track.inputs)
        signals = {
            # At the end of a row the signal equals its reading exactly, so that a sensor without delay changes nothing.
            name: Signal(
                track.duration_s,
                starts[name],
                ends[name].at[track.last_step].set(values[1:], unique_indices=True),
                values,
                track.at_rows,
            )
            for name, values in readings.items()
        }
    return {name: faulty(sensors, name, values, signals.get(name), dynamic) for name, values in readings.items()}


def within_steps(model: Model, states: State, inputs: dict[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the ideal readings at the start and at the end of every step, (steps,), both under its own inputs.

    Args:
        model: any kind.
        states: (1 + steps,) at the start and after every step.
        inputs: (1 + steps,) of the first row and of every step.
    """
    before = {name: values[:-1] for name, values in states.items()}
    after = {name: values[1:] for name, values in states.items()}
    during = {name: values[1:] for name, values in inputs.items()}
    read_all = jax.vmap(lambda s, u: read(model, s, u))
    return read_all(before, during), read_all(after, during)


def faulty(
    sensors: tuple[Effect, ...], name: str, values: Array, signal: Signal | None, dynamic: Array | None = None
) -> Array:
    """Return the readings of a column, over its rows, after its sensor effects; they need `signal` if one has state."""
    with_state = [effect.label for effect in sensors if effect.has_state]
    for effect in sensors:
        if effect.column not in ("", name):
            continue
        if dynamic is None or not effect.has_state:
            values = fold((effect,), "reading", values, signal)
        else:
            needed = dynamic[with_state.index(effect.label)]
            values = jax.lax.cond(needed, lambda x, e=effect: fold((e,), "reading", x, signal), lambda x: x, values)
    return values


def lagged(signal: Signal, time_constant_s) -> Array:
    """Return the rows of a signal behind a first-order lag, exact for a signal that is straight within each step."""
    moving = signal.duration_s > 0.0
    span = jnp.where(moving, signal.duration_s, 1.0)
    tau = jnp.asarray(time_constant_s)
    decay = jnp.exp(-span / jnp.maximum(tau, 1e-3 * span))
    behind = (signal.end - signal.start) / span * tau

    def follow(value, given):
        start, end, late, kept, runs = given
        value = jnp.where(runs, end - late + (value - start + late) * kept, value)
        return value, value

    _, values = jax.lax.scan(follow, signal.rows[0], (signal.start, signal.end, behind, decay, moving))
    return jnp.concatenate([signal.rows[:1], values])[signal.at_rows]


def shifted(signal: Signal, delay_s) -> Array:
    """Return the rows of a signal that arrives late by `delay_s` (early where negative); its ends are held."""
    ends = jnp.cumsum(signal.duration_s)
    times = jnp.concatenate([jnp.zeros(1), ends])[signal.at_rows] - delay_s
    index = jnp.clip(jnp.searchsorted(ends, times, side="left"), 0, ends.shape[0] - 1)
    span = jnp.where(signal.duration_s[index] > 0.0, signal.duration_s[index], 1.0)
    before_end = jnp.clip((ends[index] - times) / span, 0.0, 1.0)
    values = signal.end[index] - (signal.end[index] - signal.start[index]) * before_end
    return jnp.where(times <= 0.0, signal.rows[0], values)


def shifted_rows(signal: Signal, delay_s) -> Array:
    """Return the rows of a signal, interpolated linearly between rows, `delay_s` later; its ends are held."""
    times = jnp.concatenate([jnp.zeros(1), jnp.cumsum(signal.duration_s)])[signal.at_rows]
    return jnp.interp(times - delay_s, times, signal.rows)
